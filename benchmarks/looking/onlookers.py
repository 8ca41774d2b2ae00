"""Who looks at agents while these are measured: what `argosy run`, `watch`, `ui` and `record` ask of a mind."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.processes import BenchmarkFailed
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import QueryFailed
from schemas.wire import keys
from schemas.wire.mind_records import MindDecisions, MindDeeds, MindInputs, MindView
from schemas.wire.records import Health

FLEET: Final = "looking"
ANSWER_TIMEOUT: Final = 10.0
TRACES: Final[dict[str, Any]] = {"inputs": MindInputs, "decisions": MindDecisions, "deeds": MindDeeds}


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
    Onlooker("deeds", "`argosy ui` besides: it hears deeds", traces=("deeds",)),
    Onlooker("recorder", "`argosy record`: hears inputs, decisions and deeds", traces=("inputs", "decisions", "deeds")),
)
ONLOOKERS: Final = (
    CONTROL,
    Onlooker("watch", f"`argosy watch`: the mind with plans and 30 decisions, {RATE:g} Hz", _WATCH.selector),
    Onlooker("ui", "`argosy ui`: the same, and its deeds", _WATCH.selector, traces=("deeds",)),
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
