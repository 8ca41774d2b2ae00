"""What the page of `argosy ui` costs its server, the line to it and the browser.

The fleet is `tests/argosy/fleet_model/crowd.py`: each of its agents tells what a flying copter does, as often. The
page is open in a headless chromium on the same machine, which paints without a graphics processor.
"""

from __future__ import annotations

import asyncio
import re
import shutil
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.measurements.viewers import crowd_of, router
from benchmarks.parts import table, tell
from benchmarks.processes import BenchmarkFailed, processor_time, pss
from benchmarks.results import Origin
from tests.support.processes import Daemon, running

SECONDS: Final = 8.0
"""Wall seconds of a stretch."""
CROWDS: Final = (3, 50)
"""Agents and robots that the page shows."""
SETTLE: Final = 5.0
"""Wall seconds before a stretch."""
FRAME: Final = "95 % of frames within"
_FRAMES: Final = """
() => new Promise((done) => {
  const gaps = [], until = performance.now() + %d;
  let last = performance.now();
  const frame = (now) => {
    gaps.push(now - last);
    last = now;
    if (now < until) requestAnimationFrame(frame);
    else done(gaps);
  };
  requestAnimationFrame(frame);
})
"""
_LOADED: Final = """
() => [performance.getEntriesByType("navigation"), performance.getEntriesByType("resource")].flat()
  .map((one) => [one.name, one.transferSize, one.responseEnd])
"""


@dataclass
class Open:
    """What an open page takes."""

    wire: float
    """kB/s to the page."""
    message: float
    """kB of the largest message but the first."""
    main_thread: float
    """Per cent of a core that the page's thread used, painting included."""
    frame: float
    """Milliseconds between two frames, of twenty the slowest."""


@dataclass
class Stretch:
    """One stretch of time."""

    crowd: int
    """Agents and robots."""
    cpu: float
    """Per cent of a core that the server used."""
    memory: float
    """MB of the server (PSS)."""
    page: Open | None
    """None where no page is open."""

    def row(self) -> str:
        """Return a row of the table."""
        cells = [f"{self.crowd} agents and robots" if self.crowd else "nobody", "one" if self.page else "none"]
        cells += [f"{self.cpu:.1f} %", f"{self.memory:.0f} MB"]
        page = self.page
        if page is None:
            cells += [""] * 4
        else:
            cells += [f"{page.wire:.1f} kB/s", f"{page.message:.1f} kB"]
            cells += [f"{page.main_thread:.0f} %", f"{page.frame:.0f} ms"]
        return f"| {' | '.join(cells)} |"


@dataclass
class Figures:
    """All stretches, and what the page loads."""

    seconds: float
    stretches: list[Stretch]
    files: int
    loaded: float
    leaflet: float
    """kB in so many files, and of it the map."""


@contextmanager
def serving(endpoint: str) -> Iterator[tuple[Daemon, str]]:
    """Run `argosy ui`; gives it and the address of its page."""
    command = ("argosy", "ui", "--fleet", "crowd", "--router", endpoint, "--port", "0")
    with running(*command, start=subprocess.Popen) as server:
        server.says("open http://")
        found = re.search(r"^open (\S+)$", server.text, re.M)
        assert found is not None
        yield server, found[1]


async def stretch(server: Daemon, seconds: float, crowd: int, page: Any, sizes: list[int]) -> Stretch:
    """Measure for some seconds."""
    tell(f"{crowd} agents, {'no page' if page is None else 'a page'}")
    await asyncio.sleep(SETTLE)
    sizes.clear()
    devtools: Any = None
    if page is not None:
        devtools = await page.context.new_cdp_session(page)
        await devtools.send("Performance.enable", {"timeDomain": "threadTicks"})
    busy = await _busy(devtools)
    began, used = time.monotonic(), processor_time(server.process.pid)
    gaps = await page.evaluate(_FRAMES % (seconds * 1000)) if page is not None else []
    await asyncio.sleep(max(0.0, seconds - (time.monotonic() - began)))
    took = time.monotonic() - began
    cpu, held, opened = (processor_time(server.process.pid) - used) / took * 100, pss([server.process.pid]), None
    if page is not None:
        thread = (await _busy(devtools) - busy) / took * 100
        frame = sorted(gaps)[int(len(gaps) * 0.95)]
        opened = Open(sum(sizes) / took / 1000, max(sizes, default=0) / 1000, thread, frame)
    return Stretch(crowd, cpu, held, opened)


async def _busy(devtools: Any) -> float:
    if devtools is None:
        return 0.0
    metrics = (await devtools.send("Performance.getMetrics"))["metrics"]
    return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))


@asynccontextmanager
async def opened(url: str, sizes: list[int]) -> AsyncIterator[Any]:
    """Open the page; the sizes of the messages that it gets are appended."""
    from playwright.async_api import Error, async_playwright  # the rest of this module is wanted without it, too

    async with async_playwright() as playwright:
        try:
            browser = await playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        except Error as error:
            raise BenchmarkFailed(f"{chromium()} does not start: {str(error).splitlines()[0]}") from error
        try:
            page = await browser.new_page(viewport={"width": 1280, "height": 800})
            page.on("websocket", lambda socket: socket.on("framereceived", lambda data: sizes.append(len(data))))
            await page.goto(url)
            yield page
        finally:
            await browser.close()


def chromium() -> str:
    """Return the command of the browser. Raises BenchmarkFailed where there is none."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if (found := shutil.which(name)) is not None:
            return found
    raise BenchmarkFailed("no chromium on this machine: sudo apt install chromium")


def measure(quick: bool) -> Figures:
    """Measure everything. Raises BenchmarkFailed."""
    chromium()
    return asyncio.run(_measured(2.0, CROWDS[:1]) if quick else _measured(SECONDS, CROWDS))


async def _measured(seconds: float, crowds: tuple[int, ...]) -> Figures:
    endpoint, served = router()
    found, sizes = [], list[int]()
    async with served:
        with serving(endpoint) as (server, url):
            found.append(await stretch(server, seconds, 0, None, sizes))
            async with opened(url, sizes) as page:
                found.append(await stretch(server, seconds, 0, page, sizes))
                loaded = [(name, size) for name, size, _ in await page.evaluate(_LOADED)]
        for crowd in crowds:
            with serving(endpoint) as (server, url):
                async with crowd_of(crowd, endpoint):
                    found.append(await stretch(server, seconds, crowd, None, sizes))
                    async with opened(url, sizes) as page:
                        await page.locator(".row").nth(crowd - 1).wait_for(state="attached", timeout=60_000)
                        found.append(await stretch(server, seconds, crowd, page, sizes))
    total, leaflet = sum(size for _, size in loaded), sum(size for name, size in loaded if "leaflet" in name)
    return Figures(seconds, found, len(loaded), total / 1000, leaflet / 1000)


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/guides/monitoring.md."""
    lines = [
        origin.line(),
        "",
        f"{figures.seconds:g} s for each row; per cents are of a core.",
        "",
        *table(
            f"| fleet | page | server | its memory (PSS) | to the page | largest message | page's thread | {FRAME} |"
        ),
        *(one.row() for one in figures.stretches),
        "",
        f"The page loads {figures.loaded:.0f} kB in {figures.files} files, {figures.leaflet:.0f} kB of them Leaflet.",
    ]
    return {"page": "\n".join(lines)}
