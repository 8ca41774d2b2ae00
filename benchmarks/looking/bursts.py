"""What one look at an agent, or hearing what it does, takes of its daemon's processor time, all threads together.

The agent works in bursts that are alike: in each everything changes that a look would show. Bursts with somebody who
looks on are mixed with bursts with nobody, in one process; what the process uses for each is read to the nanosecond.
What differs is taken between bursts of one round, so that what changes on the machine meanwhile is in both.
"""

from __future__ import annotations

import asyncio
import random
import statistics
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.processes import BenchmarkFailed
from benchmarks.spread import Interval, interval
from benchmarks.watched import Watched
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import QueryFailed
from schemas.wire import keys
from schemas.wire.mind_records import MindActivity, MindDecisions, MindInputs, MindView
from schemas.wire.records import Health, Perception

FLEET: Final = "looking"
ANSWER_TIMEOUT: Final = 10.0
TRACES: Final[dict[str, Any]] = {"inputs": MindInputs, "decisions": MindDecisions, "activity": MindActivity}


@dataclass(frozen=True)
class Onlooker:
    """What one who looks on asks for and listens to."""

    key: str
    title: str
    selector: str | None = None
    """The parameters of its looks at each mind; None = it does not ask."""
    rate: float = 2.0
    """Hz."""
    traces: tuple[str, ...] = ()
    """What it listens to."""


RATE: Final = 2.0
"""Hz at which `argosy run`, `watch` and `ui` look at a mind."""
NOBODY: Final = Onlooker("nobody", "nobody")
CONTROL: Final = Onlooker("control", "nobody again: what the method itself is off by")
_RUN: Final = Onlooker("run", "`argosy run`: the mind without decisions", "?last=0")
_WATCH: Final = Onlooker(
    "watch", "`argosy watch`, `argosy ui`: the mind with plans and 30 decisions", "?plans=true;last=30"
)
LOOKS: Final = (_RUN, _WATCH)
LISTENERS: Final = (
    Onlooker("activity", "`argosy ui` besides: it hears activity", traces=("activity",)),
    Onlooker(
        "recorder", "`argosy record`: hears inputs, decisions and activity", traces=("inputs", "decisions", "activity")
    ),
)
ONLOOKERS: Final = (
    CONTROL,
    Onlooker("watch", f"`argosy watch`: the mind with plans and 30 decisions, {RATE:g} Hz", _WATCH.selector),
    Onlooker("ui", "`argosy ui`: the same, and its activity", _WATCH.selector, traces=("activity",)),
    Onlooker("greedy", "somebody who asks 50 times a second", "", 50.0),
    LISTENERS[1],
)


@dataclass(frozen=True)
class Stretch:
    """What an agent's daemon did between two of its healths."""

    cycles: float
    cpu: float
    """Seconds of processor time, of all its threads."""
    wall: float
    """Seconds between them."""
    lasted: float
    """Seconds of the whole stretch."""
    got: Counter[str]
    """How often the onlooker was answered, and what it heard."""


async def stretch(endpoint: str, agents: Sequence[str], onlooker: Onlooker, settle: float, seconds: float) -> Stretch:
    """Let somebody look on, and after `settle` seconds see what the agents' daemon does for so many more."""
    async with open_bus(endpoint, fleet=FLEET, name="onlooker", daemon="bench", stamp=time.time_ns) as bus:
        healths: dict[str, list[Health]] = {agent: [] for agent in agents}
        got: Counter[str] = Counter()

        def health(key: str, record: Health) -> None:
            healths[key.split("/")[2]].append(record)

        def trace(key: str, _: object) -> None:
            got[key.rsplit("/")[-1]] += 1

        for agent in agents:
            bus.subscribe(keys.health(FLEET, agent, "agentd"), Health, health)
        for part in onlooker.traces:
            bus.subscribe(keys.trace(FLEET, "*", part), TRACES[part], trace)
        looks = [
            asyncio.create_task(_look(bus, agent, onlooker, got)) for agent in agents if onlooker.selector is not None
        ]
        await asyncio.sleep(settle)
        got.clear()
        for heard in healths.values():
            heard.clear()
        begun = time.monotonic()
        while time.monotonic() < begun + seconds or any(len(heard) < 2 for heard in healths.values()):
            if time.monotonic() > begun + seconds + ANSWER_TIMEOUT:
                raise BenchmarkFailed(f"agentd told of its health less than twice in {seconds + ANSWER_TIMEOUT:g} s")
            await asyncio.sleep(0.05)
        lasted = time.monotonic() - begun
        for look in looks:
            look.cancel()
        for ended in await asyncio.gather(*looks, return_exceptions=True):
            if isinstance(ended, Exception):
                raise ended
        return _between(healths, got, lasted)


