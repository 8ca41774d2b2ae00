"""Part `trial`: the speed and the memory of `argosy trial` in virtual time.

Runs without faults, one at a time, each in its own process as in any trial. The fleet is flown once.
"""

from __future__ import annotations

import statistics
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.parts import Goal, at_least, at_most, progress, table
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
_PATIENCE: Final = 3600.0
"""Wall seconds that a run may take."""
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
        with workers(1, _PATIENCE) as run_all:
            outcomes = list(run_all(Request(str(path), seed + 1) for seed in range(1 if quick else RUNS[name])))
        if failed := [one for one in outcomes if not one.success]:
            raise BenchmarkFailed(f"{name}, seed {failed[0].seed}: {failed[0].why}")
        flown = Flown(
            name,
            len(load_mission(path).robots),
            [one.seconds for one in outcomes],
            [one.cpu for one in outcomes],
            [one.memory / 1e6 for one in outcomes],
        )
        progress(f"{MISSIONS[name]}: {flown.times:.0f} times real time")
        found.append(flown)
    return found


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
    return {"trial": "\n".join(lines)}


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of a run: its speed by vehicles, and its memory."""
    found = []
    for one in figures.flown:
        name = MISSIONS[one.mission]
        fast, held = f"trial of {name}: vehicle-seconds that a second of a core flies", f"memory of a run of {name}"
        found.append(at_least(fast, FASTER, one.times * one.vehicles, why=_SLOW))
        found.append(at_most(held, MEMORY, max(one.memory), "MB", _HELD, digits=0))
    return found


_SLOW: Final = (
    "how much less each part may take is not known. Tried: one process for all daemons, no threads, no waiting"
)
_HELD: Final = "not known: it has not been looked at which modules and records take it, nothing was tried"
