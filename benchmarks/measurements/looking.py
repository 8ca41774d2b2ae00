"""Part `looking`: the cost for an agent of queries of its mind and of subscriptions to its trace.

The agent works in equal bursts, in each of which everything changes that a query shows. Bursts with an observer are
mixed with bursts without one, in one process, whose processor time is read to the nanosecond. Differences are taken
between bursts of one round, so that changes of the machine are in both. From them follows the loss of throughput of an
agent that reasons without a pause.
"""

from __future__ import annotations

import asyncio
import random
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import AsyncExitStack, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.parts import Goal, line_of_goals, progress, row, table
from benchmarks.processes import BenchmarkFailed, Watched
from benchmarks.results import Origin
from benchmarks.serving import Site
from benchmarks.spread import Interval, interval
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import QueryFailed
from schemas.wire import keys
from schemas.wire.mind_records import MindActivity, MindDecisions, MindInputs, MindView
from schemas.wire.records import Perception

GOAL: Final = 2.0
"""Per cent of a busy agent's throughput that somebody who looks at it may take."""
RATE: Final = 2.0
"""Hz at which `argosy run`, `watch` and `ui` look at a mind."""
PUT_AT_MOST: Final = 4.0
"""Hz at which a mind puts what it has done."""
LOOKING: Final = ("run", "watch")
VIEWS: Final = {"run": ("run",), "watch": ("watch",), "ui": ("watch", "activity")}
"""What the commands that look on do: looks, and what they listen to."""
FLEET: Final = "looking"
AGENT: Final = "busy"
ANSWER_TIMEOUT: Final = 10.0
TRACES: Final[dict[str, Any]] = {"inputs": MindInputs, "decisions": MindDecisions, "activity": MindActivity}
STEPS: Final = 300
"""Of a burst: each of the 300 beliefs comes and goes."""
PAUSE: Final = 0.03
"""Wall seconds before and behind a burst."""
HEARING: Final = 0.3
"""Wall seconds behind a burst that somebody hears: what is put four times a second has been put."""
WARM_UP: Final = 10
"""Bursts before the first that counts."""
LOOKED, HEARD = 120, 60
"""Bursts with each who looks, and with each who listens."""
PROGRAM: Final = """\
n(0).
+go(N, End) <- !!work(N, End).
+!work(N, End) : N < End <- -+n(N); +seen(N mod 300); !leg(N); !!work(N + 1, End).
+!work(_, End) <- .print("end of ", End).
+!leg(N) : n(N) <- -seen((N + 150) mod 300).
"""
_UNDECIDED: Final = (
    "the interval holds the goal: processor time of so short bursts differs more from one to the next than what a look "
    "takes; tried: neighbours of one round are compared; more rounds make the interval narrower"
)
_SPENT: Final = (
    "a look at a mind is made and encoded in the agent's own process; which part of it takes the most is not known "
    "here; tried: `argosy {view}` asks for no more than it shows, and activity is put at most four times a second"
)


@dataclass(frozen=True)
class Onlooker:
    """What one who looks on asks for and listens to."""

    key: str
    title: str
    selector: str | None = None
    """The parameters of its looks at the mind; None = it does not ask."""
    traces: tuple[str, ...] = ()
    """What it listens to."""


NOBODY: Final = Onlooker("nobody", "nobody")
LOOKS: Final = (
    Onlooker("run", "`argosy run`: the mind without decisions", "?last=0"),
    Onlooker("watch", "`argosy watch`, `argosy ui`: the mind with plans and 30 decisions", "?plans=true;last=30"),
    Onlooker("control", "nobody again: what the method itself is off by"),
)
LISTENERS: Final = (
    Onlooker("activity", "`argosy ui` besides: it hears activity", traces=("activity",)),
    Onlooker(
        "recorder", "`argosy record`: hears inputs, decisions and activity", traces=("inputs", "decisions", "activity")
    ),
)


@dataclass
class Cost:
    """What somebody who looks on takes."""

    key: str
    title: str
    extra: Interval
    """Milliseconds of processor time more for a burst."""
    work: float
    """Milliseconds of a burst with nobody."""
    heard: float
    """Answers and records that came to the onlooker for each burst."""

    def lost(self) -> Interval:
        """Return the per cent of its throughput that an agent loses which reasons without a pause."""
        if self.key in LOOKING:  # milliseconds a look, so many looks a second
            return self.extra.scaled(RATE / 10)
        if self.key == "activity":  # what was done is put so often at most, however much it is
            return self.extra.scaled(PUT_AT_MOST / 10 / max(self.heard, 0.01))
        return self.extra.scaled(100 / self.work)  # inputs and decisions grow with the work

    def row(self) -> str:
        """Return a row of the table."""
        rate = {"activity": PUT_AT_MOST, **dict.fromkeys(LOOKING, RATE)}.get(self.key)
        often = "" if rate is None else f" at {rate:g} Hz"
        lost = f"{self.lost().text(' %', 2)}{often}"
        return row(self.title, self.extra.count, f"{self.work:.1f} ms", self.extra.text(" ms", 2), lost)


@dataclass
class Figures:
    """All that was measured."""

    costs: list[Cost]


def measure(quick: bool) -> Figures:
    """Measure all who look, then all who listen. Raises BenchmarkFailed."""
    looked, heard, warm_up = (3, 2, 2) if quick else (LOOKED, HEARD, WARM_UP)
    progress("what one look takes")
    with _daemons() as (endpoint, agentd):
        found = asyncio.run(costs(endpoint, agentd, LOOKS, looked, PAUSE, warm_up))
        progress("what listening takes")
        return Figures(found + asyncio.run(costs(endpoint, agentd, LISTENERS, heard, HEARING, warm_up)))


