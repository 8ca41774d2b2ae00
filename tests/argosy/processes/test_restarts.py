"""What is started again when it dies, on small processes of their own."""

import signal
import sys
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from argosy.cli.journal import Journal
from argosy.processes import supervisor
from argosy.processes.process_table import Kind, Process
from argosy.processes.supervisor import MOST, Child, Restarts, Supervisor
from tests.support.buses import until

DAEMON = Kind("daemon", lambda setup: [], lambda setup, subject: [])
SIMULATOR = replace(DAEMON, name="simulator", daemon=False)
SLEEPS = "import time; time.sleep(600)"


class Run:
    """A supervisor, its restarts, and what the journal says."""

    def __init__(self, on: bool) -> None:
        self.journal = Journal(lambda: 0.0)
        self.counts: Counter[str] = Counter()
        self.ended: list[Child] = []
        self.supervisor = Supervisor(lambda child, line: None, self._ended)
        self.restarts = Restarts(self.supervisor, self.journal, self.counts, on)

    def _ended(self, child: Child) -> None:
        self.ended.append(child)
        if child.dead:
            self.restarts.died(child)

    async def start(self, code: str, kind: Kind = DAEMON) -> Child:
        return await self.supervisor.start(Process(kind, "one", (sys.executable, "-S", "-c", code), label="one"))

    @property
    def told(self) -> list[str]:
        return [f"{entry.who}: {entry.text}" for entry in self.journal.entries]


@asynccontextmanager
async def supervised(on: bool = True) -> AsyncIterator[Run]:
    """A run whose processes end with the block."""
    run = Run(on)
    try:
        yield run
    finally:
        await run.restarts.close()
        await run.supervisor.close()
    assert all(not child.alive for child in run.supervisor.children)


@pytest.fixture
def run() -> AbstractAsyncContextManager[Run]:
    return supervised()


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nobody wait long for a restart."""
    monkeypatch.setattr(supervisor, "FIRST", 0.01)


async def test_a_daemon_that_is_killed_runs_again_by_the_same_command_in_its_place(run: Run) -> None:
    first = await run.start(SLEEPS)
    other = await run.start(SLEEPS)
    first.signal(signal.SIGKILL)
    await until(lambda: run.counts["daemon one"] == 1, "it runs again")
    again = run.supervisor.children[0]
    assert run.supervisor.children == [again, other]
    assert again.alive
    assert again.process == first.process
    assert again.pid != first.pid
    assert run.supervisor.dead() == []
    assert run.told == [
        "daemon one: was killed by SIGKILL; it is started again in 0.01 s",
        f"daemon one: restarted, pid {again.pid}, restart 1 in this run",
    ]


async def test_what_is_up_again_is_told_once(run: Run) -> None:
    first = await run.start(SLEEPS)
    run.restarts.report_restarted(lambda child: True)
    first.signal(signal.SIGKILL)
    await until(lambda: run.counts["daemon one"] == 1, "it runs again")
    run.restarts.report_restarted(lambda child: False)
    before = len(run.told)
    run.restarts.report_restarted(lambda child: True)
    run.restarts.report_restarted(lambda child: True)
    assert len(run.told) == before + 1
    assert run.told[-1].startswith("daemon one: up again after ")


async def test_a_daemon_that_dies_again_and_again_is_given_up_and_the_reason_says_so(run: Run) -> None:
    await run.start("import sys; sys.exit('no')")
    await until(lambda: bool(run.supervisor.dead()), "its end is seen")
    assert run.counts["daemon one"] == MOST == 5
    (dead,) = run.supervisor.dead()
    told = "ended by itself with exit code 1: no"
    assert dead.how_it_ended() == f"{told}; it was restarted 5 times within 60 s and is given up"
    delays = [line.rpartition(" in ")[2] for line in run.told if "is started again" in line]
    assert delays == ["0.01 s", "0.02 s", "0.04 s", "0.08 s", "0.16 s"]


async def test_deaths_that_are_long_ago_do_not_count(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "WINDOW", 0.0)
    await run.start("import sys; sys.exit(1)")
    await until(lambda: run.counts["daemon one"] == MOST + 2, "it runs again each time")
    assert run.supervisor.dead() == []


@pytest.mark.parametrize("code", [0, 2])
async def test_what_would_end_in_the_same_way_again_is_not_restarted(run: Run, code: int) -> None:
    await run.start(f"import sys; sys.exit({code})")
    await until(lambda: bool(run.ended), "the run ends")
    assert [child.how_it_ended() for child in run.supervisor.dead()] == [f"ended by itself with exit code {code}"]
    assert run.counts.total() == 0


async def test_a_simulator_is_a_vehicle_and_a_vehicle_that_crashed_does_not_start_again(run: Run) -> None:
    simulator = await run.start(SLEEPS, SIMULATOR)
    simulator.signal(signal.SIGKILL)
    await until(lambda: bool(run.ended), "the run ends")
    assert run.supervisor.dead() == [simulator]


async def test_without_restart_whoever_dies_is_dead() -> None:
    async with supervised(on=False) as run:
        daemon = await run.start(SLEEPS)
        daemon.signal(signal.SIGKILL)
        await until(lambda: bool(run.ended), "the run ends")
        assert run.supervisor.dead() == [daemon]


async def test_nothing_is_started_any_more_when_the_run_ends(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "FIRST", 600.0)
    monkeypatch.setattr(supervisor, "LONGEST", 600.0)
    daemon = await run.start(SLEEPS)
    daemon.signal(signal.SIGKILL)
    await until(lambda: daemon.replaced, "it is replaced")
    await run.restarts.close()
    assert run.counts.total() == 0
    assert run.supervisor.children == [daemon]


async def test_a_daemon_that_cannot_be_started_again_is_dead_and_says_why(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    daemon = await run.start(SLEEPS)

    async def fails(process: Process, instead_of: Child | None = None) -> Child:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(run.supervisor, "start", fails)
    daemon.signal(signal.SIGKILL)
    await until(lambda: bool(run.supervisor.dead()), "its end is seen")
    told = "was killed by SIGKILL; it cannot be started again: Resource temporarily unavailable"
    assert daemon.how_it_ended() == told
