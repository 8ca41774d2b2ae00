"""Robots and their actions as an observer sees them by records alone, in a run or in any fleet that is looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from argosy.journal import Level
from argosy.track import Track
from schemas.records import ActionStatus, Perception, State
from schemas.terms import Atom, Term, to_float
from schemas.text import write

MAX_TOLD = 60
"""Characters of a percept that are kept of a robot without a vehicle's state."""
MOST_TOLD = 200
"""Names of percepts that are kept of such a robot."""
KEPT_ACTIONS = 2_000
"""Actions that are remembered; older ones are only counted."""

Tell = Callable[[str, str, Level], None]
"""Takes who, what and what kind of thing it is: a change that is worth a line."""


@dataclass
class ActionSeen:
    """An action and what became of it. Times are seconds of the observer's clock."""

    id: str
    agent: str
    text: str
    """As the agent would write it: `goto(-27.6,-48.5,40)`."""
    name: str
    parameters: tuple[Term, ...]
    began: float
    state: State
    reason: str = ""
    feedback: dict[str, float] = field(default_factory=dict)
    ended: float | None = None

    def age(self, now: float) -> float:
        """Return how long it took, or has taken until now."""
        return (now if self.ended is None else self.ended) - self.began


class ActionsSeen:
    """The actions of a fleet by their ids, the oldest first."""

    def __init__(self) -> None:
        self.by_id: dict[str, ActionSeen] = {}
        self.forgotten = 0

    def open(self) -> list[ActionSeen]:
        """Return the actions that have no final state yet, the oldest first."""
        return [action for action in self.by_id.values() if action.ended is None]

    def status(self, agent: str, status: ActionStatus, now: float, tell: Tell) -> ActionSeen | None:
        """Take what became of an action. Returns it, or None if it had ended already."""
        seen = self.by_id.get(status.id)
        if seen is None:
            text = written(status.name, status.parameters)
            seen = ActionSeen(status.id, agent, text, status.name, status.parameters, now, status.state)
            if len(self.by_id) >= KEPT_ACTIONS:
                self.by_id.pop(next(iter(self.by_id)))
                self.forgotten += 1
            self.by_id[status.id] = seen
            if not status.final:
                tell(agent, text, "action")
        if seen.ended is not None:
            return None
        seen.state, seen.reason = status.state, status.reason
        seen.feedback = dict(status.feedback) or seen.feedback
        if status.final:
            seen.ended = now
            why = f": {status.reason}" if status.reason else ""
            level: Level = "good" if status.state == "succeeded" else "warning"
            tell(agent, f"{seen.text} {status.state} after {seen.age(now):.1f} s{why}", level)
        return seen


