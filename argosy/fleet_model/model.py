"""The model of a fleet behind `argosy run`, `ui`, `watch` and `plot`, filled from records of the bus or of a recording.

Everything that grows is bounded. Everything has the time at which it was heard, so that old data is shown as old. Times
are seconds of the model's clock `now`: Unix seconds, or in `plot` mission seconds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace as changed
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

from msgspec.structs import replace

from argosy.cli.journal import Level
from argosy.cli.remedies import level_of
from argosy.fleet_model.actions import ActionSeen, ActionsSeen, why_unknown
from argosy.fleet_model.fleet_status import FleetStatus, Row, expected_of
from argosy.fleet_model.lives import Lives
from argosy.fleet_model.members import FleetAgent, FleetRobot, Member, Roster
from argosy.fleet_model.message_log import MessageLog
from argosy.fleet_model.mission_clock import MissionClock
from argosy.fleet_model.places import Places
from argosy.fleet_model.robots import UNATTENDED
from argosy.fleet_model.term_values import Position
from argosy.fleet_model.timeline import Reporter, Timeline
from schemas.files.findings import Findings
from schemas.humanize import shortened
from schemas.liveness import ROUTER_GRACE, SILENT_AFTER
from schemas.mission.model import Mission, read_mission
from schemas.wire import keys
from schemas.wire.keys import check_name
from schemas.wire.mind_records import MindActivity, MindView
from schemas.wire.records import (
    FINAL_STATES,
    ActionStatus,
    BoardServices,
    Health,
    Mailboxes,
    Order,
    Perception,
    Perceptions,
    Record,
    RunningMission,
    RunPhase,
    RunState,
    State,
)
from schemas.wire.term_text import write
from schemas.wire.terms import Structure

ENDS: frozenset[RunPhase] = frozenset({"bringing_home", "done", "failed"})
"""Phases of a run in which its daemons leave."""
PHASES: dict[RunPhase, str] = {
    "starting": "the run starts",
    "running": "the mission runs",
    "bringing_home": "the run brings its vehicles home",
    "done": "the mission is done",
    "failed": "the mission has failed",
}
OVER = "not known: the run in which it was sent is over"
OTHERS = 20
"""Other fleets whose names are kept."""
TRACK = 2_000
"""Points kept of each robot's track, unless another number is given."""

M = TypeVar("M", bound=Member)


