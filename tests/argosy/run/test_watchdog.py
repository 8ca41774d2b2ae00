"""Which daemons count as hung, and what becomes of them."""

import os
import signal
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest

from argosy.processes.process_table import Kind, Process
from argosy.processes.supervisor import Child, Supervisor
from argosy.run import recovery
from argosy.run.recovery import Watchdog
from schemas.liveness import FIRST_HEALTH, HUNG_AFTER
from schemas.wire import keys
from tests.argosy.recorded import Recording
from tests.support.buses import until


class Looking:
    """Processes that sleep and pass for the daemons of a run, and the watchdog that looks at them."""

    def __init__(self) -> None:
        self.recording = Recording(speed=1.0)
        self.supervisor = Supervisor(lambda child, line: None, lambda child: None)
        self.recording.status.children = self.supervisor.children
        self.watchdog = Watchdog(self.recording.status)
        self.now = time.monotonic()
        """Of the watchdog's clock."""

    async def start(self, kind: str, subject: str, *, daemon: bool = True) -> Child:
        """Start a sleeper as a daemon of the board `local`."""
        of = Kind(kind, lambda setup: [], lambda setup, subject: [], daemon=daemon)
        argv = (sys.executable, "-S", "-c", "import time; time.sleep(600)")
        return await self.supervisor.start(Process(of, subject, argv, label=subject, board="local"))

    def token(self, name: str, daemon: str) -> None:
        """A daemon shows itself."""
        self.recording.model.token(keys.alive("single-uav", name, daemon, "1"), True)

    def spares(self, seconds: float = FIRST_HEALTH + HUNG_AFTER + 1) -> bool:
        """Look as a run does for so long; return whether that killed nobody."""
        end = self.now + seconds
        while self.now < end:
            self.watchdog.look()
            self.now += recovery.REFRESH
        return not any("is killed" in line for line in self.recording.lines)

    async def kills(self, child: Child) -> None:
        """Look for long enough, and wait for the end of a child."""
        assert not self.spares()
        await until(lambda: not child.alive, "it is killed")


@pytest.fixture
@asynccontextmanager
async def one() -> AsyncIterator[Looking]:
    """A watchdog with a clock of its own, and processes that end with the block."""
    one = Looking()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(recovery, "time", SimpleNamespace(monotonic=lambda: one.now))
            yield one
    finally:
        await one.supervisor.close()


async def test_a_daemon_that_is_stopped_is_killed_and_told_of(one: Looking) -> None:
    child = await one.start("agentd", "uav")
    one.recording.health("uav", "agentd")
    child.signal(signal.SIGSTOP)
    await until(lambda: child.stopped, "it is stopped")
    await one.kills(child)
    assert "agentd uav: hangs: it is stopped for 15 s, and is killed" in one.recording.lines


async def test_a_daemon_of_which_nothing_is_heard_although_its_board_is_heard_is_killed(one: Looking) -> None:
    one.token("local", "commd")
    one.recording.health("uav1", "bridged")
    bridge, agent = await one.start("bridged", "uav1"), await one.start("agentd", "uav")
    await one.kills(agent)
    assert bridge.alive
    assert one.recording.lines[-1] == "agentd uav: hangs: it publishes nothing for 15 s, and is killed"
    one.recording.at = 10.0
    await one.kills(bridge)


async def test_a_daemon_that_is_heard_for_one_of_its_agents_is_well(one: Looking) -> None:
    one.token("local", "commd")
    one.recording.health("uav", "agentd")
    await one.start("agentd", "uav killed_by_its_program")
    assert one.spares()


async def test_nobody_is_judged_while_the_way_to_its_board_is_cut(one: Looking) -> None:
    await one.start("agentd", "uav")
    assert one.spares()  # commd of its board is not heard
    one.token("local", "commd")
    one.recording.model.router(up=False)
    assert one.spares()


async def test_a_daemon_that_comes_up_has_time(one: Looking) -> None:
    one.token("local", "commd")
    await one.start("agentd", "uav")
    assert one.spares(FIRST_HEALTH - 1)


async def test_the_first_boards_router_is_killed_when_it_does_not_answer(one: Looking) -> None:
    router = await one.start("commd", "local")
    assert one.spares()
    one.recording.model.router(up=False)
    await one.kills(router)


async def test_a_simulator_may_be_stopped(one: Looking) -> None:
    simulator = await one.start("simulator", "uav1", daemon=False)
    simulator.signal(signal.SIGSTOP)
    await until(lambda: simulator.stopped, "it is stopped")
    assert one.spares()


async def test_a_daemon_that_only_paused_is_spared(one: Looking) -> None:
    daemon = await one.start("agentd", "uav")
    os.kill(daemon.pid, signal.SIGSTOP)
    await until(lambda: daemon.stopped, "it is stopped")
    assert one.spares(HUNG_AFTER - 1)
    os.kill(daemon.pid, signal.SIGCONT)
    await until(lambda: not daemon.stopped, "it goes on")
    assert one.spares()
