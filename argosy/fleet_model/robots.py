"""Robots as their percepts show them, and the tracks that they fly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

from argosy.cli.journal import Level
from argosy.fleet_model.term_values import Position, finite, is_true, plain, position_of
from bridged.drivers.mavlink.vehicle.flight_modes import COMING_HOME
from schemas.geo import distance
from schemas.humanize import printable, shortened
from schemas.wire.records import Perception
from schemas.wire.term_text import write
from schemas.wire.terms import Structure, Term

UNATTENDED = "robot_unattended"
"""Code of the note of a bridge whose vehicle is in the air without an agent in charge (docs/guides/monitoring.md)."""
AIRBORNE = 0.5
"""Metres above home from which an armed robot counts as flying."""
LONGEST_REPORT = 60
"""Characters kept of a percept of a robot that is not a vehicle."""
MOST_REPORTED = 200
"""Names of percepts kept of such a robot."""
MAX_POINTS = 20_000
"""Points that are kept; of a longer track every second one is dropped."""

Tell = Callable[[str, str, Level], None]
"""Takes who, what and the level of a change."""


@dataclass(frozen=True)
class Point:
    """A position at a time: seconds of the model's clock, degrees."""

    at: float
    latitude: float
    longitude: float


@dataclass
class Track:
    """Positions, altitudes and modes of a robot over time."""

    points: list[Point] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)
    """Seconds and metres above home. Not part of the points: a vehicle may climb without moving."""
    modes: list[tuple[float, str]] = field(default_factory=list)
    armed_at: list[tuple[float, bool]] = field(default_factory=list)
    home: tuple[float, float] | None = None
    most: int = MAX_POINTS
    """Points that are kept of this track."""

    def moved(self, at: float, latitude: float, longitude: float) -> None:
        """Add a position, in degrees, at `at` seconds."""
        self.points.append(Point(at, latitude, longitude))
        if len(self.points) > self.most:
            del self.points[1::2]

    def climbed(self, at: float, altitude: float) -> None:
        """Add an altitude, in metres above home, at `at` seconds."""
        self.heights.append((at, altitude))
        if len(self.heights) > self.most:
            del self.heights[1::2]

    def changed_mode(self, at: float, mode: str) -> None:
        """Add a change of mode at `at` seconds."""
        if len(self.modes) < self.most:
            self.modes.append((at, mode))

    def length(self) -> float:
        """Return the metres flown over ground while armed."""
        points = [point for point in self.points if self.armed(point.at)]
        return sum(distance((a.latitude, a.longitude), (b.latitude, b.longitude)) for a, b in pairwise(points))

    def highest(self) -> float | None:
        """Return the greatest altitude in metres above home."""
        return max((altitude for _, altitude in self.heights), default=None)

    def armed(self, at: float) -> bool:
        """Whether the vehicle was armed at `at` seconds."""
        state = False
        for when, armed in self.armed_at:
            if when > at:
                break
            state = armed
        return state


