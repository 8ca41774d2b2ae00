"""What an observer on the bus knows of a fleet: made from records alone, so that a recording gives the same picture."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field

from argosy.journal import Journal, printable
from argosy.track import Track
from schemas import keys
from schemas.minds import IntentionView, MindView
from schemas.mission import Mission
from schemas.records import ActionStatus, Health, Perception, State
from schemas.terms import Atom, Term, to_float
from schemas.text import write

KEPT_PRINTS = 50
MAX_TOLD = 60
"""Characters of a percept that are kept of a robot without a vehicle's state."""
KEPT_ACTIONS = 2_000
"""Actions that are remembered for the summary; older ones are only counted."""

OPERATOR = "operator: "
"""How the reason of an action begins that an operator's order ended."""

_GROWING = re.compile(r"[0-9.]+ (s\b|of [0-9]+)")
"""What counts on in a note while it holds: "for 6 s", "88 of 90"."""


@dataclass
class ActionSeen:
    """An action and what became of it. Times are mission seconds since the start of the run."""

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


@dataclass
class AgentSeen:
    """An agent as it shows itself."""

    name: str
    robot: str | None
    intentions: tuple[IntentionView, ...] = ()
    prints: deque[str] = field(default_factory=lambda: deque(maxlen=KEPT_PRINTS))
    done: dict[str, bool] = field(default_factory=dict)
    failed: dict[str, bool] = field(default_factory=dict)
    beliefs: tuple[str, ...] = ()
    cycle: int = 0


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
    track: Track = field(default_factory=Track)
    operator: str = ""
    """The order of an operator that stands above the robot's agents now."""
    told: dict[str, str] = field(default_factory=dict)
    """Of a robot that tells no vehicle's state: the last percept of each name, as its agent would write it."""
    heard: float = 0.0
    """Mission time at which a percept last told something of the vehicle."""

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


