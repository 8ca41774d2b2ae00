"""What must hold in every run, judged from outside: by the records on the bus and the true state of the vehicles.

| rule | judged by |
|---|---|
| `mail lost`, `mail reordered`, `mail doubled` | receipts of boards and of agents, and what minds are given |
| `one final status` | action statuses |
| `true end` | action statuses, and the vehicle in the seconds before |
| `one holder` | running actions, and the percept `holder` |
| `nobody alone` | processes of agents, their health records, and the vehicle |
| `motion after stop` | orders of the operator that were confirmed, action statuses, and the vehicle |
| `left to the pilot` | action statuses and percepts after a pilot took over, and the vehicle |
| `limits`, `on the ground` | vehicles |
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import msgspec

from argosy.trial import faults
from argosy.trial.network import Query, Sample, Session
from argosy.trial.world import SAMPLED, Seen, World
from bridged.bridge.safety_orders import COMING, StepField, read_steps
from bridged.drivers.mavlink.vehicle.flight_modes import COMING_HOME
from bridged.drivers.registry import load_robot_manifest
from bridged.simulation.turtle.turtle import Turtle
from schemas.files.findings import Findings
from schemas.geo import distance
from schemas.manifest.model import ActionEntry
from schemas.mission.model import NO_STEPS, Mission
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.health import each_health
from schemas.wire.records import ActionStatus, Health, Mail, Message, Perception, Perceptions, Receipt
from schemas.wire.term_text import write

SLACK: Final = 2.0
"""Metres by which a limit may be passed before it counts: vehicles overshoot, and do not measure the truth."""
UNATTENDED: Final = 30.0
"""Virtual seconds beside what the mission declares for which a vehicle may be in the air with nobody in charge: its
bridge may have to be restarted, and to ask again."""
TRUTH: Final = 5.0
"""Virtual seconds before a final status in which the vehicle must have been as the status says."""
SETTLED: Final = 10.0
"""Virtual seconds after a confirmed order of the operator in which a vehicle comes to rest."""
STILL: Final = 5.0
"""Metres by its own estimate for which a vehicle at rest may drift."""
TURTLE_STILL: Final = 0.01
"""Metres for which a turtle at rest may move."""
HANDING_OVER: Final = 3.0
"""Virtual seconds for which two agents may differ about who holds a robot."""
AWARE: Final = 3.0
"""Virtual seconds after which an agent that perceives a pilot's mode leaves the vehicle to him."""
CALM: Final = 60.0
"""Virtual seconds after which mail has arrived, if nothing is wrong with boards, links and receiver meanwhile."""
REGULAR: Final = 3.0
"""Most virtual seconds between two health records of a daemon with which nothing is wrong."""


class Violation(msgspec.Struct, frozen=True):
    """What must not be."""

    rule: str
    """Short name of the checker."""
    at: float
    """Virtual seconds after the start."""
    text: str


class _Look(NamedTuple):
    """A vehicle at one moment."""

    armed: bool
    height: float
    """Metres above home."""


class _Rest(NamedTuple):
    """A vehicle that the operator has stopped, when it was seen first or had time to come to rest."""

    since: float
    armed: bool
    begun: frozenset[str]
    """Actions that had begun."""
    place: tuple[float, float, float] | None = None
    """Latitude, longitude and metres above home where it rests."""


class _Letter(NamedTuple):
    """A message to one receiver; a broadcast has one id for all of its receivers."""

    sender: str
    receiver: str
    id: str

    @classmethod
    def of(cls, message: Message) -> _Letter:
        """Return what identifies a message."""
        return cls(message.sender, message.receiver, message.id)

    def __str__(self) -> str:
        return f"{self.id} from {self.sender} to {self.receiver}"


@dataclass
class _Way:
    """What became of a message that a board has acknowledged to its sender."""

    place: int
    """Among the messages of its sender, in the order in which they were acknowledged."""
    posted: float
    """When it was acknowledged, in virtual seconds."""
    done: bool = False
    """Whether its receiver has taken it, or refused it for good."""


@dataclass
class _Regular:
    """For how long the health records of a daemon have been regular."""

    since: float
    last: float


@dataclass
class _Actions:
    """The actions of one robot that have begun and not ended."""

    boot: str = ""
    """Of its bridge: another one has ended them, or reports them again."""
    agents: dict[str, str] = field(default_factory=dict)
    """The agent of each action, by the action's id."""


