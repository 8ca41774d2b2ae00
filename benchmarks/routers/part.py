"""Part "routers": what crosses the links of a fleet of two sites with two boards each, and how much one router takes.

Every board has the daemons that it has in a fleet, and links to its neighbours alone (`benchmarks.routers.sites`).
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.parts import Goal, tell
from benchmarks.routers import kinds, sites
from benchmarks.routers import load as router_load
from benchmarks.routers.load import Load
from benchmarks.routers.page import blocks, pictures
from benchmarks.routers.sites import BETWEEN_SITES, FLEET, Links, Site
from benchmarks.scale import health
from benchmarks.terminal import in_a_terminal

__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

SECONDS: Final = 10.0
"""For which each stretch is looked at."""
SETTLE: Final = 4.0
EACH: Final = 3
"""UAVs of a board."""
RECORDS: Final = 200
"""Of a kind, whose bytes on the link are counted."""
RATES: Final = (1_000.0, 10_000.0, 30_000.0, 100_000.0, 0.0)
"""Percepts a second through one router."""
ASK_EVERY: Final = 1.0
"""Seconds between the answer to an agent's question and its next one."""
SILENCE: Final = 0.02
"""So large a part of what percepts take with a listener may cross a link without one."""
SMALLEST: Final = 60
"""Bytes that a percept takes on a link at least: with fewer the count has not seen it, and tells nothing."""


@dataclass
class Stretch:
    """A time in which the fleet did one thing."""

    what: str
    seconds: float
    links: dict[str, float]
    """Bytes a second on each link, both ways together."""


@dataclass
class Figures:
    """What the part measures."""

    each: int = EACH
    """UAVs of a board."""
    ask_every: float = ASK_EVERY
    sizes: dict[str, float] = field(default_factory=dict)
    """Bytes on the link between the sites for one of a kind."""
    stretches: list[Stretch] = field(default_factory=list)
    starting: dict[str, int] = field(default_factory=dict)
    """Bytes on each link while all bridges and agents started: what they serve, hear and who they are is declared."""
    payload: int = 0
    """Bytes of the percept that the one router passes on."""
    loads: list[Load] = field(default_factory=list)
    percepts: float = 0.0
    """A second, that the bridge of one UAV in flight told."""

    def of(self, what: str) -> Stretch:
        """Return a stretch. Raises KeyError."""
        return {one.what: one for one in self.stretches}[what]


def measure(quick: bool) -> Figures:
    """Measure everything. Raises BenchmarkFailed."""
    figures = Figures(each=1 if quick else EACH, payload=len(router_load.payload()))
    figures.loads = router_load.measure(RATES[:2] if quick else RATES, 2.0 if quick else 6.0)
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(_of_sites(figures, Path(folder), 2.0 if quick else SECONDS, 20 if quick else RECORDS))
    return figures


async def _of_sites(figures: Figures, folder: Path, seconds: float, records: int) -> None:
    made = sites.site(folder, figures.each)
    async with sites.links(made) as (counted, options):
        with ExitStack() as stack:
            await asyncio.to_thread(stack.enter_context, sites.routers(made, options))
            await asyncio.sleep(SETTLE)
            await _look(figures, "routers and mail alone", counted, seconds)
            idle = figures.stretches[-1].links[BETWEEN_SITES]
            figures.sizes = await kinds.sizes(made, counted, idle, records)
            before = counted.passed()
            agent_group = await asyncio.to_thread(stack.enter_context, sites.crews(made))
            await asyncio.sleep(SETTLE)
            figures.starting = {link: sum(now) - sum(before[link]) for link, now in counted.passed().items()}
            await _look(figures, "bridges and agents, no vehicle", counted, seconds)
            await asyncio.to_thread(stack.enter_context, sites.vehicles(made, agent_group))
            await asyncio.sleep(SETTLE)
            await _look(figures, "flying", counted, seconds)
            recorder = ("argosy", "record", "--router", made.endpoints["n2"], "--fleet", FLEET)
            await _with(figures, "flying, `argosy record` at n2", counted, seconds, *recorder, "-o", f"{folder}/a.mcap")
            watch = ("argosy", "watch", "--router", made.endpoints["n2"], "--fleet", FLEET)
            await _with(figures, "flying, `argosy watch` at n2", counted, seconds, *watch)
            page = ("argosy", "ui", "--router", made.endpoints["n2"], "--fleet", FLEET, "--port", "0")
            await _with(figures, "flying, `argosy ui` at n2", counted, seconds, *page)
            await _ask_across(made)
            await asyncio.sleep(SETTLE)
            await _look(figures, "flying, each agent asks one of the other site", counted, seconds)
            figures.percepts = await asyncio.to_thread(_percepts, made, seconds)


async def _look(figures: Figures, what: str, counted: Links, seconds: float) -> None:
    figures.stretches.append(Stretch(what, seconds, await sites.bytes_a_second(counted, seconds)))
    shown = ", ".join(f"{link} {rate:.0f}" for link, rate in figures.stretches[-1].links.items())
    tell(f"{what}: {shown} bytes/s")


async def _with(figures: Figures, what: str, counted: Links, seconds: float, *command: str) -> None:
    """Look while a command of an operator runs."""
    with in_a_terminal(*command):
        await asyncio.sleep(2 * SETTLE)
        await _look(figures, what, counted, seconds)
    await asyncio.sleep(SETTLE)


def _percepts(made: Site, seconds: float) -> float:
    """Return the percepts a second that one UAV's bridge counts, the mean of all. Who listens is the last to come."""
    with health.listening(made.endpoints["n2"], FLEET) as records:
        time.sleep(SETTLE)
        begun = time.monotonic()
        time.sleep(seconds)
        ended = time.monotonic()
        time.sleep(1.5)  # a record of each comes behind it
    return health.grown(records, begun, ended)["bridged"].rates["percepts"] / (4 * made.each)


async def _ask_across(made: Site) -> None:
    """Let each agent ask one of the other site, from now on."""
    across = {"n1": "s1", "n2": "s2", "s1": "n1", "s2": "n2"}
    for board, other in across.items():
        async with sites.probe(made, board) as probe:
            for agent, whom in zip(made.agents(board), made.agents(other), strict=True):
                await probe.post([agent], f"ask({whom}, {1000 * ASK_EVERY:g})")


def goals(figures: Figures) -> list[Goal]:
    """What is asked: that percepts stay where nobody listens."""
    silent = abs(figures.sizes["a percept, nobody listens there"])
    heard = figures.sizes["a percept, somebody listens there"]
    counted = heard >= SMALLEST
    return [
        Goal(
            "percepts do not cross a link behind which nobody listens",
            f"{SILENCE:.0%} of their bytes at most",
            f"{silent / heard:.1%}" if counted else f"not counted: with a listener {heard:.0f} bytes of each came",
            counted and silent <= SILENCE * heard,
            "what else crossed the link meanwhile (keep-alives, declarations) is taken off by its rate before, and may "
            "have varied. Tried: nothing else is sent while records of one kind are counted",
        )
    ]