class Picture:
    """Everything known about the agents and robots of a mission; changes worth a line go to the journal."""

    def __init__(self, mission: Mission, journal: Journal, now: Callable[[], float]) -> None:
        self.mission, self.journal, self._now = mission, journal, now
        self.agents = {name: AgentSeen(name, agent.robot) for name, agent in mission.agents.items()}
        self.robots = {name: RobotSeen(name) for name in mission.robots}
        self.actions: dict[str, ActionSeen] = {}
        self.health: dict[tuple[str, str], Health] = {}
        """By name and daemon."""
        self.heard_at: dict[tuple[str, str], float] = {}
        """Mission time of each daemon's last health."""
        self.alive: set[tuple[str, str, str]] = set()
        """Name, daemon and boot of each liveliness token."""
        self.counts: Counter[str] = Counter()
        self.eyes = {agents[0]: robot for robot in mission.robots if (agents := mission.agents_of(robot))}
        """The agent or client through whom each robot is seen, and the robot."""

    def is_alive(self, name: str, daemon: str) -> bool:
        """Whether a daemon for this agent, robot or board is on the bus now."""
        return any(token[:2] == (name, daemon) for token in self.alive)

    def open_actions(self) -> list[ActionSeen]:
        """Return the actions that have no final state yet, the oldest first."""
        return [action for action in self.actions.values() if action.ended is None]

    def flying(self) -> bool:
        """Whether any vehicle is armed, or was when it fell silent."""
        return any(robot.armed for robot in self.robots.values())

    def heard_of(self, robot: RobotSeen) -> float:
        """Return the mission time until which a vehicle is known: its bridge tells changes, and that it is there."""
        return robot.heard if robot.lost else max(robot.heard, self.heard_at.get((robot.name, "bridged"), 0.0))

    def token(self, key: str, alive: bool) -> None:
        """A liveliness token came or went."""
        parsed = keys.parse(key)
        if parsed is None or len(parsed[2]) != 3:
            return
        name, (_, daemon, boot) = parsed[1], parsed[2]
        (self.alive.add if alive else self.alive.discard)((name, daemon, boot))

    def heard_health(self, key: str, health: Health) -> None:
        """A daemon said how it is."""
        parsed = keys.parse(key)
        if parsed is not None and len(parsed[2]) == 2:
            before = self.health.get((parsed[1], parsed[2][1]))
            self.health[parsed[1], parsed[2][1]] = health
            self.heard_at[parsed[1], parsed[2][1]] = self._now()
            known = {without_figures(note) for note in before.notes} if before is not None else set()
            for note in health.notes:
                if without_figures(note) not in known:
                    self.journal.add(parsed[1], note, "warning")

    def percept(self, key: str, percept: Perception) -> None:
        """An agent perceived something; a robot is seen through the first of those that have it."""
        self.counts["percepts"] += 1
        parsed = keys.parse(key)
        seen = self.eyes.get(parsed[1]) if parsed else None
        if seen is None:
            return
        robot = self.robots[seen]
        if percept.update == "remove":
            robot.told.pop(percept.name, None)
            return
        if not robot.mode and (percept.name, len(percept.parameters)) != ("state", 3):
            self._no_vehicle(robot, percept)
        match percept.name, percept.parameters:
            case "state", (mode, connected, armed):
                self._state(robot, mode, _is_true(connected), _is_true(armed))
            case "altitude", (value,):
                robot.altitude = to_float(value)
                if robot.altitude is not None:
                    robot.track.climbed(self._now(), robot.altitude)
            case "global_pos", (latitude, longitude):
                robot.position = _pair(latitude, longitude)
                if robot.position is not None:
                    robot.track.moved(self._now(), *robot.position)
            case "home_pos", (latitude, longitude):
                robot.home = robot.track.home = _pair(latitude, longitude)
            case "battery", (_, _, remaining):
                robot.battery = to_float(remaining)
            case "gps", (_, satellites):
                number = to_float(satellites)
                robot.satellites = None if number is None else int(number)
            case "override", (mode,):
                self.journal.add(robot.name, f"somebody else took control: {_plain(mode)}", "warning")
            case _:
                return
        if robot.connected:
            robot.heard = self._now()

    def _no_vehicle(self, robot: RobotSeen, percept: Perception) -> None:
        text = percept.name + (f"({','.join(map(write, percept.parameters))})" if percept.parameters else "")
        robot.told[percept.name] = text if len(text) <= MAX_TOLD else f"{text[: MAX_TOLD - 2]}…)"
        robot.heard = self._now()

    def _state(self, robot: RobotSeen, mode: Term, connected: bool, armed: bool) -> None:
        name, now = _plain(mode), self._now()
        if not connected:  # it tells neither mode nor armed: what was known last is all that is known
            if robot.connected:
                robot.connected = False
                text = f"LOST: last heard {now - robot.heard:.0f} s ago, {robot.last_known()}"
                self.journal.add(robot.name, text, "error")
            return
        if not robot.connected:
            robot.connected = True
            self.journal.add(robot.name, "vehicle heard again" if robot.mode else "vehicle connected")
        if name != robot.mode:
            robot.mode = name
            robot.told.clear()
            if name:
                robot.track.changed_mode(now, name)
                self.journal.add(robot.name, f"mode {name}")
        if armed != robot.armed:
            robot.armed = armed
            robot.track.armed_at.append((now, armed))
            self.journal.add(robot.name, "armed" if armed else "disarmed")

    def status(self, key: str, status: ActionStatus) -> None:
        """An action began, went on or ended."""
        self.counts["statuses"] += 1
        parsed, now = keys.parse(key), self._now()
        agent = parsed[1] if parsed else "?"
        seen = self.actions.get(status.id)
        if seen is None:
            text = status.name + (f"({','.join(map(write, status.parameters))})" if status.parameters else "")
            seen = ActionSeen(status.id, agent, text, status.name, status.parameters, now, status.state)
            if len(self.actions) >= KEPT_ACTIONS:
                self.actions.pop(next(iter(self.actions)))
                self.counts["actions_forgotten"] += 1
            self.actions[status.id] = seen
            if not status.final:
                self.journal.add(agent, text, "action")
        if seen.ended is not None:
            return
        seen.state, seen.reason = status.state, status.reason
        seen.feedback = dict(status.feedback) or seen.feedback
        if status.final:
            seen.ended = now
            why = f": {status.reason}" if status.reason else ""
            level = "good" if status.state == "succeeded" else "warning"
            self.journal.add(agent, f"{seen.text} {status.state} after {seen.age(now):.1f} s{why}", level)  # type: ignore[arg-type]
            robot = next((name for name in self.robots if agent in self.mission.agents_of(name)), None)
            if robot is not None and status.reason.startswith(OPERATOR):
                self.ordered(robot, status.reason.removeprefix(OPERATOR))

    def ordered(self, robot: str, order: str) -> None:
        """An operator ordered something that stands above the agents."""
        if self.robots[robot].operator != order:
            self.robots[robot].operator = order
            gives_back = f"; `argosy stop release {robot}` gives it back to its agents" if order == "hold" else ""
            self.journal.add(robot, f"the operator orders {order}{gives_back}", "warning")

    def released(self, robot: str) -> None:
        """An operator gave a robot back to its agents."""
        self.robots[robot].operator = ""
        self.journal.add(robot, "released by the operator: its agents act again", "warning")

    def mind(self, view: MindView) -> None:
        """An agent showed its mind."""
        self.counts["minds"] += 1
        agent = self.agents.get(view.agent)
        if agent is None:
            return
        agent.intentions, agent.cycle = view.intentions, view.cycle
        for formula, holds in view.done.items():
            if holds and not agent.done.get(formula):
                self.journal.add(agent.name, f"done: {formula}", "good")
        agent.done, agent.failed = dict(view.done), dict(view.failed)
        agent.beliefs = tuple(belief.text for belief in view.beliefs)

    def agent_ended(self, name: str) -> None:
        """An agent's process is dead: what its mind was is not what it is, should it come again."""
        agent = self.agents[name]
        agent.intentions, agent.cycle, agent.done, agent.failed, agent.beliefs = (), 0, {}, {}, ()

    def bridge_ended(self, robot: str) -> None:
        """The bridge of a robot is dead: what ran there has no outcome any more that would be heard."""
        for action in self.open_actions():
            if action.agent in self.mission.agents_of(robot):
                action.state, action.reason, action.ended = "failed", "its bridge died", self._now()

    def printed(self, agent: str, text: str) -> None:
        """An agent's program printed a line."""
        self.agents[agent].prints.append(text)
        self.journal.add(agent, text, "print")

    def failed(self) -> str:
        """Return in words which `failed` formula of the mission holds; nothing if none does."""
        for one in self.mission.failed:
            agent = self.agents[one.agent]
            if agent.failed.get(one.formula, False):
                name = one.formula.partition("(")[0]
                believed = next((text for text in agent.beliefs if text.partition("(")[0] == name), one.formula)
                return f"{one.agent} believes {printable(believed.rpartition('[source(')[0] or believed)}"
        return ""

    def done(self) -> bool:
        """Whether every `done` formula of the mission holds; a mission without one is never done."""
        wanted = self.mission.done
        return bool(wanted) and all(self.agents[one.agent].done.get(one.formula, False) for one in wanted)


def _is_true(term: Term) -> bool:
    return term is True or term == Atom("true") or (isinstance(term, str) and term.lower() == "true")


def _plain(term: Term) -> str:
    return term if isinstance(term, str) else write(term)


def _pair(first: Term, second: Term) -> tuple[float, float] | None:
    one, two = to_float(first), to_float(second)
    return None if one is None or two is None else (one, two)


def without_figures(note: str) -> str:
    """What a note says but for how long or how often: it is told once, not each second."""
    return _GROWING.sub("", note)