class MailChecker:
    """Each message that a board has acknowledged is taken exactly once, and in the order of its sender."""

    def __init__(self, mission: Mission, world: World, tell: Callable[[str, str, str], None]) -> None:
        """`tell(rule, subject, text)` reports a violation."""
        self._mission, self._world, self._tell = mission, world, tell
        self._ways: dict[_Letter, _Way] = {}
        self._given_up: set[tuple[str, str]] = set()
        """Sender and id of the messages of which the sender was notified that they are dead letters."""
        self._fed: dict[Hashable, dict[_Letter, None]] = {}
        """What each life of an agent was given, in that order."""
        self._receipts: dict[_Letter, Hashable] = {}
        """The life of the receiver that has taken it."""
        self._health: dict[tuple[str, str], _Regular] = {}
        world.network.on_query.append(self._answered)

    def healthy(self, name: str, daemon: str) -> None:
        """Note a health record of a daemon."""
        now = self._world.network.loop.time()
        regular = self._health.get((name, daemon))
        if regular is None or now - regular.last > REGULAR:
            regular = self._health[name, daemon] = _Regular(now, now)
        regular.last = now

    def fed(self, life: Hashable, letter: _Letter) -> None:
        """Note that a mind is given a message; `life`: its process."""
        given = self._fed.setdefault(life, {})
        if letter in given:
            self._tell("mail doubled", str(letter), f"{letter} was given to one life of its receiver twice")
        elif (before := self._receipts.get(letter)) is not None and before != life:
            self._tell("mail doubled", str(letter), f"{letter} was given again to a receiver that had taken it")
        given.setdefault(letter)

    def _answered(self, query: Query, reply: Sample) -> None:
        parsed = keys.parse(query.key_expr)
        if parsed is None or parsed[2][0] not in ("outbox", "inbox") or query.payload is None:
            return
        mail = codec(Mail).decode(query.payload.to_bytes(), query.encoding or "")
        receipt = codec(Receipt).decode(reply.payload.to_bytes(), reply.encoding)
        now = self._world.network.loop.time()
        for place, message in enumerate(mail.messages):
            letter = _Letter.of(message)
            if parsed[2][0] == "inbox":
                if message.id.startswith("undelivered."):
                    self._given_up.add((message.receiver, message.id.removeprefix("undelivered.")))
                if place in receipt.later:
                    continue
                if letter in self._ways:
                    self._ways[letter].done = True
                if place not in receipt.refused:
                    self._receipts.setdefault(letter, query.server.owner)
            elif place not in receipt.later and place not in receipt.refused:
                self._ways.setdefault(letter, _Way(len(self._ways), now))

    def finish(self) -> None:
        """Judge what has arrived, and in which order."""
        storm = faults.last(list(self._world.faults))
        for letter, way in self._ways.items():
            if way.done or letter in self._receipts or (letter.sender, letter.id) in self._given_up:
                continue
            if (calm := self._calm(letter, max(storm, way.posted))) >= CALM:
                text = f"{letter}, acknowledged at {way.posted:.1f} s, has not arrived after {calm:.0f} s of calm"
                self._tell("mail lost", str(letter), text)
        for given in self._fed.values():
            latest: dict[tuple[str, str], tuple[int, _Letter]] = {}
            for letter in given:
                if letter not in self._ways:
                    continue
                pair, place = (letter.sender, letter.receiver), self._ways[letter].place
                before = latest.setdefault(pair, (place, letter))
                if place < before[0]:
                    self._tell(
                        "mail reordered", str(letter), f"{letter} was given to its receiver after {before[1].id}"
                    )
                else:
                    latest[pair] = place, letter

    def _calm(self, letter: _Letter, since: float) -> float:
        """Return for how long nothing was wrong with receiver and boards, from a time to the end of the receiver."""
        boards = self._mission.mailboxes
        parties = [(letter.receiver, "agentd"), *((boards[one], "commd") for one in letter[:2] if one in boards)]
        seen = [self._health.get(one) for one in parties]
        if not all(seen):
            return 0.0
        found = [one for one in seen if one is not None]
        return min(one.last for one in found) - max(since, *(one.since for one in found))


