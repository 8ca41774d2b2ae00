"""Part `viewers`: the cost of `argosy watch`, `record` and `ui` beside a crowd that publishes what flying copters do.

The crowd is `tests/argosy/fleet_model/crowd.py`. `argosy watch` has a terminal of its own, whose output is discarded.
The page of `argosy ui` is a client that loads what a browser loads and reads the feed.
"""

from __future__ import annotations

import asyncio
import json
import os
import pty
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import aiohttp

from benchmarks.parts import progress, row, table
from benchmarks.processes import BenchmarkFailed, processor_time, pss
from benchmarks.results import ROOT, Origin
from commd.bus.bus import open_bus
from tests.support.ports import free_port
from tests.support.processes import running

SECONDS: Final = 10.0
SETTLE: Final = 6.0
"""Wall seconds before a stretch: everybody is known, and imports are over."""
CROWDS: Final = (3, 50)
WATCH, RECORD, SERVER, PAGE = "watch", "record", "ui without a page", "ui"


@dataclass
class ViewerCost:
    """What a viewer took."""

    what: str
    crowd: int
    """Agents and robots."""
    cpu: float
    """Per cent of a core."""
    memory: float
    """MB (PSS)."""
    written: float
    """kB/s to the disk, or to the page."""


@dataclass
class Figures:
    """All of them."""

    seconds: float
    seen: list[ViewerCost]


def measure(quick: bool) -> Figures:
    """Measure everything. Raises BenchmarkFailed."""
    seconds, crowds = (2.0, CROWDS[:1]) if quick else (SECONDS, CROWDS)
    return Figures(seconds, [one for crowd in crowds for one in asyncio.run(_beside(crowd, seconds))])


async def _beside(crowd: int, seconds: float) -> list[ViewerCost]:
    """Return what each viewer takes beside a crowd of so many."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = open_bus(endpoint, fleet="crowd", name="board", daemon="commd", mode="router")
    fleet = running("tests.argosy.fleet_model.crowd", endpoint, str(crowd))
    with ExitStack() as stack:
        file = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "crowd.mcap"
        options = ("--fleet", "crowd", "--router", endpoint)
        async with bus:
            await asyncio.to_thread(stack.enter_context(fleet).says, "there")
            took = partial(_cost, crowd, seconds)
            with _in_a_terminal("argosy", WATCH, *options) as viewer:
                found = [await took(WATCH, viewer, lambda: 0)]
            with _in_a_terminal("argosy", RECORD, *options, "-o", str(file)) as viewer:
                found.append(await took(RECORD, viewer, lambda: file.stat().st_size if file.exists() else 0))
            with running("argosy", "ui", *options, "--port", "0", start=subprocess.Popen) as server:
                found.append(await took(SERVER, server.process, lambda: 0))
                sizes: list[int] = []
                await asyncio.to_thread(server.says, "open http://")
                async with _open_page(server.text, sizes):
                    found.append(await took(PAGE, server.process, lambda: sum(sizes)))
        return found


async def _cost(
    crowd: int, seconds: float, what: str, process: subprocess.Popen[Any], written: Callable[[], int]
) -> ViewerCost:
    """Measure a viewer that runs for `seconds`; `written` counts its bytes so far. Raises BenchmarkFailed."""
    progress(f"argosy {what}, {crowd} agents")
    await asyncio.sleep(SETTLE)
    begun, before, size = time.monotonic(), processor_time(process.pid), written()
    await asyncio.sleep(seconds)
    if process.poll() is not None:
        raise BenchmarkFailed(f"argosy {what} ended with exit code {process.returncode}")
    took = time.monotonic() - begun
    cpu = 100 * (processor_time(process.pid) - before) / took
    return ViewerCost(what, crowd, cpu, pss([process.pid]), (written() - size) / took / 1000)


@asynccontextmanager
async def _open_page(text: str, sizes: list[int]) -> AsyncIterator[None]:
    """Open the page whose address is in `text` and read its feed; the sizes of its messages are appended to `sizes`."""
    found = re.search(r"^open (\S+)$", text, re.M)
    assert found is not None
    base = found[1].partition("/?")[0]
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        async with session.get(found[1]) as answer:  # which sets the cookie
            answer.raise_for_status()
        async with session.ws_connect(f"{base}/feed", origin=base, max_msg_size=0) as socket:
            await socket.send_str(json.dumps({"look": [], "event": 0}))

            async def read() -> None:
                async for message in socket:
                    sizes.append(len(message.data))

            reading = asyncio.create_task(read())
            try:
                yield
            finally:
                reading.cancel()


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/guides/monitoring.md and docs/guides/recording.md."""
    about = f"Over {figures.seconds:g} s, beside agents and robots that publish what flying copters do:"
    shown = {
        "watch": ("`argosy watch`", "", (WATCH,)),
        "recorder": ("`argosy record`", " on the disk, `lz4` |", (RECORD,)),
        "page": ("`argosy ui`", " to the page |", (SERVER, PAGE)),
    }
    found = {}
    for name, (command, written, those) in shown.items():
        lines = table(f"| agents and robots | {command}, % of a core | memory (PSS) |{written}")
        for one in figures.seen:
            if one.what in those:
                cells = [one.crowd, f"{one.cpu:.1f} %", f"{one.memory:.0f} MB"]
                if written:
                    cells.append("no page is open" if one.what == SERVER else f"{one.written:.1f} kB/s")
                lines.append(row(*cells))
        found[name] = "\n".join([origin.line(), "", about, "", *lines])
    return found


@contextmanager
def _in_a_terminal(*command: str) -> Iterator[subprocess.Popen[bytes]]:
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
