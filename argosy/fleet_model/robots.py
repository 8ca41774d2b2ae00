"""Robots and their actions as an observer sees them by records alone, in a run or in any fleet that is looked at."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Literal

from argosy.cli.journal import Level
from argosy.fleet_model.track import Track
from bridged.drivers.mavlink.vehicle.flight_modes import COMING_HOME
from schemas.humanize import LONGEST, printable, shortened
from schemas.wire.records import ActionStatus, Perception, State
from schemas.wire.term_text import write
from schemas.wire.terms import Atom, Term, to_float

MAX_TOLD = 60
"""Characters of a percept that are kept of a robot without a vehicle's state."""
MOST_TOLD = 200
"""Names of percepts that are kept of such a robot."""
KEPT_ACTIONS = 2_000
"""Actions that are remembered; older ones are only counted."""

MAX_FIGURES = 20
"""Figures of an action's progress that are kept."""
NOT_HEARD = 3.0
"""Seconds without a status after which a running action counts as not heard; bridges tell of it each second."""

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
    state: State | Literal["unknown"]
    """`unknown`: nobody told how it ended, and nobody is there who could."""
    reason: str = ""
    feedback: dict[str, float] = field(default_factory=dict)
    ended: float | None = None
    heard: float = 0.0
    """When its bridge last told of it."""

    def silent(self, now: float) -> float | None:
        """Return for how many seconds nobody has told of it; None if it has ended, or was told of just now."""
        age = now - self.heard
        return age if self.ended is None and age > NOT_HEARD else None

    def age(self, now: float) -> float:
        """Return how long it took, or has taken until now."""
        return (now if self.ended is None else self.ended) - self.began


