"""What a bridge costs: three vehicles on one link in one bridge, and how long a byte takes to become an event.

A router, the bridge and the agents run as the processes that they are on a board; the vehicles are talkers in this one.
The latency goes from the moment before a datagram is sent to the line that a plan prints for the event, so it holds the
bridge, the bus, the mind's cycle and the way of the line back to here.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import statistics
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.processes import BenchmarkFailed, memory
from benchmarks.traffic import RATES, Talker, talk
from benchmarks.watched import Watched, watched
from tests.support.ports import free_port

SECONDS: Final = 60.0
WARM_UP: Final = 8.0
"""Seconds of traffic before anything is measured: connecting, streams, first percepts."""
GOAL_CPU, GOAL_RSS, GOAL_P99 = 5.0, 15.0, 5.0
"""Per cent of a core, MB above a bare process, milliseconds."""
VEHICLES: Final = 3

_MISSION = """\
mission: bench
agents:
{agents}
robots:
{robots}
router: {{endpoint: {endpoint}}}
"""
_PROGRAM = "+altitude(A) <- .print(A).\n"
_BARE = """\
import asyncio, sys, msgspec, zenoh
class Perception(msgspec.Struct):
    name: str
msgspec.json.Decoder(Perception), msgspec.json.Encoder()
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("connect/endpoints", '["%s"]' % sys.argv[1])
async def main():
    with zenoh.open(config) as session:
        print("ready", flush=True)
        await asyncio.sleep(600)
asyncio.run(main())
"""


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
    """MB."""
    latencies: list[float]
    """Milliseconds, sorted."""
    lost: int
    """Positions that made no event."""

    def percentile(self, part: float) -> float:
        """Milliseconds that so large a part of the positions stayed under."""
        return self.latencies[min(len(self.latencies) - 1, round(part * len(self.latencies)))]


def measure(seconds: float, warm_up: float = WARM_UP) -> Figures:
    """Run everything once. Raises BenchmarkFailed."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
        mission = folder / "bench.yaml"
        (folder / "bench.asl").write_text(_PROGRAM)
        names = [f"uav{number}" for number in range(1, VEHICLES + 1)]
        agents = "\n".join(f"  agent{index}: {{program: bench.asl, robot: {n}}}" for index, n in enumerate(names, 1))
        robots = "\n".join(
            f"  {name}: {{manifest: arducopter, link: 'udpin:127.0.0.1:{port}', sysid: {index}}}"
            for index, name in enumerate(names, 1)
        )
        mission.write_text(_MISSION.format(agents=agents, robots=robots, endpoint=endpoint))
        state = ("--state", str(folder / "state"))
        router = stack.enter_context(watched("commd", "-m", "commd", "serve", str(mission)))
        router.says("commd")
        bare = stack.enter_context(watched("bare", "-c", _BARE, endpoint))
        bare.says("ready")
        bridge = stack.enter_context(watched("bridged", "-m", "bridged", "serve", str(mission), *names, *state))
        for name in names:
            bridge.says(f"serving {name}")
        agentd = stack.enter_context(watched("agentd", "-m", "agentd", "serve", str(mission), *state))
        agentd.says("agents=")
        talkers = [Talker(number, ("127.0.0.1", port)) for number in range(1, VEHICLES + 1)]
        for talker in talkers:
            stack.callback(talker.close)
        begun, used = 0.0, 0.0

        def warm() -> None:
            nonlocal begun, used
            for talker in talkers:
                talker.sent.clear()
                talker.messages = 0
            begun, used = time.monotonic(), bridge.cpu()

        talk(talkers, seconds, warm_up, warm)
        spent, used = time.monotonic() - begun, bridge.cpu() - used
        rss = memory(bridge.process.pid, "VmRSS"), memory(bare.process.pid, "VmRSS")
        time.sleep(1.0)
        latencies, lost = _latencies(talkers, agentd)
        return Figures(
            spent, sum(talker.messages for talker in talkers) / spent, 100 * used / spent, *rss, latencies, lost
        )


_PRINTED = re.compile(r"\[agent(\d+)\] (\d+)$")


def _latencies(talkers: list[Talker], agentd: Watched) -> tuple[list[float], int]:
    came = {(int(m[1]), int(m[2])): at for at, line in agentd.said if (m := _PRINTED.search(line))}
    sent = {(talker.system, altitude): at for talker in talkers for altitude, at in talker.sent.items()}
    if not sent or not (both := sent.keys() & came.keys()):
        raise BenchmarkFailed("no position became an event")
    return sorted(1000 * (came[one] - sent[one]) for one in both), len(sent) - len(both)


def report(figures: Figures) -> str:
    """The figures as a page."""
    above = figures.rss - figures.bare
    rows = (
        ("processor time of the bridge", f"{figures.cpu:.1f} % of a core", f"{GOAL_CPU:g} %", figures.cpu <= GOAL_CPU),
        (
            "memory above a bare process (RSS)",
            f"{above:.1f} MB ({figures.rss:.1f} - {figures.bare:.1f})",
            f"{GOAL_RSS:g} MB",
            above <= GOAL_RSS,
        ),
        ("byte in to belief event, p50", f"{figures.percentile(0.5):.2f} ms", "", None),
        (
            "byte in to belief event, p99",
            f"{figures.percentile(0.99):.2f} ms",
            f"{GOAL_P99:g} ms",
            figures.percentile(0.99) <= GOAL_P99,
        ),
    )
    table = "\n".join(
        f"| {what} | {value} | {goal} | {'' if met is None else 'met' if met else 'missed'} |"
        for what, value, goal, met in rows
    )
    measured = len(figures.latencies)
    python = platform.python_version()
    mean = f"{statistics.mean(figures.latencies):.2f} ms"
    return f"""# What a bridge costs

Written by `make bench-bridge`: {VEHICLES} vehicles on one UDP link in one bridge, {sum(RATES.values())} messages a
second each ({figures.messages:.0f} msg/s in all, measured), for {figures.seconds:.0f} s. Python {python},
{os.cpu_count()} cores of {platform.machine()}; router, bridge, agents and the vehicles' traffic share them.

| figure | measured | goal | |
|---|---|---|---|
{table}

* The bare process has a Zenoh session, msgspec and asyncio, and does nothing; it ran beside the bridge.
* The latency goes from the moment before a datagram is sent to the line that a plan prints for its `+altitude(A)`,
  read by the sender: it holds the bridge, the router, the agent's cycle and the pipe. {measured} positions were
  measured, {figures.lost} made no event; the slowest took {figures.latencies[-1]:.1f} ms, the mean {mean}.
"""


def main() -> int:
    """Measure, and write the page. Returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--out", type=Path, help="file for the report; none = the terminal only")
    args = parser.parse_args()
    try:
        text = report(measure(args.seconds))
    except BenchmarkFailed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(text)
    if args.out is not None:
        args.out.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
