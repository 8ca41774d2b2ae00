"""What the page of `argosy ui` costs its server, the line to it and the browser; writes the figures of docs/ui.md.

The fleet is `tests/argosy/team/crowd.py`: each of its agents tells what a flying copter does, as often. The page is
open in a headless chromium on the same machine, which paints without a graphics processor.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import platform
import re
import shutil
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from playwright.async_api import Page, async_playwright

from commd.bus import open_bus
from tests.support.ports import free_port
from tests.support.processes import Daemon, pss, running

SETTLE: Final = 5.0
"""Wall seconds before a stretch."""
FRAME: Final = "95 % of frames within"
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"
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
class Figures:
    """One stretch."""

    fleet: str
    page: str
    cpu: float
    """Per cent of a core that the server used."""
    memory: float
    """MB of the server (PSS)."""
    wire: float = 0.0
    """kB/s to the page."""
    message: float = 0.0
    """kB of the largest message but the first."""
    main_thread: float = 0.0
    """Per cent of a core that the page's thread used, painting included."""
    frame: float = 0.0
    """ms between two frames, of twenty the slowest."""

    def row(self) -> str:
        """Return a row of the table."""
        cells = [self.fleet, self.page, f"{self.cpu:.1f} %", f"{self.memory:.0f} MB"]
        if self.page != "none":
            cells += [
                f"{self.wire:.1f} kB/s",
                f"{self.message:.1f} kB",
                f"{self.main_thread:.0f} %",
                f"{self.frame:.0f} ms",
            ]
        else:
            cells += ["", "", "", ""]
        return f"| {' | '.join(cells)} |"


def cpu_of(pid: int) -> float:
    """Return the processor seconds that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def serving(endpoint: str) -> Iterator[tuple[Daemon, str]]:
    """Run `argosy ui`; gives it and the address of its page."""
    with running("argosy", "ui", "--fleet", "crowd", "--router", endpoint, "--port", "0") as server:
        server.says("open http://")
        found = re.search(r"^open (\S+)$", server.text, re.M)
        assert found is not None
        yield server, found[1]


async def stretch(server: Daemon, seconds: float, fleet: str, page: Page | None, sizes: list[int]) -> Figures:
    """Measure for some seconds."""
    await asyncio.sleep(SETTLE)
    sizes.clear()
    devtools: Any = None
    if page is not None:
        devtools = await page.context.new_cdp_session(page)
        await devtools.send("Performance.enable", {"timeDomain": "threadTicks"})
    busy = await _busy(devtools)
    began, used = time.monotonic(), cpu_of(server.process.pid)
    gaps = await page.evaluate(_FRAMES % (seconds * 1000)) if page is not None else []
    await asyncio.sleep(max(0.0, seconds - (time.monotonic() - began)))
    took = time.monotonic() - began
    figures = Figures(
        fleet,
        "none" if page is None else "one",
        (cpu_of(server.process.pid) - used) / took * 100,
        pss(server.process.pid),
    )
    if page is not None:
        figures.wire, figures.message = sum(sizes) / took / 1000, max(sizes, default=0) / 1000
        figures.main_thread, figures.frame = (
            (await _busy(devtools) - busy) / took * 100,
            sorted(gaps)[int(len(gaps) * 0.95)],
        )
    return figures


async def _busy(devtools: Any) -> float:
    if devtools is None:
        return 0.0
    metrics = (await devtools.send("Performance.getMetrics"))["metrics"]
    return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))


@asynccontextmanager
async def opened(url: str, sizes: list[int]) -> AsyncIterator[Page]:
    """Open the page; the sizes of the messages that it gets are appended."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        try:
            page = await browser.new_page(viewport={"width": 1280, "height": 800})
            page.on("websocket", lambda socket: socket.on("framereceived", lambda data: sizes.append(len(data))))
            await page.goto(url)
            yield page
        finally:
            await browser.close()


async def measured(seconds: float) -> tuple[list[Figures], list[tuple[str, int]]]:
    """Measure everything. Returns the stretches, and what the page loads with the bytes of each."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    figures, sizes, loaded = [], list[int](), list[tuple[str, int]]()
    async with open_bus(endpoint, fleet="crowd", name="board", daemon="commd", stamp=time.time_ns, mode="router"):
        with serving(endpoint) as (server, url):
            figures.append(await stretch(server, seconds, "nobody", None, sizes))
            async with opened(url, sizes) as page:
                figures.append(await stretch(server, seconds, "nobody", page, sizes))
                loaded = [(name, size) for name, size, _ in await page.evaluate(_LOADED)]
        for agents in (3, 50):
            with serving(endpoint) as (server, url), running("tests.argosy.team.crowd", endpoint, str(agents)) as crowd:
                await asyncio.to_thread(crowd.says, "there")
                figures.append(await stretch(server, seconds, f"{agents} agents and robots", None, sizes))
                async with opened(url, sizes) as page:
                    await page.locator(".row").nth(agents - 1).wait_for(state="attached", timeout=60_000)
                    figures.append(await stretch(server, seconds, f"{agents} agents and robots", page, sizes))
    return figures, loaded


def text_of(figures: list[Figures], loaded: list[tuple[str, int]], seconds: float) -> str:
    """Return the figures as Markdown."""
    total, leaflet = sum(size for _, size in loaded), sum(size for name, size in loaded if "leaflet" in name)
    load = os.getloadavg()[0]  # with the crowd and the browser of this measurement in it
    machine = (
        f"load {load:.0f} on {os.cpu_count()} cores, Python {platform.python_version()}, aiohttp {version('aiohttp')}"
    )
    return "\n".join(
        (
            f"`make bench-page`, {seconds:g} s for each row ({machine}):",
            "",
            f"| fleet | page | server | its memory | to the page | largest message | page's thread | {FRAME} |",
            "|---|---|---|---|---|---|---|---|",
            *(one.row() for one in figures),
            "",
            f"The page loads {total / 1000:.0f} kB in {len(loaded)} files, {leaflet / 1000:.0f} kB of them Leaflet.",
        )
    )


def main() -> None:
    """Measure, and write the figures between their marks in a page, or print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--seconds", type=float, default=15.0)
    args = parser.parse_args()
    text = text_of(*asyncio.run(measured(args.seconds)), args.seconds)
    if args.out is None:
        print(text)
        return
    before, _, rest = args.out.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    args.out.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
