"""The shared model of a running fleet: made from records alone, so that it needs no bus and a recording gives the same.

Whatever may grow is bounded, and nothing that has gone silent looks alive: everything has the time at which it was
heard.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal

from msgspec.structs import replace

from argosy.cli.journal import Level
from argosy.cli.remedies import level_of
from argosy.fleet_model.fleet_status import FleetStatus, Row, expected_of
from argosy.fleet_model.lost_actions import Lives, why_unknown
from argosy.fleet_model.members import Member, TeamAgent, TeamRobot
from argosy.fleet_model.message_log import MessageLog
from argosy.fleet_model.mission_clock import MissionClock
from argosy.fleet_model.naming import named
from argosy.fleet_model.places import Places
from argosy.fleet_model.robots import ActionSeen, ActionsSeen, written
from argosy.fleet_model.roster import Roster
from argosy.fleet_model.run_boundaries import Runs
from argosy.fleet_model.timeline import Timeline
from argosy.fleet_model.timeline_source import Teller
from schemas.files.findings import Findings
from schemas.humanize import shortened
from schemas.liveness import ROUTER_GRACE, SILENT_AFTER
from schemas.mission.model import Mission, read_mission
from schemas.wire.mind_records import MindDeeds, MindView
from schemas.wire.records import (
    FINAL_STATES,
    ActionStatus,
    BoardServices,
    Health,
    Mailboxes,
    Perception,
    RunningMission,
    RunPhase,
    RunState,
    State,
)

ENDS: frozenset[RunPhase] = frozenset({"bringing_home", "done", "failed"})
"""Phases of a run in which its daemons leave."""
PHASES: dict[RunPhase, str] = {
    "starting": "the run starts",
    "flying": "the mission is flown",
    "bringing_home": "the run brings its vehicles home",
    "done": "the mission is done",
    "failed": "the mission has failed",
}
OVER = "not known: the run in which it was sent is over"
OTHERS = 20
"""Other fleets whose names are kept."""


class TeamModel:
    """Everything known of one fleet. `now` returns Unix seconds of a clock that never jumps."""

    def __init__(self, now: Callable[[], float], *, fleet: str = "", mission: Mission | None = None) -> None:
        self.now, self.mission = now, mission
        self.fleet = fleet if mission is None else mission.fleet
        """Empty until one is known."""
        self.other_fleets: set[str] = set()
        """Further fleets at the same router."""
        self._roster = roster = Roster(mission)
        self.agents, self.robots, self.boards, self.clients = (
            roster.agents,
            roster.robots,
            roster.boards,
            roster.clients,
        )
        """Clients are programs that act as agents, and what else holds a name on the bus."""
        self.timeline, self.letters, self.places, self._actions = Timeline(), MessageLog(), Places(), ActionsSeen()
        self.clock = MissionClock(mission)
        self.mission_problem = ""
        """Why the mission of the fleet is not known here, although a board has served it; empty: it is."""
        self._mission_of = ""
        """The board whose mission counts, while it is there."""
        self.run_state: RunState | None = None
        """What `argosy run` has published last; None = nothing, as of a fleet of boards that nobody watches over."""
        self.run_heard = 0.0
        """Unix seconds of `run_state`."""
        self._run_ended = 0.0
        """Unix seconds at which the run was first heard to be done or to have failed."""
        self.router_up = True
        self.router_since: float | None = None
        """Unix seconds at which the router was lost or came back; None = it has been there all the time."""
        self.defect = ""
        """What went wrong in here when it was last looked at who is there; empty: nothing."""
        self._fleet_status = FleetStatus(mission, now)
        self._tell = Teller(self.timeline, self.letters, now)
        self._lives, self._runs = Lives(), Runs()

    @property
    def eyes(self) -> dict[str, str]:
        """The agent or client through whom each robot is seen, and the robot."""
        return self._roster.eyes

    @property
    def run(self) -> int:
        """The number of the run that is on: with another one, what was shown of the run before is over."""
        return self._runs.number

    @property
    def over(self) -> bool:
        """Whether the run is done or has failed: nothing flies any more, and its daemons leave."""
        return self.run_state is not None and self.run_state.phase in ("done", "failed")

    @property
    def as_of(self) -> float:
        """Unix seconds at which what is shown holds: now, or when the run ended."""
        return self._run_ended if self.over else self.now()

    @property
    def run_silent(self) -> float | None:
        """Seconds since `argosy run` was heard, if it should be heard and is not."""
        if self.run_state is None or self.over or not self.router_up or self._coming_back():
            return None
        age = self.now() - max(self.run_heard, self.router_since or 0.0)
        return age if age > SILENT_AFTER else None

    @property
    def forgotten(self) -> int:
        """How many members are not kept any more."""
        return self._roster.forgotten

    @property
    def actions(self) -> dict[str, ActionSeen]:
        """The actions by their ids, the oldest first. Their times are Unix seconds."""
        return self._actions.by_id

    def open_actions(self, agent: str | None = None) -> list[ActionSeen]:
        """Return the actions that have no final state yet, of one agent or of all, the oldest first."""
        return self._actions.open(agent)

    def hold_actions(self) -> None:
        """Let what becomes of the actions from now on change nothing here: this model is a copy of one that goes on."""
        self._actions = self._actions.held()

    def mail_for(self, agent: str) -> int:
        """Return how many messages wait for an agent at the boards, besides those in its mind's mailbox."""
        return sum(board.waiting((agent,)) for board in self.boards.values())

    # What is taken in. Keys are whole Zenoh keys; what is of another fleet or malformed is left alone.

    def token(self, key: str, alive: bool) -> None:
        """A liveliness token came or went."""
        parsed = named(key)
        if parsed is None or len(parsed[2]) != 3:
            return
        if parsed[0] != self.fleet:
            if len(self.other_fleets) < OTHERS:
                self.other_fleets.add(parsed[0])
            return
        self._fleet_status.token(key, alive)
        name, (_, daemon, boot) = parsed[1], parsed[2]
        self._runs.token((name, daemon, boot), alive, self.now())
        if alive and self._lives.token(name, daemon, boot, self.now()) and daemon == "agentd" and name in self.agents:
            self.agents[name].forget()  # the new life's mind is another, also if it was kept
            self.clock.restarted(name)
        if alive and self.router_up and not self._coming_back():
            self._see_run()  # now, and not at the next tick: what is heard from here on is of the new one

    def health(self, key: str, health: Health) -> None:
        """A daemon told how it is."""
        parsed = named(key)
        if parsed is None or parsed[0] != self.fleet or len(parsed[2]) != 2:
            return
        name, daemon = parsed[1], parsed[2][1]
        member = self._roster.member(name, daemon)
        known = {note.identity for note in member.notes}
        for note in health.notes:
            if note.identity not in known:
                self._tell(name, note.text, level_of(note))
        self._fleet_status.heard(key, health)
        member.told = self.now()
        if isinstance(member, TeamRobot):
            if health.percepts:
                self._roster.has(name, tuple(health.percepts))
            member.seen.operator = health.ordered or ""

    def percept(self, key: str, percept: Perception) -> None:
        """An agent perceived something; a robot is seen through the first of those that have it."""
        name = self._name(key)
        if name is None:
            return
        if not percept.name:
            percept = replace(percept, name=key.rpartition("/")[2])
        self.places.percept(name, percept, self._positions, self.now())
        if not percept.header.source:  # it is an agent's matter alone: no robot has said so
            text = f"{percept.update} {written(percept.name, percept.parameters)}"
            self.timeline.add(self.now(), name, "operator", f"a percept by hand: {text}", "warning")
        elif name in self.eyes:
            self.robots[self.eyes[name]].seen.percept(percept, self.now(), self._tell)

    def status(self, key: str, status: ActionStatus) -> None:
        """An action began, went on or ended."""
        name = self._name(key)
        if name is None:
            return
        tell = partial(self._tell.action, status)
        action = self._actions.status(name, status, self.now(), tell, self.clock.speed)
        if action is None:
            return
        self.places.action(action, self._positions, self.now())
        agent = self.agents.get(name)
        ordered = status.order if status.cause == "operator" else None
        if agent is not None and ordered is not None and agent.robot in self.robots:
            self.robots[agent.robot].seen.operator = ordered

    def mind(self, agent: str, view: MindView, *, detailed: bool = False) -> None:
        """An agent showed its mind; `detailed`: with its plans and all decisions that it keeps."""
        member = self._roster.member(agent, "agentd")
        assert isinstance(member, TeamAgent)
        if member.silent is not None:
            self._tell(agent, f"its mind answers again, after {self.now() - member.silent:.0f} s", "good")
        self.clock.look(agent, view.time, self.now())
        if not math.isfinite(view.time):
            view = replace(view, time=0.0)
        member.mind, member.heard, member.silent, member.why_silent = view, self.now(), None, ""
        if detailed:
            member.detail, member.detailed = view, self.now()

    def mind_unanswered(self, agent: str, why: str = "") -> None:
        """An agent was asked for its mind and did not show it."""
        member = self.agents.get(agent)
        if member is None or not member.there or not self.router_up or self.over:
            return
        last = max(member.heard or 0.0, member.since or 0.0, self.router_since or 0.0)
        member.why_silent = why
        if member.silent is None and self.now() - last > SILENT_AFTER:
            member.silent = last
            self._tell(
                agent, f"its mind has not answered for {SILENT_AFTER:.0f} s{': ' if why else ''}{why}", "warning"
            )

    def deeds(self, key: str, told: MindDeeds) -> None:
        """An agent told what it has done."""
        name = self._name(key)
        if name is None:
            return
        self._tell.deeds(name, told)
        for deed in told.deeds:
            action = self.actions.get(shortened(deed.id)) if deed.kind == "outcome" else None
            if action is not None and action.agent == name and action.state not in FINAL_STATES:
                state = next((one for one in FINAL_STATES if one == deed.state), None)
                self._ends(action, state or "unknown", deed.reason)

    def mailboxes(self, key: str, told: Mailboxes | None, problem: str = "") -> None:
        """A board told what waits there, or why it did not."""
        name = self._name(key)
        board = self.boards.get(name or "")
        if board is None:
            return
        board.problem = problem
        if told is not None:
            board.mailboxes, board.heard = told, self.now()

    def services(self, key: str, told: BoardServices) -> None:
        """A board told which agents live on it."""
        name = self._name(key)
        if name is not None:
            self._roster.live_on(name, told.agents)

    def mission_told(self, key: str, told: RunningMission) -> None:
        """A board told the mission file that it runs: it counts, whatever file the observer was started with."""
        board, known = self._name(key), self.boards.get(self._mission_of)
        if board is None or (known is not None and known.there and known.name != board):
            return
        self._mission_of = board
        if self.mission is not None and self.mission.text == told.text:
            return
        try:
            mission = read_mission(told.text, Path(told.file))
        except Findings as findings:
            self.mission_problem = f"the mission of the fleet cannot be read here: {findings.findings[0].message}"
            return
        self.mission, self.mission_problem = mission, ""
        self._roster.expect(mission)
        self._fleet_status.expected = expected_of(mission)
        self.clock.expect(mission)

    def run_told(self, key: str, state: RunState) -> None:
        """`argosy run` told how far it has come."""
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
        self._tell(self.fleet, f"{PHASES[state.phase]}{': ' if state.why else ''}{state.why}", level)

    def router(self, up: bool) -> None:
        """The router was lost or came back."""
        if up == self.router_up:
            return
        before, self.router_since, self.router_up = self.router_since, self.now(), up
        if up:
            self._tell("router", f"it answers again, after {self.now() - (before or self.now()):.1f} s", "good")
        elif self.over:
            self._tell("router", "it has ended with the run: what is shown is how that ended")
        else:
            self._tell("router", "it does not answer: what is shown is what was known last", "error")

    def tick(self) -> None:
        """See who came and went: to be called some times a second, as time alone changes that."""
        if not self.router_up:  # nobody has gone because we hear nothing
            return
        coming_back = self._coming_back()
        if not coming_back:
            self._see_run()
        rows = {(row.name, row.daemon): row for row in self._fleet_status.rows()}
        for (name, daemon), row in rows.items():
            if not (coming_back and row.standing == "missing"):
                self._stands(self._roster.member(name, daemon), row)
        if not coming_back:
            for members in (self.agents, self.robots, self.boards, self.clients):
                for member in members.values():
                    if (member.name, member.daemon) not in rows:
                        self._stands(member, None)
            for action in self._actions.open():
                why = why_unknown(action, self._roster, self._lives, self.now())
                if why:
                    self._ends(action, "unknown", f"not known how it ended: {why}")
                    self._tell(action.agent, f"{action.text}: {action.reason}", "warning")

    def _coming_back(self) -> bool:
        """Whether the router came back so lately that not all that are there may have been heard."""
        return self.router_since is not None and self.now() - self.router_since < ROUTER_GRACE

    def _see_run(self) -> None:
        """Forget what is of an earlier run, if another one is on; the timeline keeps what happened."""
        before = self._runs.anew()
        if before is None:
            return
        self._roster.forget(before)
        self.places.forget(before)
        self._actions.forget(before)
        self.letters.give_up(before, OVER)
        if self.run_heard < before:
            self.run_state = None
            self.clock.begin()
        self._tell(self.fleet, "a new run begins: everybody of the one before had gone")

    def _ends(self, action: ActionSeen, state: State | Literal["unknown"], reason: str) -> None:
        self._actions.end(action, state, reason, self.now())
        self.places.action(action, self._positions, self.now())

    def _stands(self, member: Member, row: Row | None) -> None:
        was, member.row = member.there, row
        if member.there == was:
            return
        member.since = self.now()
        if isinstance(member, TeamAgent):
            member.silent = None
        member.ended = not member.there and self._leaves(member)
        what: Literal["came", "went"] = "came" if member.there else "went"
        level: Level = "info" if member.there or member.ended else "warning"
        text = f"{member.daemon} {'is there' if member.there else 'has ended' if member.ended else 'is gone'}"
        self.timeline.add(self.now(), member.name, what, text, level)

    def _leaves(self, member: Member) -> bool:
        """Whether the run has come so far that a member leaves, and it is not one that has died."""
        run = self.run_state
        return run is not None and run.phase in ENDS and f"{member.daemon} {member.name}" not in run.dead

    def _name(self, key: str) -> str | None:
        """Return whom a key of this fleet is about."""
        parsed = named(key.partition("?")[0])
        if parsed is None or parsed[0] != self.fleet:
            return None
        return parsed[1]

    def _positions(self) -> set[tuple[float, float]]:
        """Return where the fleet is."""
        known = (one.seen.position or one.seen.home for one in self.robots.values())
        return {position for position in known if position is not None}
