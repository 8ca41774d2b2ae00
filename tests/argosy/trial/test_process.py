"""The processes of a trial: their ends, their signals, and what a killed one leaves."""

import asyncio
import fcntl
import gc
import signal
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest

from argosy.trial.edges import bus_edges
from argosy.trial.event_loop import VirtualLoop
from argosy.trial.network import Network
from argosy.trial.process import FIRST_PID, PRESENT, START, VirtualProcess, main_of
from commd.bus.bus import open_bus
from commd.process.process import EXIT_BAD_INPUT, EXIT_FAILED
from schemas.files.findings import Finding, Findings
from schemas.wire.log_lines import LogLine

Main = Callable[[], Coroutine[Any, Any, int]]
PLACE = ("127.0.0.1", 14550)


class Trial:
    """A loop and a network, on which processes run what a test gives them."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.loop = VirtualLoop()
        self.network = Network(self.loop)
        self._patch = patch
        self.loop.owner = PRESENT
        for name, replacement in bus_edges(self.network).items():
            patch.setattr(name, replacement)

    async def start(self, main: Main) -> VirtualProcess:
        """Start a process, and let it come to its first wait."""
        self._patch.setattr("argosy.trial.process.main_of", lambda argv: main())
        process = VirtualProcess(self.network, FIRST_PID + 1, ("test",))
        await asyncio.sleep(START + 0.1)
        return process


@pytest.fixture
def trial(monkeypatch: pytest.MonkeyPatch) -> Iterator[Trial]:
    """Return a loop with its network."""
    made = Trial(monkeypatch)
    yield made
    for task in asyncio.all_tasks(made.loop):
        task._log_destroy_pending = False  # type: ignore[attr-defined]  # those of killed processes wait for ever
    made.loop.close()


async def forever() -> int:
    await asyncio.Event().wait()
    return 0


def test_a_process_ends_with_the_code_of_its_command_and_says_what_it_has_written(trial: Trial) -> None:
    async def main() -> int:
        present = PRESENT.get()
        present.write(LogLine(text="hello"))
        await asyncio.sleep(5)
        return 3

    async def play() -> tuple[int, bytes]:
        process = await trial.start(main)
        assert PRESENT.get() is None
        assert process.returncode is None
        return await process.wait(), await process.stderr.read()

    code, said = trial.loop.run_until_complete(play())
    assert code == 3
    assert trial.loop.time() == pytest.approx(START + 5)
    assert b'"hello"' in said


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (ValueError("broken"), EXIT_FAILED, b"ValueError: broken"),
        (Findings([Finding("m.yaml", 3, 1, "no such robot")]), EXIT_BAD_INPUT, b"no such robot"),
    ],
)
def test_a_command_that_fails_says_why_and_ends_as_a_real_one_does(
    trial: Trial, error: Exception, code: int, said: bytes
) -> None:
    async def main() -> int:
        raise error

    async def play() -> tuple[int, bytes]:
        process = await trial.start(main)
        return await process.wait(), await process.stderr.read()

    found, text = trial.loop.run_until_complete(play())
    assert found == code
    assert said in text


def test_a_signal_calls_its_handler_or_ends_the_process_and_kill_always_does(trial: Trial) -> None:
    handled: list[VirtualProcess | None] = []

    async def handling() -> int:
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, lambda: handled.append(PRESENT.get()))
        asyncio.get_running_loop().add_signal_handler(signal.SIGKILL, lambda: handled.append(None))
        return await forever()

    async def play() -> None:
        process, plain = await trial.start(handling), await trial.start(forever)
        process.send_signal(signal.SIGTERM)
        plain.send_signal(signal.SIGTERM)
        assert handled == [process]
        assert (process.returncode, await plain.wait()) == (None, -signal.SIGTERM)
        process.send_signal(signal.SIGKILL)
        assert await process.wait() == -signal.SIGKILL
        assert handled == [process]
        with pytest.raises(ProcessLookupError):
            process.send_signal(signal.SIGTERM)

    trial.loop.run_until_complete(play())


def test_nothing_of_a_killed_process_runs_again(trial: Trial) -> None:
    ran: list[str] = []

    async def main() -> int:
        asyncio.get_running_loop().call_later(1, ran.append, "timer")
        waiting = asyncio.create_task(asyncio.sleep(1))
        waiting.add_done_callback(lambda task: ran.append("task"))
        try:
            await asyncio.sleep(1)
        finally:
            ran.append("cleaned up")
        return 0

    async def play() -> None:
        process = await trial.start(main)
        process.send_signal(signal.SIGKILL)
        process.write(LogLine(text="from the grave"))
        await asyncio.sleep(10)
        assert await process.stderr.read() == b""
        assert ran == []

    trial.loop.run_until_complete(play())


def test_what_a_killed_process_was_to_do_finally_is_not_done_when_its_memory_is_freed(trial: Trial) -> None:
    ran: list[str] = []

    async def main() -> int:
        try:
            return await forever()
        finally:
            ran.append("cleaned up")

    async def play() -> None:
        (await trial.start(main)).send_signal(signal.SIGKILL)
        gc.collect()
        assert ran == []

    trial.loop.run_until_complete(play())


def test_a_killed_process_leaves_the_bus_its_addresses_and_its_locks(trial: Trial, tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    served: list[str] = []

    async def main() -> int:
        present = PRESENT.get()
        assert present is not None
        file = lock.open("w")
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        present.locks.append(file.fileno())
        await trial.loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=PLACE)
        async with open_bus("tcp/r", fleet="test", name="a", daemon="agentd") as bus:
            bus.token("argosy/test/a")
            served.append("begun")
            return await forever()

    async def play() -> None:
        async with open_bus("tcp/r", fleet="test", name="board", daemon="commd", mode="router") as router:
            process = await trial.start(main)
            assert await router.tokens("argosy/**") == ["argosy/test/a"]
            with lock.open() as other, pytest.raises(BlockingIOError):
                fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
            process.send_signal(signal.SIGKILL)
            assert await router.tokens("argosy/**") == []
            again = await trial.start(main)  # at the same address, with the same lock
            assert await router.tokens("argosy/**") == ["argosy/test/a"]
            again.send_signal(signal.SIGKILL)

    trial.loop.run_until_complete(play())
    assert served == ["begun", "begun"]


def test_a_program_that_no_trial_knows_is_refused() -> None:
    with pytest.raises(ValueError, match="bridged simulate submarine cannot run in a trial"):
        _ = main_of(("bridged", "simulate", "submarine"))
