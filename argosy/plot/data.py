"""What a plot shows: everything that a recording tells of the flights, the actions and the messages of a fleet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from argosy.fleet_model.robots import ActionSeen, ActionsSeen, RobotSeen, finite
from argosy.fleet_model.track import Track
from schemas.geo import distance
from schemas.humanize import printable
from schemas.wire import keys
from schemas.wire.mind_records import Deed, MindDeeds
from schemas.wire.records import ActionStatus, Perception, Record
from schemas.wire.term_text import write
from schemas.wire.terms import Term

SHORTEST = 1.0
"""Mission seconds that are shown at least, also of a recording that is over at once."""
NEAR = 20_000.0
"""Metres from home within which the last two parameters of a percept are taken for a place."""
HIGHEST = 1_000_000.0
"""Metres above home that are drawn."""
MAX_MESSAGES = 20_000
"""Messages that are kept; further ones are counted."""
MAX_PLACES = 2_000
"""Places that are marked."""
TARGET = "target"
TARGETS = ("goto", "setpoint")
"""Actions whose first two parameters are the place that is flown to."""
DROPS = "drop"
"""How the names of actions begin that leave something behind where the robot is."""


@dataclass(frozen=True, slots=True)
class Heard:
    """A record of a recording."""

    at: float
    """Mission seconds."""
    key: str
    """Its key on the bus."""
    record: Record
    """Decoded."""


@dataclass(frozen=True)
class Place:
    """Something that is marked on the plan: where a robot was sent, what it saw, what it left behind."""

    at: float
    """Mission seconds at which it is known first."""
    kind: str
    """`target`, or the name of the percept or action that tells of it, such as `victim` and `drop_buoy`."""
    robot: str
    position: tuple[float, float]
    """Latitude and longitude in degrees."""
    label: str = ""
    """Of what a robot saw; others may have seen it too."""


@dataclass
class MessageSeen:
    """A message between agents. Times are mission seconds; None = not recorded."""

    id: str
    sender: str
    receiver: str
    performative: str
    content: str
    sent: float | None = None
    received: float | None = None
    answers: bool = False
    """Whether it answers a question."""
    undelivered: str = ""
    """Why it never arrived, as its sender was told."""

    @property
    def at(self) -> float:
        """When it is seen first."""
        return min(time for time in (self.sent, self.received) if time is not None)


@dataclass
class Scene:
    """All that a plot can show of a recording, or of a part of it."""

    title: str
    robots: dict[str, RobotSeen]
    agents: list[str]
    """Who acts or sends, in the order of the mission."""
    robot_of: dict[str, str]
    """The robot of each agent that has one."""
    actions: list[ActionSeen] = field(default_factory=list)
    messages: list[MessageSeen] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)
    begin: float = 0.0
    end: float = 0.0
    """Mission seconds that are shown."""
    modes: list[str] = field(default_factory=list)
    """Every mode of every robot of the recording, also where a part is shown: each keeps its colour."""
    told: bool = False
    """Whether agents told of their deeds, so that there were no more messages than are here."""
    notes: list[str] = field(default_factory=list)
    """What is missing, in words."""

    @property
    def tracks(self) -> dict[str, Track]:
        """By robot."""
        return {name: robot.track for name, robot in self.robots.items()}

    @property
    def origin(self) -> tuple[float, float] | None:
        """The first known home, or the first position of the first robot; None if no position is known."""
        tracks = list(self.tracks.values())
        first = [(track.points[0].latitude, track.points[0].longitude) for track in tracks if track.points]
        return next((track.home for track in tracks if track.home is not None), first[0] if first else None)


class SceneReader:
    """Takes the records of a recording one after the other."""

    def __init__(self, title: str, robot_of: Mapping[str, str], agents: Sequence[str] = ()) -> None:
        """`robot_of`: the robot of each agent that has one, in the order of the mission."""
        self._title, self._robot_of, self._agents = printable(title), dict(robot_of), list(agents)
        first = {robot: agent for agent, robot in reversed(self._robot_of.items())}
        self._eyes = {agent: robot for robot, agent in first.items()}
        """Of the agents that share a robot, the one through whom it is seen."""
        self._robots = {robot: RobotSeen(robot) for robot in dict.fromkeys(self._robot_of.values())}
        self._actions = ActionsSeen()
        self._messages: dict[str, MessageSeen] = {}
        self._places: dict[tuple[str, str], Place] = {}
        self._first: float | None = None
        self._now = 0.0
        self._lost = self._left_out = 0
        self._told = False

    def read(self, records: Iterable[Heard]) -> Scene:
        """Take all records. Returns what is to be shown of them."""
        for heard in records:
            self._now = max(self._now, heard.at)
            self._first = heard.at if self._first is None else min(self._first, heard.at)
            parsed = keys.parse(heard.key)
            agent = printable(parsed[1]) if parsed else "?"
            match heard.record:
                case Perception() as percept if agent in self._eyes and not _absurd(percept):
                    robot = self._robots[self._eyes[agent]]
                    robot.percept(percept, heard.at, _tell_nobody)
                    self._sight(robot, percept)
                case ActionStatus() as status:
                    self._status(agent, status)
                case MindDeeds() as deeds:
                    self._told = True
                    for deed in deeds.deeds:  # each agent counts from its own start
                        self._deed(agent, heard.at - max(0.0, deeds.now - deed.time), deed)
                    self._left_out += deeds.left_out
        return self._scene()

    def _sight(self, robot: RobotSeen, percept: Perception) -> None:
        """Note what a robot saw somewhere else than itself: `victim(3, Lat, Lon)`."""
        if percept.update == "remove" or len(percept.parameters) < 3:
            return
        *names, latitude, longitude = percept.parameters
        where, home = _position(latitude, longitude), robot.home or robot.position
        if where is None or home is None or distance(where, home) > NEAR:
            return
        label = printable(",".join(map(write, names)))
        self._mark(label, Place(self._now, printable(percept.name), robot.name, where, label))

    def _status(self, agent: str, status: ActionStatus) -> None:
        self._actions.status(agent, status, self._now, _tell_nobody)
        robot = self._robots.get(self._robot_of.get(agent, ""))
        if robot is None:
            return
        if status.name in TARGETS and len(status.parameters) >= 2:
            where = _position(*status.parameters[:2])
            if where is not None:
                self._mark(f"{robot.name} {where[0]:.7f} {where[1]:.7f}", Place(self._now, TARGET, robot.name, where))
        if status.name.startswith(DROPS) and status.state == "succeeded" and robot.position is not None:
            self._mark(status.id, Place(self._now, printable(status.name), robot.name, robot.position))

    def _mark(self, name: str, place: Place) -> None:
        if len(self._places) < MAX_PLACES:
            self._places.setdefault((place.kind, name), place)

    def _deed(self, agent: str, at: float, deed: Deed) -> None:
        if deed.kind not in ("sent", "received", "undelivered"):
            return
        name = deed.id or f"{agent} {at} {len(self._messages)}"
        seen = self._messages.get(name)
        if seen is None:
            if len(self._messages) >= MAX_MESSAGES:
                self._lost += 1
                return
            other, performative, text = map(printable, (deed.other, deed.performative, deed.text))
            sender, receiver = (other, agent) if deed.kind == "received" else (agent, other)
            seen = MessageSeen(name, sender, receiver, performative, text, answers=bool(deed.in_reply_to))
            self._messages[name] = seen
        match deed.kind:
            case "sent":
                seen.sent = at
            case "received":
                seen.received = at
            case _:
                seen.undelivered = printable(deed.reason) or "not delivered"
                seen.sent = at if seen.sent is None else seen.sent
        if seen.sent is not None and seen.received is not None and seen.received < seen.sent:
            seen.received = (
                seen.sent
            )  # two clocks that are read at different moments: nothing arrives before it is sent

    def _scene(self) -> Scene:
        met = {name for one in self._messages.values() for name in (one.sender, one.receiver)}
        met |= {one.agent for one in self._actions.by_id.values()}
        scene = Scene(
            title=self._title,
            robots=self._robots,
            agents=list(dict.fromkeys([*self._agents, *self._robot_of, *sorted(met)])),
            robot_of=self._robot_of,
            actions=list(self._actions.by_id.values()),
            messages=sorted(self._messages.values(), key=lambda message: message.at),
            places=list(self._places.values()),
            begin=self._first or 0.0,
            end=self._now,
            told=self._told,
            modes=list(dict.fromkeys(mode for robot in self._robots.values() for _, mode in robot.track.modes)),
        )
        if self._actions.forgotten:
            scene.notes.append(f"{self._actions.forgotten} actions are left out, the first ones")
        if self._lost:
            scene.notes.append(f"{self._lost} messages are left out, the last ones")
        if self._left_out:
            scene.notes.append(f"of {self._left_out} deeds the agents themselves had no room to tell")
        return scene


def _absurd(percept: Perception) -> bool:
    """Whether it tells an altitude that no figure has room for."""
    return percept.name == "altitude" and any(abs(finite(term) or 0) > HIGHEST for term in percept.parameters)


def _position(latitude: Term, longitude: Term) -> tuple[float, float] | None:
    """Return degrees; None for what is no place on earth."""
    one, two = finite(latitude), finite(longitude)
    if one is None or two is None or abs(one) > 90 or abs(two) > 180:
        return None
    return one, two


def _tell_nobody(who: str, what: str, level: object) -> None:
    """A plot needs no journal."""


def part_of(scene: Scene, robots: list[str], begin: float | None, end: float | None) -> Scene:
    """Return what a scene shows of some robots (none named: all) between two mission times.

    Raises ValueError that names the robots there are, or says why nothing lies between the times.
    """
    for name in robots:
        if name not in scene.robots:
            raise ValueError(f"there is no robot {name} in it; there are {', '.join(scene.robots) or 'none'}")
    first = scene.begin if begin is None else begin
    last = max(scene.end, scene.begin + SHORTEST) if end is None else end
    if first >= last or first > scene.end or last < scene.begin:
        raise ValueError(
            f"nothing lies between {first:g} s and {last:g} s: it goes from {scene.begin:.1f} s to {scene.end:.1f} s"
        )
    shown = {name: robot for name, robot in scene.robots.items() if not robots or name in robots}
    agents = [name for name in scene.agents if not robots or scene.robot_of.get(name) in shown]

    def during(since: float, until: float | None) -> bool:
        return since <= last and (until is None or until >= first)

    return Scene(
        title=scene.title,
        robots=shown,
        agents=agents if not robots else [*agents, *_partners(scene, agents)],
        robot_of=scene.robot_of,
        actions=[one for one in scene.actions if one.agent in agents and during(one.began, one.ended)],
        messages=[
            one
            for one in scene.messages
            if (one.sender in agents or one.receiver in agents) and during(one.at, one.received or one.at)
        ],
        places=[one for one in scene.places if (one.robot in shown or one.label) and one.at <= last],
        begin=first,
        end=last,
        modes=scene.modes,
        told=scene.told,
        notes=list(scene.notes),
    )


def _partners(scene: Scene, agents: list[str]) -> list[str]:
    """Return those with whom some agents exchange messages."""
    met = {one.receiver for one in scene.messages if one.sender in agents}
    met |= {one.sender for one in scene.messages if one.receiver in agents}
    return [name for name in scene.agents if name in met and name not in agents]
