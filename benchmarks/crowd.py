"""Part "crowd": 1 to 1,000 agents in one agentd, as agents of a fleet are: mail on disk, checkpoints, health.

Agents sit in a ring: each asks the one behind it for a belief, and waits for the answer. Every question and every
answer is a message through the board's commd, written down by sender, board and receiver.
"""

from __future__ import annotations

import asyncio
import re
import statistics
import tempfile
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks import spread as fits
from benchmarks.mail.boards import FLEET, Member, fsync, member, until
from benchmarks.pages import table
from benchmarks.parts import Goal, tell
from benchmarks.processes import BenchmarkFailed, Watched, memory
from benchmarks.results import Origin
from benchmarks.serving import Site
from benchmarks.spread import NOTHING, Spread, spread

STARTING: Final = 120.0
"""Seconds that an agentd has to start, and to end."""
ANSWERING: Final = 200.0
"""Seconds that all agents have to get their answers."""
SETTLE: Final = 3.0
SETTLE_EACH: Final = 0.01
"""Seconds before anything counts, and for each agent: services of a former life are forgotten meanwhile."""
AT_ONCE: Final = 200
"""Agents that are told in one batch to begin."""
BOARD: Final = "b1"
_PROGRAM: Final = """\
secret(42).
+ask(N, Pause)[source(S)] <- -ask(N, Pause)[source(S)]; .random(R); .wait(R * Pause); !ask(N, []).
+!ask(0, Took) <- .print("took ", Took).
+!ask(N, Took) : behind(A) <-
    .nano_time(Begun); .send(A, askOne, secret(_), secret(_), 180000); .nano_time(Ended);
    !ask(N - 1, [(Ended - Begun) / 1000000|Took]).
"""
_TOOK: Final = re.compile(r"\[(\w+)\] took \[(.*)\]")


@dataclass
class Loaded:
    """A crowd under a load."""

    asked: int
    """Questions of all agents together."""
    answered: int
    """Those of agents that had all their answers within `ANSWERING`."""
    rate: float
    """Messages a second, from the first word to an agent that it may ask to the last answer."""
    took: Spread
    """Milliseconds from a question to its answer."""
    median_agent: float
    slowest_agent: float
    """Milliseconds that a question of one agent took in the mean: of the median agent, and of the slowest."""
    agentd: float
    commd: float
    """Per cent of a core."""

    @property
    def fairness(self) -> float:
        """The slowest agent against the median one."""
        return self.slowest_agent / self.median_agent if self.median_agent else 0.0

    @property
    def all_answered(self) -> bool:
        """Whether no question was left."""
        return self.answered == self.asked


@dataclass
class Crowd:
    """An agentd with so many agents, and the commd of its board."""

    agents: int
    start: float
    """Seconds from the start of the process until it serves."""
    cpu_start: float
    """Seconds of processor time for that."""
    rss: float
    commd_rss: float
    """MB, at rest."""
    idle: float
    commd_idle: float
    """Per cent of a core at rest."""
    stop: float
    """Seconds from SIGTERM to the end of the process."""
    hurried: Loaded | None = None
    eased: Loaded | None = None
    """Not measured of a crowd that was still at its questions of before."""


async def crowd(folder: Path, agents: int, idle: float, each: int, pace: float) -> Crowd:
    """Measure one crowd: each agent asks `each` questions as fast as it can, and one within `pace` seconds.

    Raises BenchmarkFailed.
    """
    with ExitStack() as stack:
        site = site_of(folder, agents)
        commd = await asyncio.to_thread(site.serve, stack, "commd", "--board", BOARD)
        begun = time.monotonic()
        agentd = await asyncio.to_thread(site.serve, stack, "agentd", "--board", BOARD, patience=STARTING)
        started = time.monotonic() - begun
        found = Crowd(agents, started, agentd.cpu(), 0, 0, 0, 0, 0)
        await asyncio.sleep(SETTLE + SETTLE_EACH * agents)
        used, since = (agentd.cpu(), commd.cpu()), time.monotonic()
        await asyncio.sleep(idle)
        passed = time.monotonic() - since
        found.idle, found.commd_idle = (100 * (agentd.cpu() - used[0]) / passed, 100 * (commd.cpu() - used[1]) / passed)
        found.rss, found.commd_rss = memory(agentd.process.pid, "VmRSS"), memory(commd.process.pid, "VmRSS")
        async with member(site.router, "probe") as probe:
            if agents > 1:
                found.hurried = await _loaded(probe, commd, agentd, agents, each, 0)
            if found.hurried is not None and found.hurried.all_answered:
                found.eased = await _loaded(probe, commd, agentd, agents, 1, pace)
        begun = time.monotonic()
        agentd.process.terminate()
        await until(lambda: agentd.process.poll() is not None, "agentd ends", STARTING)
        found.stop = time.monotonic() - begun
        return found