@contextmanager
def _daemons() -> Iterator[tuple[str, Watched]]:
    """Run a router and the agent; yields the endpoint and agentd. Raises BenchmarkFailed."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        mission = f"mission: {FLEET}\nagents: {{{AGENT}: {{program: looking.asl}}}}\ninject: true"
        site = Site.written(folder, mission, looking=PROGRAM)
        site.serve(stack, "commd")
        yield site.router, site.serve(stack, "agentd")


async def costs(
    endpoint: str, agentd: Watched, onlookers: Sequence[Onlooker], rounds: int, behind: float, warm_up: int
) -> list[Cost]:
    """Measure all of them, each once a round, in another order each time, and nobody, too. Raises BenchmarkFailed.

    `behind` is the time in seconds behind a burst that belongs to it.
    """
    order: list[Onlooker] = [NOBODY, *onlookers]
    taken: dict[str, list[float]] = {one.key: [] for one in order}
    heard = dict.fromkeys(taken, 0)
    mixed = random.Random(1)
    async with open_bus(endpoint, fleet=FLEET, name="onlooker", daemon="bench") as bus:
        bursts = _Bursts(endpoint, bus, agentd)
        for _ in range(warm_up):
            await bursts.one(NOBODY, PAUSE)
        for _ in range(rounds):
            mixed.shuffle(order)
            for one in order:
                taken[one.key].append(await bursts.one(one, behind))
                heard[one.key] += bursts.heard
    alone = taken[NOBODY.key]
    return [
        Cost(
            one.key,
            one.title,
            interval([more - less for more, less in zip(taken[one.key], alone, strict=True)]),
            statistics.median(alone),
            heard[one.key] / rounds,
        )
        for one in onlookers
    ]


class _Bursts:
    """Lets the agent work, and somebody look on."""

    def __init__(self, endpoint: str, bus: Bus, agentd: Watched) -> None:
        self._endpoint, self._bus, self._agentd, self._done, self._read = endpoint, bus, agentd, 0, 0
        self.heard = 0
        """Answers and records of the last burst."""

    async def one(self, onlooker: Onlooker, behind: float) -> float:
        """Return the milliseconds of processor time that a burst takes, and what the onlooker wants of it."""
        async with AsyncExitStack() as stack:
            self.heard = 0
            if onlooker.traces:
                opened = open_bus(self._endpoint, fleet=FLEET, name="ear", daemon="bench")
                ear = await stack.enter_async_context(opened)
                for part in onlooker.traces:
                    ear.subscribe(keys.trace(FLEET, AGENT, part), TRACES[part], self._hear)
                await asyncio.sleep(behind)
            await asyncio.sleep(PAUSE)
            self.heard = 0
            before = self._agentd.cpu()
            await self._burst()
            if onlooker.selector is not None:
                await self._look(onlooker.selector)
            await asyncio.sleep(behind)
            return 1000 * (self._agentd.cpu() - before)

    def _hear(self, key: str, record: Any) -> None:
        self.heard += 1

    async def _burst(self) -> None:
        begun, self._done = self._done, self._done + STEPS
        self._bus.put(keys.percept_by_hand(FLEET, AGENT, "go"), Perception(parameters=(begun, self._done)))
        until = time.monotonic() + ANSWER_TIMEOUT
        while not self._printed(f"end of {self._done}"):
            if time.monotonic() > until:
                raise BenchmarkFailed(f"the agent has not worked within {ANSWER_TIMEOUT:g} s")
            await asyncio.sleep(0.005)

    def _printed(self, words: str) -> bool:
        lines = self._agentd.output
        while self._read < len(lines):
            self._read += 1
            if lines[self._read - 1][1].endswith(words):
                return True
        return False

    async def _look(self, selector: str) -> None:
        try:
            await self._bus.ask_one(keys.mind(FLEET, AGENT) + selector, None, MindView, ANSWER_TIMEOUT)
        except QueryFailed as failed:
            raise BenchmarkFailed(f"a look was not answered: {failed}") from None
        self.heard += 1


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of those that look on: the whole interval is held against the goal."""
    costs = {one.key: one.lost() for one in figures.costs}
    found = []
    for view, (first, *others) in VIEWS.items():
        lost = costs[first]
        for part in others:
            lost = lost.plus(costs[part])
        undecided = lost.low < GOAL <= lost.high
        why = (_UNDECIDED if undecided else _SPENT).format(view=view)
        title = f"what a busy agent loses by `argosy {view}` at {RATE:g} Hz"
        wanted = f"under {GOAL:g} %, with 95 %"
        found.append(Goal(title, wanted, lost.text(" %", 2), lost.high < GOAL, why, decided=not undecided))
    return found


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/measurements/daemons.md."""
    head = "| observer | bursts | a burst alone | more by one query, or by publishing | lost |"
    lines = [
        origin.line(),
        "",
        *line_of_goals(goals(figures)),
        "",
        f"Processor time of agentd, all threads, for a burst of {STEPS} steps of a program, with and without somebody; "
        "medians of differences, in brackets their intervals of 95 %.",
        "",
        *table(head, (one.row() for one in figures.costs)),
    ]
    return {"looking": "\n".join(lines)}
