"""Which daemons count as hung, and what becomes of them."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from argosy.processes.process_table import Kind, Process
from argosy.processes.supervisor import Child, Supervisor
from argosy.run import recovery
from argosy.run.recovery import Watchdog
from schemas.wire import keys
from tests.argosy.given import given
from tests.argosy.recorded import Recording


class Looking:
    """Processes that sleep and pass for the daemons of a run, and the watchdog that looks at them."""

    def __init__(self) -> None:
        self.recording = Recording(speed=1.0)
        self.supervisor = Supervisor(lambda child, line: None, lambda child: None)
        self.recording.status.children = self.supervisor.children
        self.watchdog = Watchdog(self.recording.status)

    async def start(self, kind: str, subject: str, *, daemon: bool = True) -> Child:
        """Start a sleeper as a daemon of the board `local`."""
        of = Kind(kind, lambda setup: [], lambda setup, subject: [], daemon=daemon)
        argv = (sys.executable, "-S", "-c", "import time; time.sleep(600)")
        return await self.supervisor.start(Process(of, subject, argv, label=subject, board="local"))

    def token(self, name: str, daemon: str) -> None:
        """A daemon shows itself."""
        self.recording.model.token(keys.alive("single-uav", name, daemon, "1"), True)

    async def until(self, condition: Callable[[], bool]) -> None:
        """Look again and again until something holds."""
        while not condition():
            self.watchdog.look()
            await asyncio.sleep(0.01)

    async def looked(self, times: int = 40) -> None:
        """Look so often."""
        for _ in range(times):
            self.watchdog.look()
            await asyncio.sleep(0.01)


@asynccontextmanager
async def looking() -> AsyncIterator[Looking]:
    """A watchdog and processes that end with the block."""
    one = Looking()
    try:
        yield one
    finally:
        await one.supervisor.close()


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nobody have much patience."""
    monkeypatch.setattr(recovery, "HUNG_AFTER", 0.2)
    monkeypatch.setattr(recovery, "FIRST_HEALTH", 0.0)


@given(looking)
async def test_a_daemon_that_is_stopped_is_killed_and_told_of(one: Looking) -> None:
    child = await one.start("agentd", "uav")
    one.recording.health("uav", "agentd")
    child.signal(signal.SIGSTOP)
    await one.until(lambda: not child.alive)
    assert "agentd uav: hangs: it is stopped for 0.2 s, and is killed" in one.recording.lines


@given(looking)
async def test_a_daemon_of_which_nothing_is_heard_although_its_board_is_heard_is_killed(one: Looking) -> None:
    one.token("local", "commd")
    one.recording.health("uav1", "bridged")
    bridge, agent = await one.start("bridged", "uav1"), await one.start("agentd", "uav")
    await one.until(lambda: not agent.alive)
    assert bridge.alive
    assert one.recording.lines[-1] == "agentd uav: hangs: it publishes nothing for 0.2 s, and is killed"
    one.recording.at = 10.0
    await one.until(lambda: not bridge.alive)


@given(looking)
async def test_a_daemon_that_is_heard_for_one_of_its_agents_is_well(one: Looking) -> None:
    one.token("local", "commd")
    one.recording.health("uav", "agentd")
    agents = await one.start("agentd", "uav killed_by_its_program")
    await one.looked()
    assert agents.alive


@given(looking)
async def test_nobody_is_judged_while_the_way_to_its_board_is_cut(one: Looking) -> None:
    agent = await one.start("agentd", "uav")
    await one.looked()  # commd of its board is not heard
    one.token("local", "commd")
    one.recording.model.router(up=False)
    await one.looked()
    assert agent.alive


@given(looking)
async def test_a_daemon_that_comes_up_has_time(one: Looking, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recovery, "FIRST_HEALTH", 600.0)
    one.token("local", "commd")
    agent = await one.start("agentd", "uav")
    await one.looked()
    assert agent.alive


@given(looking)
async def test_the_first_boards_router_is_killed_when_it_does_not_answer(one: Looking) -> None:
    router = await one.start("commd", "local")
    await one.looked()
    assert router.alive
    one.recording.model.router(up=False)
    await one.until(lambda: not router.alive)


@given(looking)
async def test_a_simulator_may_be_stopped(one: Looking) -> None:
    simulator = await one.start("simulator", "uav1", daemon=False)
    simulator.signal(signal.SIGSTOP)
    await one.looked()
    assert simulator.alive


@given(looking)
async def test_a_daemon_that_only_paused_is_spared(one: Looking, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recovery, "HUNG_AFTER", 600.0)
    daemon = await one.start("agentd", "uav")
    os.kill(daemon.pid, signal.SIGSTOP)
    await one.until(lambda: daemon.stopped)
    os.kill(daemon.pid, signal.SIGCONT)
    await one.until(lambda: not daemon.stopped)
    monkeypatch.setattr(recovery, "HUNG_AFTER", 0.0)
    await one.looked()
    assert daemon.alive
