"""`argosy referee`: what became of a search and rescue, judged by nothing that the fleet says of itself.

It knows the victims from the seed of the mission's world, and what fell from the copters from the servo logs of their
simulators. Of real copters, which have none, it has a recording of what the vehicles told of themselves. Each victim is
to get exactly one buoy, within 5 m, and no buoy is to fall anywhere else.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from argosy.processes.search_world import servo_log, victims
from argosy.processes.simulators import vehicle_of
from bridged.simulation.copter.servo_log import ServoMove, read_moves
from bridged.simulation.copter.world import Victim
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED
from schemas.files.findings import Findings
from schemas.geo import distance
from schemas.mission.model import Mission, load_mission

NEAR = 5.0
"""Metres over ground from a victim within which a buoy helps."""
LATCH = 9
"""The output that holds the buoy."""
OPEN = 1500
"""Microseconds from which on the latch is open."""
PAD, GROUND = 5.0, 0.5
"""Metres from home over ground, and above the ground, within which a copter takes a new buoy."""


@dataclass(frozen=True)
class Drop:
    """A buoy that fell."""

    robot: str
    at: float
    """Seconds since the copter was switched on, or since the recording began."""
    lat: float
    lon: float

    def metres_from(self, victim: Victim) -> float:
        """Metres over ground to a victim."""
        return distance((victim.lat, victim.lon), (self.lat, self.lon))


@dataclass
class Verdict:
    """What the referee saw."""

    rescues: dict[Victim, list[Drop]]
    """The buoys near each victim."""
    astray: list[Drop] = field(default_factory=list)
    """Buoys near nobody."""

    @property
    def good(self) -> bool:
        """Whether each victim got exactly one buoy and none fell elsewhere."""
        return not self.astray and all(len(drops) == 1 for drops in self.rescues.values())

    def __str__(self) -> str:
        lines = ["victim  buoys  by"]
        for victim, drops in self.rescues.items():
            by = ", ".join(f"{one.robot} {one.metres_from(victim):.1f} m off at {one.at:.0f} s" for one in drops)
            lines.append(f"{victim.number:6}  {len(drops):5}  {by or '-'}")
        lines += [f"astray: {one.robot} at {one.lat:.7f}, {one.lon:.7f} after {one.at:.0f} s" for one in self.astray]
        once = sum(len(drops) == 1 for drops in self.rescues.values())
        twice = sum(len(drops) > 1 for drops in self.rescues.values())
        never = sum(not drops for drops in self.rescues.values())
        told = f"{once} of {len(self.rescues)} victims got exactly one buoy"
        told += f", {never} none" if never else ""
        told += f", {twice} more than one" if twice else ""
        told += f", {len(self.astray)} buoys fell astray" if self.astray else ""
        return "\n".join([*lines, f"{'PASSED' if self.good else 'FAILED'}: {told}"])


def drops_of(robot: str, moves: Iterable[ServoMove], *, loaded: bool = True) -> list[Drop]:
    """Return the buoys that fell from a copter: its latch opened while it held one. `loaded`: it begins with one."""
    drops: list[Drop] = []
    shut = True
    for move in moves:
        if move.output != LATCH:
            continue
        opens = move.pulse >= OPEN
        if opens and shut and loaded:
            drops.append(Drop(robot, move.at, move.lat, move.lon))
            loaded = False
        elif not opens and move.home <= PAD and move.height <= GROUND and not move.armed:
            loaded = True
        shut = not opens
    return drops


def judge(everybody: Sequence[Victim], drops: Iterable[Drop]) -> Verdict:
    """Return which buoy fell near whom."""
    verdict = Verdict({victim: [] for victim in everybody})
    for drop in drops:
        nearest = min(everybody, key=drop.metres_from, default=None)
        if nearest is not None and drop.metres_from(nearest) <= NEAR:
            verdict.rescues[nearest].append(drop)
        else:
            verdict.astray.append(drop)
    return verdict


def judge_run(mission: Mission, report: Path) -> Verdict:
    """Judge the run that left its servo logs in a folder. Raises ValueError and OSError in words."""
    if mission.world is None:
        raise ValueError(f"{mission.path}: the mission has no `world`")
    drops: list[Drop] = []
    for name, robot in mission.robots.items():
        if vehicle_of(robot) == "copter":
            drops += drops_of(name, read_moves(servo_log(report, name)))
    return judge(victims(mission.world), drops)


def judge_recording(mission: Mission, file: Path) -> Verdict:
    """Judge what was recorded of a flight. Without a `world` the victims are those that a camera told of.

    Raises ValueError and OSError in words.
    """
    from argosy.recording.reader import open_recording
    from argosy.simulate.recorded_drops import copters_of, latch_field  # needs the extra `record`, which logs do not

    recording = open_recording(file)
    if recording.missing:
        print(f"warning: {recording.missing}", file=sys.stderr)
    copters, seen = copters_of(mission, recording, LATCH)
    if not copters:
        raise ValueError(f"{mission.path}: no robot's manifest has a percept of {'.'.join(latch_field(LATCH))}")
    everybody = seen if mission.world is None else victims(mission.world)
    if not everybody:
        raise ValueError(f"{file}: no camera told of a victim, and the mission has no `world`")
    drops: list[Drop] = []
    for name, copter in copters.items():
        moves = list(copter.moves(name, LATCH))
        drops += drops_of(name, moves, loaded=moves[0].pulse < OPEN)
    return judge(everybody, drops)


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy referee`."""
    parser.add_argument("mission", help="mission file, with the `world` that was flown in")
    parser.add_argument("report", type=Path, help="folder of `argosy run --report`, or file of `argosy record`")


def run(args: Namespace) -> int:
    """Judge a run. Returns the exit code: 0 only if every victim got exactly one buoy."""
    try:
        mission = load_mission(args.mission)
        verdict = (judge_recording if args.report.is_file() else judge_run)(mission, args.report)
    except Findings as findings:
        print(findings, file=sys.stderr)
        return EXIT_BAD_INPUT
    except OSError as error:
        told = (
            f"{error.filename}: {error.strerror}: was it flown with `argosy run {args.mission} --report {args.report}`?"
        )
        print(f"error: {told}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(verdict)
    return EXIT_DONE if verdict.good else EXIT_FAILED
