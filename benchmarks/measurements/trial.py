"""Part `trial`: how fast `argosy trial` flies missions in virtual time, what a run takes, and where the time goes.

Runs without faults, one at a time, each in its own process as in any trial. The profile is of one further run of each
mission, in a process of its own: `python -m benchmarks.measurements.trial MISSION` prints CPU seconds by package.
The fleet is flown once, and not profiled.
"""

from __future__ import annotations

import cProfile
import json
import os
import pstats
import statistics
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Final

from benchmarks.parts import Goal, table, tell
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import ROOT, Origin

FLEET: Final = 100
"""Copters of the fleet, each with its agent, on one board."""
ROUNDS: Final = 41
"""Flights there and back of each of them: a mission of ten minutes."""
MISSIONS: Final = {
    "single_uav": "single UAV",
    "search_and_rescue": "search and rescue, three boards",
    "fleet": f"{FLEET} copters, one board",
}
RUNS: Final = {"single_uav": 10, "search_and_rescue": 5, "fleet": 1}
FASTER: Final = 150.0
"""Vehicle-seconds that one second of a core is to fly."""
MEMORY: Final = 150.0
"""MB that a run is to stay below."""
SHOWN: Final = 8
"""Packages in the table."""
_PATIENCE: Final = 300.0
_FLEET_PATIENCE: Final = 3600.0
_PROGRAM: Final = """\
!patrol.
+!patrol : post(Lat, Long, Height) & rounds(Rounds)
  <- .wait(bridge(up), 120000);
     set_mode("GUIDED");
     arm_motors(true);
     takeoff(Height);
     for (.range(_, 1, Rounds)) {
        goto(Lat + 0.0002, Long, Height);
        goto(Lat, Long, Height)
     };
     return_to_launch;
     +home_again.
"""


@dataclass
class Flown:
    """The runs of one mission."""

    mission: str
    vehicles: int
    seconds: list[float]
    """Virtual seconds of each run."""
    cpu: list[float]
    """CPU seconds of each run."""
    memory: list[float]
    """MB that each run's process had at most, with what it shares with the worker that forked it."""
    packages: dict[str, float]
    """Share of the profiled run's time in the code of each package, 0 to 1."""

    @property
    def times(self) -> float:
        """Virtual seconds of a CPU second."""
        return sum(self.seconds) / sum(self.cpu)


@dataclass
class Figures:
    """What was measured."""

    flown: list[Flown]


