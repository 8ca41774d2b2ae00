"""Part `viewers`: the cost of `argosy watch` and `argosy record` beside a crowd that publishes what flying copters do.

The crowd is `tests/argosy/fleet_model/crowd.py`. `argosy watch` has a terminal of its own, whose output is discarded.
"""

from __future__ import annotations

import asyncio
import os
import pty
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.parts import progress, table
from benchmarks.processes import BenchmarkFailed, processor_time, pss
from benchmarks.results import ROOT, Origin
from commd.bus.bus import Bus, open_bus
from tests.support.ports import free_port
from tests.support.processes import running

SECONDS: Final = 10.0
SETTLE: Final = 6.0
"""Wall seconds before a stretch: everybody is known, and imports are over."""
CROWDS: Final = (3, 50)


@dataclass
class ViewerCost:
    """What a viewer took."""

    what: str
    """Its command."""
    crowd: int
    """Agents and robots."""
    cpu: float
    """Per cent of a core."""
    memory: float
    """MB (PSS)."""
    written: float
    """kB/s on the disk."""


@dataclass
class Figures:
    """All of them."""

    seconds: float
    seen: list[ViewerCost]


def measure(quick: bool) -> Figures:
    """Measure everything. Raises BenchmarkFailed."""
    seconds, crowds = (2.0, CROWDS[:1]) if quick else (SECONDS, CROWDS)
    return Figures(seconds, [one for crowd in crowds for one in asyncio.run(_beside(crowd, seconds))])


def router() -> tuple[str, AbstractAsyncContextManager[Bus]]:
    """Return the endpoint of a router, and what runs it."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    return endpoint, open_bus(endpoint, fleet="crowd", name="board", daemon="commd", stamp=time.time_ns, mode="router")


@asynccontextmanager
async def crowd_of(size: int, endpoint: str) -> AsyncIterator[None]:
    """Run so many agents and robots that publish what flying copters do."""
    if not size:
        yield
        return
    with running("tests.argosy.fleet_model.crowd", endpoint, str(size)) as fleet:
        await asyncio.to_thread(fleet.says, "there")
        yield


async def _beside(crowd: int, seconds: float) -> list[ViewerCost]:
    (endpoint, served), found = router(), []
    async with served, crowd_of(crowd, endpoint):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "crowd.mcap"
            for what, more in (("watch", ()), ("record", ("-o", str(file)))):
                progress(f"argosy {what}, {crowd} agents")
                options = ("--router", endpoint, *more)
                found.append(await asyncio.to_thread(_view, what, options, crowd, seconds, file))
    return found


def _view(what: str, options: tuple[str, ...], crowd: int, seconds: float, file: Path) -> ViewerCost:
    with in_a_terminal("argosy", what, "--fleet", "crowd", *options) as process:
        time.sleep(SETTLE)
        begun, before, size = time.monotonic(), processor_time(process.pid), _size(file)
        time.sleep(seconds)
        if process.poll() is not None:
            raise BenchmarkFailed(f"argosy {what} ended with exit code {process.returncode}")
        took = time.monotonic() - begun
        cpu, written = 100 * (processor_time(process.pid) - before) / took, (_size(file) - size) / took / 1000
        return ViewerCost(what, crowd, cpu, pss([process.pid]), written)


def _size(file: Path) -> int:
    return file.stat().st_size if file.exists() else 0


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/guides/monitoring.md and docs/guides/recording.md."""
    head = [
        origin.line(),
        "",
        f"Over {figures.seconds:g} s, beside agents and robots that publish what flying copters do:",
        "",
    ]
    watch = table("| agents and robots | `argosy watch`, % of a core | memory (PSS) |")
    record = table("| agents and robots | `argosy record`, % of a core | memory (PSS) | on the disk, `lz4` |")
    for one in figures.seen:
        row = f"| {one.crowd} | {one.cpu:.1f} % | {one.memory:.0f} MB |"
        if one.what == "watch":
            watch.append(row)
        else:
            record.append(f"{row} {one.written:.1f} kB/s |")
    return {"watch": "\n".join([*head, *watch]), "recorder": "\n".join([*head, *record])}


@contextmanager
def in_a_terminal(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run `python -m COMMAND` with a terminal of 100 columns while the block lasts."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
    process = subprocess.Popen(
        [sys.executable, "-m", *command], stdin=theirs, stdout=theirs, stderr=theirs, cwd=ROOT, env=environment
    )
    os.close(theirs)

    def read() -> None:
        with suppress(OSError):
            while os.read(ours, 65_536):
                pass

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        reader.join(5)
        os.close(ours)
