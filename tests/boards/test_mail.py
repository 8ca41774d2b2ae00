"""Mail between three boards for real: what is lost, what comes twice, in which order, and what the judge can see."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.boards.fleet import Fleet
from tests.boards.network import Network
from tests.boards.numbered_mail import Post
from tests.boards.troubles import Trouble, plan
from tests.soak.mail import AGENTS, BOARDS, control, run
from tests.support.amount import some_of

RATE = 60.0
"""Messages a second of all together."""


def _post(each: int) -> Post:
    return Post(AGENTS, each, 1000 * len(AGENTS) * (len(AGENTS) - 1) / RATE)


@pytest.mark.parametrize("cut", ["unplug", "down", "part"])
def test_a_cut_link_heals_and_nothing_is_lost(network: Network, tmp_path: Path, cut: str) -> None:
    outcome = run(tmp_path, _post(20), [Trouble(2, cut, "pi2", 4)], 120)  # type: ignore[arg-type]
    assert outcome.verdict.clean, outcome.verdict.details
    assert (outcome.verdict.taken, outcome.waiting, outcome.dead) == (600, 0, 0)
    assert not outcome.complaints


def test_a_board_that_is_killed_wholly_returns_and_has_lost_nothing(network: Network, tmp_path: Path) -> None:
    troubles = [Trouble(2, "kill agentd", "pi3", 4), Trouble(2, "kill commd", "pi3", 3), Trouble(1.9, "down", "pi3", 3)]
    outcome = run(tmp_path, _post(20), troubles, 120)
    assert outcome.verdict.clean, outcome.verdict.details
    assert (outcome.verdict.taken, outcome.waiting, outcome.dead) == (600, 0, 0)
    assert not outcome.complaints


def test_kills_cuts_and_a_full_disk_lose_and_duplicate_nothing(network: Network, tmp_path: Path) -> None:
    """A cut of what `make soak` does with 100,000 messages."""
    post = _post(some_of(140, 2))
    troubles = plan(BOARDS, some_of(60, 2), kills=6, cuts=(3.0, 3.0), full=("pi3", 3.0), seed=4)
    outcome = run(tmp_path, post, troubles, 240)
    assert outcome.verdict.clean, outcome.verdict.details
    assert (outcome.verdict.taken, outcome.waiting, outcome.dead) == (post.total, 0, 0)
    assert not outcome.complaints
    assert not outcome.ended_by_themselves
    assert outcome.happened["kill agentd"] >= 2
    assert outcome.happened["kill commd"] >= 2


def test_the_judge_sees_that_agents_without_memory_repeat_themselves(network: Network) -> None:
    """`on_restart: fresh` gives the promise up; a judge that finds nothing then would find nothing ever."""
    _, outcome = control()
    assert not outcome.verdict.clean
    assert outcome.verdict.duplicated > 0, "what it sent before, it sends again"


_ONCE = """\
mission: once
boards: BOARDS
agents:
  ann: {program: ann.asl, board: pi1}
  bob: {program: bob.asl, board: pi2}
  cid: {program: cid.asl, board: pi3}
"""


def test_mail_waits_for_a_board_that_was_never_there_yet(fleet: Callable[..., Fleet]) -> None:
    team = fleet(
        _ONCE,
        ann="!go. +!go <- .send(bob, tell, hello); .broadcast(tell, all); .send(cid, askOne, what(X), A); +told(A).",
        bob="+hello[source(S)] <- .send(S, tell, heard).",
        cid="what(time).",
    )
    team.up("pi1")
    look = team.look("pi1")
    look.until(lambda look: sum(q["messages"] for q in look.boxes()["pi1"]["queues"]) == 4, "four messages wait")
    team.up("pi2")
    look.believes("ann", "heard[source(bob)]")
    assert "told(what(time)[source(self)])" not in " ".join(look.mind("ann") or ())
    team.up("pi3")
    look.until(lambda look: any(one.startswith("told(what(time)") for one in look.mind("ann") or ()), "cid's answer")
    for name, board in (("bob", "pi2"), ("cid", "pi3")):
        team.look(board).believes(name, "all[source(ann)]")
    look.until(lambda look: not any(box["queues"] for box in look.boxes().values() if "queues" in box), "all is empty")