def site_of(folder: Path, agents: int) -> Site:
    """Write the mission of so many agents into a folder."""
    ring = "\n".join(
        f"  a{one}: {{program: asker.asl, board: {BOARD}, beliefs: [behind(a{(one + 1) % agents})]}}"
        for one in range(agents)
    )
    clients = f"clients: {{probe: {{board: {BOARD}}}}}"
    return Site.written(
        folder, f"mission: {FLEET}\nboards: {{{BOARD}: {{}}}}\nagents:\n{ring}\n{clients}", asker=_PROGRAM
    )


async def _loaded(probe: Member, commd: Watched, agentd: Watched, agents: int, each: int, pause: float) -> Loaded:
    """Let each agent ask so many questions, with so many seconds between them."""
    said = len(agentd.said)
    used, begun = (agentd.cpu(), commd.cpu()), time.monotonic()
    names = [f"a{one}" for one in range(agents)]
    for first in range(0, agents, AT_ONCE):
        await probe.post(names[first : first + AT_ONCE], f"ask({each}, {1000 * pause:g})")
    took: dict[str, list[float]] = {}
    seen = said

    def all_answered() -> bool:
        nonlocal seen
        while seen < len(agentd.said):
            if (match := _TOOK.search(agentd.said[seen][1])) is not None:
                took[match[1]] = [float(one) for one in match[2].split(",")]
            seen += 1
        return len(took) == agents

    with suppress(BenchmarkFailed):  # what came until then is told
        await until(all_answered, f"all {agents} agents have their answers", ANSWERING)
    if agentd.process.poll() is not None or commd.process.poll() is not None:
        raise BenchmarkFailed("agentd or commd ended while agents asked")
    seconds = time.monotonic() - begun
    values = [one for those in took.values() for one in those]
    means = [statistics.fmean(one) for one in took.values()] or [0.0]
    return Loaded(
        agents * each,
        len(values),
        2 * len(values) / seconds,
        spread(values) if values else NOTHING,
        statistics.median(means),
        max(means),
        100 * (agentd.cpu() - used[0]) / seconds,
        100 * (commd.cpu() - used[1]) / seconds,
    )


SIZES: Final = (1, 10, 100, 300, 1000)
QUICK: Final = (1, 10)
QUESTIONS: Final = 1_000
"""That all agents together ask as fast as they can."""
EACH_MOST: Final = 100
PACE: Final = 20.0
"""Seconds within which each agent of a crowd at its ease asks one question."""
IDLE: Final = 5.0
"""Seconds over which a crowd that does nothing is measured."""
KEPT: Final = 0.5
"""So large a part of the most messages a second is to be left with the most agents."""


@dataclass
class Figures:
    """What the part measures."""

    crowds: list[Crowd] = field(default_factory=list)
    fsync: float = 0.0
    """Milliseconds of one on this disk."""
    pace: float = PACE


def measure(quick: bool) -> Figures:
    """Start one crowd after the other. Raises BenchmarkFailed."""
    figures = Figures(fsync=fsync(), pace=3.0 if quick else PACE)
    for agents in QUICK if quick else SIZES:
        each = min(5 if quick else EACH_MOST, max(1, round(QUESTIONS / agents)))
        with tempfile.TemporaryDirectory() as folder:
            found = asyncio.run(crowd(Path(folder), agents, 1.0 if quick else IDLE, each, figures.pace))
        figures.crowds.append(found)
        rate = f", {found.hurried.rate:.0f} messages/s" if found.hurried else ""
        tell(f"{agents} agents: started in {found.start:.1f} s, {found.rss:.0f} MB{rate}")
    return figures


def goals(figures: Figures) -> list[Goal]:
    """What is asked: that the largest crowd talks at all, and that an agent more costs what the last one did."""
    largest = figures.crowds[-1]
    last = largest.hurried
    found = [
        Goal(
            f"{largest.agents:,} agents in one agentd exchange messages: questions answered within {ANSWERING:g} s",
            f"all {last.asked:,}" if last else "all",
            f"{last.answered:,}" if last else "not measured",
            last is not None and last.all_answered,
            _DECLARED,
        )
    ]
    if len(figures.crowds) < fits.SIZES:
        return found
    for what, points in (
        ("memory of an agentd grows no faster than its agents", [(one.agents, one.rss) for one in figures.crowds]),
        ("so does the processor time of its start", [(one.agents, one.cpu_start) for one in figures.crowds]),
    ):
        growth = fits.power([(float(size), cost) for size, cost in points])
        told = f"{growth} (off by {growth.off:.0%} at worst)"
        found.append(Goal(what, f"size ^ {fits.STEEPEST:g} at most", told, growth.power <= fits.STEEPEST, _GROWS))
    rates = [one.hurried.rate for one in figures.crowds if one.hurried is not None]
    part = rates[-1] / max(rates) if last is not None and rates else 0.0
    found.append(
        Goal(
            f"messages a second among {largest.agents:,} agents, against the most of any crowd",
            f"{KEPT:.0%}",
            f"{part:.0%}",
            part >= KEPT,
            _DECLARED,
        )
    )
    return found


