"""What a bridge costs: three vehicles on one link in one bridge, and how long a byte takes to become an event.

A router, the bridge and the agents run as the processes that they are on a board; the vehicles are talkers in this one.
The latency goes from the moment before a datagram is sent to the line that a plan prints for the event, so it holds the
bridge, the bus, the mind's cycle and the way of the line back to here.
"""

from __future__ import annotations

import re
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.parts import Goal, line_of_goals, tell
from benchmarks.processes import BenchmarkFailed, Watched, memory, watched
from benchmarks.results import Origin
from benchmarks.serving import Site
from benchmarks.serving import bare as bare_process
from benchmarks.spread import Spread, spread
from benchmarks.traffic import RATES, Talker, talk
from tests.support.ports import free_port

SECONDS: Final = 45.0
WARM_UP: Final = 8.0
"""Seconds of traffic before anything is measured: connecting, streams, first percepts."""
GOAL_CPU, GOAL_RSS, GOAL_P99 = 5.0, 15.0, 5.0
"""Per cent of a core, MB above a bare process, milliseconds."""
VEHICLES: Final = 3

_DIALECT: Final = "pymavlink.dialects.v20.ardupilotmega"
_PROGRAM = "+altitude(A) <- .print(A).\n"
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


def measure(quick: bool) -> Figures:
    """Run everything once. Raises BenchmarkFailed."""
    seconds, warm_up = (2.0, 3.0) if quick else (SECONDS, WARM_UP)
    with ExitStack() as stack:
        folder, port = Path(stack.enter_context(tempfile.TemporaryDirectory())), free_port()
        names = [f"uav{number}" for number in range(1, VEHICLES + 1)]
        agents = "\n".join(f"  agent{index}: {{program: bench.asl, robot: {n}}}" for index, n in enumerate(names, 1))
        robots = "\n".join(
            f"  {name}: {{manifest: arducopter, link: 'udpin:127.0.0.1:{port}', sysid: {index}}}"
            for index, name in enumerate(names, 1)
        )
        site = Site.written(folder, f"mission: bench\nagents:\n{agents}\nrobots:\n{robots}", bench=_PROGRAM)
        site.serve(stack, "commd")
        bare = stack.enter_context(watched("bare", *bare_process(site.router, *_EVERY)))
        dialect = stack.enter_context(watched("bare with dialect", *bare_process(site.router, *_EVERY, _DIALECT)))
        bare.says("open")
        dialect.says("open")
        bridge = site.serve(stack, "bridged", *names)
        for name in names:
            bridge.says(f"serving {name}")
        agentd = site.serve(stack, "agentd")
        talkers = [Talker(number, ("127.0.0.1", port)) for number in range(1, VEHICLES + 1)]
        for talker in talkers:
            stack.callback(talker.close)
        begun, used = 0.0, 0.0
        tell(f"{VEHICLES} vehicles talk for {warm_up + seconds:.0f} s")

        def warm() -> None:
            nonlocal begun, used
            for talker in talkers:
                talker.sent.clear()
                talker.messages = 0
            begun, used = time.monotonic(), bridge.cpu()

        talk(talkers, seconds, warm_up, warm)
        spent, used = time.monotonic() - begun, bridge.cpu() - used
        rss, rss_bare, rss_dialect = (memory(one.process.pid, "VmRSS") for one in (bridge, bare, dialect))
        time.sleep(1.0)
        latencies, lost = _latencies(talkers, agentd)
        messages = sum(talker.messages for talker in talkers) / spent
        return Figures(spent, messages, 100 * used / spent, rss, rss_bare, rss_dialect, spread(latencies), lost)


_PRINTED = re.compile(r"\[agent(\d+)\] (\d+)$")


def _latencies(talkers: list[Talker], agentd: Watched) -> tuple[list[float], int]:
    came = {(int(m[1]), int(m[2])): at for at, line in agentd.said if (m := _PRINTED.search(line))}
    sent = {(talker.system, altitude): at for talker in talkers for altitude, at in talker.sent.items()}
    if not sent or not (both := sent.keys() & came.keys()):
        raise BenchmarkFailed("no position became an event")
    return [1000 * (came[one] - sent[one]) for one in both], len(sent) - len(both)


_LATE: Final = (
    "what is late is known only at its two ends: sender, bridge, router, mind and the pipe to the sender share the "
    "cores, and which of them waits is not known; tried: a percept takes one pass of the agent's loop and one lazy "
    "timer, keys are declared once, only changes are told"
)


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of a bridge."""
    above, part = figures.rss - figures.bare, figures.dialect - figures.bare
    told = f"{above:.1f} MB ({figures.rss:.1f} - {figures.bare:.1f})"
    p99, lost, of = figures.latency.p99, figures.lost, figures.latency.count + figures.lost
    return [
        Goal(
            "processor time of the bridge",
            f"{GOAL_CPU:g} % of a core",
            f"{figures.cpu:.1f} %",
            figures.cpu <= GOAL_CPU,
            f"at {figures.messages:.0f} messages a second; where it goes was not measured by this part; tried: only "
            "what has changed is told, keys are declared once",
        ),
        Goal(
            "memory of a bridge above a bare process (RSS)",
            f"{GOAL_RSS:g} MB",
            told,
            above <= GOAL_RSS,
            f"pymavlink's dialect alone is {part:.1f} MB of it; tried: the daemon imports no package but those that "
            "tests/test_imports.py names",
        ),
        Goal("byte in to belief event, p99", f"{GOAL_P99:g} ms", f"{p99:.2f} ms", p99 <= GOAL_P99, _LATE),
        Goal(
            "positions that made no event",
            "none",
            f"{lost:,} of {of:,}",
            not lost,
            "where they were lost (kernel, bridge, bus or mind), or whether they came after the count, is not known; "
            "tried: a second of rest before the count, and nothing else yet",
        ),
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
    ]
    return {"bridge": "\n".join(lines)}
