"""Part `bridge`: the cost of three vehicles on one link in one bridge, and the latency from a byte to an event.

The fleet is that of part `scale`. The latency goes from the moment before a datagram is sent to the line that a plan
prints for the event: it includes the bridge, the bus, the mind's cycle and the pipe of the output.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Final

from benchmarks.measurements.fleet import run
from benchmarks.measurements.vehicles import POSITIONS, RATES
from benchmarks.parts import Goal, at_most, line_of_goals, table
from benchmarks.processes import BenchmarkFailed, memory, watched
from benchmarks.results import Origin
from benchmarks.serving import bare
from benchmarks.spread import Spread
from tests.support.ports import free_port

SECONDS: Final = 45.0
WARM_UP: Final = 8.0
"""Seconds of traffic before anything is measured: connecting, streams, first percepts."""
GOAL_CPU, GOAL_RSS, GOAL_P99 = 5.0, 15.0, 5.0
"""Per cent of a core, MB above a bare process, milliseconds."""
VEHICLES: Final = 3

_DIALECT: Final = "pymavlink.dialects.v20.ardupilotmega"
_EVERY: Final = ("asyncio", "msgspec")
"""What each daemon has imported, and the bare process as well."""


@dataclass(frozen=True)
class Figures:
    """What one run measured."""

    seconds: float
    messages: float
    """MAVLink messages a second, of all vehicles."""
    cpu: float
    """Per cent of a core."""
    rss: float
    bare: float
    dialect: float
    """MB: of the bridge, of a bare process, and of one that has imported pymavlink's dialect besides."""
    latency: Spread
    """Milliseconds."""
    lost: int
    """Positions that made no event."""
    missed: dict[str, int] = field(default_factory=dict)
    """What else was missed or lost, as the daemons and the kernel count it."""
    lag: dict[str, float] = field(default_factory=dict)
    """Seconds by which the loop of each kind of daemon was late at worst."""


def measure(quick: bool, seconds: float = SECONDS) -> Figures:
    """Run everything once. Raises BenchmarkFailed."""
    seconds, warm_up = (2.0, 3.0) if quick else (seconds, WARM_UP)
    found = run(VEHICLES, seconds=seconds, settle=warm_up)
    if not found.percept.count:
        raise BenchmarkFailed("no position became an event")
    held, with_dialect = _bare_memory(_EVERY), _bare_memory((*_EVERY, _DIALECT))
    bridge, positions = found.use["bridged"], (found.percept.count + found.unseen) / found.seconds
    return Figures(
        found.seconds,
        positions * sum(RATES.values()) / POSITIONS,
        bridge.cpu,
        bridge.rss,
        held,
        with_dialect,
        found.percept,
        found.unseen,
        {what: count for what, count in found.missed.items() if count},
        found.lag,
    )


def _bare_memory(modules: tuple[str, ...]) -> float:
    """Return the MB of a process that has a session with a router and modules, and nothing else."""
    with ExitStack() as stack:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        stack.enter_context(watched("router", *bare(endpoint, mode="router"))).wait_for("open")
        process = stack.enter_context(watched("bare", *bare(endpoint, *modules)))
        process.wait_for("open")
        time.sleep(1.0)
        return memory(process.process.pid, "VmRSS")


def probe(quick: bool) -> dict[str, float]:
    """Return what a bridge costs: less is better."""
    figures = measure(quick, 15.0)
    return {
        "processor time a message (µs)": 1e4 * figures.cpu / figures.messages,
        "memory (MB)": figures.rss,
        "byte in to belief event, p50 (ms)": figures.latency.p50,
        "byte in to belief event, p99 (ms)": figures.latency.p99,
        "positions without event, and 1": 1 + figures.lost,
    }


_LATE: Final = (
    "what is late is known only at its two ends: sender, bridge, router, mind and the pipe to the sender share the "
    "cores, and which of them waits is not known; tried: a percept takes one pass of the agent's loop and one lazy "
    "timer, keys are declared once, only changes are published"
)


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of a bridge."""
    above, part = figures.rss - figures.bare, figures.dialect - figures.bare
    messages = (
        f"at {figures.messages:.0f} messages a second; where it goes was not measured by this part; tried: only what "
        "has changed is published, keys are declared once"
    )
    held = (
        f"{figures.rss:.1f} beside {figures.bare:.1f} MB; pymavlink's dialect alone is {part:.1f} MB of it; tried: the "
        "daemon imports no package but those that tests/test_imports.py names"
    )
    lost = (
        f"of {figures.latency.count + figures.lost:,}; where they were lost (kernel, bridge, bus or mind), or whether "
        "they came after the count, is not known; tried: a second of rest before the count"
    )
    return [
        at_most("processor time of the bridge", GOAL_CPU, figures.cpu, "% of a core", messages),
        at_most("memory of a bridge above a bare process (RSS)", GOAL_RSS, above, "MB", held),
        at_most("byte in to belief event, p99", GOAL_P99, figures.latency.p99, "ms", _LATE, digits=2),
        at_most("positions that made no event", 0, figures.lost, "", lost, digits=0),
    ]


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/measurements/daemons.md."""
    latency = figures.latency
    lines = [
        origin.line(),
        "",
        f"{VEHICLES} vehicles on one UDP link in one bridge, {sum(RATES.values())} messages a second each "
        f"({figures.messages:.0f} msg/s in all, measured), for {figures.seconds:.0f} s.",
        "",
        *line_of_goals(goals(figures)),
        "",
        f"Byte in to belief event: p50 {latency.p50:.2f} ms, mean {latency.mean:.2f} ms, the slowest "
        f"{latency.max:.1f} ms, of {latency.count} positions; {figures.lost} made no event. Of the memory "
        f"above a bare process {figures.dialect - figures.bare:.1f} MB are pymavlink's dialect.",
        *_late_and_missed(figures),
    ]
    return {"bridge": "\n".join(lines)}


def _late_and_missed(figures: Figures) -> list[str]:
    """Return which part was late and what was missed, as the daemons and the kernel count it; none for old results."""
    if not figures.lag:
        return []
    late = table(
        "| loop late at worst | by |", (f"| {kind} | {1000 * lag:.0f} ms |" for kind, lag in figures.lag.items())
    )
    missed = "; ".join(f"{what}: {count}" for what, count in figures.missed.items()) or "nothing"
    return ["", *late, "", f"Missed or lost, as daemons and kernel count it: {missed}."]
