"""The members of a fleet by name: made when they are first heard of, in order, and no more than there is room for."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import TypeVar

from argosy.fleet_model.members import Member, TeamAgent, TeamBoard, TeamRobot
from schemas.mission.model import Mission

MOST = 500
"""Members of one kind that are kept; those that went first are forgotten first."""

M = TypeVar("M", bound=Member)
_NUMBERS = re.compile(r"(\d+)")


class Roster:
    """Agents, robots, boards and clients, and who acts with which robot."""

    def __init__(self, mission: Mission | None) -> None:
        self.agents: dict[str, TeamAgent] = {}
        self.robots: dict[str, TeamRobot] = {}
        self.boards: dict[str, TeamBoard] = {}
        self.clients: dict[str, Member] = {}
        self.eyes: dict[str, str] = {}
        """The agent or client through whom each robot is seen, and the robot."""
        self.forgotten = 0
        """Members that are not kept any more."""
        self._boards_of: dict[str, str] = {}
        self._named: dict[str, int] = {}
        """The members that the mission names, with their place in it."""
        if mission is not None:
            self.expect(mission)

    def expect(self, mission: Mission) -> None:
        """Take the members of a mission; those of another one that were never seen are forgotten."""
        everybody = [*mission.board_names, *mission.robots, *mission.agents]
        self._named = {name: place for place, name in enumerate(everybody)}
        for board in mission.board_names:
            self.boards.setdefault(board, TeamBoard(board, board=board))
        for name, robot in mission.robots.items():
            self.robots.setdefault(name, TeamRobot.named(name)).board = robot.board
            self.has(name, tuple(mission.agents_of(name)))
        for name, agent in mission.agents.items():
            member = self.agents.setdefault(name, TeamAgent(name))
            member.board, member.robot = agent.board, agent.robot or member.robot
        self._only_known(self.boards)
        self._only_known(self.robots)
        self._only_known(self.agents)
        self._see()

    def member(self, name: str, daemon: str) -> Member:
        """Return a member, made if it is not known yet."""
        match daemon:
            case "agentd":
                board = self._boards_of.get(name, "")
                return self._kept(self.agents, name, lambda: TeamAgent(name, board=board, robot=self._robot_of(name)))
            case "bridged":
                return self._kept(self.robots, name, lambda: TeamRobot.named(name))
            case "commd":
                return self._kept(self.boards, name, lambda: TeamBoard(name, board=name))
        return self._kept(self.clients, name, lambda: Member(name, daemon))

    def forget(self, before: float) -> None:
        """Forget what was heard of minds, vehicles and mail before that time: it is of an earlier run."""
        for agent in self.agents.values():
            if agent.heard is None or agent.heard < before:
                agent.forget()
        for robot in self.robots.values():
            robot.seen = robot.seen.since(before)
        for board in self.boards.values():
            if board.heard is None or board.heard < before:
                board.mailboxes = board.heard = None

    def has(self, robot: str, agents: tuple[str, ...]) -> None:
        """A robot has these agents."""
        member = self.robots[robot]
        if member.agents == agents:
            return
        member.agents = agents
        self._see()
        for agent in agents:
            if agent in self.agents:
                self.agents[agent].robot = robot

    def live_on(self, board: str, agents: Iterable[str]) -> None:
        """These agents live on a board."""
        for agent in agents:
            if agent in self.agents:
                self.agents[agent].board = board
            if len(self._boards_of) < MOST:
                self._boards_of[agent] = board

    def _see(self) -> None:
        self.eyes = {one.agents[0]: name for name, one in self.robots.items() if one.agents}

    def _robot_of(self, agent: str) -> str:
        return next((name for name, robot in self.robots.items() if agent in robot.agents), "")

    def _kept(self, members: dict[str, M], name: str, make: Callable[[], M]) -> M:
        if name not in members:
            if len(members) >= MOST:
                gone = [one for one in members.values() if not one.there]
                del members[min(gone or members.values(), key=lambda one: one.since or 0.0).name]
                self.forgotten += 1
                self._see()  # a robot that is forgotten is seen through nobody
            members[name] = make()
            self._put_in_order(members)
        return members[name]

    def _only_known(self, members: dict[str, M]) -> None:
        """Forget those that neither the mission names nor anybody has seen."""
        for name in [name for name, one in members.items() if name not in self._named and one.since is None]:
            del members[name]
        self._put_in_order(members)

    def _put_in_order(self, members: dict[str, M]) -> None:
        """Keep those of the mission as it has them, then the others by name, `uav2` before `uav10`."""
        last = len(self._named)
        for name in sorted(members, key=lambda one: (self._named.get(one, last), _numbered(one))):
            members[name] = members.pop(name)


def _numbered(name: str) -> list[tuple[int, str]]:
    """Return a name so that numbers in it are compared as numbers."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in _NUMBERS.split(name)]
