"""Run one agent on the bus: its mind, and the connections that feed it and carry out its effects."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Sequence
from time import monotonic
from typing import Protocol

from agentd.conversion.log_format import line_of
from agentd.language.compiler.compile import CompiledProgram
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mail.mail_client import MailClient
from agentd.mail.neighbours import Neighbours
from agentd.mind.data.effects import CancelAction, Effect, Log, PerformAction, Print, StopTeam, TeamRequest
from agentd.mind.data.inputs import (
    PerceptRemoved,
    PerceptReplaced,
    SignalRaised,
    TeamReply,
)
from agentd.mind.persistence.change_tracking import Keeper
from agentd.persistence.checkpoint import AgentRows
from agentd.persistence.checkpointer import Checkpointer
from agentd.persistence.group_commit import GroupCommit
from agentd.persistence.poison_inputs import DEATHS, Held, PoisonInputs, text_of
from agentd.persistence.restore import RestoredState, come_back, raise_interrupted
from agentd.runtime.action_client import ActionClient
from agentd.runtime.agent_directory import AgentDirectory
from agentd.runtime.mind_runner import LagEstimator, MindRunner, reason
from agentd.runtime.operator_control import OperatorControl
from agentd.runtime.program_loader import Part
from agentd.runtime.view_server import Viewer
from agentd.trace import Tracing
from agentd.trace.initial_state import InitialState, make_mind
from agentd.trace.input_records import CameBack, Included, Interrupted
from agentd.trace.publisher import TraceSubscribers
from commd.bus.bus import Bus, Token, boot_id
from commd.client.actions import ActionRequests
from commd.client.manual_percepts import HandPercepts, HandPerceptSubscription
from commd.client.percept_sync import PerceptSync
from commd.common.clock import Clock
from commd.common.tasks import Tasks
from commd.liveness.bridge_presence import BridgePresence
from commd.process.output import stdout
from schemas.mission.access_rules import MailRights
from schemas.wire.mind_records import InitialMind
from schemas.wire.records import AgentHealth, Note

log = logging.getLogger("agent")

ASK_TIMEOUT = 30.0
"""Mission seconds after which a synchronous ask without a limit of its own is answered with the atom `timeout`."""
LAST_PRINTS = 20
ATOMIC_END = 0.5
"""Wall seconds for an atomic plan to end when the agent leaves."""
LEAVE = 2.0
"""Wall seconds for mail and cancellations to leave when the agent ends."""


class Team(Protocol):
    """Fulfils the requests of minds to their team."""

    async def answer(self, host: AgentHost, request: TeamRequest) -> TeamReply:
        """Fulfil a request; the reply has the error if that fails."""


class AgentHost:
    """One agent of a mission on the bus."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        part: Part,
        directory: AgentDirectory,
        team: Team,
        token: Token,
        subscribers: TraceSubscribers,
        by_hand: HandPerceptSubscription,
        commits: GroupCommit,
        neighbours: Neighbours,
        memory: RestoredState | None = None,
        rights: MailRights | None = None,
    ) -> None:
        """`memory` is the agent's state on disk; without one it begins without a past each time.

        `commits` and `neighbours` are those of the daemon; `rights` decide whose mail it accepts; None: all.
        """
        self.part = part
        self.begins = memory is None or memory.stored is None
        """Whether the agent begins without state of a former life."""
        self.stopped: StopTeam | None = None
        """The effect by which the program has stopped the team."""
        self._bus, self._clock, self._directory, self._team, self._token = bus, clock, directory, team, token
        self._memory = memory
        stored = None if memory is None or memory.stored is None else memory.stored.mind
        self._keeper = None if memory is None else Keeper(stored)
        self._tasks = Tasks(f"working for agent {part.name}")
        self._prints: deque[str] = deque(maxlen=LAST_PRINTS)
        self._failures = 0
        """Intentions that have ended by a failure that no plan handled."""
        self._backlog = LagEstimator()
        self._reasons = False
        """Whether the state of a former life is restored, so that the agent reasons."""
        life = boot_id()
        settings = InitialMind(
            program="",
            seed=part.own_seed,
            start=clock.now(),
            epoch=clock.epoch,
            zone=str(clock.zone),
            names_variables=part.names_variables,
            ask_timeout=ASK_TIMEOUT,
            decisions=part.decisions,
            kept=memory is not None,
        )
        initial = InitialState(settings, part.sources, stored)
        self._tracing = Tracing(bus, clock, part.name, initial, directory, life, self._tasks, subscribers)
        inputs = self._tracing.inputs
        self._mind = make_mind(
            part.name, part.program, settings, clock.now, inputs.names, self._keeper, part.decisions, inputs.given
        )
        self._tracing.follow(self._mind)
        for formula in (*part.done.values(), *part.failed.values()):
            self._mind.query(formula)  # so that the predicates in it exist before anybody queries it
        self._runner = MindRunner(bus, self._mind, self._turn)
        self.feed = self._runner.feed
        """Gives the mind an input that is not from the agent's own mail or robot."""
        self._mailing = MailClient(bus, life, self._runner, directory, rights, self._tracing, neighbours)
        self._mind.post_office = self._mailing.send
        self._poison: PoisonInputs | None = None
        if memory is not None:
            self._poison = PoisonInputs(memory.folder, self._in_hand)
            if self._poison.is_watchful:
                self._mailing.poison = self._poison
            self._restore(memory)
        self._checkpointer = Checkpointer(commits, memory, self._keeper, self._runner, self._mailing, bus.wire)
        if memory is not None:
            self._checkpointer.first = memory.first_saving(self._mailing, part.digest)
        self._perceiving: PerceptSync | None = None
        self._by_hand: HandPercepts | None = None
        self._action_requests: ActionRequests | None = None
        if part.robot is not None:
            self._perceiving = PerceptSync(bus, part.name, part.robot, self._runner.perceive, part.inject)
            watch = BridgePresence(bus, part.robot, self._bridge_up, self._bridge_gone, part.robot_elsewhere)
            self._action_requests = ActionRequests(bus, part.name, self._perceiving, watch, clock.to_wall)
            self._tasks.spawn(self._perceiving.run())
            self._tasks.spawn(watch.run())
        else:
            self._by_hand = by_hand.add(part.name, part.inject, self._runner.perceive)
        self._action_client = ActionClient(
            bus,
            self._runner,
            self._tracing,
            self._action_requests,
            self._checkpointer,
            self._interrupted,
            self._tasks,
        )
        self._control = OperatorControl(bus, clock, self._runner, part.inject, self._ordered, part.robot)
        self.viewer = Viewer(bus, clock, self._runner, part, self._control, self._tracing, self._prints)

    def _restore(self, memory: RestoredState) -> None:
        """Restore the mail of a former life."""
        memory.restore(self._mailing)
        self._directory.remember(memory.correspondents)
        if not memory.is_of(self.part.digest):
            log.warning("agent=%s its program has changed: beliefs and goals are those of the old one", self.part.name)

    async def _come_back(self) -> None:
        """Resume what a former life has left, if there was one."""
        memory, keeper = self._memory, self._keeper
        if memory is None or keeper is None or memory.stored is None:
            return
        for what in keeper.left_out:
            log.warning("agent=%s cannot be what it was: %s", self.part.name, what)
        self._mailing.return_refused()
        self._tasks.spawn(self._note_old_state(memory, memory.stored))
        await self._checkpointer.count_life()
        interrupted = await self._action_client.take_up(memory.actions)
        self._tracing.came_back(CameBack(memory.life, tuple(interrupted)))
        come_back(self._mind, keeper, memory.life, interrupted, self.part.on_restart)
        memory.stored = None

    async def _note_old_state(self, memory: RestoredState, stored: AgentRows) -> None:
        """Note if the checkpoint is older than the mail that the agent has sent."""
        if warning := await memory.went_back(stored, self._mailing):
            self._checkpointer.add_note(Note("state_went_back", warning))
            self._mailing.signal("state_went_back")

    def _in_hand(self) -> Held:
        """Return the event and the message that the mind is working on; called on another thread."""
        return Held(
            "" if self._keeper is None else self._keeper.origins.in_hand(),
            self._mailing.inbox.taken_last(len(self._mind.mailbox)),
        )

    def _set_aside(self) -> None:
        """Skip the input at which the last lives have ended, if there is one."""
        poison, keeper = self._poison, self._keeper
        if poison is None or poison.died_at is None or keeper is None:
            return
        held = poison.died_at
        if keeper.origins.drop(held.event):
            poison.poison = None  # else a message brings it, and is refused
        poison.keep(held)
        what = text_of(held)
        text = f"set aside, because it ended the process {DEATHS} times: {what} (kept in {poison.kept})"
        self._checkpointer.add_note(Note("set_aside", text, what))
        self._mailing.signal("set_aside", what)

    # --- turns ---

    async def run(self, stop: asyncio.Event) -> None:
        """Reason until `stop` is set or the program stops the team."""
        await self._come_back()
        self._set_aside()
        self._reasons = True
        in_order = False
        try:
            await self._runner.run(stop)
            in_order = True
        finally:
            _busy.discard(self)
            await self._leave(in_order)

    def _turn(self) -> float | None:
        """Reason about the inputs, carry out the effects and begin a save if one is due.

        Returns the wall seconds until the next turn without an input: 0: immediately, None: never.
        """
        mind, clock, control, poison = self._mind, self._clock, self._control, self._poison
        if poison is not None:
            poison.since = monotonic()
        try:
            if not control.paused or control.may_reason():
                _busy.add(self)
                self._carry_out(reason(mind, clock, len(_busy), self._tracing.ran))
            else:
                self._step()
            ready = mind.ready and not control.paused
            if not ready:
                _busy.discard(self)
            self._checkpointer.look(quiet=not mind.ready or (control.paused and mind.atomic is None))
            if ready:
                return 0.0
            if control.paused:
                return control.left
            return None if (due := mind.wake_at) is None else max(0.0, clock.to_wall(due - clock.now()))
        finally:
            if poison is not None:
                poison.since = None
                if poison.written:
                    poison.end()

    def _step(self) -> None:
        """Run the single cycles that an operator has ordered of a paused mind."""
        while step := self._control.take_step():
            self._carry_out(self._run_one())
            if not step.done():
                step.set_result("")

    def _run_one(self) -> list[Effect]:
        first, now = self._mind.cycle + 1, self._clock.now()
        effects = self._mind.run(now, 1)
        if self._tracing.ran is not None:
            self._tracing.ran(first, now, effects)
        return effects

    async def _leave(self, in_order: bool) -> None:
        """Save the state, hand over mail, and end the tasks; after `.stopMAS` the state is removed later."""
        self._carry_out(self._mind.drops.unlogged(self._mind.now))
        self._mailing.leave()
        await self._end_atomic_plan()
        await self._checkpointer.finish()
        await self._mailing.outbox.drain(LEAVE)
        if self._action_requests is not None:
            self._action_requests.close()
        await self._tasks.end()
        await self._checkpointer.finish()
        self._checkpointer.leave()
        self._tracing.close(in_order=in_order)

    async def _end_atomic_plan(self) -> None:
        """Run the rest of an atomic plan that does not wait, within `ATOMIC_END`: it is saved whole."""
        mind = self._mind
        until = asyncio.get_running_loop().time() + ATOMIC_END
        while mind.atomic is not None and mind.ready and asyncio.get_running_loop().time() < until:
            effects = self._run_one()
            self._carry_out([one for one in effects if not isinstance(one, PerformAction)])  # the next life decides
            await asyncio.sleep(0)

    def close(self) -> None:
        """Leave the bus for good."""
        self._mailing.return_left()
        self.viewer.withdraw()
        self._control.withdraw()
        self._bus.withdraw(self._token)

    # --- for the group ---

    def retry_mail(self) -> None:
        """Try to hand over waiting mail immediately: commd or the router is back."""
        self._mailing.outbox.retry_now()

    def copy_from(self, other: AgentHost) -> None:
        """Copy the beliefs and plans of another agent (``.clone``)."""
        other._runner.catch_up()
        self._mind.copy_from(other._mind)
        self._tracing.cloned(other.part.name)

    def included(self, request: int, read: Included) -> CompiledProgram:
        """Trace and return the program of an `.include` with this request id."""
        self._tracing.included(request, read)
        return read.program

    # --- effects ---

    def _carry_out(self, effects: Sequence[Effect]) -> None:
        mind, activity = self._mind, self._tracing.activity
        mind.beliefs.mark(mind.now)
        for effect in effects:
            activity.did(mind.cycle, effect)
            match effect:
                case Print(text=text):
                    self._prints.append(text)
                    for line in text.split("\n"):  # each with the agent's name: none may pass for another agent's
                        stdout().write(line, agent=self.part.name)
                case Log(level=level):
                    self._failures += effect.ends
                    log.log(_LEVELS.get(level, logging.INFO), "agent=%s %s", self.part.name, line_of(effect))
                case PerformAction():
                    self._action_client.begin(effect)
                case CancelAction(id=number):
                    self._action_client.cancel(number)
                case StopTeam(delay=delay):
                    self._stop_after(effect, delay)
                case TeamRequest():
                    self._tasks.spawn(self._ask_team(effect))

    def _stop_after(self, order: StopTeam, delay: float) -> None:
        """Stop the team after `delay` mission seconds, announced to the agent (Jason: `+jag_shutting_down(Ms)`)."""

        def now() -> None:
            self.stopped = self.stopped or order
            self._runner.finish()

        if delay <= 0:
            now()
            return
        self._runner.feed(SignalRaised.named("jag_shutting_down", delay * 1000.0))
        asyncio.get_running_loop().call_later(self._clock.to_wall(delay), now)

    async def _ask_team(self, request: TeamRequest) -> None:
        try:
            self._runner.feed(await self._team.answer(self, request))
        except Exception as error:  # the intention must not wait forever
            why = f"defect in agentd: {type(error).__name__}: {error}"
            self._runner.feed(TeamReply(request.id, None, "unknown", why))
            raise

    # --- inputs ---

    def _bridge_up(self) -> None:
        self._runner.feed(PerceptReplaced(_BRIDGE_UP))
        if self._perceiving is not None:
            self._perceiving.doubt()

    def _bridge_gone(self) -> None:
        if self._perceiving is not None:
            self._perceiving.forget()
        self._runner.feed(PerceptRemoved(_BRIDGE_UP))

    def _interrupted(self, literal: Literal) -> None:
        """Raise the event of an action of a former life that has ended without a plan that waits for it."""
        if self._keeper is not None:
            self._tracing.came_back(Interrupted(literal))
            raise_interrupted(self._mind, self._keeper, literal)
            self._runner.wake()

    def _ordered(self, order: str) -> None:
        """Note an operator's order to the mind, as text."""
        self._tracing.ordered(order)
        self.viewer.forget()
        self._runner.wake()

    # --- for observers ---

    def health(self) -> AgentHealth:
        """Return the counters and warnings of the agent."""
        mind, mail, percepts = self._mind, self._mailing.counters, self._perceiving or self._by_hand
        counters = {"bad_percepts": self._runner.bad_percepts}
        parts = {"mail": mail, "kept": self._checkpointer.counters}
        if percepts is not None:
            parts["percepts"] = percepts.counters
        if self._action_requests is not None:
            parts["actions"] = self._action_requests.counters
        for prefix, counted in parts.items():
            for name, count in counted.items():
                counters[f"{prefix}_{name}"] = count
        counters["mail_near_waiting"] = self._mailing.inbox.near
        counters["cycles"] = mind.cycle
        counters["intentions_failed"] = self._failures
        counters["trace_dropped"] = self._tracing.inputs.dropped
        counters["percepts_missed"] = self._perceiving.percepts.missed if self._perceiving else 0
        reasons = self._runner.turn_due and not self._control.paused
        waiting = len(mind.events) + len(mind.mailbox) if reasons else 0  # an atomic plan that waits keeps the rest
        return AgentHealth(
            drops=sum(mind.drops.counts.values()),
            bad_input=self._runner.bad_percepts + mail["bad"],
            counters={name: float(count) for name, count in sorted(counters.items()) if count},
            notes=self.notes(),
            lag=self._backlog.lag(mind.cycle, waiting, self._clock.wall()),
            idle=self._idle,
            robot=self.part.robot or "",
        )

    @property
    def _idle(self) -> bool | None:
        """Whether the agent has nothing to do and no intention; None while it is paused or not restored."""
        if not self._reasons or self._control.paused:
            return None
        mind = self._mind
        return not (self._runner.turn_due or mind.waiting or mind.suspended) and mind.wake_at is None

    def notes(self) -> tuple[Note, ...]:
        """Return the present warnings."""
        percepts = self._perceiving or self._by_hand
        by_hand = () if percepts is None else percepts.notes()
        return (*self._control.notes(), *by_hand, *self._checkpointer.notes())


_busy: set[AgentHost] = set()
"""Agents of this process that reason, or whose last slice ended before they were done."""
_BRIDGE_UP = Literal(signature("bridge", 1), (atom("up"),))
_LEVELS = {"error": logging.ERROR, "warning": logging.WARNING, "info": logging.INFO, "debug": logging.DEBUG}