class FleetModel:
    """Everything known of one fleet. Keys are whole Zenoh keys; those of other fleets are ignored."""

    def __init__(
        self,
        now: Callable[[], float],
        *,
        fleet: str = "",
        mission: Mission | None = None,
        track_points: int = TRACK,
        messages: MessageLog | None = None,
        rate: float = 1.0,
        sees_runs: bool = True,
    ) -> None:
        """`now` is a clock that never jumps, in seconds; `rate`: its seconds per wall second.

        `messages` keeps those between agents. `track_points` are kept of each robot's track.

        `sees_runs`: one run may follow another, and what is of the run before is forgotten.
        """
        self.now, self.mission, self._sees_runs = now, mission, sees_runs
        self.fleet = fleet if mission is None else mission.fleet
        """Empty until one is known."""
        self.other_fleets: set[str] = set()
        """Further fleets at the same router."""
        self.roster = roster = Roster(mission, track_points)
        self.agents, self.robots, self.boards = roster.agents, roster.robots, roster.boards
        self.clients = roster.clients
        """Programs that act as agents, and other holders of names on the bus."""
        self.clock = MissionClock(mission)
        self.timeline = Timeline(self.clock.seconds)
        self.messages, self.places = MessageLog() if messages is None else messages, Places()
        self.actions = ActionsSeen()
        self.counts: Counter[str] = Counter()
        """Percepts and statuses that were heard."""
        self.mission_problem = ""
        """Why the mission that a board has served cannot be used here; empty if it can."""
        self._mission_of = ""
        """The board whose mission counts, while it is there."""
        self.run_state: RunState | None = None
        """The last record of `argosy run`; None = none, as in a fleet of boards without a run."""
        self.run_heard = 0.0
        """Time of `run_state`."""
        self._run_ended = 0.0
        """Time at which the run was first heard to be done or to have failed."""
        self.router_up = True
        self.router_since: float | None = None
        """Time at which the router was lost or came back; None = it has been there all the time."""
        self.defect = ""
        """The error of the last `tick`; empty: none."""
        self._fleet_status = FleetStatus(mission, now)
        self.reporter = Reporter(self.timeline, self.messages, now, rate)
        self.lives = Lives()

    @property
    def over(self) -> bool:
        """Whether the run is done or has failed: nothing flies any more, and its daemons leave."""
        return self.run_state is not None and self.run_state.phase in ("done", "failed")

    @property
    def as_of(self) -> float:
        """Time for which the model holds: now, or when the run ended."""
        return self._run_ended if self.over else self.now()

    @property
    def run_silent(self) -> float | None:
        """Seconds since `argosy run` was heard; None if it is heard, or there is none."""
        if self.run_state is None or self.over or not self.router_up or self._coming_back():
            return None
        age = self.now() - max(self.run_heard, self.router_since or 0.0)
        return age if age > SILENT_AFTER else None

    def mail_for(self, agent: str) -> int:
        """Return how many messages wait for an agent at the boards, besides those in its mind's mailbox."""
        return sum(board.waiting((agent,)) for board in self.boards.values())

    def holders(self, daemon: str) -> set[str]:
        """Return the names that daemons of this kind hold on the bus."""
        return self._fleet_status.holders(self.fleet, daemon)

    def health_of(self, name: str, daemon: str) -> Health | None:
        """Return the last health record of a daemon; None if there is none."""
        return self._fleet_status.health_of(self.fleet, name, daemon)

    def unheard(self, member: Member) -> bool:
        """Whether a member has published neither health nor a token for `SILENT_AFTER`, although the router answers."""
        known = (at for at in (member.health_at, member.since, self.router_since) if at is not None)
        return self.router_up and self.now() - max(known, default=-math.inf) > SILENT_AFTER

    def frozen(self) -> FleetModel:
        """Return a copy with a stopped clock that later records do not change."""
        at, held = self.now(), copy(self)
        held.now = lambda: at
        held.agents, held.boards, held.clients = _copies(self.agents), _copies(self.boards), _copies(self.clients)
        held.robots = {name: changed(robot, seen=copy(robot.seen)) for name, robot in self.robots.items()}
        held.timeline = copy(self.timeline)
        held.timeline.entries = self.timeline.entries.copy()
        held.actions = self.actions.held()
        return held

    def take(self, key: str, record: Record) -> None:
        """Take a record of the bus or of a recording; records that do not concern the model are ignored."""
        match record:
            case Perception():
                self.percept(key, record)
            case ActionStatus():
                self.status(key, record)
            case MindActivity():
                self.activity(key, record)
            case Health():
                self.health(key, record)
            case BoardServices():
                self.services(key, record)
            case RunState():
                self.run_published(key, record)
            case RunningMission():
                self.mission_published(key, record)

    def token(self, key: str, alive: bool) -> None:
        """Take a liveliness token that appeared or vanished."""
        parsed = named(key)
        if parsed is None or len(parsed[2]) != 3:
            return
        if parsed[0] != self.fleet:
            if len(self.other_fleets) < OTHERS:
                self.other_fleets.add(parsed[0])
            return
        self._fleet_status.token(key, alive)
        name, (_, daemon, boot) = parsed[1], parsed[2]
        restarted = self.lives.token((name, daemon, boot), alive, self.now())
        if restarted and daemon == "agentd" and name in self.agents:
            self.agents[name].forget()
            self.clock.restarted(name)
        if alive and self.router_up and not self._coming_back():
            self._see_run()  # before the next record, which is of the new run

    def health(self, key: str, health: Health) -> None:
        """Take the health record of a daemon."""
        parsed = named(key)
        if parsed is not None and parsed[0] == self.fleet:
            for (_, name, daemon), its in self._fleet_status.heard(key, health):
                self._health_of(name, daemon, its)

    def _health_of(self, name: str, daemon: str, health: Health) -> None:
        member = self.roster.member(name, daemon)
        before = member.health
        same_life = before is not None and before.header.boot == health.header.boot
        known = {note.identity for note in before.notes} if before is not None and same_life else set()
        for note in health.notes:
            if note.identity not in known:
                self.reporter(name, note.text, level_of(note))
        member.health, member.health_at = health, self.now()
        if isinstance(member, FleetRobot):
            if health.percepts:
                self.roster.set_agents(name, tuple(health.percepts))
            seen = member.seen
            seen.unattended = seen.unattended or any(
                note.code == UNATTENDED and note.identity not in known for note in health.notes
            )
            if health.ordered != (None if before is None else before.ordered):  # changes only: an order may be known
                seen.operator = health.ordered or ""  # before the first health record that has it

    def percepts(self, key: str, perceptions: Perceptions) -> None:
        """Take changes of the percepts of an agent."""
        for percept in perceptions.changes:
            self.percept(key, percept)

    def percept(self, key: str, percept: Perception) -> None:
        """Take a percept of an agent; each robot is known by the percepts of one of its agents."""
        self.counts["percepts"] += 1
        name = self._name(key)
        if name is None:
            return
        if not percept.name:
            percept = replace(percept, name=key.rpartition("/")[2])
        self.places.percept(name, percept, self._positions, self.now())
        if "/percept_by_hand/" in key:
            text = f"{percept.update} {write(Structure(percept.name, percept.parameters))}"
            self.timeline.add(self.now(), name, "operator", f"a percept by hand: {text}", "warning")
        elif name in self.roster.robot_seen_by:
            self.robots[self.roster.robot_seen_by[name]].seen.percept(percept, self.now(), self.reporter)

    def status(self, key: str, status: ActionStatus) -> None:
        """Take the status of an action."""
        self.counts["statuses"] += 1
        name = self._name(key)
        if name is None:
            return
        tell = partial(self.reporter.action, status)
        action = self.actions.status(name, status, self.now(), tell, self.clock.speed)
        if action is None:
            return
        self.places.action(action, self._positions, self.now())
        robot = self.robots.get(self.roster.robot_of(name))
        if robot is not None and not status.final:
            robot.seen.unattended = False
        elif robot is not None and status.cause == "operator" and status.order is not None:
            self.ordered(robot.name, status.order)

    def ordered(self, robot: str, order: Order) -> None:
        """Take that an operator has given a robot an order, which its agents cannot override."""
        seen = self.robots[robot].seen
        if seen.operator != order:
            seen.operator = order
            gives_back = f"; `argosy stop release {robot}` gives it back to its agents" if order == "hold" else ""
            self.reporter(robot, f"the operator orders {order}{gives_back}", "warning")

    def released(self, robot: str) -> None:
        """Take that an operator has given a robot back to its agents."""
        self.robots[robot].seen.operator = ""
        self.reporter(robot, "released by the operator: its agents act again", "warning")

    def bridge_died(self, robot: str) -> None:
        """Take that the bridge of a robot has died: its vehicle is lost, and its actions have failed.

        The next life of the bridge publishes positions before it knows whether the vehicle is armed: the vehicle is
        heard again with its `state`, not before.
        """
        member = self.robots[robot]
        member.seen.heard, member.seen.connected = member.heard, False
        for action in self.actions.open():
            if action.agent in member.agents:
                self._ends(action, "failed", "its bridge died")

    def mind(self, agent: str, view: MindView, *, detailed: bool = False) -> None:
        """Take a view of an agent's mind; `detailed`: with its plans and all decisions that it keeps."""
        member = self.roster.member(agent, "agentd")
        assert isinstance(member, FleetAgent)
        if member.silent is not None:
            self.reporter(agent, f"its mind answers again, after {self.now() - member.silent:.0f} s", "good")
        self.clock.look(agent, view.time, self.now())
        if not math.isfinite(view.time):
            view = replace(view, time=0.0)
        done = {} if member.mind is None else member.mind.done
        for formula, holds in view.done.items():
            if holds and not done.get(formula):
                self.reporter(agent, f"done: {formula}", "good")
        member.mind, member.heard, member.silent, member.why_silent = view, self.now(), None, ""
        if view.beliefs or not view.beliefs_left_out:
            member.believed = view.beliefs
        if detailed:
            member.detail, member.detailed = view, self.now()

    def mind_unanswered(self, agent: str, why: str = "") -> None:
        """Take that an agent did not answer the request for its mind."""
        member = self.agents.get(agent)
        if member is None or not member.there or not self.router_up or self.over:
            return
        last = max(member.heard or 0.0, member.since or 0.0, self.router_since or 0.0)
        member.why_silent = why
        if member.silent is None and self.now() - last > SILENT_AFTER:
            member.silent = last
            self.reporter(
                agent, f"its mind has not answered for {SILENT_AFTER:.0f} s{': ' if why else ''}{why}", "warning"
            )

    def activity(self, key: str, activity: MindActivity) -> None:
        """Take what an agent has done."""
        name = self._name(key)
        if name is None:
            return
        self.reporter.activity(name, activity)
        for event in activity.events:
            if event.kind == "print" and name in self.agents:
                self.agents[name].prints.append(shortened(event.text))
            action = self.actions.by_id.get(shortened(event.id)) if event.kind == "outcome" else None
            if action is not None and action.agent == name and action.state not in FINAL_STATES:
                state = next((one for one in FINAL_STATES if one == event.state), None)
                self._ends(action, state or "unknown", event.reason)

    def mailboxes(self, key: str, mailboxes: Mailboxes | None, problem: str = "") -> None:
        """Take the mailboxes of a board, or why they are not known."""
        name = self._name(key)
        board = self.boards.get(name or "")
        if board is None:
            return
        board.problem = problem
        if mailboxes is not None:
            board.mailboxes, board.heard = mailboxes, self.now()

    def services(self, key: str, services: BoardServices) -> None:
        """Take the agents of a board."""
        name = self._name(key)
        if name is not None:
            self.roster.live_on(name, services.agents)

    def mission_published(self, key: str, mission_file: RunningMission) -> None:
        """Take the mission file that a board runs; it replaces the file that the observer was started with."""
        board, known = self._name(key), self.boards.get(self._mission_of)
        if board is None or (known is not None and known.there and known.name != board):
            return
        self._mission_of = board
        if self.mission is not None and self.mission.text == mission_file.text:
            return
        try:
            mission = read_mission(mission_file.text, Path(mission_file.file))
        except Findings as findings:
            self.mission_problem = f"the mission of the fleet cannot be read here: {findings.findings[0].message}"
            return
        self.mission, self.mission_problem = mission, ""
        self.roster.expect(mission)
        self._fleet_status.expected = expected_of(mission)
        self.clock.expect(mission)

    def run_published(self, key: str, state: RunState) -> None:
        """Take the state of `argosy run`."""
        if self._name(key) is None:
            return
        was, self.run_state, self.run_heard = self.run_state, state, self.now()
        if not self.over:
            self.clock.look_at_run(state.mission_time, state.speed, self.now())
        for members in (self.agents, self.robots, self.boards):
            for member in members.values():
                member.ended = member.ended and self._leaves(member)
        if was is not None and was.phase == state.phase:
            return
        if self.over:
            self._run_ended = self.now()
        level: Level = "good" if state.phase == "done" else "error" if state.phase == "failed" else "info"
        self.reporter(self.fleet, f"{PHASES[state.phase]}{': ' if state.why else ''}{state.why}", level)

    def router(self, up: bool) -> None:
        """Take the loss or the return of the router."""
        if up == self.router_up:
            return
        before, self.router_since, self.router_up = self.router_since, self.now(), up
        if up:
            self.reporter("router", f"answers again, after {self.now() - (before or self.now()):.1f} s", "good")
        elif self.over:
            self.reporter("router", "has ended with the run; the view shows the end of the run")
        else:
            self.reporter("router", "does not answer; the view shows the last known state", "error")

    def tick(self) -> None:
        """Update who is there. Call it several times a second, as time alone changes that."""
        if not self.router_up:  # without the router nothing is heard, which is no loss of a member
            return
        coming_back = self._coming_back()
        if not coming_back:
            self._see_run()
        rows = {(row.name, row.daemon): row for row in self._fleet_status.rows()}
        for (name, daemon), row in rows.items():
            if not (coming_back and row.standing == "missing"):
                self._stands(self.roster.member(name, daemon), row)
        if not coming_back:
            for members in (self.agents, self.robots, self.boards, self.clients):
                for member in members.values():
                    if (member.name, member.daemon) not in rows:
                        self._stands(member, None)
            for action in self.actions.open():
                why = why_unknown(action, self.roster, self.lives, self.now())
                if why:
                    self._ends(action, "unknown", f"not known how it ended: {why}")
                    self.reporter(action.agent, f"{action.text}: {action.reason}", "warning")

    def _coming_back(self) -> bool:
        """Whether the router came back within `ROUTER_GRACE`, so that some members may not have been heard again."""
        return self.router_since is not None and self.now() - self.router_since < ROUTER_GRACE

    def _see_run(self) -> None:
        """Forget the state of an earlier run, if another one has begun; the timeline keeps its events."""
        before = self.lives.new_run() if self._sees_runs else None
        if before is None:
            return
        self.roster.forget(before)
        self.places.forget(before)
        self.actions.forget(before)
        self.messages.give_up(before, OVER)
        if self.run_heard < before:
            self.run_state = None
            self.clock.begin()
        self.reporter(self.fleet, "a new run begins: all daemons of the one before had gone")

    def _ends(self, action: ActionSeen, state: State | Literal["unknown"], reason: str) -> None:
        self.actions.end(action, state, reason, self.now())
        self.places.action(action, self._positions, self.now())

    def _stands(self, member: Member, row: Row | None) -> None:
        was, member.row = member.there, row
        if member.there == was:
            return
        member.since = self.now()
        if isinstance(member, FleetAgent):
            member.silent = None
        member.ended = not member.there and self._leaves(member)
        what: Literal["came", "went"] = "came" if member.there else "went"
        level: Level = "info" if member.there or member.ended else "warning"
        text = f"{member.daemon} {'is there' if member.there else 'has ended' if member.ended else 'is gone'}"
        self.timeline.add(self.now(), member.name, what, text, level)

    def _leaves(self, member: Member) -> bool:
        """Whether the run ends, so that its members leave, and this one has not died."""
        run = self.run_state
        return run is not None and run.phase in ENDS and f"{member.daemon} {member.name}" not in run.dead

    def _name(self, key: str) -> str | None:
        """Return the name in a key of this fleet; None for other keys."""
        parsed = named(key.partition("?")[0])
        if parsed is None or parsed[0] != self.fleet:
            return None
        return parsed[1]

    def _positions(self) -> Iterator[Position]:
        """Yield the known positions of the fleet."""
        for one in self.robots.values():
            if (position := one.seen.position or one.seen.home) is not None:
                yield position


def named(key: str) -> tuple[str, str, list[str]] | None:
    """Split a key into fleet, name and the rest; None if it is malformed."""
    parsed = keys.parse(key)
    try:
        return parsed if parsed is not None and check_name(parsed[0]) and check_name(parsed[1]) else None
    except ValueError:
        return None


def _copies(members: dict[str, M]) -> dict[str, M]:
    return {name: copy(member) for name, member in members.items()}