@dataclass
class RobotSeen:
    """A robot as its percepts show it; None = not known."""

    name: str
    mode: str = ""
    connected: bool = False
    armed: bool = False
    altitude: float | None = None
    """Metres above home."""
    position: Position | None = None
    """Latitude and longitude in degrees."""
    home: Position | None = None
    battery: float | None = None
    """Percent."""
    satellites: int | None = None
    heading: float | None = None
    """Degrees from north, clockwise."""
    velocity: tuple[float, float, float] | None = None
    """Metres per second to the north, to the east and up."""
    track: Track = field(default_factory=Track)
    operator: str = ""
    """The operator's order that is in force; its agents cannot override it."""
    holder: str = ""
    """The agent that holds the robot, of several that share it; empty: none, or it has one agent only."""
    unattended: bool = False
    """It was in the air without an agent in charge, and no agent has begun an action with it since."""
    paused: bool = False
    """An operator has paused it: it holds, and actions of its agents wait."""
    override: str = ""
    """The mode that another one than its bridge, such as its pilot, has set."""
    reported: dict[str, str] = field(default_factory=dict)
    """Of a robot without the percept `state`: the last percept of each name, as its agent would write it."""
    heard: float = 0.0
    """Time of the last percept of the vehicle."""

    @property
    def coming_home(self) -> bool:
        """Whether its mode brings it home or down, whoever set it."""
        return self.connected and self.armed and self.mode in COMING_HOME

    @property
    def lost(self) -> bool:
        """Whether its vehicle was heard and is not any more; all other values are then the last known ones."""
        return bool(self.mode) and not self.connected

    def since(self, at: float) -> RobotSeen:
        """Return a copy with what was heard since `at`, in seconds."""
        known, most = self.track, self.track.most
        track = Track(
            points=[one for one in known.points if one.at >= at],
            heights=[one for one in known.heights if one[0] >= at],
            modes=[one for one in known.modes if one[0] >= at],
            armed_at=[one for one in known.armed_at if one[0] >= at],
            most=most,
        )
        if self.heard < at:
            return RobotSeen(self.name, track=track)
        track.home = known.home
        return replace(self, track=track)

    def last_known(self) -> str:
        """Return the last known state as text."""
        parts = ["armed" if self.armed else "disarmed", self.mode]
        if self.altitude is not None:
            parts.append(f"{self.altitude + 0.0:.0f} m up")
        place = f" at {self.position[0]:.6f}, {self.position[1]:.6f}" if self.position is not None else ""
        return ", ".join(parts) + place

    def percept(self, percept: Perception, now: float, tell: Tell) -> None:
        """Take a percept of an agent of the robot at `now` seconds; `tell` takes each change."""
        if percept.update == "remove":
            self.reported.pop(percept.name, None)
            match percept.name:
                case "holder" | "override":
                    setattr(self, percept.name, "")
                case "paused" if self.paused:
                    self.paused = False
                    tell(self.name, "goes on: no longer paused", "warning")
            return
        if not self.mode and (percept.name, len(percept.parameters)) != ("state", 3):
            text = printable(write(Structure(percept.name, percept.parameters)))
            if percept.name in self.reported or len(self.reported) < MOST_REPORTED:
                short = text if len(text) <= LONGEST_REPORT else f"{text[: LONGEST_REPORT - 2]}…)"
                self.reported[percept.name] = short
            self.heard = now
        match percept.name, percept.parameters:
            case "state", (mode, connected, armed):
                self._state(mode, is_true(connected), is_true(armed), now, tell)
            case "altitude", (value,):
                self.altitude = finite(value)
                if self.altitude is not None:
                    self.track.climbed(now, self.altitude)
            case "global_pos", (latitude, longitude):
                self.position = position_of(latitude, longitude)
                if self.position is not None:
                    self.track.moved(now, *self.position)
            case "home_pos", (latitude, longitude):
                self.home = self.track.home = position_of(latitude, longitude)
            case "battery", (_, _, remaining):
                self.battery = finite(remaining)
            case "gps", (_, satellites):
                number = finite(satellites)
                self.satellites = None if number is None else int(number)
            case "heading", (value,):
                self.heading = finite(value)
            case "velocity", (north, east, up):
                parts = finite(north), finite(east), finite(up)
                self.velocity = None if None in parts else parts  # type: ignore[assignment]
            case "holder", (agent,):
                self.holder = shortened(plain(agent))
                return  # a bridge knows this and `paused` before it hears the vehicle
            case "paused", (_,):
                if not self.paused:
                    tell(
                        self.name,
                        f"paused by the operator; `argosy stop continue {self.name}` lets it go on",
                        "warning",
                    )
                self.paused = True
                return
            case "override", (mode,):
                self.override = shortened(plain(mode))
                if self.override in COMING_HOME:
                    tell(self.name, f"comes home: others have set {self.override} (pilot, failsafe)", "warning")
                else:
                    tell(self.name, f"somebody else took control: {self.override}", "warning")
            case _:
                return
        if self.connected:
            self.heard = now

    def _state(self, mode: Term, connected: bool, armed: bool, now: float, tell: Tell) -> None:
        name = shortened(plain(mode))
        if not connected:  # mode and armed are then not known: keep the last values
            if self.connected:
                self.connected = False
                tell(self.name, f"LOST: last heard {now - self.heard:.0f} s ago, {self.last_known()}", "error")
            return
        if not self.connected:
            self.connected = True
            tell(self.name, "vehicle heard again" if self.mode else "vehicle connected", "info")
        if name != self.mode:
            self.mode = name
            self.reported.clear()
            if name:
                self.track.changed_mode(now, name)
                tell(self.name, f"mode {name}", "info")
        if armed != self.armed:
            self.armed = armed
            if len(self.track.armed_at) < self.track.most:
                self.track.armed_at.append((now, armed))
            tell(self.name, "armed" if armed else "disarmed", "info")
