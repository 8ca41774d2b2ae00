"""The members of a fleet: agents, robots, boards and clients, and which agents act with which robot.

A member is made when the mission names it or it is first heard. Unknown values are None, never guessed.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from argosy.fleet_model.fleet_status import Row, Standing
from argosy.fleet_model.robots import MAX_POINTS, RobotSeen, Track
from schemas.liveness import STALE_AFTER
from schemas.mission.model import Mission
from schemas.wire.mind_records import BeliefView, MindView
from schemas.wire.records import Health, Mailboxes, Note

MOST = 500
"""Members of one kind that are kept besides those of the mission; those that went first are forgotten first."""
PRINTS = 3
"""Printed lines of an agent that are kept."""

M = TypeVar("M", bound="Member")
_NUMBERS = re.compile(r"(\d+)")


@dataclass
class Member:
    """A holder of a name on the bus, with its daemon."""

    name: str
    daemon: str
    board: str = ""
    """Empty: not known."""
    row: Row | None = None
    """Presence and health of its daemon; None = it was never there."""
    since: float | None = None
    """Time at which it came, or went if it is gone."""
    ended: bool = False
    """It left at the end of its run, which is no loss."""
    health: Health | None = None
    """The last health record of its daemon."""
    health_at: float | None = None
    """Time of that record."""

    @property
    def there(self) -> bool:
        """Whether its daemon holds its name on the bus."""
        return self.row is not None and self.row.standing not in ("missing", "unclaimed")

    @property
    def standing(self) -> Standing:
        """Presence of its daemon (docs/guides/monitoring.md)."""
        return "missing" if self.row is None else self.row.standing

    @property
    def well(self) -> bool:
        """Whether it is there and publishes its health."""
        return self.row is not None and self.row.well

    @property
    def notes(self) -> tuple[Note, ...]:
        """Warnings that hold now: of its presence, and its own."""
        return () if self.row is None or self.ended else self.row.notes

    @property
    def lag(self) -> float:
        """Seconds by which it is behind; 0 if not known."""
        return 0.0 if self.row is None or self.row.now is None else self.row.now.lag

    @property
    def drops(self) -> int:
        """Number of items that its queues have dropped."""
        return 0 if self.row is None or self.row.now is None else self.row.now.drops


@dataclass
class FleetAgent(Member):
    """An agent and the last views of its mind."""

    daemon: str = "agentd"
    robot: str = ""
    """The robot that it acts with; empty: none, or not known yet."""
    mind: MindView | None = None
    detail: MindView | None = None
    """The last view with plans and decisions; see `detailed`."""
    believed: tuple[BeliefView, ...] = ()
    """The beliefs of the last view that has them."""
    heard: float | None = None
    """Time of `mind`."""
    detailed: float | None = None
    """Time of `detail`."""
    silent: float | None = None
    """Time since when its mind does not answer although the router does; None = it answers."""
    why_silent: str = ""
    """The error in place of an answer."""
    prints: deque[str] = field(default_factory=lambda: deque(maxlen=PRINTS))
    """The last lines that its program printed."""

    def forget(self) -> None:
        """Forget its mind: it has been replaced by one that has not been seen yet."""
        self.mind = self.detail = self.heard = self.detailed = self.silent = None
        self.believed, self.why_silent = (), ""

    def age(self, now: float) -> float | None:
        """Return the age of `mind` in seconds; None if there is none."""
        return None if self.heard is None else max(0.0, now - self.heard)


@dataclass
class FleetRobot(Member):
    """A robot, its bridge, and what its agents perceive."""

    daemon: str = "bridged"
    agents: tuple[str, ...] = ()
    """The agents that act with it, by its bridge or the mission."""
    seen: RobotSeen = field(default_factory=lambda: RobotSeen(""))

    @property
    def heard(self) -> float:
        """Time at which its state was last known; 0 = never. Bridges publish changes, and each second their health."""
        seen = self.seen
        return seen.heard if seen.lost or not seen.heard or self.health_at is None else max(seen.heard, self.health_at)

    def age(self, now: float) -> float | None:
        """Return how old its state is, in seconds; None if it was never heard."""
        return max(0.0, now - self.heard) if self.heard else None

    def stale(self, now: float) -> bool:
        """Whether its state is old at `now`, in model seconds, or was never known."""
        age = self.age(now)
        return age is None or self.seen.lost or age > STALE_AFTER


@dataclass
class FleetBoard(Member):
    """A board's `commd` and its mailboxes."""

    daemon: str = "commd"
    mailboxes: Mailboxes | None = None
    heard: float | None = None
    """Time of `mailboxes`."""
    problem: str = ""
    """Why its mailboxes are not known now; empty if they are."""

    def waiting(self, names: Sequence[str] | None = None) -> int:
        """Return how many messages wait there, for these receivers or for all."""
        queues = () if self.mailboxes is None else self.mailboxes.queues
        return sum(queue.messages for queue in queues if names is None or queue.receiver in names)