class ActionsSeen:
    """The actions of a fleet by their ids, the oldest first."""

    def __init__(self) -> None:
        self.by_id: dict[str, ActionSeen] = {}
        self.forgotten = 0
        self._open: dict[str, dict[str, ActionSeen]] = {}
        """Those without a final state, by agent and id."""

    def open(self, agent: str | None = None) -> list[ActionSeen]:
        """Return the actions that have no final state yet, of one agent or of all, the oldest first."""
        those = self._open.values() if agent is None else (self._open.get(agent, {}),)
        found = [one for each in those for one in each.values() if one.ended is None]
        return found if agent is not None else sorted(found, key=lambda one: one.began)

    def held(self) -> ActionsSeen:
        """Return a copy that nothing changes any more."""
        held = ActionsSeen()
        held.by_id = {id: copy(action) for id, action in self.by_id.items()}
        held._open = {agent: {id: held.by_id[id] for id in those} for agent, those in self._open.items()}
        held.forgotten = self.forgotten
        return held

    def status(self, agent: str, status: ActionStatus, now: float, tell: Tell, speed: float = 1.0) -> ActionSeen | None:
        """Take what became of an action. Returns it, or None if it had ended already.

        `speed` is in mission seconds per second of `now`: how long an action took is told in mission seconds.
        """
        id = shortened(status.id)
        seen = self.by_id.get(id)
        if seen is None:
            text = shortened(written(status.name, status.parameters))
            parameters = status.parameters if len(text) < LONGEST else ()  # what is not kept as text is not kept
            seen = ActionSeen(id, agent, text, shortened(status.name), parameters, now, status.state)
            self._keep(seen)
            if not status.final:
                tell(agent, text, "action")
        if seen.ended is not None and seen.state != "unknown":
            return None
        if seen.ended is not None:  # somebody does tell of it
            seen.ended = None
            self._open.setdefault(seen.agent, {})[seen.id] = seen
        seen.state, seen.reason, seen.heard = status.state, shortened(status.reason), now
        figures = ((printable(name[:LONGEST]), value) for name, value in status.feedback.items())
        seen.feedback = dict(islice(figures, MAX_FIGURES)) or seen.feedback
        if status.final:
            self.end(seen, status.state, seen.reason, now)
            why = f": {seen.reason}" if seen.reason else ""
            level: Level = "good" if status.state == "succeeded" else "warning"
            tell(agent, f"{seen.text} {status.state} after {seen.age(now) * speed:.1f} s{why}", level)
        return seen

    def end(self, action: ActionSeen, state: State | Literal["unknown"], reason: str, now: float) -> None:
        """An action has ended, or nobody is there any more who could tell how it ends."""
        action.state, action.reason, action.ended = state, shortened(reason), now
        those = self._open.get(action.agent, {})
        those.pop(action.id, None)
        if not those:
            self._open.pop(action.agent, None)

    def forget(self, before: float) -> None:
        """Forget the actions of which was told last before that time."""
        for id, action in list(self.by_id.items()):
            if action.heard < before:
                del self.by_id[id]
                those = self._open.get(action.agent, {})
                those.pop(id, None)
                if not those:
                    self._open.pop(action.agent, None)

    def _keep(self, action: ActionSeen) -> None:
        if len(self.by_id) >= KEPT_ACTIONS:
            gone = self.by_id.pop(next(iter(self.by_id)))
            self._open.get(gone.agent, {}).pop(gone.id, None)
            self.forgotten += 1
        self.by_id[action.id] = action
        self._open.setdefault(action.agent, {})[action.id] = action


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
    unattended: bool = False
    """It was in the air with nobody in charge, and no agent has begun an action with it since."""
    paused: bool = False
    """An operator has paused it: it holds, and what its agents ask for waits."""
    override: str = ""
    """The mode into which somebody else, such as its pilot, has put it."""
    told: dict[str, str] = field(default_factory=dict)
    """Of a robot that tells no vehicle's state: the last percept of each name, as its agent would write it."""
    heard: float = 0.0
    """When a percept last told something of the vehicle, in seconds of the observer's clock."""

    @property
    def coming_home(self) -> bool:
        """Whether its own mode brings it home or down, whoever set it."""
        return self.connected and self.armed and self.mode in COMING_HOME

    @property
    def lost(self) -> bool:
        """Whether it was heard and is no more; all else is then as it was last known."""
        return bool(self.mode) and not self.connected

    def since(self, at: float) -> RobotSeen:
        """Return what was seen of it since then: of one that was not heard since, nothing."""
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
            match percept.name:
                case "holder" | "override":
                    setattr(self, percept.name, "")
                case "paused" if self.paused:
                    self.paused = False
                    tell(self.name, "goes on: it is not paused any longer", "warning")
            return
        if not self.mode and (percept.name, len(percept.parameters)) != ("state", 3):
            self._no_vehicle(percept, now)
        match percept.name, percept.parameters:
            case "state", (mode, connected, armed):
                self._state(mode, _is_true(connected), _is_true(armed), now, tell)
            case "altitude", (value,):
                self.altitude = finite(value)
                if self.altitude is not None:
                    self.track.climbed(now, self.altitude)
            case "global_pos", (latitude, longitude):
                self.position = _pair(latitude, longitude)
                if self.position is not None:
                    self.track.moved(now, *self.position)
            case "home_pos", (latitude, longitude):
                self.home = self.track.home = _pair(latitude, longitude)
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
                return  # this and `paused` a bridge knows before it has heard the vehicle
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

    def _no_vehicle(self, percept: Perception, now: float) -> None:
        text = printable(written(percept.name, percept.parameters))
        if percept.name in self.told or len(self.told) < MOST_TOLD:
            self.told[percept.name] = text if len(text) <= MAX_TOLD else f"{text[: MAX_TOLD - 2]}…)"
        self.heard = now

    def _state(self, mode: Term, connected: bool, armed: bool, now: float, tell: Tell) -> None:
        name = shortened(plain(mode))
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


def finite(term: Term) -> float | None:
    """Return the number that a term is; None if it is none, or not one that can be measured: infinite, or no number."""
    try:
        number = to_float(term)
    except OverflowError:  # an integer of more than 300 digits
        return None
    return number if number is not None and math.isfinite(number) else None


def _pair(first: Term, second: Term) -> tuple[float, float] | None:
    """Return degrees of latitude and longitude; None if these numbers are none."""
    one, two = finite(first), finite(second)
    if one is None or two is None or not (-90 <= one <= 90 and -180 <= two <= 180):
        return None
    return one, two
