"""Part `page`: the cost of the page of `argosy ui` for its server and for the line to it.

The fleet is `tests/argosy/fleet_model/crowd.py`: each of its agents publishes what a flying copter does, as often. The
page is a client that loads what a browser loads and reads the feed.
"""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Final

import aiohttp

from benchmarks.measurements.viewers import crowd_of, router
from benchmarks.parts import progress, table
from benchmarks.processes import processor_time, pss
from benchmarks.results import Origin
from tests.support.processes import Daemon, running

SECONDS: Final = 8.0
"""Wall seconds of a measurement."""
CROWDS: Final = (0, 3, 50)
"""Agents and robots that the page shows."""
SETTLE: Final = 5.0
"""Wall seconds before a measurement."""


@dataclass
class Open:
    """The traffic of an open page."""

    wire: float
    """kB/s to the page."""
    message: float
    """kB of the largest message but the first."""


@dataclass
class Stretch:
    """One measurement."""

    crowd: int
    """Agents and robots."""
    cpu: float
    """Per cent of a core that the server used."""
    memory: float
    """MB of the server (PSS)."""
    page: Open | None
    """None where no page is open."""


@dataclass
class Figures:
    """All measurements."""

    seconds: float
    stretches: list[Stretch]


@contextmanager
def serving(endpoint: str) -> Iterator[tuple[Daemon, str]]:
    """Run `argosy ui`; yields it and the address of its page."""
    command = ("argosy", "ui", "--fleet", "crowd", "--router", endpoint, "--port", "0")
    with running(*command, start=subprocess.Popen) as server:
        server.says("open http://")
        found = re.search(r"^open (\S+)$", server.text, re.M)
        assert found is not None
        yield server, found[1]


@asynccontextmanager
async def open_page(url: str, sizes: list[int]) -> AsyncIterator[None]:
    """Open the page and read its feed; the sizes of its messages are appended to `sizes`."""
    base = url.partition("/?")[0]
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        async with session.get(url) as answer:  # which sets the cookie
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


async def stretch(server: Daemon, seconds: float, crowd: int, sizes: list[int] | None) -> Stretch:
    """Measure for some seconds; `sizes` are those of the messages to the page, if one is open."""
    progress(f"{crowd} agents, {'no page' if sizes is None else 'a page'}")
    await asyncio.sleep(SETTLE)
    if sizes is not None:
        sizes.clear()
    began, used = time.monotonic(), processor_time(server.process.pid)
    await asyncio.sleep(seconds)
    took = time.monotonic() - began
    cpu, held = 100 * (processor_time(server.process.pid) - used) / took, pss([server.process.pid])
    page = None if sizes is None else Open(sum(sizes) / took / 1000, max(sizes, default=0) / 1000)
    return Stretch(crowd, cpu, held, page)


def measure(quick: bool) -> Figures:
    """Measure everything. Raises BenchmarkFailed."""
    return asyncio.run(_stretches(2.0, CROWDS[1:2]) if quick else _stretches(SECONDS, CROWDS))


async def _stretches(seconds: float, crowds: tuple[int, ...]) -> Figures:
    endpoint, served = router()
    found, sizes = [], list[int]()
    async with served:
        for crowd in crowds:
            with serving(endpoint) as (server, url):
                async with crowd_of(crowd, endpoint):
                    found.append(await stretch(server, seconds, crowd, None))
                    async with open_page(url, sizes):
                        found.append(await stretch(server, seconds, crowd, sizes))
    return Figures(seconds, found)


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/guides/monitoring.md."""
    lines = [
        origin.line(),
        "",
        f"{figures.seconds:g} s for each row; per cents are of a core.",
        "",
        *table("| agents and robots | page | server | its memory (PSS) | to the page | largest message |"),
    ]
    for one in figures.stretches:
        page = f"{one.page.wire:.1f} kB/s | {one.page.message:.1f} kB" if one.page else "|"
        lines.append(
            f"| {one.crowd} | {'one' if one.page else 'none'} | {one.cpu:.1f} % | {one.memory:.0f} MB | {page} |"
        )
    return {"page": "\n".join(lines)}