class Checkers:
    """All checkers of a run; each rule is reported once for each subject."""

    def __init__(self, mission: Mission, world: World, served: Callable[[str], bool]) -> None:
        """`served(robot)`: whether an agent of the robot is running."""
        self._mission, self._world, self._served = mission, world, served
        self.found: list[Violation] = []
        self._reported: set[tuple[str, str]] = set()
        self._ends: dict[str, tuple[str, str]] = {}
        self._alone: dict[str, tuple[float, str]] = {}
        """Since when each vehicle is in the air with nobody in charge, and why."""
        self._actions = {name: _Actions() for name in mission.robots}
        self._agents = {name: mission.agents_of(name) for name in mission.robots}
        self._robots = {agent: robot for robot in reversed(mission.robots) for agent in self._agents[robot]}
        """The first robot of each agent."""
        self._idle: dict[str, bool] = {}
        """Whether each agent intends nothing, by its last health record."""
        self._holders: dict[str, dict[str, str]] = {}
        """Holder of each robot by agent, as it was last published to that agent."""
        self._differ: dict[str, float] = {}
        """Since when several agents seem to hold a robot."""
        self._rests: dict[str, _Rest] = {}
        self._turtles: dict[str, tuple[float, tuple[float, float] | None]] = {}
        """When each turtle was stopped by the operator, and where it rests, in metres."""
        self._known: set[str] = set()
        """Actions that have begun, by id."""
        self._aware: dict[str, float] = {}
        """Since when each agent perceives the mode of the pilot who has its robot."""
        self._orders: dict[str, str] = {}
        """The last order of an agent that knew of the pilot who has the robot."""
        self._put_down: set[str] = set()
        """Vehicles that a pilot has landed and that were disarmed then."""
        self._past: dict[str, deque[_Look]] = {}
        """Each vehicle in the last seconds."""
        self._manifests = {name: _actions_of(mission, name) for name in mission.robots}
        self._patience = {name: _patience(mission, name) for name in mission.robots}
        self.mail = MailChecker(mission, world, self._tell)
        world.network.on_put.append(self._put)
        world.looks.append(self._look)

    def _tell(self, rule: str, subject: str, text: str) -> None:
        if (rule, subject) not in self._reported:
            self._reported.add((rule, subject))
            self.found.append(Violation(rule, round(self._world.network.loop.time(), 2), text))

    def _put(self, session: Session, sample: Sample) -> None:
        parsed = keys.parse(sample.key_expr)
        if parsed is None:
            return
        _, name, rest = parsed
        match rest:
            case ("status", *_):
                self._status(name, codec(ActionStatus).decode(sample.payload.to_bytes(), sample.encoding))
            case ("health", daemon):
                health = codec(Health).decode(sample.payload.to_bytes(), sample.encoding)
                for one, its in each_health(name, health):
                    self.mail.healthy(one, daemon)
                    if daemon == "agentd":
                        self._idle[one] = its.idle is True
            # Others are not looked at: most percepts tell neither who holds a robot nor the mode of its pilot.
            case ("percepts",) if b"holder" in (payload := sample.payload.to_bytes()) or self._pilots_mode(name):
                for percept in codec(Perceptions).decode(payload, sample.encoding).changes:
                    self._percept(name, percept)
            case _:
                pass

    def _percept(self, agent: str, percept: Perception) -> None:
        if percept.name == "holder":
            self._holder(agent, percept)
        elif agent not in self._aware and (mode := self._pilots_mode(agent)) and mode in percept.parameters:
            self._aware[agent] = self._world.network.loop.time()

    def _pilots_mode(self, agent: str) -> str:
        """Return the mode of the pilot who has an agent's robot; empty: none has it."""
        seen = self._world.vehicles.get(self._robots.get(agent, ""))
        return "" if seen is None else seen.pilots_mode

    def _holder(self, agent: str, percept: Perception) -> None:
        if (robot := self._robots.get(agent)) is not None:
            holders = self._holders.setdefault(robot, {})
            if percept.update == "remove" or not percept.parameters:
                holders.pop(agent, None)
            else:
                holders[agent] = write(percept.parameters[0])

    def _status(self, agent: str, status: ActionStatus) -> None:
        if (robot := self._robots.get(agent)) is not None:
            actions = self._actions[robot]
            if actions.boot != status.header.boot:
                actions.agents.clear()
                actions.boot = status.header.boot
            if status.final:
                actions.agents.pop(status.id, None)
            else:
                actions.agents[status.id] = agent
            if status.id not in self._known and (not status.final or status.state == "succeeded"):
                self._known.add(status.id)
                self._begins(robot, agent, status)
        if not status.final:
            return
        end = status.state, status.reason
        before = self._ends.setdefault(status.id, end)
        if before is end and robot is not None and status.state == "succeeded":
            self._true_end(robot, status)
        if before != end:
            text = f"{status.name} {status.id} ended as {before[0]} ({before[1]}) and as {end[0]} ({end[1]})"
            self._tell("one final status", status.id, text)

    def _begins(self, robot: str, agent: str, status: ActionStatus) -> None:
        """Note an order of an agent that knows of the pilot who has the robot."""
        action, now = self._manifests[robot].get(status.name), self._world.network.loop.time()
        controls = action is not None and (action.motion or action.confirm in ("armed", "mode"))
        if controls and now - self._aware.get(agent, now) > AWARE:
            self._orders[robot] = f"{status.name} {status.id}"

    def _true_end(self, robot: str, status: ActionStatus) -> None:
        """Compare a success with the vehicle, by the state that confirms it in the manifest."""
        action, seen = self._manifests[robot].get(status.name), self._world.vehicles.get(robot)
        if action is None or seen is None:
            return
        past = [*self._past.get(robot, ()), _Look(seen.armed, seen.height)]
        match action.confirm, status.parameters:
            case "altitude", (int() | float() as altitude, *_):
                true = any(abs(one.height - altitude) <= (action.tolerance or 0.0) + SLACK for one in past)
            case (("landed" | "home"), _):
                true = any(not one.armed and one.height <= SLACK for one in past)
            case "armed", (bool() as armed, *_):
                true = any(one.armed == armed for one in past)
            case _:
                return
        if not true:
            is_armed = "armed" if past[-1].armed else "not armed"
            given = ", ".join(map(str, status.parameters))
            text = f"{status.name}({given}) {status.id} succeeded; {robot} is {is_armed}, {past[-1].height:.1f} m high"
            self._tell("true end", status.id, text)

    def _look(self) -> None:
        now = self._world.network.loop.time()
        for name, seen in self._world.vehicles.items():
            past = self._past.setdefault(name, deque(maxlen=round(TRUTH / SAMPLED)))
            past.append(_Look(seen.armed, seen.height))
            limits = self._mission.robots[name].limits
            if limits.altitude is not None and seen.height > limits.altitude + SLACK:
                self._tell("limits", f"{name} altitude", f"{name} is at {seen.height:.1f} m of {limits.altitude:g} m")
            if limits.radius is not None and seen.farthest > limits.radius + SLACK + seen.misled:
                self._tell("limits", f"{name} radius", f"{name} was {seen.farthest:.0f} m from home")
            self._look_who_attends(name, seen, now)
            self._look_who_is_stopped(name, seen, now)
            self._look_who_has_a_pilot(name, seen)
        for name, turtle in self._world.turtles.items():
            self._look_at_a_turtle(name, turtle, now)
        for robot in self._mission.robots:
            self._look_who_holds(robot, now)

    def _look_who_attends(self, name: str, seen: Seen, now: float) -> None:
        """Judge how long a vehicle is in the air while its agents are gone, or intend nothing.

        While its board has no power nobody can attend it.
        """
        why: StepField | None = None
        dead = now < self._world.machine(self._mission.robots[name].board).down_until
        others = dead or seen.piloted or name in self._world.stopped
        if seen.armed and seen.height > 1 and seen.mode not in COMING_HOME and not others:
            agents = self._agents[name]
            if not self._served(name):
                why = "on_agent_loss"
            elif all(self._idle.get(one, False) for one in agents) and not self._actions[name].agents:
                why = "on_idle"
        if why is None:
            self._alone.pop(name, None)
            return
        since, before = self._alone.setdefault(name, (now, why))
        patience = self._patience[name][why]
        if before != why:
            self._alone[name] = now, why
        elif patience is not None and now - since > patience + UNATTENDED:
            what = "without an agent" if why == "on_agent_loss" else "with nothing intended"
            self._tell("nobody alone", name, f"{name} is in the air in {seen.mode}, {what} since {since:.0f} s")

    def _look_who_is_stopped(self, name: str, seen: Seen, now: float) -> None:
        """Judge a vehicle that the operator has stopped: it rests or comes down, and nothing begins."""
        order, begun = self._world.stopped.get(name), frozenset(self._actions[name].agents)
        if order is None or seen.piloted:
            self._rests.pop(name, None)
            return
        rest = self._rests.setdefault(name, _Rest(now, seen.armed, begun))
        if seen.armed and not rest.armed:
            self._tell(
                "motion after stop", name, f"{name} was armed after the operator's {order} at {rest.since:.0f} s"
            )
        elif order != "pause" and (more := begun - rest.begun):
            text = f"{', '.join(sorted(more))} began after the operator's {order} at {rest.since:.0f} s"
            self._tell("motion after stop", name, text)
        if seen.mode in COMING_HOME or not seen.armed:
            self._rests[name] = rest._replace(armed=seen.armed, place=None)
        elif now - rest.since > SETTLED:
            here = *seen.estimated, seen.height
            there = rest.place or here
            self._rests[name] = rest._replace(place=there)
            if distance(there[:2], here[:2]) > STILL + seen.misled or abs(there[2] - here[2]) > STILL:
                text = f"{name} moves in {seen.mode} after the operator's {order} at {rest.since:.0f} s"
                self._tell("motion after stop", name, text)

    def _look_at_a_turtle(self, name: str, turtle: Turtle, now: float) -> None:
        """Judge a turtle that the operator has stopped: it stays where it has come to rest."""
        if (order := self._world.stopped.get(name)) is None:
            self._turtles.pop(name, None)
            return
        since, rest = self._turtles.setdefault(name, (now, None))
        if now - since <= SETTLED:
            return
        here = turtle.x, turtle.y
        self._turtles[name] = since, rest or here
        if rest is not None and math.dist(rest, here) > TURTLE_STILL:
            self._tell("motion after stop", name, f"{name} moves after the operator's {order} at {since:.0f} s")

    def _look_who_has_a_pilot(self, name: str, seen: Seen) -> None:
        """Judge a vehicle that a pilot has, or has landed: no agent takes it from him, and nothing arms it again."""
        if not seen.pilots_mode:
            self._orders.pop(name, None)
            for agent in self._agents[name]:
                self._aware.pop(agent, None)
        elif not seen.piloted and (order := self._orders.get(name)):
            text = f"{order} took {name} from its pilot, from {seen.pilots_mode} to {seen.mode}"
            self._tell("left to the pilot", name, text)
        if seen.landed_by_pilot and not seen.armed:
            self._put_down.add(name)
        elif seen.armed and name in self._put_down:
            self._tell("left to the pilot", name, f"{name} was armed again after its pilot had landed it")

    def _look_who_holds(self, robot: str, now: float) -> None:
        acting = set(self._actions[robot].agents.values())
        believed = set(self._holders.get(robot, {}).values())
        if len(acting) < 2 and len(believed) < 2:
            self._differ.pop(robot, None)
        elif now - self._differ.setdefault(robot, now) > HANDING_OVER:
            names = ", ".join(sorted(acting if len(acting) > 1 else believed))
            self._tell("one holder", robot, f"{robot} has been held by {names} for {HANDING_OVER:g} s")

    def finish(self) -> list[Violation]:
        """Judge the end of the run; return everything that was found."""
        for name, seen in self._world.vehicles.items():
            if seen.armed and not seen.piloted and not seen.parked:
                self._tell("on the ground", name, f"the run is over and {name} is armed, {seen.height:.1f} m high")
        self.mail.finish()
        return self.found

    def watch_minds(self) -> None:
        """Look at each message that a mind of this process is given."""
        from agentd.mail.mail_client import MailClient
        from agentd.mind.data.inputs import Mail as GivenMail
        from argosy.trial.process import PRESENT

        tell = MailClient.tell

        def told(client: MailClient, mail: GivenMail, *numbers: Any) -> None:
            self.mail.fed(PRESENT.get(), _Letter(mail.sender, client._agent, mail.msg_id))
            tell(client, mail, *numbers)

        MailClient.tell = told  # type: ignore[assignment, method-assign]


def _actions_of(mission: Mission, robot: str) -> dict[str, ActionEntry]:
    """Return the actions of a robot's manifest."""
    return dict(load_robot_manifest(mission.robots[robot].manifest, mission.path.parent).actions)


def _patience(mission: Mission, robot: str) -> dict[StepField, float | None]:
    """Return for how many seconds the mission lets a robot wait before it comes down; None: it never does."""
    one = mission.robots[robot]
    first: dict[StepField, float] = {"on_agent_loss": float(one.agent_silence), "on_idle": float(one.idle_after)}
    return {why: _until_it_comes(mission, robot, why, wait) for why, wait in first.items()}


def _until_it_comes(mission: Mission, robot: str, why: StepField, wait: float) -> float | None:
    if getattr(mission.robots[robot], why) == NO_STEPS:
        return None
    try:
        steps = read_steps(mission, robot, why)
    except Findings:  # `argosy check` reports them
        return None
    for step in steps:
        if step.order in COMING:
            return wait + float(mission.robots[robot].idle_after)
        wait += step.pause
    return None