_DECLARED: Final = (
    "What the router of Zenoh does for a record, above all for one that nobody hears, grows with all that is declared; "
    "each agent declares keys of its own, and tells its health each second. Tried: keys that are used again are "
    "declared once, agents take turns to ask commd and to write to it. Not tried: health told more rarely in a crowd. "
    "The larger a crowd, the fewer questions each of its agents asks, so that first words weigh more in it"
)
_GROWS: Final = (
    "Which part of an agent grows with the number of the others is not known. Tried: manifests are read once for all "
    "robots, keys that are used again are declared once"
)


KEEPS_UP: Final = 0.8
"""A crowd at its ease keeps up if it makes so large a part of the messages a second that are asked of it..."""
IN_TIME: Final = 10
"""... and 99 of 100 of its questions are answered within the pace divided by this."""


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    parts = [
        origin.line(),
        f"An fsync of this disk takes {figures.fsync:.2f} ms. Per cent are of one core.",
        _at_rest(figures.crowds),
        _grows(figures.crowds),
        "At once (the time in which all are told to begin counts too):",
        _talking([(one, one.hurried) for one in figures.crowds if one.hurried]),
        f"At ease, one question of each agent within {figures.pace:g} s:",
        _talking([(one, one.eased) for one in figures.crowds if one.eased]),
        _outgrown(figures),
    ]
    return {"crowd": "\n\n".join(part for part in parts if part)}


def _at_rest(crowds: list[Crowd]) -> str:
    rows = [
        *table(
            "| agents | starts in | processor time of the start | memory of agentd | for each agent more "
            "| at rest: agentd, commd | ends in |"
        ),
    ]
    first = crowds[0]
    for one in crowds:
        more = one.agents - first.agents
        each = f"{(one.rss - first.rss) / more:.2f} MB" if more else ""
        rows.append(
            f"| {one.agents:,} | {one.start:.1f} s | {one.cpu_start:.1f} s | {one.rss:.0f} MB | {each} "
            f"| {one.idle:.1f} %, {one.commd_idle:.1f} % | {one.stop:.1f} s |"
        )
    return "\n".join(rows)


def _grows(crowds: list[Crowd]) -> str:
    if len(crowds) < fits.SIZES:
        return ""
    told = []
    for what, points in (
        ("memory", _points(crowds, "rss")),
        ("the processor time of the start", _points(crowds, "cpu_start")),
        ("agentd at rest", _points(crowds, "idle")),
        ("commd at rest", _points(crowds, "commd_idle")),
    ):
        growth = fits.power(points)
        told.append(f"{what}: {growth}, off by {growth.off:.0%} at worst")
    return f"How it grows, by least squares (size ^ 1 = in proportion): {'; '.join(told)}."


def _points(crowds: list[Crowd], what: str) -> list[tuple[float, float]]:
    return [(float(one.agents), getattr(one, what)) for one in crowds]


def _talking(rows: list[tuple[Crowd, Loaded]]) -> str:
    head = [
        *table(
            "| agents | questions | answered | messages/s | question to answer, p50 | p99 | worst "
            "| slowest agent against the median one | agentd | commd |"
        ),
    ]
    return "\n".join(
        head
        + [
            f"| {one.agents:,} | {load.asked:,} | {load.answered:,} | {load.rate:.0f} | {load.took.p50:.0f} ms "
            f"| {load.took.p99:.0f} ms | {load.took.max:.0f} ms | x {load.fairness:.1f} "
            f"| {load.agentd:.0f} % | {load.commd:.0f} % |"
            for one, load in rows
        ]
    )


def _late(one: Crowd, pace: float) -> str:
    """Return what a crowd at its ease did not get, in words; empty: it keeps up."""
    if one.hurried is None:  # one alone has nobody to ask
        return ""
    load = one.eased
    if load is None:
        return "questions asked at once were still not answered"
    if not load.all_answered:
        return f"{load.asked - load.answered:,} of {load.asked:,} questions were not answered"
    wanted = 2 * one.agents / pace
    if load.rate < KEEPS_UP * wanted:
        return f"{load.rate:.0f} messages/s, {wanted:.0f} are asked"
    if load.took.p99 > 1000 * pace / IN_TIME:
        return f"p99 of an answer is {load.took.p99 / 1000:.1f} s"
    return ""


def _outgrown(figures: Figures) -> str:
    """Say from which of the sizes on a crowd cannot keep up."""
    pace = figures.pace
    criterion = (
        f"one question of each agent in {pace:g} s: all are answered, at {KEEPS_UP:.0%} of that pace at least, and "
        f"99 of 100 within {pace / IN_TIME:g} s"
    )
    sizes = ", ".join(f"{one.agents:,}" for one in figures.crowds)
    late = [(one, why) for one in figures.crowds if (why := _late(one, pace))]
    if not late:
        return f"Of the sizes measured ({sizes}) every one keeps up with {criterion}."
    (first, why), *_ = late
    return (
        f"Of the sizes measured ({sizes}), {first.agents:,} agents are the smallest that do not keep up with "
        f"{criterion}. There {why}: one agentd and one board are outgrown at that size."
    )
