"""What an observer on the bus knows of a fleet: made from records alone, so that a recording gives the same picture."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field

from argosy.cli.journal import Journal
from argosy.cli.remedies import level_of
from argosy.fleet_model.robots import ActionSeen, ActionsSeen, RobotSeen
from bridged.bridge.safety_orders import UNATTENDED
from schemas.humanize import printable
from schemas.mission.model import Mission
from schemas.wire import keys
from schemas.wire.mind_records import IntentionView, MindView
from schemas.wire.records import ActionStatus, Health, Perception

KEPT_PRINTS = 50


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


class Picture:
    """Everything known about the agents and robots of a mission; changes worth a line go to the journal."""

    def __init__(self, mission: Mission, journal: Journal, now: Callable[[], float]) -> None:
        self.mission, self.journal, self._now = mission, journal, now
        self.agents = {name: AgentSeen(name, agent.robot) for name, agent in mission.agents.items()}
        self.robots = {name: RobotSeen(name) for name in mission.robots}
        self._actions = ActionsSeen()
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

    @property
    def actions(self) -> dict[str, ActionSeen]:
        """The actions by their ids, the oldest first."""
        return self._actions.by_id

    @property
    def actions_forgotten(self) -> int:
        """How many older actions are not among them any more."""
        return self._actions.forgotten

    def open_actions(self) -> list[ActionSeen]:
        """Return the actions that have no final state yet, the oldest first."""
        return self._actions.open()

    def flying(self) -> bool:
        """Whether any vehicle is armed, or was when it fell silent."""
        return any(robot.armed for robot in self.robots.values())

    def idle(self) -> bool:
        """Whether every agent says that it has nothing left to do, no action runs, and no client is there to act."""
        agents = (self.health.get((name, "agentd")) for name, agent in self.agents.items() if agent.cycle)
        saying = [health is not None and health.idle is True for health in agents]
        clients = any(daemon == "client" for _, daemon, _ in self.alive)
        return len(saying) == len(self.agents) and all(saying) and not self.open_actions() and not clients

    def paused(self) -> list[str]:
        """Return the robots that an operator has paused."""
        return [robot.name for robot in self.robots.values() if robot.paused]

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
            if parsed[1] in self.robots and _unattended(health) and not _unattended(before):
                self.robots[parsed[1]].unattended = True
            known = {note.identity for note in before.notes} if before is not None else set()
            for note in health.notes:
                if note.identity not in known:
                    self.journal.add(parsed[1], note.text, level_of(note))

    def percept(self, key: str, percept: Perception) -> None:
        """An agent perceived something; a robot is seen through the first of those that have it."""
        self.counts["percepts"] += 1
        parsed = keys.parse(key)
        seen = self.eyes.get(parsed[1]) if parsed else None
        if seen is None:
            return
        self.robots[seen].percept(percept, self._now(), self.journal.add)

    def status(self, key: str, status: ActionStatus) -> None:
        """An action began, went on or ended."""
        self.counts["statuses"] += 1
        parsed = keys.parse(key)
        agent = parsed[1] if parsed else "?"
        if self._actions.status(agent, status, self._now(), self.journal.add) is None:
            return
        robot = next((name for name in self.robots if agent in self.mission.agents_of(name)), None)
        if robot is not None and not status.final:
            self.robots[robot].unattended = False
        elif robot is not None and status.cause == "operator" and status.order is not None:
            self.ordered(robot, status.order)

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
        agent.beliefs = view.beliefs

    def agent_ended(self, name: str) -> None:
        """An agent's process is dead: what its mind was is not what it is, should it come again."""
        agent = self.agents[name]
        agent.intentions, agent.cycle, agent.done, agent.failed, agent.beliefs = (), 0, {}, {}, ()

    def bridge_ended(self, robot: str) -> None:
        """The bridge of a robot is dead: its vehicle is not heard, and what ran there has no outcome.

        Another life of the bridge tells positions before it knows whether the vehicle is armed: the vehicle counts as
        heard again by its `state` alone.
        """
        seen = self.robots[robot]
        seen.heard, seen.connected = self.heard_of(seen), False
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

    def not_commanded(self) -> str:
        """Return in words which vehicle's autopilot is none that is commanded; nothing if all are."""
        for name in self.robots:
            if (health := self.health.get((name, "bridged"))) is not None:
                for note in health.notes:
                    if note.code == "autopilot_unknown":
                        return f"{name}: {note.text}"
        return ""

    def done(self) -> bool:
        """Whether every `done` formula of the mission holds; a mission without one is never done."""
        wanted = self.mission.done
        return bool(wanted) and all(self.agents[one.agent].done.get(one.formula, False) for one in wanted)


def _unattended(health: Health | None) -> bool:
    return health is not None and any(note.code == UNATTENDED for note in health.notes)
