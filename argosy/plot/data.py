"""The scene of a plot: flights, actions and messages of a fleet, from a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from argosy.fleet_model.actions import ActionSeen
from argosy.fleet_model.message_log import LoggedMessage, MessageLog
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.robots import MAX_POINTS, RobotSeen, Track
from argosy.fleet_model.term_values import finite, position_of
from schemas.geo import distance
from schemas.humanize import printable
from schemas.mission.model import Mission
from schemas.wire import keys
from schemas.wire.mind_records import MindActivity
from schemas.wire.records import ActionStatus, Perception, Record
from schemas.wire.term_text import write

SHORTEST = 1.0
"""Mission seconds that are shown at least, also of an empty recording."""
NEAR = 20_000.0
"""Metres from home within which the last two parameters of a percept are taken for a place."""
HIGHEST = 1_000_000.0
"""Metres above home that are drawn."""
MAX_MESSAGES = 20_000
"""Messages that are kept; older ones are counted."""
LONGEST_CONTENT = 2_000
"""Characters of a message's content, as agents publish it."""
MAX_PLACES = 2_000
"""Places that are marked."""
TARGET = "target"
TARGETS = ("goto", "setpoint")
"""Actions whose first two parameters are the place that is flown to."""
DROPS = "drop"
"""Prefix of actions that leave something at the position of the robot."""


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
    """A mark on the map: a target, a sighting, or something left behind."""

    at: float
    """Mission seconds at which it is known first."""
    kind: str
    """`target`, or the name of the percept or action, such as `victim` and `drop_buoy`."""
    robot: str
    position: tuple[float, float]
    """Latitude and longitude in degrees."""
    label: str = ""
    """Of a sighting; other robots may have seen it too."""


