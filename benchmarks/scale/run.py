"""One run: so many UAVs with their agents, started as the product starts them, and looked at."""

from __future__ import annotations

import os
import tempfile
import time
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import msgspec

from argosy.processes.process_table import Setup, places, plan
from benchmarks.processes import BenchmarkFailed
from benchmarks.scale import health as scale_health
from benchmarks.scale import reading
from benchmarks.scale.daemons import lost_datagrams, sample, used
from benchmarks.scale.found import Run
from benchmarks.scale.mission import FLEET, Field, Vehicles, write_mission
from benchmarks.scale.talkers import Told
from benchmarks.watched import Watched, watched
from schemas.mission.model import load_mission

AT_ONCE: Final = 8
"""Simulators that start at the same time."""
PATIENCE: Final = 90.0
"""Seconds that all agents have to serve their vehicles, from the start of the last daemon."""
SETTLE: Final = 4.0
"""Seconds from then on before anything counts."""
TALKER: Final = 250
"""System id of the one vehicle that only talks among copters that fly: by it the latency is measured."""


def run(vehicles: Vehicles, size: int, *, seconds: float, own_links: bool = False, settle: float = SETTLE) -> Run:
    """Start everything, let it run, and look. Raises BenchmarkFailed if a process ends or nobody flies."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        made = write_mission(folder, vehicles, size, own_links=own_links, talker=TALKER if vehicles == "copters" else 0)
        parts, started = _started(stack, folder, made)
        records = stack.enter_context(scale_health.listening(made.router, FLEET))
        talkers = parts["talkers"][0]
        found = Run(vehicles, size, own_links, seconds)
        _wait_for_all(found, parts, size + (vehicles == "copters"), started)
        time.sleep(settle)
        pids = {kind: [one.process.pid for one in those] for kind, those in parts.items()}
        lost, begun, before = lost_datagrams(made.ports), time.monotonic(), sample(pids)
        time.sleep(seconds)
        after, ended = sample(pids), time.monotonic()
        found.seconds = ended - begun
        found.use = used(pids, before, after, found.seconds)
        found.busy = 100 * (1 - (after.idle - before.idle) / found.seconds / _cores())
        lost = lost_datagrams(made.ports) - lost
        time.sleep(1.0)  # what was sent last becomes a belief
        told = _told(talkers)
        _ended(parts)
        reading.latencies(found, parts["agentd"], told, begun, ended)
        reading.missed(found, records, told, begun, ended, lost)
        reading.simulators(found, parts.get("simulator", []), begun, ended)
        return found


def _started(stack: ExitStack, folder: Path, made: Field) -> tuple[dict[str, list[Watched]], float]:
    """Start the processes of the mission as `argosy run` does, and the vehicles that only talk.

    Returns them by their kinds, and when the first bridge was started.
    """
    mission = load_mission(made.mission)
    real = frozenset(name for name, robot in mission.robots.items() if robot.simulate is None)
    setup = Setup(mission, made.router, 1.0, real, folder / "state", places=places(mission, made.router))
    parts: defaultdict[str, list[Watched]] = defaultdict(list)
    begun = 0.0
    for process in plan(setup):
        kind = process.kind.name
        if kind == "bridged" and not parts[kind]:
            begun = time.monotonic()
        started = stack.enter_context(watched(process.name, *process.argv[1:]))
        parts[kind].append(started)
        if kind == "commd":
            started.says("router board=")
        elif kind == "simulator" and len(parts[kind]) % AT_ONCE == 0:
            for one in parts[kind][-AT_ONCE:]:
                one.says("simulated copter")
    where = [f"{robot.sysid}:{port}" for robot, port in zip(mission.robots.values(), made.ports, strict=True)
             if robot.simulate is None]  # fmt: skip
    talkers = ("-m", "benchmarks.scale.talkers", str(made.every), *where)
    parts["talkers"].append(stack.enter_context(watched("talkers", *talkers)))
    return dict(parts), begun


def _wait_for_all(found: Run, parts: dict[str, list[Watched]], wanted: int, begun: float) -> None:
    """Wait until the agents serve their vehicles; those that do not within `PATIENCE` are told of by their number."""
    agents, until = parts["agentd"][0], time.monotonic() + PATIENCE
    while True:
        served = {line.partition("]")[0]: at for at, line in list(agents.said) if line.endswith("] serves")}
        ended = [one.name for those in parts.values() for one in those if one.process.poll() is not None]
        if ended or (not served and time.monotonic() > until):
            last = "\n".join(line for those in parts.values() for one in those[:3] for _, line in one.said[-3:])
            raise BenchmarkFailed(
                f"{found.size} {found.vehicles}: ended: {ended}, serving: {len(served)}; last:\n{last}"
            )
        if len(served) == wanted or time.monotonic() > until:
            break
        time.sleep(0.1)
    found.serving, found.ready = len(served), max(served.values()) - begun


def _told(talkers: Watched) -> Told:
    talkers.process.terminate()
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        for _, line in reversed(talkers.said):
            if line.startswith("TOLD "):
                return msgspec.json.decode(line[5:], type=Told)
        time.sleep(0.05)
    raise BenchmarkFailed("the vehicles that only talk did not tell what they sent")


def _ended(parts: dict[str, list[Watched]]) -> None:
    """End what says something at its end: simulators."""
    for one in parts.get("simulator", []):
        one.process.terminate()
    for one in parts.get("simulator", []):
        one.process.wait(30)


def _cores() -> int:
    return os.cpu_count() or 1
