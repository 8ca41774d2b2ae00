"""Recorders and replays as processes, as users start them; trials that are recorded."""

import asyncio
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.recording.reader import Recording
from argosy.trial.faults import Fault
from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import workers
from tests.support.buses import Connect, until

STARTED = "recording "


@dataclass
class Process:
    """An `argosy record` or `argosy replay` under way."""

    handle: asyncio.subprocess.Process
    said: str = ""

    async def until(self, text: str, seconds: float = 90) -> None:
        """Wait until a line with this text has come."""
        assert self.handle.stdout is not None
        async with asyncio.timeout(seconds):
            while text not in self.said:
                line = await self.handle.stdout.readline()
                assert line, f"ended before {text!r}: {self.said}"
                self.said += line.decode()

    async def end(self, number: signal.Signals | None = signal.SIGINT, seconds: float = 90) -> tuple[int, str, str]:
        """Send a signal and wait. Returns exit code, standard output and standard error."""
        if number is not None:
            self.handle.send_signal(number)
        async with asyncio.timeout(seconds):
            out, err = await self.handle.communicate()
        assert self.handle.returncode is not None
        return self.handle.returncode, self.said + out.decode(), err.decode()


@asynccontextmanager
async def argosy(*arguments: str | Path) -> AsyncIterator[Process]:
    """Start `argosy ARGUMENTS`; it is killed at the end if it still runs."""
    handle = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "argosy",
        *map(str, arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        yield Process(handle)
    finally:
        if handle.returncode is None:
            handle.kill()
            await handle.wait()


@asynccontextmanager
async def recording(endpoint: str, path: Path, *arguments: str, fleet: str = "test") -> AsyncIterator[Process]:
    """Start a recorder and wait until it hears everything."""
    async with argosy("record", "--fleet", fleet, "--router", endpoint, "-o", path, *arguments) as process:
        await process.until(STARTED)
        yield process


async def seen(path: Path, key: str, count: int, seconds: float = 90) -> None:
    """Wait until so many messages on a key are in a file."""
    await until(
        lambda: sum(t.messages for t in Recording(path).topics if t.key == key) >= count,
        f"{count} on {key}",
        seconds,
    )


class Studio:
    """A bus on which is recorded and replayed, and the file of a test."""

    def __init__(self, connect: Connect, endpoint: str, folder: Path) -> None:
        self.connect, self.endpoint, self.folder, self.path = connect, endpoint, folder, folder / "a.mcap"

    def recording(self, *arguments: str, fleet: str = "test") -> AbstractAsyncContextManager[Process]:
        """Start a recorder of the file and wait until it hears everything."""
        return recording(self.endpoint, self.path, *arguments, fleet=fleet)

    async def seen(self, key: str, count: int) -> None:
        """Wait until so many messages on a key are in the file."""
        await seen(self.path, key, count)


async def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Ask for a recording that is refused; return what is said of it."""
    assert await asyncio.to_thread(main, ["record", *map(str, arguments)]) == 2
    return capsys.readouterr().err


def tried(mission: Path, path: Path, *faults: Fault) -> Outcome:
    """Fly a mission in virtual time and record it."""
    with workers(1) as run_all:
        return next(iter(run_all([Request(str(mission), 1, faults, record=str(path))])))