def _between(healths: dict[str, list[Health]], got: Counter[str], lasted: float) -> Stretch:
    cycles = sum(heard[-1].counters["cycles"] - heard[0].counters["cycles"] for heard in healths.values())
    first = next(iter(healths.values()))
    begun, ended = first[0], first[-1]
    return Stretch(cycles, ended.cpu - begun.cpu, (ended.header.stamp - begun.header.stamp) / 1e9, lasted, got)


async def _look(bus: Bus, agent: str, onlooker: Onlooker, got: Counter[str]) -> None:
    selector = keys.mind(FLEET, agent) + (onlooker.selector or "")
    while True:
        begun = time.monotonic()
        try:
            await bus.ask_one(selector, None, MindView, ANSWER_TIMEOUT)
        except QueryFailed as failed:
            raise BenchmarkFailed(f"a look at {agent} was not answered: {failed}") from None
        got["looks"] += 1
        await asyncio.sleep(max(0.0, begun + 1.0 / onlooker.rate - time.monotonic()))


AGENT: Final = "busy"
PROGRAM: Final = """\
n(0).
+go(N, End) <- !!work(N, End).
+!work(N, End) : N < End <- -+n(N); +seen(N mod 300); !leg(N); !!work(N + 1, End).
+!work(_, End) <- .print("end of ", End).
+!leg(N) : n(N) <- -seen((N + 150) mod 300).
"""
STEPS: Final = 300
"""Of a burst: each of the 300 beliefs comes and goes."""
PAUSE: Final = 0.03
"""Wall seconds before and behind a burst."""
HEARING: Final = 0.3
"""Wall seconds behind a burst that somebody hears: what is put four times a second has been put."""
WARM_UP: Final = 10


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


def used(pid: int) -> float:
    """Return the seconds of processor time of a process so far, of all its threads, those included that have ended."""
    return time.clock_gettime((~pid << 3) | 2)  # Linux: its clock, as clock_getcpuclockid(3) would name it


async def costs(
    endpoint: str, agentd: Watched, onlookers: Sequence[Onlooker], rounds: int, behind: float, warm_up: int = WARM_UP
) -> list[Cost]:
    """Measure all of them, each once a round, in another order each time, and nobody, too. Raises BenchmarkFailed.

    `behind` is the time behind a burst that belongs to it.
    """
    order: list[Onlooker] = [NOBODY, *onlookers]
    taken: dict[str, list[float]] = {one.key: [] for one in order}
    heard = dict.fromkeys(taken, 0)
    mixed = random.Random(1)
    async with open_bus(endpoint, fleet=FLEET, name="onlooker", daemon="bench", stamp=time.time_ns) as bus:
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
                opened = open_bus(self._endpoint, fleet=FLEET, name="ear", daemon="bench", stamp=time.time_ns)
                ear = await stack.enter_async_context(opened)
                for part in onlooker.traces:
                    ear.subscribe(keys.trace(FLEET, AGENT, part), TRACES[part], self._hear)
                await asyncio.sleep(behind)
            await asyncio.sleep(PAUSE)
            self.heard = 0
            before = used(self._agentd.process.pid)
            await self._burst()
            if onlooker.selector is not None:
                await self._look(onlooker.selector)
            await asyncio.sleep(behind)
            return 1000 * (used(self._agentd.process.pid) - before)

    def _hear(self, key: str, record: Any) -> None:
        self.heard += 1

    async def _burst(self) -> None:
        begun, self._done = self._done, self._done + STEPS
        self._bus.put(keys.percept(FLEET, AGENT, "go"), Perception(parameters=(begun, self._done)))
        until = time.monotonic() + ANSWER_TIMEOUT
        while not self._said(f"end of {self._done}"):
            if time.monotonic() > until:
                raise BenchmarkFailed(f"the agent has not worked within {ANSWER_TIMEOUT:g} s")
            await asyncio.sleep(0.005)

    def _said(self, words: str) -> bool:
        lines = self._agentd.said
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