@dataclass
class Scene:
    """All that a plot can show of a recording, or of a part of it."""

    title: str
    robots: dict[str, RobotSeen]
    agents: list[str]
    """Agents that act or send, in the order of the mission."""
    robot_of: dict[str, str]
    """The robot of each agent that has one."""
    actions: list[ActionSeen] = field(default_factory=list)
    messages: list[LoggedMessage] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)
    begin: float = 0.0
    end: float = 0.0
    """Mission seconds that are shown."""
    modes: list[str] = field(default_factory=list)
    """All modes in the recording, so that each has the same colour in every part of it."""
    has_activity: bool = False
    """Whether agents published their activity, so that the messages are complete."""
    notes: list[str] = field(default_factory=list)
    """Missing data, as text."""

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

    def __init__(
        self,
        title: str,
        fleet: str,
        robot_of: Mapping[str, str],
        agents: Sequence[str] = (),
        *,
        mission: Mission | None = None,
        speed: float = 1.0,
    ) -> None:
        """`robot_of`: the robot of each agent that has one, in the order of the mission; `speed`: of the recording."""
        self._title, self._robot_of, self._agents = printable(title), dict(robot_of), list(agents)
        self._now = 0.0
        self._model = FleetModel(
            lambda: self._now,
            fleet=fleet,
            mission=mission,
            track_points=MAX_POINTS,
            messages=MessageLog(MAX_MESSAGES, LONGEST_CONTENT),
            rate=speed,
            sees_runs=False,
        )
        for robot in dict.fromkeys(self._robot_of.values()):
            self._model.roster.member(robot, "bridged")
            agents = tuple(agent for agent, its in self._robot_of.items() if its == robot)
            self._model.roster.set_agents(robot, agents)  # where neither a mission nor a bridge says so
        self._places: dict[tuple[str, str], Place] = {}
        self._first: float | None = None
        self._has_activity = False

    def read(self, records: Iterable[Heard]) -> Scene:
        """Take all records. Returns the scene of the whole recording."""
        for heard in records:
            self._now = max(self._now, heard.at)
            self._first = heard.at if self._first is None else min(self._first, heard.at)
            if isinstance(heard.record, Perception) and _absurd(heard.record):
                continue
            self._model.take(heard.key, heard.record)
            parsed = keys.parse(heard.key)
            agent = parsed[1] if parsed else ""
            match heard.record:
                case Perception() as percept if agent in self._model.roster.robot_seen_by:
                    self._sight(self._model.robots[self._model.roster.robot_seen_by[agent]].seen, percept)
                case ActionStatus() as status if agent in self._robot_of:
                    self._target(self._model.robots[self._robot_of[agent]].seen, status)
                case MindActivity():
                    self._has_activity = True
        return self._scene()

    def _sight(self, robot: RobotSeen, percept: Perception) -> None:
        """Mark what a robot saw somewhere else than itself: `victim(3, Lat, Lon)`."""
        if percept.update == "remove" or len(percept.parameters) < 3:
            return
        *names, latitude, longitude = percept.parameters
        where, home = position_of(latitude, longitude), robot.home or robot.position
        if where is None or home is None or distance(where, home) > NEAR:
            return
        label = printable(",".join(map(write, names)))
        self._mark(label, Place(self._now, printable(percept.name), robot.name, where, label))

    def _target(self, robot: RobotSeen, status: ActionStatus) -> None:
        """Mark where a robot was sent, and what it left behind."""
        if status.name in TARGETS and len(status.parameters) >= 2:
            where = position_of(*status.parameters[:2])
            if where is not None:
                self._mark(f"{robot.name} {where[0]:.7f} {where[1]:.7f}", Place(self._now, TARGET, robot.name, where))
        if status.name.startswith(DROPS) and status.state == "succeeded" and robot.position is not None:
            self._mark(status.id, Place(self._now, printable(status.name), robot.name, robot.position))

    def _mark(self, name: str, place: Place) -> None:
        if len(self._places) < MAX_PLACES:
            self._places.setdefault((place.kind, name), place)

    def _scene(self) -> Scene:
        model = self._model
        robots = {name: model.robots[name].seen for name in dict.fromkeys(self._robot_of.values())}
        messages = sorted(model.messages.newest(), key=lambda message: message.at)
        met = {name for one in messages for name in (one.sender, one.receiver)}
        met |= {action.agent for action in model.actions.by_id.values()}
        scene = Scene(
            title=self._title,
            robots=robots,
            agents=list(dict.fromkeys([*self._agents, *self._robot_of, *sorted(met)])),
            robot_of=self._robot_of,
            actions=list(model.actions.by_id.values()),
            messages=messages,
            places=list(self._places.values()),
            begin=self._first or 0.0,
            end=self._now,
            has_activity=self._has_activity,
            modes=list(dict.fromkeys(mode for robot in robots.values() for _, mode in robot.track.modes)),
        )
        if model.actions.forgotten:
            scene.notes.append(f"{model.actions.forgotten} actions are left out, the first ones")
        if model.messages.forgotten:
            scene.notes.append(f"{model.messages.forgotten} messages are left out, the first ones")
        if model.reporter.left_out:
            scene.notes.append(
                f"{model.reporter.left_out} activity events are missing: the agents had no room to publish them"
            )
        return scene


def _absurd(percept: Perception) -> bool:
    """Whether it is an altitude that no figure has room for."""
    return percept.name == "altitude" and any(abs(finite(term) or 0) > HIGHEST for term in percept.parameters)


def part_of(scene: Scene, robots: list[str], begin: float | None, end: float | None) -> Scene:
    """Return the part of a scene with some robots (none named: all) from `begin` to `end`, in mission seconds.

    Raises ValueError that says why nothing lies between the times.
    """
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
        has_activity=scene.has_activity,
        notes=list(scene.notes),
    )


def _partners(scene: Scene, agents: list[str]) -> list[str]:
    """Return the agents that exchange messages with some agents."""
    met = {one.receiver for one in scene.messages if one.sender in agents}
    met |= {one.sender for one in scene.messages if one.receiver in agents}
    return [name for name in scene.agents if name in met and name not in agents]
