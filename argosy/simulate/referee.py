"""`argosy referee`: judge a search and rescue without trusting the agents.

Victims follow from the seed of the mission's world, drops from the servo logs of the simulators. Real copters have no
servo log: there, a recording of their telemetry is judged. Each victim must get exactly one buoy, within 5 m, and no
buoy may fall elsewhere. Percepts of a recording are identified by message and field in the robots' manifests, not by
name.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from argosy.cli.errors import BadInput
from argosy.fleet_model.term_values import Position
from argosy.processes.simulators import ON_MAVLINK, servo_log, vehicle_of, victims
from bridged.drivers.registry import load_robot_manifest
from bridged.simulation.vehicle.world import ServoMove, Victim, read_moves
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.geo import distance
from schemas.manifest.ini import truth
from schemas.manifest.loader import Manifest
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import Perception
from schemas.wire.term_text import write
from schemas.wire.terms import Term, to_float

if TYPE_CHECKING:
    from argosy.recording.reader import Recording

DEGREES = 1e-7
"""Degrees per unit of a MAVLink position."""
PLACE = (("GLOBAL_POSITION_INT", "lat"), ("GLOBAL_POSITION_INT", "lon"))
HOME = (("HOME_POSITION", "latitude"), ("HOME_POSITION", "longitude"))
ARMED = ("HEARTBEAT", "armed")
FRESH = 1.0
"""Seconds for which a reported position is valid: bridges report moving copters 10 times a second."""
SIGHTING = ("id", "lat", "lon")
"""Fields of the percept by which a camera reports a victim (docs/start/search-and-rescue.md)."""


def latch_fields(output: int) -> dict[tuple[str, str], None]:
    """Return the sources and fields that report a servo output (its number, from 1), for either autopilot."""
    return dict.fromkeys([("SERVO_OUTPUTS", f"output{output}"), ("SERVO_OUTPUT_RAW", f"servo{output}_raw")])


@dataclass
class CopterSeen:
    """A copter as the percepts of one agent show it. Times: seconds since the beginning of the recording."""

    manifest: Manifest
    values: dict[tuple[str, str], float | bool] = field(default_factory=dict)
    """The last value of each message and field, in the message's own unit."""
    places: list[tuple[float, Position]] = field(default_factory=list)
    latch: list[tuple[float, float, bool, Position | None]] = field(default_factory=list)
    """Pulse in microseconds, whether the motors were armed, and where home was."""

    def take(self, at: float, perception: Perception, output: int) -> None:
        """Take a change of a percept, at `at` seconds; `output` is the channel of the latch, from 1."""
        entry = self.manifest.percepts.get(perception.name)
        if entry is None or entry.arity != len(perception.parameters) or perception.update == "remove":
            return  # a removed percept held until then
        fields: set[tuple[str, str]] = set()
        for one, term in zip(entry.fields(), perception.parameters, strict=True):
            if (value := _value(term)) is not None:
                raw = value if isinstance(value, bool) else (value - one.offset) / (one.scale or 1.0)
                self.values[entry.source, one.field] = raw
                fields.add((entry.source, one.field))
        if fields.issuperset(PLACE) and (place := self._place(PLACE)) is not None:
            self.places.append((at, place))
        for pulse in fields & latch_fields(output).keys():
            armed = bool(self.values.get(ARMED, True))
            self.latch.append((at, float(self.values[pulse]), armed, self._place(HOME)))

    def moves(self, robot: str, output: int) -> Iterator[ServoMove]:
        """Yield the first state of an output (channel, from 1), and its moves.

        Raises ValueError if the recording has none.
        """
        if not self.latch:
            raise ValueError(f"{robot}: its output {output} is not in the recording")
        before = None
        for at, pulse, armed, home in self.latch:
            if pulse == before:
                continue
            before, place = pulse, self._nearest(robot, at)
            away = 0.0 if home is None else distance(place, home)
            yield ServoMove(round(at, 2), 0, output, round(pulse), *place, 1.0 if armed else 0.0, away, armed)

    def _nearest(self, robot: str, at: float) -> Position:
        """Return the last position before a time; after a gap, the position nearest in time."""
        index = bisect_right(self.places, at, key=lambda one: one[0])
        near = self.places[max(0, index - 1) : index + 1]
        if not near:
            raise ValueError(f"{robot}: its position is not in the recording")
        return near[0][1] if 0 <= at - near[0][0] <= FRESH else min(near, key=lambda one: abs(one[0] - at))[1]

    def _place(self, fields: tuple[tuple[str, str], tuple[str, str]]) -> Position | None:
        latitude, longitude = (self.values.get(one) for one in fields)
        if latitude is None or longitude is None:
            return None
        return latitude * DEGREES, longitude * DEGREES


