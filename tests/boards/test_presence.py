"""Who is there, seen from every board: a cut, a kill and a router that comes back are told apart."""

from __future__ import annotations

import time
from collections.abc import Callable

from tests.boards.fleet import Fleet

_MISSION = """\
mission: presence
boards: BOARDS
agents:
  ann: {program: watcher.asl, board: pi1, presence: true}
  bob: {program: watcher.asl, board: pi2, presence: true}
  cid: {program: watcher.asl, board: pi3, presence: true}
"""
_WATCHER = """\
+online(A) <- .print("hello ", A).
-online(A) <- .print("gone ", A).
"""
OTHERS = {"ann": ("bob", "cid"), "bob": ("ann", "cid"), "cid": ("ann", "bob")}
BOARD = {"ann": "pi1", "bob": "pi2", "cid": "pi3"}


def _all_see_all(team: Fleet) -> None:
    for name, others in OTHERS.items():
        for other in others:
            team.look(BOARD[name]).believes(name, f"online({other})")


def _gone(team: Fleet, name: str) -> list[str]:
    return [line.partition("gone ")[2] for line in team.text(BOARD[name], "agentd").splitlines() if "] gone " in line]


def test_agents_see_one_another_and_the_boards_that_they_are_on(fleet: Callable[..., Fleet]) -> None:
    team = fleet(_MISSION, watcher=_WATCHER)
    team.up()
    _all_see_all(team)
    beliefs = team.look("pi1").mind("ann") or []
    assert any(one.startswith("online(bob)[") and "board(pi2)" in one for one in beliefs), beliefs


def test_a_killed_agent_is_gone_for_all_others_and_seen_again_when_it_is_back(fleet: Callable[..., Fleet]) -> None:
    team = fleet(_MISSION, watcher=_WATCHER)
    team.up()
    _all_see_all(team)
    team.kill("pi3", "agentd")
    for name in ("ann", "bob"):
        team.running[BOARD[name], "agentd"].says("gone cid")
        assert _gone(team, name) == ["cid"]
    team.start("pi3", "agentd")
    _all_see_all(team)


def test_a_router_that_comes_back_at_once_is_nobodys_death(fleet: Callable[..., Fleet]) -> None:
    team = fleet(_MISSION, watcher=_WATCHER)
    team.up()
    _all_see_all(team)
    team.kill("pi2", "commd")
    time.sleep(1.0)
    team.start("pi2", "commd")
    team.ready("pi2", "commd")
    team.running["pi2", "agentd"].says("router lost")
    team.look("pi1").until(lambda look: "bob/agentd" in look.alive(), "bob's token is back")
    time.sleep(7.0)  # longer than any patience of those who judge
    assert [_gone(team, name) for name in OTHERS] == [[], [], []]
    _all_see_all(team)


def test_boards_behind_a_cut_are_gone_and_come_back_when_it_heals(fleet: Callable[..., Fleet]) -> None:
    team = fleet(_MISSION, watcher=_WATCHER)
    team.up()
    _all_see_all(team)
    team.network.unplug("pi1")
    team.running["pi1", "agentd"].until(lambda text: "gone bob" in text and "gone cid" in text, "all are gone")
    team.running["pi2", "agentd"].says("gone ann")
    assert _gone(team, "bob") == ["ann"], "cid is as near as before"
    team.network.plug("pi1")
    _all_see_all(team)
