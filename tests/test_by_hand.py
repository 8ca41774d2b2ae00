"""The daemons of the first mission started by hand, as on a board, and what happens when one of them dies."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.processes import ROOT, Daemon, running
from tests.support.promises import kept

SPEED = "5"


class Board:
    """The four processes of the mission, each to be started and killed on its own."""

    def __init__(self, stack: contextlib.ExitStack, mission: Path, endpoint: str, link: str, state: Path) -> None:
        self._stack, self._mission, self._endpoint = stack, str(mission), endpoint
        self._link, self._state = link, str(state)

    def _start(self, *arguments: str) -> Daemon:
        return self._stack.enter_context(running(*arguments))

    def _serve(self, daemon: str, *names: str, speed: bool = True) -> Daemon:
        options = ["--router", self._endpoint, *(["--speed", SPEED] if speed else [])]
        return self._start(daemon, "serve", self._mission, *names, *options)

    def commd(self) -> Daemon:
        return self._serve("commd", speed=False)

    def bridged(self) -> Daemon:
        return self._serve("bridged", "uav1", "--state", self._state)

    def agentd(self) -> Daemon:
        return self._serve("agentd", "uav")

    def copter(self) -> Daemon:
        return self._start("bridged", "simulate", "copter", "--link", self._link, "--speed", SPEED)


@pytest.fixture
def board(tmp_path: Path, endpoint: str, free_port: Callable[[], int]) -> Iterator[Board]:
    port = free_port()
    text = (ROOT / "missions" / "single_uav.yaml").read_text().replace(":14550", f":{port}")
    mission = tmp_path / "single_uav.yaml"
    mission.write_text(text)
    (tmp_path / "single_uav").mkdir()
    (tmp_path / "single_uav" / "uav.asl").write_text((ROOT / "missions" / "single_uav" / "uav.asl").read_text())
    with contextlib.ExitStack() as stack:
        yield Board(stack, mission, endpoint, f"udpout:127.0.0.1:{port}", tmp_path / "state")


def test_a_router_killed_in_flight_and_back_within_3_s_costs_nothing(board: Board) -> None:
    commd, copter, bridged, agentd = board.commd(), board.copter(), board.bridged(), board.agentd()
    agentd.says("[uav] flying to")
    commd.kill()
    for daemon in (bridged, agentd):
        daemon.says("router lost")
    again = board.commd()
    again.says("router board=local")
    agentd.says("action=goto")
    goto = next(line for line in agentd.lines if "action=goto" in line)
    assert "state=succeeded" in goto
    agentd.says("[uav] mission done", 120)
    assert "bridge_lost" not in agentd.text
    assert "is lost" not in bridged.text
    assert copter.process.poll() is None
    assert not re.search("Traceback|defect", agentd.text + bridged.text + again.text)


def test_a_bridge_killed_in_flight_fails_the_action_and_takes_its_percepts_along(board: Board) -> None:
    board.commd()
    board.copter()
    bridged, agentd = board.bridged(), board.agentd()
    agentd.says("[uav] flying to")
    bridged.kill()
    agentd.says("action=goto")
    goto = next(line for line in agentd.lines if "action=goto" in line)
    assert "state=failed bridge_lost: the bridge of this robot is not running" in goto, (
        "known by its token, not by grace"
    )
    agentd.says("[uav] mission failed: bridge_lost")


def test_a_bridge_that_is_started_again_serves_the_agent_that_goes_on(board: Board) -> None:
    board.commd()
    board.copter()
    bridged, agentd = board.bridged(), board.agentd()
    agentd.says("[uav] flying to")
    bridged.kill()
    agentd.says("bridge_lost robot=uav1")
    board.bridged().says("serving uav1")
    agentd.until(lambda text: text.count("bridge_up robot=uav1") == 2, "the agent sees the bridge's second life")


def test_an_agent_that_is_started_again_perceives_everything_within_a_second(board: Board, endpoint: str) -> None:
    board.commd()
    board.copter()
    board.bridged()
    first = board.agentd()
    first.says("[uav] flying to")
    first.signal(signal.SIGKILL)
    first.ends(10)
    names = ("state(", "altitude(", "global_pos(", "home_pos(", "battery(", "gps(", "bridge(up)")

    def knowing() -> float:
        again = board.agentd()
        again.says("agents=uav")
        started = time.monotonic()
        while time.monotonic() - started < 60:
            took, beliefs = time.monotonic() - started, _beliefs(endpoint)
            if all(any(belief.startswith(name) for belief in beliefs) for name in names):
                break
        again.kill()
        return took

    assert kept(knowing, 1.0)


def _beliefs(endpoint: str) -> list[str]:
    """Ask the agent's mind as an observer does."""
    script = (
        "import sys, zenoh, msgspec\n"
        "from commd.bus.session import session_config\n"
        "with zenoh.open(session_config('client', sys.argv[1], 'test')) as session:\n"
        "    for reply in session.get('argosy/single-uav/uav/mind', timeout=60):\n"
        "        print('\\n'.join(msgspec.json.decode(reply.ok.payload.to_bytes())['beliefs']))\n"
    )
    return subprocess.run(
        [sys.executable, "-c", script, endpoint], capture_output=True, text=True, timeout=120, check=True, cwd=ROOT
    ).stdout.splitlines()
