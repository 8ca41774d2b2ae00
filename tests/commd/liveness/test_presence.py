"""When an agent counts as gone: courses of tokens, routers and words in virtual time, no bus.

A line of a course is what happens at a moment: `20 uav -b1` a token of a life that goes (`+` comes), `20 pi2 -b1` that
of a board's commd, `20 router -` our own router, `20 lost uav` who is lost then.
"""

import math

import pytest

from commd.liveness.presence import CATCH_UP, Presence, Silence
from schemas.liveness import AGENT_GRACE, BUS_GRACE, FIRST_HEALTH, ROUTER_GRACE, SILENT_AFTER

HOMES = {"uav": "pi2", "other": "pi1"}


def alone() -> Presence:
    """Two agents may come, and one has."""
    presence = Presence(["uav", "other"])
    presence.token("uav", "b1", True, 10.0)
    return presence


def fleet() -> Presence:
    """All agents, with the boards that they live on: pi1 is ours."""
    presence = Presence(None, HOMES.get)
    for board in ("pi1", "pi2"):
        presence.board(board, "b1", True, 10.0)
    for agent in HOMES:
        presence.token(agent, "b1", True, 10.0)
    return presence


def play(presence: Presence, course: str) -> None:
    for line in filter(None, map(str.strip, course.splitlines())):
        moment, what, *rest = line.split()
        now = sum(map(float, moment.split("+")))
        change = rest[0] if rest else ""
        match what:
            case "lost":
                assert set(presence.lost(now)) == set(rest), line
            case "expect":
                presence.expect(change, now)
            case "router":
                presence.router(change == "+", now)
            case "pi1" | "pi2":
                presence.board(what, change[1:], change[0] == "+", now)
            case _:
                presence.token(what, change[1:], change[0] == "+", now)


G, R, B = AGENT_GRACE, ROUTER_GRACE, BUS_GRACE
ALONE = {
    "a missing token counts after a grace through a live router": f"20 uav -b1\n {20 + G / 2} lost\n 20+{G} lost uav",
    "an agent that is restarted within the grace was never lost": "20 uav -b1\n 20.3 uav +b2\n 30 lost",
    "the old life going after the new one came is no loss": "20 uav +b2\n 22 uav -b1\n 30 lost",
    "an agent that had the robot before the bridge restarted is lost if it does not come": (
        f"20 expect other\n {20 + R - 0.1} lost\n 20+{R} lost other"  # on a busy board a daemon takes time to reconnect
    ),
    "an agent that is expected and comes is lost like any other when it goes": (
        f"20 expect other\n 21 other +b1\n 30 lost\n 30 other -b1\n 30+{G} lost other"
    ),
    "a router that restarts takes no agent with it": (
        f"20 router -\n 20 uav -b1\n {20 + B - 0.1} lost\n 23 router +\n 23.2 lost\n 23.3 uav +b1\n 40 lost"
    ),
    "an agent that does not come back with the router is lost": (
        f"20 router -\n 20 uav -b1\n 23 router +\n {23 + R - 0.1} lost\n 23+{R} lost uav"
    ),
    "without a router for long nobody could tell the robot anything": f"20 router -\n 20+{B} lost uav",
}
FLEET = {
    "an agent that goes just before its boards commd has time to come back": (
        f"19.9 pi2 -b1\n 20 uav -b1\n {20 + R - 0.1} lost\n 20+{R} lost uav"
    ),
    "an agent that goes just after its boards commd has time to come back": (
        f"20 uav -b1\n 20.1 pi2 -b1\n {20 + R - 0.1} lost\n 20+{R} lost uav"
    ),
    "a router of another board that restarts takes no agent with it, its agents reconnect each at its own pace": (
        f"20 pi2 -b1\n 20 uav -b1\n 23 pi2 +b2\n {23 + R - 0.1} lost\n 27 uav +b1\n 60 lost"
    ),
    "an agent that does not come back with its boards router is lost": (
        f"20 pi2 -b1\n 20 uav -b1\n 23 pi2 +b2\n 23+{R} lost uav"
    ),
    "an agent that dies on a board that stays is lost after the short grace": (
        f"20 pi2 -b1\n 21 pi2 +b2\n 40 uav -b1\n 40+{G} lost uav"
    ),
    "another boards router says nothing of the agents here": f"20 pi2 -b1\n 20 other -b1\n 20+{G} lost other",
    "who is lost stays lost until it comes whatever the routers do": (
        "20 pi2 -b1\n 20 uav -b1\n 30 lost uav\n 31 pi2 +b2\n 31.5 lost uav\n"
        "40 router -\n 41 router +\n 41.5 lost uav\n 42 uav +b2\n 42 lost"
    ),
    "whose token never went is there again with the router": (
        f"20 router -\n 20+{B} lost uav other\n 30 router +\n 30 lost"
    ),
}


@pytest.mark.parametrize("course", ALONE.values(), ids=ALONE)
def test_of_the_agents_of_a_robot(course: str) -> None:
    play(alone(), course)


@pytest.mark.parametrize("course", FLEET.values(), ids=FLEET)
def test_of_agents_on_boards(course: str) -> None:
    play(fleet(), course)


