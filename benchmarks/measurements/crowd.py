"""Part `crowd`: 1 to 1,000 agents in one agentd, with mail on disk, checkpoints and health as in a fleet.

Agents form a ring: each asks the one behind it for a belief, and waits for the answer: two messages. All begin at the
same time, which each gets in advance, and ask so many questions that they are busy for some seconds. The rate is taken
from the first question to the last answer by their own clock.
"""

from __future__ import annotations

import asyncio
import math
import re
import statistics
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks import spread as fits
from benchmarks.measurements.boards import PROBE, Boards, Member, Synchronous, boards, fsync, member, until
from benchmarks.parts import Goal, at_least, at_most, progress, row, table
from benchmarks.processes import BenchmarkFailed, Watched, memory
from benchmarks.results import Origin
from benchmarks.spread import NOTHING, Spread, spread

STARTING: Final = 120.0
"""Seconds that an agentd has to start, and to end."""
ANSWERING: Final = 200.0
"""Seconds that all agents have to get their answers."""
SETTLE: Final = 3.0
SETTLE_EACH: Final = 0.01
"""Seconds before anything counts, and for each agent: services of a former life are forgotten meanwhile."""
AT_ONCE: Final = 200
"""Agents that are asked in one batch to begin."""
LEAD, LEAD_EACH = 0.3, 0.01
"""Seconds from the first word to the begin, and for each agent; then one and a half times as long as words took."""
SHOWN: Final = 2_000
"""Answers whose time agents print, of all together."""
_PROGRAM: Final = """\
secret(42).
+ask(N, Each, Pause, At)[source(S)] <-
    -ask(N, Each, Pause, At)[source(S)]; .print("asks"); !from(At); .nano_time(First); !!ask(N, Each, Pause, First).
+!from(At) : At > system.time <- .wait(At - system.time).
+!from(_).
+!ask(0, _, _, First) <- .nano_time(Last); .print("done ", First, " ", Last).
+!ask(N, Each, Pause, First) : behind(A) <-
    !rest(Pause);
    .nano_time(Begun); .send(A, askOne, secret(_), secret(_), 180000); .nano_time(Ended);
    !shown(N mod Each, (Ended - Begun) / 1000000);
    !!ask(N - 1, Each, Pause, First).
+!rest(0).
+!rest(Pause) <- .random(R); .wait(R * Pause).
+!shown(0, Took) <- .print("took ", Took).
+!shown(_, _).
"""
_TOOK: Final = re.compile(r"\[(\w+)\] took ([\d.eE+-]+)$")
_DONE: Final = re.compile(r"\[(\w+)\] done ([\d.eE+-]+) ([\d.eE+-]+)$")


@dataclass
class Loaded:
    """A crowd under a load."""

    asked: int
    """Questions of all agents together."""
    answered: int
    """Those of agents that had all their answers within `ANSWERING`."""
    rate: float
    """Messages a second, from the first question to the last answer."""
    took: Spread
    """Milliseconds from a question to its answer, of the answers that were printed."""
    median_agent: float
    slowest_agent: float
    """Milliseconds that a question of one agent took in the mean: of the median agent, and of the slowest."""
    agentd: float
    commd: float
    """Per cent of a core."""
    seconds: float = 0.0
    reached: float = 0.0
    """Seconds until the last agent had been asked to begin."""

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
    """MB of agentd, at rest."""
    idle: float
    commd_idle: float
    """Per cent of a core at rest."""
    stop: float
    """Seconds from SIGTERM to the end of the process."""
    hurried: Loaded | None = None
    normal: Loaded | None = None
    """As `hurried`, with `mail: {synchronous: normal}`."""


