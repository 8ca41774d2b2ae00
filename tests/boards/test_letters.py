"""The judge of the letters sees what is lost, what comes twice and what comes late; troubles are as they were asked."""

from __future__ import annotations

from tests.boards.letters import Post, judge
from tests.boards.troubles import SAME_DAEMON, plan

POST = Post({"a": "pi1", "b": "pi2"}, each=10, pause=1)
CLEAN = {
    "a": ["next(b,11)[source(self)]", "expected(b,11)[source(self)]"],
    "b": ["next(a,11)[source(self)]", "expected(a,11)[source(self)]"],
}


def test_all_that_came_once_and_in_order_is_clean() -> None:
    verdict = judge(POST, CLEAN)
    assert verdict.clean
    assert (verdict.sent, verdict.taken) == (20, 20)


def test_what_was_not_taken_is_lost() -> None:
    verdict = judge(POST, CLEAN | {"b": ["next(a,11)", "expected(a,9)[source(self)]"]})
    assert (verdict.lost, verdict.duplicated, verdict.disordered) == (2, 0, 0)
    verdict = judge(POST, CLEAN | {"b": ["next(a,11)", "expected(a,11)", "gap(a,4,6)[source(self)]"]})
    assert (verdict.lost, verdict.duplicated, verdict.disordered) == (2, 0, 0)


def test_what_comes_again_is_duplicated_unless_it_was_missing() -> None:
    verdict = judge(POST, CLEAN | {"b": ["next(a,11)", "expected(a, 11)", "again(a,4)[source(self)]"]})
    assert (verdict.lost, verdict.duplicated, verdict.disordered) == (0, 1, 0)
    verdict = judge(POST, CLEAN | {"b": ["next(a,11)", "expected(a,11)", "gap(a,4,6)", "again(a,4)", "again(a,5)"]})
    assert (verdict.lost, verdict.duplicated, verdict.disordered) == (0, 0, 2)


def test_a_sender_that_sent_less_than_came_has_duplicated() -> None:
    """A sender that forgot what it had sent numbers anew; what the receiver has beyond that came of another life."""
    verdict = judge(POST, CLEAN | {"a": ["next(b,6)", "expected(b,11)"]})
    assert not verdict.clean


def test_troubles_follow_from_their_seed_and_are_as_many_as_asked() -> None:
    boards = ("pi1", "pi2", "pi3")
    made = plan(boards, 600, kills=30, cuts=(5.0, 60.0), full=("pi3", 20.0), seed=1)
    assert made == plan(boards, 600, kills=30, cuts=(5.0, 60.0), full=("pi3", 20.0), seed=1)
    assert made != plan(boards, 600, kills=30, cuts=(5.0, 60.0), full=("pi3", 20.0), seed=2)
    kills = [trouble for trouble in made if trouble.what.startswith("kill")]
    assert len(kills) == 30
    assert sorted(trouble.seconds for trouble in made if trouble not in kills) == [5.0, 20.0, 60.0]
    for one in kills:
        others = [other.at for other in kills if (other.what, other.board) == (one.what, one.board) and other != one]
        assert all(abs(one.at - other) > SAME_DAEMON for other in others), "each kill hits a living daemon"
