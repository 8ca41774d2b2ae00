"""Who is there, seen from every board: a cut, a kill and a router that comes back are told apart."""

import time
from collections.abc import Iterator

import pytest

from tests.boards.conftest import BOARDS, fleet_of
from tests.boards.fleet import Fleet
from tests.boards.network import Network

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


class Presence:
    """A team that sees itself whole, and who has gone since then in the eyes of each."""

    def __init__(self, team: Fleet) -> None:
        self.team = team
        self._before = {name: len(self._all_gone(name)) for name in OTHERS}

    def all_see_all(self) -> None:
        """Wait until everybody believes that all others are there."""
        for name, others in OTHERS.items():
            for other in others:
                self.team.look(BOARD[name]).believes(name, f"online({other})")

    def gone(self, name: str) -> list[str]:
        """Who has gone in the eyes of somebody."""
        return self._all_gone(name)[self._before[name] :]

    def until_gone(self, name: str, *others: str) -> None:
        """Wait until these, and nobody else, have gone in the eyes of somebody."""
        agentd = self.team.running[BOARD[name], "agentd"]
        agentd.until(lambda _: len(self.gone(name)) >= len(others), f"{others} are gone for {name}")
        assert sorted(self.gone(name)) == sorted(others)

    def _all_gone(self, name: str) -> list[str]:
        lines = self.team.text(BOARD[name], "agentd").splitlines()
        return [line.partition("gone ")[2] for line in lines if "] gone " in line]


@pytest.fixture(scope="module")
def team(namespaces: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    folder = tmp_path_factory.mktemp("presence")
    with Network(BOARDS) as network, fleet_of(network, folder, _MISSION, watcher=_WATCHER) as made:
        made.up()
        yield made
        print(made.transcript())


@pytest.fixture
def presence(team: Fleet) -> Iterator[Presence]:
    """The team, in which all see all before and after the test."""
    seen = Presence(team)
    seen.all_see_all()
    yield seen
    seen.all_see_all()


def test_agents_see_one_another_and_the_boards_that_they_are_on(presence: Presence) -> None:
    beliefs = presence.team.look("pi1").mind("ann") or []
    assert any(one.startswith("online(bob)[") and "board(pi2)" in one for one in beliefs), beliefs


def test_a_killed_agent_is_gone_for_all_others_and_seen_again_when_it_is_back(presence: Presence) -> None:
    presence.team.kill("pi3", "agentd")
    for name in ("ann", "bob"):
        presence.until_gone(name, "cid")
    presence.team.start("pi3", "agentd")


def test_a_router_that_comes_back_at_once_is_nobodys_death(presence: Presence) -> None:
    team = presence.team
    team.kill("pi2", "commd")
    time.sleep(1.0)
    team.start("pi2", "commd")
    team.ready("pi2", "commd")
    team.running["pi2", "agentd"].says("router lost")
    team.look("pi1").until(lambda look: "bob/agentd" in look.alive(), "bob's token is back")
    time.sleep(7.0)  # longer than any patience of those who judge
    assert [presence.gone(name) for name in OTHERS] == [[], [], []]


def test_boards_behind_a_cut_are_gone_and_come_back_when_it_heals(presence: Presence) -> None:
    presence.team.network.unplug("pi1")
    presence.until_gone("ann", "bob", "cid")
    presence.until_gone("bob", "ann")  # cid is as near as before
    presence.team.network.plug("pi1")