def copters_of(mission: Mission, recording: Recording, output: int) -> tuple[dict[str, CopterSeen], list[Victim]]:
    """Return the copters whose output a percept reports, and the victims that cameras have reported.

    Reads the first of the agents that share a robot. Raises ValueError for a recording of another fleet.
    """
    if mission.fleet not in recording.fleets:
        there = ", ".join(recording.fleets) or "no fleet"
        raise ValueError(f"{recording.path}: expected a recording of fleet `{mission.fleet}`, it has {there}")
    seen: dict[str, CopterSeen] = {}
    copters: dict[str, CopterSeen] = {}
    for name, robot in mission.robots.items():
        manifest = load_robot_manifest(robot.manifest, mission.path.parent)
        agents = mission.agents_of(name)
        if agents:
            seen[agents[0]] = CopterSeen(manifest)
        fields = {(e.source, f.field) for e in manifest.percepts.values() for f in e.fields()}
        if agents and fields & latch_fields(output).keys():
            copters[name] = seen[agents[0]]
    found: dict[int, Victim] = {}
    for message, perception in recording.typed(Perception, (f"{keys.ROOT}/{mission.fleet}/*/percept/*",)):
        parsed = keys.parse(message.key)
        if parsed is not None and (copter := seen.get(parsed[1])) is not None:
            copter.take(message.seconds, perception, output)
            if (victim := _victim(copter.manifest, perception)) is not None:
                found.setdefault(victim.number, victim)
    return copters, sorted(found.values(), key=lambda one: one.number)


def _victim(manifest: Manifest, perception: Perception) -> Victim | None:
    """Return the victim that a camera's percept reports; None for any other percept."""
    entry = manifest.percepts.get(perception.name)
    if entry is None or perception.update == "remove":
        return None
    fields = {one.field: to_float(term) for one, term in zip(entry.fields(), perception.parameters, strict=False)}
    number, lat, lon = (fields.get(name) for name in SIGHTING)
    if number is None or lat is None or lon is None:
        return None
    return Victim(int(number), lat, lon)


def _value(term: Term) -> float | bool | None:
    """Return a number or truth value of a percept, also of one that is text."""
    if isinstance(term, bool):
        return term
    number = to_float(term)
    return number if number is not None else truth(term if isinstance(term, str) else write(term))


NEAR = 5.0
"""Horizontal distance in metres within which a buoy reaches a victim."""
LATCH = 9
"""The servo output that holds the buoy."""
OPEN = 1500
"""Pulse in microseconds at which the latch is open."""
PAD, GROUND = 5.0, 0.5
"""Metres from home, horizontally and vertically, within which a copter is given a new buoy."""


@dataclass(frozen=True)
class Drop:
    """A buoy that fell."""

    robot: str
    at: float
    """Seconds since the copter was switched on, or since the recording started."""
    lat: float
    lon: float

    def metres_from(self, victim: Victim) -> float:
        """Return the horizontal distance to a victim in metres."""
        return distance((victim.lat, victim.lon), (self.lat, self.lon))


