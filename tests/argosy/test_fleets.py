"""Fleets of several boards under `argosy run`: the real daemons, killed and started again."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import psutil
import pytest

from tests.argosy.conftest import Running, Start

RING = """\
mission: ring
boards: {pi1: {}, pi2: {address: 10.0.0.12}}
agents:
  one: {program: talk.asl, board: pi1, beliefs: ["next(two)"]}
  two: {program: talk.asl, board: pi2, beliefs: ["next(one)"]}
done: ["one: heard(20)", "two: heard(20)"]
timeout: 2min
"""
TALK = """\
!say(1).
+restarted(_) : said(N) <- !say(N + 1).
+restarted(_) <- !say(1).
+!say(N) : N <= 20 & next(Other)
  <- .send(Other, tell, heard(N)); -+said(N); .wait(300); !say(N + 1).
+!say(_).
+heard(N) <- .print("heard ", N).
"""
"""Each tells the other twenty things, and goes on where it was."""


@pytest.fixture
def ring(tmp_path: Path) -> Path:
    """Return a mission of two agents on two boards that tell each other things."""
    (tmp_path / "talk.asl").write_text(TALK)
    path = tmp_path / "ring.yaml"
    path.write_text(RING)
    return path


def pid(running: Running, name: str) -> int:
    """Return the process id that the run has told last for a process."""
    return int(re.findall(rf" {re.escape(name)}: (?:re)?started, pid (\d+)", running.stdout)[-1])


def kill(running: Running, name: str, number: signal.Signals = signal.SIGKILL) -> None:
    """Send a signal to a process of a run by its name."""
    psutil.Process(pid(running, name)).send_signal(number)


def ended(running: Running, seconds: float = 180) -> tuple[int, str]:
    """Wait for the end. Returns exit code and stdout; nothing may be left running."""
    code = running.wait(seconds)
    assert running.left_running() == []
    return code, running.stdout


def test_daemons_of_any_board_that_are_killed_are_started_again_and_no_message_is_lost(
    start: Start, ring: Path
) -> None:
    running = start(ring, "--restart", real_daemons=True)
    running.until("one: heard 2")
    routers = [line for line in running.family if "commd serve" in line and " --board " in line]
    endpoints = [re.findall(r"--(?:router|listen) (\S+)", line) for line in routers]
    assert len({endpoint for pair in endpoints for endpoint in pair}) == 4, "each board has its own router"
    for name in ("agentd pi2", "commd pi2", "commd pi1", "agentd pi1"):
        kill(running, name)
        running.until(f"{name}: up again", 120)
    running.until("argosy: done", 120)
    running.process.send_signal(signal.SIGINT)
    code, out = ended(running)
    assert code == 0, out
    assert "restarts   agentd pi2 1, commd pi2 1, commd pi1 1, agentd pi1 1" in out
    for agent in ("one", "two"):
        heard = [int(number) for number in re.findall(rf" {agent}: heard (\d+)", out)]
        assert sorted(set(heard)) == list(range(1, 21)), (agent, heard)