@dataclass
class RobotSeen:
    """A robot as its percepts show it; None = not known."""

    name: str
    mode: str = ""
    connected: bool = False
    armed: bool = False
    altitude: float | None = None
    """Metres above home."""
    position: tuple[float, float] | None = None
    """Latitude and longitude in degrees."""
    home: tuple[float, float] | None = None
    battery: float | None = None
    """Percent."""
    satellites: int | None = None
    heading: float | None = None
    """Degrees from north, clockwise."""
    velocity: tuple[float, float, float] | None = None
    """Metres per second to the north, to the east and up."""
    track: Track = field(default_factory=Track)
    operator: str = ""
    """The order of an operator that stands above the robot's agents now."""
    holder: str = ""
    """The agent that has the robot, of several that share it; empty: nobody, or it has one agent only."""
    override: str = ""
    """The mode into which somebody else, such as its pilot, has put it."""
    told: dict[str, str] = field(default_factory=dict)
    """Of a robot that tells no vehicle's state: the last percept of each name, as its agent would write it."""
    heard: float = 0.0
    """When a percept last told something of the vehicle, in seconds of the observer's clock."""

    @property
    def lost(self) -> bool:
        """Whether it was heard and is no more; all else is then as it was last known."""
        return bool(self.mode) and not self.connected

    def last_known(self) -> str:
        """Return the last known state in words."""
        told = ["armed" if self.armed else "disarmed", self.mode]
        if self.altitude is not None:
            told.append(f"{self.altitude + 0.0:.0f} m up")
        place = f" at {self.position[0]:.6f}, {self.position[1]:.6f}" if self.position is not None else ""
        return ", ".join(told) + place

    def percept(self, percept: Perception, now: float, tell: Tell) -> None:
        """Take what an agent of the robot perceived."""
        if percept.update == "remove":
            self.told.pop(percept.name, None)
            if percept.name in ("holder", "override"):
                setattr(self, percept.name, "")
            return
        if not self.mode and (percept.name, len(percept.parameters)) != ("state", 3):
            self._no_vehicle(percept, now)
        match percept.name, percept.parameters:
            case "state", (mode, connected, armed):
                self._state(mode, _is_true(connected), _is_true(armed), now, tell)
            case "altitude", (value,):
                self.altitude = to_float(value)
                if self.altitude is not None:
                    self.track.climbed(now, self.altitude)
            case "global_pos", (latitude, longitude):
                self.position = _pair(latitude, longitude)
                if self.position is not None:
                    self.track.moved(now, *self.position)
            case "home_pos", (latitude, longitude):
                self.home = self.track.home = _pair(latitude, longitude)
            case "battery", (_, _, remaining):
                self.battery = to_float(remaining)
            case "gps", (_, satellites):
                number = to_float(satellites)
                self.satellites = None if number is None else int(number)
            case "heading", (value,):
                self.heading = to_float(value)
            case "velocity", (north, east, up):
                parts = to_float(north), to_float(east), to_float(up)
                self.velocity = None if None in parts else parts  # type: ignore[assignment]
            case "holder", (agent,):
                self.holder = plain(agent)
            case "override", (mode,):
                self.override = plain(mode)
                tell(self.name, f"somebody else took control: {self.override}", "warning")
            case _:
                return
        if self.connected:
            self.heard = now

    def _no_vehicle(self, percept: Perception, now: float) -> None:
        text = written(percept.name, percept.parameters)
        if percept.name in self.told or len(self.told) < MOST_TOLD:
            self.told[percept.name] = text if len(text) <= MAX_TOLD else f"{text[: MAX_TOLD - 2]}…)"
        self.heard = now

    def _state(self, mode: Term, connected: bool, armed: bool, now: float, tell: Tell) -> None:
        name = plain(mode)
        if not connected:  # it tells neither mode nor armed: what was known last is all that is known
            if self.connected:
                self.connected = False
                tell(self.name, f"LOST: last heard {now - self.heard:.0f} s ago, {self.last_known()}", "error")
            return
        if not self.connected:
            self.connected = True
            tell(self.name, "vehicle heard again" if self.mode else "vehicle connected", "info")
        if name != self.mode:
            self.mode = name
            self.told.clear()
            if name:
                self.track.changed_mode(now, name)
                tell(self.name, f"mode {name}", "info")
        if armed != self.armed:
            self.armed = armed
            if len(self.track.armed_at) < self.track.most:
                self.track.armed_at.append((now, armed))
            tell(self.name, "armed" if armed else "disarmed", "info")


def written(name: str, parameters: tuple[Term, ...]) -> str:
    """Return a percept or an action as a program would write it."""
    return name + (f"({','.join(map(write, parameters))})" if parameters else "")


def plain(term: Term) -> str:
    """Return a term for people: strings without quotes."""
    return term if isinstance(term, str) else write(term)


def _is_true(term: Term) -> bool:
    return term is True or term == Atom("true") or (isinstance(term, str) and term.lower() == "true")


def _pair(first: Term, second: Term) -> tuple[float, float] | None:
    one, two = to_float(first), to_float(second)
    return None if one is None or two is None else (one, two)