class Roster:
    """The members by name, in order, and no more than there is room for."""

    def __init__(self, mission: Mission | None, track_points: int = MAX_POINTS) -> None:
        """`track_points` are kept of each robot's track."""
        self.agents: dict[str, FleetAgent] = {}
        self.robots: dict[str, FleetRobot] = {}
        self.boards: dict[str, FleetBoard] = {}
        self.clients: dict[str, Member] = {}
        self.robot_seen_by: dict[str, str] = {}
        """For each robot the agent or client whose percepts show it, as key, and the robot."""
        self.forgotten = 0
        """Members that are no longer kept."""
        self._track_points = track_points
        self._boards_of: dict[str, str] = {}
        self._named: dict[str, int] = {}
        """The members of the mission, with their place in it."""
        if mission is not None:
            self.expect(mission)

    def expect(self, mission: Mission) -> None:
        """Add the members of a mission; forget those of another mission that were never seen."""
        everybody = [*mission.board_names, *mission.robots, *mission.agents]
        self._named = {name: place for place, name in enumerate(everybody)}
        for board in mission.board_names:
            self.boards.setdefault(board, FleetBoard(board, board=board))
        for name, robot in mission.robots.items():
            self.robots.setdefault(name, self._robot(name)).board = robot.board
            self.set_agents(name, tuple(mission.agents_of(name)))
        for name, agent in mission.agents.items():
            member = self.agents.setdefault(name, FleetAgent(name))
            member.board, member.robot = agent.board, agent.robot or member.robot
        self._only_known(self.boards)
        self._only_known(self.robots)
        self._only_known(self.agents)
        self._see()

    def member(self, name: str, daemon: str) -> Member:
        """Return a member; make it if it is new."""
        match daemon:
            case "agentd":
                board = self._boards_of.get(name, "")
                return self._kept(self.agents, name, lambda: FleetAgent(name, board=board, robot=self.robot_of(name)))
            case "bridged":
                return self._kept(self.robots, name, lambda: self._robot(name))
            case "commd":
                return self._kept(self.boards, name, lambda: FleetBoard(name, board=name))
        return self._kept(self.clients, name, lambda: Member(name, daemon))

    def forget(self, before: float) -> None:
        """Forget minds, vehicles and mail that were last heard before that time: they are of an earlier run."""
        for agent in self.agents.values():
            if agent.heard is None or agent.heard < before:
                agent.forget()
        for robot in self.robots.values():
            robot.seen = robot.seen.since(before)
        for board in self.boards.values():
            if board.heard is None or board.heard < before:
                board.mailboxes = board.heard = None

    def set_agents(self, robot: str, agents: tuple[str, ...]) -> None:
        """Set the agents of a robot."""
        member = self.robots[robot]
        if member.agents == agents:
            return
        member.agents = agents
        self._see()
        for agent in agents:
            if agent in self.agents:
                self.agents[agent].robot = robot

    def live_on(self, board: str, agents: Iterable[str]) -> None:
        """Set the board of some agents; those of the mission live where it says."""
        for agent in (name for name in agents if name not in self._named):
            if agent in self.agents:
                self.agents[agent].board = board
            if len(self._boards_of) < MOST:
                self._boards_of[agent] = board

    def _see(self) -> None:
        self.robot_seen_by = {one.agents[0]: name for name, one in self.robots.items() if one.agents}

    def robot_of(self, agent: str) -> str:
        """Return the robot that an agent or client acts with; empty if it has none."""
        return next((name for name, robot in self.robots.items() if agent in robot.agents), "")

    def _robot(self, name: str) -> FleetRobot:
        return FleetRobot(name, seen=RobotSeen(name, track=Track(most=self._track_points)))

    def _kept(self, members: dict[str, M], name: str, make: Callable[[], M]) -> M:
        if name not in members:
            others = [one for one in members.values() if one.name not in self._named]
            if len(others) >= MOST:
                gone = [one for one in others if not one.there]
                del members[min(gone or others, key=lambda one: one.since or 0.0).name]
                self.forgotten += 1
                self._see()
            members[name] = make()
            self._put_in_order(members)
        return members[name]

    def _only_known(self, members: dict[str, M]) -> None:
        """Forget members that are not in the mission and were never there."""
        for name in [name for name, one in members.items() if name not in self._named and one.since is None]:
            del members[name]
        self._put_in_order(members)

    def _put_in_order(self, members: dict[str, M]) -> None:
        """Sort: members of the mission in its order, then the others by name, `uav2` before `uav10`."""
        last = len(self._named)
        for name in sorted(members, key=lambda one: (self._named.get(one, last), _numbered(one))):
            members[name] = members.pop(name)


def notes_of(members: Iterable[Member]) -> dict[Note, list[str]]:
    """Return the notes of some members, each with the names of the members that have it."""
    named: dict[Note, list[str]] = {}
    for member in members:
        for note in member.notes:
            named.setdefault(note, []).append(member.name)
    return named


def _numbered(name: str) -> list[tuple[int, str]]:
    """Return a sort key of a name that compares its numbers as numbers."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in _NUMBERS.split(name)]