def test_who_is_lost_is_told_with_the_reason() -> None:
    assert Presence(["uav"]).lost(1000.0) == {}, "an agent that never came cannot be lost"
    for course, reason in (
        ("20 uav -b1", "no liveliness token"),
        ("20 router -", "no router for 5 s"),
        ("20 uav -b1\n 20 uav +b2\n 20 expect uav", "it has not come back since the bridge restarted"),
    ):
        presence = Presence(["uav"]) if "expect" in course else alone()
        play(presence, course.rpartition("\n")[2])
        assert presence.lost(25.0) == {"uav": reason}


def test_only_while_nobody_is_missing_nothing_need_be_looked_at() -> None:
    assert not Presence(["uav"]).complete, "a robot that nobody came for"
    presence = alone()
    for course, complete in (
        ("11 uav +b1", True),
        ("20 uav -b1", False),
        ("20.3 uav +b2", True),
        ("21 router -", False),
        ("22 router +", True),
        ("23 expect other", False),
        ("24 other +b1", True),
    ):
        play(presence, course)
        assert presence.complete == complete, course


def test_who_came_is_known_until_it_ends_for_good() -> None:
    presence = fleet()
    play(presence, "20 uav -b1")
    assert presence.known() == {"uav", "other"}
    presence.forget("uav")
    assert presence.lost(60.0) == {}
    assert presence.known() == {"other"}


def test_it_is_known_when_the_next_agent_will_be_lost() -> None:
    presence = fleet()
    for course, due in (
        ("", math.inf),
        ("20 uav -b1", 20 + G),
        ("20.5 pi2 -b1", 20 + R),
        ("22 pi2 +b2", 22 + R),
        (f"22+{R} lost uav", math.inf),
        ("40 router -", 40 + B),
        (f"40+{B} lost uav other", math.inf),
    ):
        play(presence, course)
        assert presence.due == due, course


def test_a_thousand_agents_that_go_one_after_the_other_are_lost_each_in_its_turn() -> None:
    presence = Presence(None, lambda _: "pi1")
    presence.board("pi1", "b1", True, 0.0)
    for number in range(1000):
        presence.token(f"a{number}", "b1", True, 1.0)
        presence.token(f"a{number}", "b1", False, 10.0 + number)
    assert len(presence.lost(500.0 + AGENT_GRACE)) == 491
    assert presence.due == 501.0 + AGENT_GRACE


def listen(silence: Silence, course: str) -> None:
    """Play a course: `14 +b2` a token, `20.2 b1` a word, `20 excuse`; `10-60 silent at 20` looks twice a second."""
    for line in filter(None, map(str.strip, course.splitlines())):
        moment, what, *rest = line.split()
        begin, _, end = moment.partition("-")
        now = float(begin)
        match what:
            case "silent":
                found, wall = None, now
                while wall <= float(end or begin):
                    found = wall if silence.silent(wall) and found is None else found
                    wall += 0.5
                assert found == (float(rest[1]) if rest else None), line
            case "excuse":
                silence.excuse(now, SILENT_AFTER)
            case _ if what[0] in "+-":
                silence.token("uav", what[1:], what[0] == "+", now)
            case _:
                silence.word("uav", what, now)


WORDS = {
    "who speaks once a second is not silent": "".join(
        f"{at}-{at + 0.5} silent\n {at + 1} b1\n" for at in range(10, 60)
    ),
    "who says nothing any more is silent after the patience": f"10-30 silent at {10 + SILENT_AFTER}",
    "who speaks again is not silent any more": f"10-20 silent at {10 + SILENT_AFTER}\n 20.2 b1\n 20.5 silent",
    "who has no token is not judged": "11 -b1\n 12 b1\n 10-60 silent",
    "a new life speaks for the old one whose token is still there": (
        f"14 +b2\n 14-60 silent at {14 + FIRST_HEALTH}\n 60 b2\n 60.5 silent"
    ),
    "after a pause of our own others have time to be heard": f"10-12 silent\n 40-60 silent at {40 + CATCH_UP}",
    "a pause of our own excuses nobody for longer than that": f"10-11 silent\n 13-60 silent at {10 + SILENT_AFTER}",
    "after the router was away words have time to come": f"14 excuse\n 14-60 silent at {14 + SILENT_AFTER}",
    "who hangs and then dies was not back between, until another life of it is there": (
        f"10-20 silent at {10 + SILENT_AFTER}\n 20 -b1\n 20.5 silent at 20.5\n 22 +b2\n 22.5 silent"
    ),
    "who hangs hangs on when its token is told again": (
        f"10-20 silent at {10 + SILENT_AFTER}\n 20 excuse\n 20 +b1\n 20.5 silent at 20.5\n 21 b1\n 21.5 silent"
    ),
    "who has spoken has no first word to say when its token comes again": (
        f"11 -b1\n 12 +b1\n 12-60 silent at {12 + SILENT_AFTER}"
    ),
}


@pytest.mark.parametrize("course", WORDS.values(), ids=WORDS)
def test_of_an_agent_that_has_spoken(course: str) -> None:
    silence = Silence()
    listen(silence, "9 +b1\n 10 b1")
    listen(silence, course)


@pytest.mark.parametrize("patience", [SILENT_AFTER, FIRST_HEALTH + 10])
def test_the_first_word_may_take_longer_and_as_long_as_any(patience: float) -> None:
    listen(Silence(patience), f"0 +b1\n 0-60 silent at {max(FIRST_HEALTH, patience)}")