def write_fleet(folder: Path, size: int, rounds: int) -> Path:
    """Write a mission of copters that fly to and fro, each with its agent and its link, and return its path."""
    (folder / "patrol.asl").write_text(_PROGRAM)
    lines = ["mission: fleet", "agents:"]
    posts = [(one, -27.604 + 0.0005 * (one % 10), -48.518 + 0.0005 * (one // 10)) for one in range(1, size + 1)]
    for one, lat, lon in posts:
        beliefs = f'["post({lat:.4f}, {lon:.4f}, 10)", "rounds({rounds})"]'
        lines.append(f"  agent{one}: {{program: patrol.asl, robot: uav{one}, beliefs: {beliefs}}}")
    lines.append("robots:")
    for one, lat, lon in posts:
        simulate = f"{{vehicle: copter, home: [{lat:.4f}, {lon:.4f}, 21.0]}}"
        link = f"udpin:127.0.0.1:{15_000 + one}"
        lines.append(f"  uav{one}: {{manifest: copter, link: '{link}', sysid: {one}, simulate: {simulate}}}")
    done = ", ".join(f'"agent{one}: home_again"' for one, _, _ in posts)
    (path := folder / "fleet.yaml").write_text("\n".join([*lines, f"done: [{done}]", "timeout: 30min", ""]))
    return path


def measure(quick: bool) -> Figures:
    """Fly each mission, and profile it. Raises BenchmarkFailed."""
    with tempfile.TemporaryDirectory() as folder:
        return Figures(_flown(quick, Path(folder)))


def _flown(quick: bool, folder: Path) -> list[Flown]:
    from argosy.trial.single_run import Request
    from argosy.trial.workers import workers
    from schemas.mission.model import load_mission

    found = []
    for name in list(MISSIONS)[:1] if quick else MISSIONS:
        path = write_fleet(folder, FLEET, ROUNDS) if name == "fleet" else ROOT / f"missions/{name}.yaml"
        with workers(1, _FLEET_PATIENCE) as run_all:
            outcomes = list(run_all(Request(str(path), seed + 1) for seed in range(1 if quick else RUNS[name])))
        if failed := [one for one in outcomes if not one.success]:
            raise BenchmarkFailed(f"{name}, seed {failed[0].seed}: {failed[0].why}")
        flown = Flown(
            name,
            len(load_mission(path).robots),
            [one.seconds for one in outcomes],
            [one.cpu for one in outcomes],
            [one.memory / 1e6 for one in outcomes],
            {} if name == "fleet" else _profiled(str(path)),
        )
        tell(f"{MISSIONS[name]}: {flown.times:.0f} times real time")
        found.append(flown)
    return found


def _profiled(path: str) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.measurements.trial", path]
    environment = os.environ | {"PYTHONHASHSEED": "0"}
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, env=environment, timeout=_PATIENCE, check=False
    )
    if done.returncode != 0:
        raise BenchmarkFailed(f"the profile of {path}: {done.stderr[-500:]}")
    seconds: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return {name: one / sum(seconds.values()) for name, one in seconds.items()}


def profile(path: str) -> dict[str, float]:
    """Return the CPU seconds that one run spends in each package, the most first. Takes over the clocks for good."""
    from argosy.trial.edges import Authority
    from argosy.trial.worker import IMPORTED

    authority = Authority()
    authority.take_over()
    from argosy.trial.single_run import Request, fly

    for module in IMPORTED:
        import_module(module)
    profiler = cProfile.Profile()
    with tempfile.TemporaryDirectory() as folder:
        request = Request(path, 1, folder=folder)
        loop = authority.begin(1)
        profiler.runcall(fly, loop, request)
        os.chdir("/")
    seconds: dict[str, float] = defaultdict(float)
    for (file, _, function), (_, _, own, _, _) in pstats.Stats(profiler).stats.items():  # type: ignore[attr-defined]
        seconds[package(file, function)] += own
    return dict(sorted(seconds.items(), key=lambda one: -one[1]))


def package(file: str, function: str) -> str:
    """Return what the code of a function belongs to."""
    parts = file.split("/")
    for ours in ("argosy", "agentd", "bridged", "commd", "schemas"):
        if ours in parts:
            inner = parts[parts.index(ours) + 1]
            within = f"{ours}.{inner}" if (ours, inner) in (("argosy", "trial"), ("bridged", "simulation")) else ours
            return f"`{within}`"
    if file == "~":  # written in C: the function names its module
        for module in ("msgspec", "sqlite3"):
            if module in function:
                return module
        return "Python's built-in functions"
    for library in ("pymavlink", "zenoh", "asyncio", "msgspec"):
        if library in parts:
            return library
    return "the programs' compiled plans" if file.startswith("<") else "other libraries"


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    lines = [
        origin.line(),
        "",
        "Runs without faults, one at a time; CPU and memory are medians of the runs, without the start of the worker "
        "process, which all runs share.",
        "",
        *table(
            "| mission | runs | virtual seconds | CPU seconds | times real time | vehicle-seconds a second | memory |"
        ),
    ]
    lines += [
        f"| {MISSIONS[one.mission]} | {len(one.cpu)} | {statistics.median(one.seconds):.0f} "
        f"| {statistics.median(one.cpu):.2f} | {one.times:.0f} | {one.times * one.vehicles:.0f} "
        f"| {statistics.median(one.memory):.0f} MB |"
        for one in figures.flown
    ]
    profiled = [one for one in figures.flown if one.packages]
    head = "".join(f" {MISSIONS[one.mission]} |" for one in profiled)
    lines += ["", "Where the time of a run goes (cProfile, own time of all functions):", "", *table(f"| code |{head}")]
    sums: dict[str, float] = defaultdict(float)
    for one in profiled:
        for name, share in one.packages.items():
            sums[name] += share
    ranked = sorted(sums, key=lambda name: -sums[name])
    for name in ranked[:SHOWN]:
        cells = "".join(f" {100 * one.packages.get(name, 0.0):.0f} % |" for one in profiled)
        lines.append(f"| {name} |{cells}")
    rest = [sum(one.packages.get(name, 0.0) for name in ranked[SHOWN:]) for one in profiled]
    lines.append("| all else |" + "".join(f" {100 * one:.0f} % |" for one in rest))
    return {"trial": "\n".join(lines)}


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of a run: its speed by vehicles, and its memory."""
    found = []
    for one in figures.flown:
        speed, memory = one.times * one.vehicles, max(one.memory)
        why = (
            "the table of packages says where the time goes. Tried: one process for all daemons, no threads, no "
            "waiting; not known: how much less each part may take"
        )
        found += [
            Goal(
                f"trial of {MISSIONS[one.mission]}: vehicle-seconds that a second of a core flies",
                f"{FASTER:g}",
                f"{speed:.0f}",
                speed >= FASTER,
                why,
            ),
            Goal(
                f"memory of a run of {MISSIONS[one.mission]}",
                f"< {MEMORY:g} MB",
                f"{memory:.0f} MB",
                memory < MEMORY,
                "not known: it has not been looked at which modules and records take it, nothing was tried",
            ),
        ]
    return found


if __name__ == "__main__":
    print(json.dumps(profile(os.path.abspath(sys.argv[1]))))