class Ring:
    """Boards with an agentd each, and agents of which each asks the one behind it."""

    def __init__(self, made: Boards, probe: Member, minds: list[Watched], agents: int, start: float) -> None:
        self.commds, self.minds, self.agents = list(made.daemons.values()), minds, agents
        self.start = start
        """Seconds from the start of the last agentd until it serves."""
        self._probe = probe

    async def load(self, each: int, pause: float = 0.0, lead: float = 0.0, agents: int = 0) -> Loaded:
        """Let agents, all of them or the first, ask so often, with `pause` seconds at most before each question.

        They begin `lead` seconds after the first message to them.
        """
        asking = agents or self.agents
        before = [len(one.output) for one in self.minds]
        shown, asked = max(1, min(each, asking * each // SHOWN)), time.monotonic()
        order = f"ask({each}, {shown}, {1000 * pause:g}, {1000 * (time.time() + lead):.0f})"
        names = [f"a{one}" for one in range(asking)]
        for first in range(0, asking, AT_ONCE):
            await self._probe.post(names[first : first + AT_ONCE], order)
        await asyncio.sleep(max(0.0, asked + lead - time.monotonic()))
        used, begun = self._cpu(), time.monotonic()

        def fresh() -> list[tuple[float, str]]:
            return [line for since, one in zip(before, self.minds, strict=True) for line in one.output[since:]]

        def all_answered() -> bool:
            return sum(" done " in line for _, line in fresh()) == asking

        with suppress(BenchmarkFailed):  # the answers until then count
            await until(all_answered, f"all {asking} agents have their answers", ANSWERING, 0.1)
        if any(one.process.poll() is not None for one in (*self.minds, *self.commds)):
            raise BenchmarkFailed("agentd or commd ended while agents asked")
        spent = time.monotonic() - begun
        busy = [100 * (now - then) / spent for now, then in zip(self._cpu(), used, strict=True)]
        return _load(fresh(), asking, each, asked, busy)

    def _cpu(self) -> list[float]:
        return [sum(one.cpu() for one in those) for those in (self.minds, self.commds)]

    async def hurried(self, enough: float) -> Loaded:
        """Let all ask as fast as they can, for `enough` seconds at least, after a first round that does not count."""
        each, lead, found = 1, LEAD + LEAD_EACH * self.agents, None
        while True:
            found, first = await self.load(each, lead=lead), found is None
            if not found.all_answered or (found.seconds >= enough and not first):
                return found
            each *= max(1, min(20, math.ceil(1.3 * enough / max(found.seconds, 0.01))))
            lead = LEAD + 1.5 * found.reached


def _load(lines: list[tuple[float, str]], asking: int, each: int, asked: float, used: list[float]) -> Loaded:
    """Read what agents have printed."""
    took: dict[str, list[float]] = {}
    done: dict[str, tuple[float, float]] = {}
    for _, line in lines:
        if (match := _TOOK.search(line)) is not None:
            took.setdefault(match[1], []).append(float(match[2]))
        elif (match := _DONE.search(line)) is not None:
            done[match[1]] = float(match[2]) / 1e9, float(match[3]) / 1e9
    seconds = max(ended for _, ended in done.values()) - min(begun for begun, _ in done.values()) if done else 0.0
    values = [one for those in took.values() for one in those]
    means = [statistics.fmean(one) for one in took.values()] or [0.0]
    return Loaded(
        asking * each,
        len(done) * each,
        2 * len(done) * each / seconds if seconds else 0.0,
        spread(values) if values else NOTHING,
        statistics.median(means),
        max(means),
        used[0],
        used[1],
        seconds,
        max((at for at, line in lines if line.endswith("] asks")), default=asked) - asked,
    )


SIZES: Final = (1, 10, 100, 300, 1000)
QUICK: Final = (1, 10)
ENOUGH: Final = 3.0
"""Seconds for which agents ask as fast as they can, at least."""
IDLE: Final = 5.0
"""Seconds over which a crowd that does nothing is measured."""
QUESTIONS, REST = 200, 0.02
"""Of one agent while the others rest, and the seconds between two of them at most."""


@asynccontextmanager
async def ring(synchronous: Synchronous, agents: int, across: int = 1) -> AsyncIterator[Ring]:
    """Run so many agents, on one board or in turn on several, while the block lasts. Raises BenchmarkFailed."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "asker.asl").write_text(_PROGRAM)
        names = {f"a{one}": f"b{one % across + 1}" for one in range(agents)}
        behind = {f"a{one}": f"program: asker.asl, beliefs: [behind(a{(one + 1) % agents})]" for one in range(agents)}
        with boards(Path(folder), names, synchronous, programs=behind) as made:
            minds = []
            for name in made.endpoints:
                begun = time.monotonic()
                minds.append(await asyncio.to_thread(made.think, name, STARTING))
            start = time.monotonic() - begun
            async with member(made.endpoints["b1"], PROBE) as probe:
                yield Ring(made, probe, minds, agents, start)


async def crowd(agents: int, quick: bool) -> Crowd:
    """Measure one crowd: at rest, then while each agent asks as fast as it can. Raises BenchmarkFailed."""
    async with ring("full", agents) as asking:
        (agentd,), (commd,) = asking.minds, asking.commds
        found = Crowd(agents, asking.start, agentd.cpu(), 0, 0, 0, 0)
        await asyncio.sleep(SETTLE + SETTLE_EACH * agents)
        used, since = (agentd.cpu(), commd.cpu()), time.monotonic()
        await asyncio.sleep(1.0 if quick else IDLE)
        passed = time.monotonic() - since
        found.idle, found.commd_idle = (100 * (agentd.cpu() - used[0]) / passed, 100 * (commd.cpu() - used[1]) / passed)
        found.rss = memory(agentd.process.pid, "VmRSS")
        if agents > 1:
            found.hurried = await asking.hurried(0.3 if quick else ENOUGH)
        begun = time.monotonic()
        agentd.process.terminate()
        await until(lambda: agentd.process.poll() is not None, "agentd ends", STARTING)
        found.stop = time.monotonic() - begun
    return found


async def normal(agents: int, quick: bool) -> Loaded:
    """Let agents ask as fast as they can whose mail is not synced to the disk. Raises BenchmarkFailed."""
    async with ring("normal", agents) as asking:
        await asyncio.sleep(SETTLE_EACH * agents)
        return await asking.hurried(0.3 if quick else ENOUGH)


async def at_rest(quick: bool, across: int) -> Spread:
    """Let one of two agents ask while the other rests: milliseconds from a question to its answer."""
    async with ring("full", 2, across) as asking:
        await asking.load(5, agents=1)
        return (await asking.load(10 if quick else QUESTIONS, REST, agents=1)).took


@dataclass
class Figures:
    """What the part measures."""

    crowds: list[Crowd] = field(default_factory=list)
    fsync: float = 0.0
    """Milliseconds of one on this disk."""
    alone: Spread = NOTHING
    """Milliseconds from a question to its answer of two agents of one daemon while nothing else happens."""
    across: Spread = NOTHING
    """The same on two boards: two messages."""
    counted: str = "the time in which all are asked to begin counts too"


def measure(quick: bool) -> Figures:
    """Start one crowd after the other. Raises BenchmarkFailed."""
    figures = Figures(fsync=fsync(), counted="from the first question to the last answer")
    figures.alone, figures.across = (asyncio.run(at_rest(quick, across)) for across in (1, 2))
    progress(f"question to answer {figures.alone} ms, on two boards {figures.across} ms (p50 / p99)")
    for agents in QUICK if quick else SIZES:
        found = asyncio.run(crowd(agents, quick))
        if agents > 1:
            found.normal = asyncio.run(normal(agents, quick))
        figures.crowds.append(found)
        rates = ", ".join(f"{load.rate:.0f}" for load in (found.hurried, found.normal) if load)
        progress(f"{agents} agents: started in {found.start:.1f} s, {found.rss:.0f} MB; messages/s: {rates or 'none'}")
    return figures


COMPARED: Final = (10, 100, 1000)
"""Sizes whose messages a second have goals, and are compared with earlier revisions."""


def probe(quick: bool) -> dict[str, float]:
    """Return what mail among agents of one daemon costs: less is better."""
    found = {}
    for agents in QUICK[1:] if quick else COMPARED:
        one = asyncio.run(crowd(agents, quick))
        for what, load in (("full", one.hurried), ("normal", asyncio.run(normal(agents, quick)))):
            assert load is not None
            rate = load.rate or 1e-9
            found[f"message among {agents:,} agents, {what} (µs)"] = 1e6 / rate
            used = load.agentd + load.commd
            found[f"message among {agents:,} agents, {what}, processor time of agentd and commd (µs)"] = (
                1e4 * used / rate
            )
    found |= {
        f"{agents:,} agents: start (s)": one.start,
        f"{agents:,} agents: agentd at rest (% of a core)": one.idle,
        f"{agents:,} agents: commd at rest (% of a core)": one.commd_idle,
        f"{agents:,} agents: agentd (MB)": one.rss,
    }
    for what, across in (("in one daemon", 1), ("on two boards", 2)):
        found[f"question to answer {what}, p50 (ms)"] = asyncio.run(at_rest(quick, across)).p50
    return found


RATES: Final = {"normal": 10_000.0, "hurried": 4_000.0}
"""Messages a second that are asked for, by how mail is synced."""
KEPT: Final = 0.6
"""So large a part of the most messages a second is to be left with the most agents."""
GOAL_ALONE, GOAL_ACROSS = 5.0, 8.0
"""Milliseconds from a question to its answer in one daemon, and of a message between two boards, p50."""
GOAL_START, GOAL_IDLE, GOAL_COMMD, GOAL_RSS = 4.0, 4.0, 2.0, 200.0
"""Of the largest crowd: seconds, per cent of a core at rest of agentd and of commd, and MB of agentd."""


def goals(figures: Figures) -> list[Goal]:
    """What is asked: so many messages a second at each size, and a daemon that is small and idle at rest."""
    largest = figures.crowds[-1]
    last = largest.hurried
    title = f"{largest.agents:,} agents in one agentd exchange messages: questions answered within {ANSWERING:g} s"
    wanted, answered = (f"all {last.asked:,}", f"{last.answered:,}") if last else ("all", "not measured")
    found = [Goal(title, wanted, answered, last is not None and last.all_answered, _ONE_CORE)]
    for how, what in (("hurried", "full"), ("normal", "normal")):
        loads = {one.agents: load for one in figures.crowds if (load := getattr(one, how)) is not None}
        for agents in (agents for agents in COMPARED if agents in loads):
            title = f"messages a second among {agents:,} agents of one agentd, {what}"
            found.append(at_least(title, RATES[how], loads[agents].rate, why=_ONE_CORE))
        if len(loads) > 1:
            part = loads[largest.agents].rate / max(load.rate for load in loads.values())
            title = f"messages a second among {largest.agents:,} agents, {what}, against the most of any crowd"
            found.append(Goal(title, f"{KEPT:.0%}", f"{part:.0%}", part >= KEPT, _ONE_CORE))
    if figures.alone.count:
        title = "question to answer at rest, p50: agents of one daemon"
        found.append(at_most(title, GOAL_ALONE, figures.alone.p50, "ms", _ONE_CORE))
        title = "message at rest, p50, half of question to answer: agents on two boards"
        found.append(at_most(title, GOAL_ACROSS, figures.across.p50 / 2, "ms", _FOUR_COMMITS))
    if largest.agents == SIZES[-1]:
        for what, limit, value, unit in (
            ("start of agentd", GOAL_START, largest.start, "s"),
            ("processor time of agentd at rest", GOAL_IDLE, largest.idle, "% of a core"),
            ("processor time of commd at rest", GOAL_COMMD, largest.commd_idle, "% of a core"),
            ("memory of agentd (RSS)", GOAL_RSS, largest.rss, "MB"),
        ):
            found.append(at_most(f"{largest.agents:,} agents: {what}", limit, value, unit, _HEALTH))
    if len(figures.crowds) >= fits.SIZES:
        for what, field_ in (
            ("memory of an agentd grows no faster than its agents", "rss"),
            ("so does the processor time of its start", "cpu_start"),
        ):
            growth = fits.power(_points(figures.crowds, field_))
            fit = f"{growth} (off by {growth.off:.0%} at worst)"
            found.append(Goal(what, f"size ^ {fits.STEEPEST:g} at most", fit, growth.power <= fits.STEEPEST, _GROWS))
    return found


_ONE_CORE: Final = (
    "One core runs all agents and is used up: two thirds of it by minds, whose time does not depend on the number of "
    "agents, a tenth by commits among 1,000, which grow with the agents in each (samples of a profile). Garbage "
    "collection took a third among 1,000 agents, and a fifth among 100. Tried: one commit for all agents, ten a second "
    "at most and in a tenth of the time, mail that is not encoded, code that agents of one program share, garbage "
    "collection without loaded modules, timers of answered questions that end with them, names that are not copied for "
    "each message"
)
_FOUR_COMMITS: Final = (
    "four commits and three queries follow one another, and take a processor most of the time: in a profile about "
    "1.5 ms of each agentd and 2.5 ms of each commd. Tried: the next commit for mail of others follows after 5 ms "
    "instead of 20"
)
_HEALTH: Final = (
    "at rest nine tenths of the time are the health of each agent, which is collected once a second. Tried: one health "
    "record for all agents, no timer of an agent at rest, counters added up once"
)
_GROWS: Final = (
    "Which part of an agent grows with the number of the others is not known. Tried: manifests are read once for all "
    "robots, keys that are used again are declared once"
)


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    parts = [
        origin.line(),
        f"An fsync of this disk takes {figures.fsync:.2f} ms. Per cent are of one core.",
        _at_rest(figures.crowds),
        _grows(figures.crowds),
        f"As fast as they can ({figures.counted}):",
        _talking([(one.agents, one.hurried) for one in figures.crowds]),
        "The same with `mail: {synchronous: normal}`:",
        _talking([(one.agents, one.normal) for one in figures.crowds]),
    ]
    if figures.alone.count:
        parts.append(
            "Two agents of which one asks while nothing else happens, question to answer (p50 / p99): in one daemon "
            f"{figures.alone} ms, on two boards {figures.across} ms."
        )
    return {"crowd": "\n\n".join(part for part in parts if part)}


def _at_rest(crowds: list[Crowd]) -> str:
    head = (
        "| agents | starts in | processor time of the start | memory of agentd | for each agent more "
        "| at rest: agentd, commd | ends in |"
    )
    first, rows = crowds[0], []
    for one in crowds:
        more = one.agents - first.agents
        each = f"{(one.rss - first.rss) / more:.2f} MB" if more else ""
        start = f"{one.start:.1f} s", f"{one.cpu_start:.1f} s"
        rest = f"{one.idle:.1f} %, {one.commd_idle:.1f} %"
        rows.append(row(f"{one.agents:,}", *start, f"{one.rss:.0f} MB", each, rest, f"{one.stop:.1f} s"))
    return "\n".join(table(head, rows))


def _grows(crowds: list[Crowd]) -> str:
    if len(crowds) < fits.SIZES:
        return ""
    names = {"memory": "rss", "start": "cpu_start", "agentd at rest": "idle", "commd at rest": "commd_idle"}
    growths = {what: fits.power(_points(crowds, name)) for what, name in names.items()}
    grown = "; ".join(f"{what}: {one}, off by {one.off:.0%} at worst" for what, one in growths.items())
    return f"How it grows, by least squares (size ^ 1 = in proportion; processor time of the start): {grown}."


def _points(crowds: list[Crowd], what: str) -> list[tuple[float, float]]:
    return [(float(one.agents), getattr(one, what)) for one in crowds]


def _talking(loads: list[tuple[int, Loaded | None]]) -> str:
    head = (
        "| agents | questions | answered | messages/s | question to answer, p50 | p99 | worst "
        "| slowest agent against the median one | agentd | commd |"
    )
    rows = []
    for agents, load in loads:
        if load is not None:
            took = (f"{one:.0f} ms" for one in (load.took.p50, load.took.p99, load.took.max))
            busy = f"x {load.fairness:.1f}", f"{load.agentd:.0f} %", f"{load.commd:.0f} %"
            rows.append(row(f"{agents:,}", f"{load.asked:,}", f"{load.answered:,}", f"{load.rate:.0f}", *took, *busy))
    return "\n".join(table(head, rows))
