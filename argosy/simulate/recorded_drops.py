"""What a recording tells a referee: the moves of each latch and where its copter was, and whom the cameras saw.

Which percept says what is read from the robots' manifests, by message and field, and not from the percepts' names.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

from argosy.recording.reader import Recording
from bridged.bridge.manifest_loader import load_robot_manifest
from bridged.simulation.copter.servo_log import ServoMove
from bridged.simulation.copter.world import Victim
from schemas.geo import distance
from schemas.manifest.ini import truth
from schemas.manifest.loader import Manifest
from schemas.mission.model import Mission
from schemas.wire import keys
from schemas.wire.records import Perception
from schemas.wire.term_text import write
from schemas.wire.terms import Term, to_float

DEGREES = 1e-7
"""MAVLink tells places as integers of so many degrees."""
PLACE = (("GLOBAL_POSITION_INT", "lat"), ("GLOBAL_POSITION_INT", "lon"))
HOME = (("HOME_POSITION", "latitude"), ("HOME_POSITION", "longitude"))
ARMED = ("HEARTBEAT", "armed")
FRESH = 1.0
"""Seconds for which a place that was told holds: bridges tell of moving copters 10 times a second."""
SIGHTING = ("id", "lat", "lon")
"""The fields of a percept by which a camera tells of a victim (docs/start/search-and-rescue.md)."""
FarAndNear = tuple[float, float]
"""Latitude and longitude in degrees."""


def latch_field(output: int) -> tuple[str, str]:
    """Return the message and field by which a vehicle tells of a servo output."""
    return "SERVO_OUTPUT_RAW", f"servo{output}_raw"


@dataclass
class CopterSeen:
    """What the percepts of one agent tell of its copter. Times: seconds since the beginning of the recording."""

    manifest: Manifest
    values: dict[tuple[str, str], float | bool] = field(default_factory=dict)
    """The last value of each message and field, in the message's own unit."""
    places: list[tuple[float, FarAndNear]] = field(default_factory=list)
    latch: list[tuple[float, float, bool, FarAndNear | None]] = field(default_factory=list)
    """Pulse in microseconds, whether the motors were armed, and where home was."""

    def take(self, at: float, perception: Perception, output: int) -> None:
        """Take a change of a percept."""
        entry = self.manifest.percepts.get(perception.name)
        if entry is None or entry.arity != len(perception.parameters) or perception.update == "remove":
            return  # what is not told any more was so until then
        told: set[tuple[str, str]] = set()
        for one, term in zip(entry.fields(), perception.parameters, strict=True):
            if (value := _value(term)) is not None:
                raw = value if isinstance(value, bool) else (value - one.offset) / (one.scale or 1.0)
                self.values[entry.source, one.field] = raw
                told.add((entry.source, one.field))
        if told.issuperset(PLACE) and (place := self._place(PLACE)) is not None:
            self.places.append((at, place))
        if (pulse := latch_field(output)) in told:
            armed = bool(self.values.get(ARMED, True))
            self.latch.append((at, float(self.values[pulse]), armed, self._place(HOME)))

    def moves(self, robot: str, output: int) -> Iterator[ServoMove]:
        """Yield where the output stood first, and its moves. Raises ValueError if nothing was told of it."""
        if not self.latch:
            raise ValueError(f"{robot}: the recording does not tell of its output {output}")
        before = None
        for at, pulse, armed, home in self.latch:
            if pulse == before:
                continue
            before, place = pulse, self._nearest(robot, at)
            away = 0.0 if home is None else distance(place, home)
            yield ServoMove(round(at, 2), 0, output, round(pulse), *place, 1.0 if armed else 0.0, away, armed)

    def _nearest(self, robot: str, at: float) -> FarAndNear:
        """Return where it was last told to be; after a gap in what was told, the place that is nearest in time."""
        index = bisect_right(self.places, at, key=lambda one: one[0])
        near = self.places[max(0, index - 1) : index + 1]
        if not near:
            raise ValueError(f"{robot}: the recording does not tell where it was")
        return near[0][1] if 0 <= at - near[0][0] <= FRESH else min(near, key=lambda one: abs(one[0] - at))[1]

    def _place(self, fields: tuple[tuple[str, str], tuple[str, str]]) -> FarAndNear | None:
        latitude, longitude = (self.values.get(one) for one in fields)
        if latitude is None or longitude is None:
            return None
        return latitude * DEGREES, longitude * DEGREES


def copters_of(mission: Mission, recording: Recording, output: int) -> tuple[dict[str, CopterSeen], list[Victim]]:
    """Return the copters of which a percept tells the output, and the victims that any camera has told of.

    Of the agents that share a robot the first is read. Raises ValueError for a recording of another fleet.
    """
    if mission.fleet not in recording.fleets:
        there = ", ".join(recording.fleets) or "nothing of a fleet"
        raise ValueError(f"{recording.path}: expected a recording of the fleet `{mission.fleet}`, it has {there}")
    seen: dict[str, CopterSeen] = {}
    copters: dict[str, CopterSeen] = {}
    for name, robot in mission.robots.items():
        manifest = load_robot_manifest(robot.manifest, mission.path.parent)
        agents = mission.agents_of(name)
        if agents:
            seen[agents[0]] = CopterSeen(manifest)
        if agents and latch_field(output) in {
            (e.source, f.field) for e in manifest.percepts.values() for f in e.fields()
        }:
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
    """Return the victim that a percept tells of, if it is one of a camera."""
    entry = manifest.percepts.get(perception.name)
    if entry is None or perception.update == "remove":
        return None
    told = {one.field: to_float(term) for one, term in zip(entry.fields(), perception.parameters, strict=False)}
    number, lat, lon = (told.get(name) for name in SIGHTING)
    if number is None or lat is None or lon is None:
        return None
    return Victim(int(number), lat, lon)


def _value(term: Term) -> float | bool | None:
    """Return a number or truth value of a percept, also of one that is told as text."""
    if isinstance(term, bool):
        return term
    number = to_float(term)
    return number if number is not None else truth(term if isinstance(term, str) else write(term))