@dataclass
class Verdict:
    """The referee's result."""

    rescues: dict[Victim, list[Drop]]
    """The buoys near each victim."""
    astray: list[Drop] = field(default_factory=list)
    """Buoys that reached no victim."""
    missing: str = ""
    """What a recording lacks: another buoy may have fallen there."""

    @property
    def good(self) -> bool:
        """Whether it is proved that each victim got exactly one buoy and none fell elsewhere."""
        return not self.missing and not self.astray and all(len(drops) == 1 for drops in self.rescues.values())

    def __str__(self) -> str:
        lines = ["victim  buoys  by"]
        for victim, drops in self.rescues.items():
            by = ", ".join(f"{one.robot} {one.metres_from(victim):.1f} m off at {one.at:.0f} s" for one in drops)
            lines.append(f"{victim.number:6}  {len(drops):5}  {by or '-'}")
        lines += [f"astray: {one.robot} at {one.lat:.7f}, {one.lon:.7f} after {one.at:.0f} s" for one in self.astray]
        return "\n".join([*lines, f"{'PASSED' if self.good else 'FAILED'}: {self.summary}"])

    @property
    def summary(self) -> str:
        """The numbers of victims with one buoy, with none and with more, and of buoys astray, as text."""
        once = sum(len(drops) == 1 for drops in self.rescues.values())
        twice = sum(len(drops) > 1 for drops in self.rescues.values())
        never = sum(not drops for drops in self.rescues.values())
        verdict = f"{once} of {len(self.rescues)} victims got exactly one buoy"
        verdict += f", {never} none" if never else ""
        verdict += f", {twice} more than one" if twice else ""
        verdict += f", {len(self.astray)} buoys fell astray" if self.astray else ""
        verdict += f"; not all is known: {self.missing}" if self.missing else ""
        return verdict


def drops_of(robot: str, moves: Iterable[ServoMove], *, loaded: bool = True) -> list[Drop]:
    """Return the buoys that a copter dropped: its latch opened while it held one. `loaded`: it starts with one."""
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
    """Assign each buoy to the nearest victim."""
    verdict = Verdict({victim: [] for victim in everybody})
    for drop in drops:
        nearest = min(everybody, key=drop.metres_from, default=None)
        if nearest is not None and drop.metres_from(nearest) <= NEAR:
            verdict.rescues[nearest].append(drop)
        else:
            verdict.astray.append(drop)
    return verdict


def judge_run(mission: Mission, report: Path) -> Verdict:
    """Judge a run by the servo logs in its report folder. Raises ValueError and OSError."""
    if mission.world is None:
        raise ValueError(f"{mission.path}: the mission has no `world`")
    drops: list[Drop] = []
    for name, robot in mission.robots.items():
        if vehicle_of(robot) in ON_MAVLINK:
            drops += drops_of(name, read_moves(servo_log(report, name)))
    return judge(victims(mission.world), drops)


def judge_recording(mission: Mission, file: Path) -> Verdict:
    """Judge a recording. Without a `world` in the mission the victims are those that cameras reported.

    Raises ValueError and OSError.
    """
    from argosy.recording.reader import Recording  # needs the extra `record`, which servo logs do not

    recording = Recording(file)
    copters, seen = copters_of(mission, recording, LATCH)
    if not copters:
        wanted = " or ".join(map(".".join, latch_fields(LATCH)))
        raise ValueError(f"{mission.path}: no robot's manifest has a percept of {wanted}")
    everybody = seen if mission.world is None else victims(mission.world)
    if not everybody:
        raise ValueError(f"{file}: no camera reported a victim, and the mission has no `world`")
    drops: list[Drop] = []
    for name, copter in copters.items():
        moves = list(copter.moves(name, LATCH))
        drops += drops_of(name, moves, loaded=moves[0].pulse < OPEN)
    return replace(judge(everybody, drops), missing=recording.missing)


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy referee`."""
    parser.add_argument("mission", help="mission file, with its `world`")
    parser.add_argument("report", type=Path, help="report folder of `argosy run`, or a recording")


def run(args: Namespace) -> int:
    """Judge a run. Returns 0 only if every victim got exactly one buoy and none fell elsewhere."""
    mission = load_mission(args.mission)
    try:
        verdict = (judge_recording if args.report.is_file() else judge_run)(mission, args.report)
    except OSError as error:
        hint = f"was it flown with `argosy run {args.mission} --report {args.report}`?"
        raise BadInput(f"{error.filename}: {error.strerror}: {hint}") from None
    except ValueError as error:
        raise BadInput(str(error)) from None
    print(verdict)
    return EXIT_DONE if verdict.good else EXIT_FAILED
