"""Runs one mind on the bus: feeds it what arrives, carries out what comes out, sleeps when there is nothing to do."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TypeAlias
from zlib import crc32

from agentd.conversion.log_format import line_of
from agentd.conversion.term_conversion import BadTerm, perceived
from agentd.language.compiler.compile import CompiledProgram
from agentd.language.syntax_tree.nodes import Formula, Goal
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mail.mail_client import MailClient
from agentd.mind import Mind
from agentd.mind.data.effects import CancelAction, Effect, Log, PerformAction, Print, StopTeam, TeamRequest
from agentd.mind.data.inputs import (
    ActionDone,
    Input,
    Mail,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    SignalRaised,
    TeamReply,
)
from agentd.mind.persistence.change_tracking import Keeper
from agentd.persistence.checkpoint import Stored
from agentd.persistence.checkpointer import Checkpointer
from agentd.persistence.poison_inputs import DEATHS, Held, PoisonInputs, said
from agentd.persistence.restart import come_back, raise_interrupted
from agentd.persistence.restore import RestoredState
from agentd.runtime.action_client import ActionClient, NoJournal
from agentd.runtime.agent_directory import AgentDirectory
from agentd.runtime.lag_estimator import LagEstimator
from agentd.runtime.operator_control import OperatorControl
from agentd.runtime.view_server import Viewer
from agentd.runtime.wakeup_timer import WakeupTimer
from agentd.trace import Tracing
from agentd.trace.environment_reads import CameBack, Interrupted
from agentd.trace.initial_state import InitialState
from agentd.trace.input_records import Included
from agentd.trace.program_sources import Sources
from commd.bus.bus import Bus, Token
from commd.client.actions import ActionRequests
from commd.client.manual_percepts import HandPercepts, hear_by_hand
from commd.client.percept_sync import PerceptSync
from commd.common.clock import Clock
from commd.common.tasks import Tasks
from commd.liveness.bridge_presence import BridgePresence
from commd.process.output import stdout
from commd.process.systemd import Loop
from schemas.humanize import escape_line
from schemas.wire.mind_records import MindView
from schemas.wire.records import Health, Message, Note, Perception

Team: TypeAlias = "Callable[[AgentHost, TeamRequest], Awaitable[TeamReply]]"
"""Who fulfils what a mind asks of its team."""
log = logging.getLogger("agent")

SLICE = 500
"""Reasoning cycles in a row before the event loop gets a turn, at most."""
LONGEST_SLICE = 0.2
"""Wall seconds that they take at most: who says nothing for long counts as hung (`agent_silence`)."""
BATCH = 8
"""Cycles between two looks at the clock at most; a slice begins with one, for what is heavy mostly stays so."""
MANY = 32
"""So many decisions that wait to be told are many."""
INPUTS = 20_000
"""Inputs that may wait for the mind; mail beyond is refused to its sender, who keeps it."""
ASK_TIMEOUT = 30.0
"""Mission seconds after which a synchronous ask without a limit of its own is answered with the atom `timeout`."""
LAST_PRINTS = 20
DECISIONS = 200
"""Decisions and failures that an agent remembers if nobody says otherwise."""
ATOMIC_END = 0.5
"""Wall seconds that an atomic plan has to come to its end when the agent leaves."""
LEAVE = 2.0
"""Wall seconds that mail and cancellations have to leave when the agent ends."""


@dataclass(frozen=True)
class Part:
    """What an agent is made of: its program, its robot, and what the mission wants to see."""

    name: str
    program: CompiledProgram
    robot: str | None
    done: dict[str, Formula]
    failed: dict[str, Formula]
    seed: int = 0
    """Of the run; that of the agent is `own_seed`."""
    on_restart: Goal | None = None
    """What it goes on with after a restart in place of what it had in mind."""
    decisions: int = DECISIONS
    """How many of its last decisions the agent remembers; 0: none."""
    names_variables: bool = False
    """The robot takes a free variable in an action by its name (`values = "text"` in its manifest)."""
    digest: bytes = b""
    """Stands for the program: another one has another digest."""
    robot_elsewhere: str | None = None
    """The board of its robot, if that is another one than its own."""
    presence: bool = False
    """It is told who else is there: `online(Agent)[board(B)]`."""
    inject: bool = False
    """Operators may pause it and give it goals and beliefs."""
    sources: Sources | None = None
    """The texts of its program."""

    @property
    def own_seed(self) -> int:
        """Seed of this agent's random numbers: two agents of a run draw different ones, also in different processes."""
        return self.seed + crc32(self.name.encode())


Ran: TypeAlias = Callable[[int, float, list[Effect]], None]
"""Hears of runs of a mind, their first cycle, time and effects: of each in which the time mattered or after which many
decisions wait to be told, and of the last."""


def reason(mind: Mind, clock: Clock, share: int = 1, ran: Ran | None = None) -> list[Effect]:
    """Run one slice; the first cycle with an effect is its last, and one with nothing left to do.

    `share`: so many agents of this process reason one after the other, and have the time of a slice together.
    """
    until, last, batch = clock.wall() + LONGEST_SLICE / max(1, share), mind.cycle + SLICE, 1
    timers, looks = mind.timers, mind.timers.looks
    decided = () if mind.recorder is None else mind.recorder.waiting
    while True:
        before, now = mind.cycle, clock.now()
        effects = mind.run(now, min(batch, last - before))
        batch = min(2 * batch, BATCH)
        if effects or not mind.ready or mind.cycle >= last or clock.wall() >= until:
            if ran is not None:
                ran(before + 1, now, effects)
            return effects
        if timers.looks != looks or len(decided) > MANY:
            looks = timers.looks
            if ran is not None:
                ran(before + 1, now, effects)


class AgentHost:
    """One agent of a mission: its mind, and the mind's hands and ears."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        part: Part,
        roster: AgentDirectory,
        team: Team,
        token: Token,
        memory: RestoredState | None = None,
        accept: Callable[[Message], bool] = lambda message: True,
    ) -> None:
        """`memory` is what the agent has on disk; without one it begins anew each time.

        `accept` says whether it takes a message from its sender.
        """
        self.part = part
        self.begins = memory is None or memory.stored is None
        """Whether the agent begins anew, without memory of a former life."""
        self.stopped: StopTeam | None = None
        """What the program said when it stopped the team."""
        self.counters: Counter[str] = Counter()
        self._bus, self._clock, self._roster, self._team, self._token = bus, clock, roster, team, token
        self._memory = memory
        self._keeper = None if memory is None else Keeper(None if memory.stored is None else memory.stored.mind)
        birth = InitialState(
            sources=part.sources,
            seed=part.own_seed,
            start=clock.now(),
            epoch=clock.epoch,
            zone=clock.zone,
            names_variables=part.names_variables,
            ask_timeout=ASK_TIMEOUT,
            decisions=part.decisions,
            kept=memory is not None,
            stored=None if memory is None or memory.stored is None else memory.stored.mind,
        )
        early: list[tuple[int, Input]] = []
        self._mind = Mind(
            part.name,
            part.program,
            seed=part.own_seed,
            start=birth.start,
            on_input=lambda cycle, item: early.append((cycle, item)),
            names_variables=part.names_variables,
            clock=clock.now,
            agents=lambda: roster.names,
            has_team=True,
            ask_timeout=ASK_TIMEOUT,
            epoch=clock.epoch,
            zone=clock.zone,
            decisions=part.decisions,
            keeper=self._keeper,
        )
        self._backlog = LagEstimator()
        self._wake = WakeupTimer()
        self._beats = Loop.unwatched()
        self._reasons = False
        """Whether it reasons by now: what a former life had begun is known."""
        self._turning = False
        """Whether a turn is to come as soon as all that the bus has brought is taken in."""
        self._through = False
        """Whether a turn outside of `run` has stopped the team."""
        self._broken: BaseException | None = None
        """What a turn outside of `run` has failed with."""
        self._prints: deque[str] = deque(maxlen=LAST_PRINTS)
        self._tasks = Tasks(f"working for agent {part.name}")
        for formula in (*part.done.values(), *part.failed.values()):
            self._mind.query(formula)  # what it names is known from the beginning, whenever somebody looks
        self._mailing = MailClient(bus, part.name, self._mind, self._take_mail, lambda: roster.names, accept)
        self._tracing = Tracing(
            bus, clock, self._mind, birth, early, lambda: roster.names, self._mailing.life, self._tasks.spawn
        )
        self._tracing.send_by(self._mailing.send, self._mailing.receivers)
        self._checkpointer = self._keep_in(memory)
        self._hand: PoisonInputs | None = None
        if memory is not None:
            self._hand = PoisonInputs(memory.checkpoint.path.parent, self._in_hand)
            self._mailing.is_set_aside = self._hand.is_set_aside
        self._perceiving: PerceptSync | None = None
        self._by_hand: HandPercepts | None = None
        self._action_requests: ActionRequests | None = None
        if part.robot is not None:
            self._perceiving = PerceptSync(bus, part.name, part.robot, self._perceive, part.inject)
            watch = BridgePresence(bus, part.robot, self._bridge_up, self._bridge_gone, part.robot_elsewhere)
            self._action_requests = ActionRequests(bus, part.name, self._perceiving, watch, clock.to_wall)
            self._tasks.spawn(self._perceiving.run())
            self._tasks.spawn(watch.run())
        else:
            self._by_hand = hear_by_hand(bus, part.name, part.inject, self._perceive)
        self._action_client = ActionClient(
            part.name,
            bus.boot,
            self._action_requests,
            self._checkpointer or NoJournal(),
            self._done,
            self._tasks.spawn,
            self._interrupted,
        )
        self._control = OperatorControl(
            bus,
            self._mind,
            part.inject,
            wall=clock.wall,
            now=clock.now,
            feed=self._feed,
            changed=self._ordered,
            robot=part.robot,
        )
        self._viewer = Viewer(
            bus,
            self._mind,
            clock,
            self._control,
            life=self._mailing.life,
            prints=self._prints,
            actions=self._tracing.deeds.actions,
            done=part.done,
            failed=part.failed,
        )

    def _keep_in(self, memory: RestoredState | None) -> Checkpointer | None:
        """Take up the mail of a former life, and prepare to keep this one."""
        if memory is None or self._keeper is None:
            return None
        memory.restore(self._mailing)
        self._roster.remember(memory.correspondents)
        if not memory.is_of(self.part.digest):
            log.warning("agent=%s its program has changed: beliefs and goals are those of the old one", self.part.name)
        checkpointer = Checkpointer(
            self.part.name, memory, self._keeper, self._mind, self._mailing, self._bus.wire, self._wake.set
        )
        checkpointer.first = memory.first_saving(self._mailing, self.part.digest)
        return checkpointer

    async def _come_back(self) -> None:
        """Go on where a former life ended, if there was one."""
        if self._memory is None or self._keeper is None or self._checkpointer is None or self._memory.stored is None:
            return
        for what in self._keeper.left_out:
            log.warning("agent=%s cannot be what it was: %s", self.part.name, what)
        self._tasks.spawn(self._compare(self._memory, self._memory.stored, self._checkpointer))
        await self._checkpointer.count_life()
        interrupted = await self._action_client.take_up(self._memory.actions)
        self._tracing.came_back(CameBack(self._memory.life, tuple(interrupted)))
        come_back(self._mind, self._keeper, self._memory.life, interrupted, self.part.on_restart)
        self._memory.stored = None

    def _in_hand(self) -> Held:
        """Say what the mind is at, on another thread."""
        return Held("" if self._keeper is None else self._keeper.in_hand(), self._mailing.in_hand())

    def _set_aside(self) -> None:
        """Set aside what the last lives have died at, if there is such."""
        hand, keeper, checkpointer = self._hand, self._keeper, self._checkpointer
        if hand is None or hand.died_at is None or keeper is None or checkpointer is None:
            return
        poison = hand.died_at
        if keeper.set_aside(poison.event):
            hand.poison = None  # else it comes with a message, which will be refused
        hand.keep(poison)
        what = said(poison)
        text = f"set aside after {DEATHS} lives that ended at it: {what} (kept in {hand.kept})"
        checkpointer.tell(Note("set_aside", text, what))
        self._mailing.signal("set_aside", what)

    async def _compare(self, memory: RestoredState, stored: Stored, checkpointer: Checkpointer) -> None:
        """Tell if what is kept has gone back in time."""
        if told := await memory.went_back(stored, self._mailing):
            checkpointer.tell(Note("state_went_back", told))
            self._mailing.signal("state_went_back")

    def _interrupted(self, literal: Literal) -> None:
        """An action of a former life has ended, and no plan has waited for it."""
        if self._keeper is not None:
            self._tracing.came_back(Interrupted(literal))
            raise_interrupted(self._mind, self._keeper, literal)
            self._wake.set()

    def hurry(self) -> None:
        """Mail that had to wait may find commd again."""
        self._mailing.outbox.hurry()

    async def run(self, stop: asyncio.Event, loop: Loop | None = None) -> None:
        """Reason until `stop` is set or the program stops the team. Sleeps while there is nothing to do.

        Each turn is a beat of `loop`.
        """
        loop = loop or Loop.unwatched()
        await self._come_back()
        self._set_aside()
        self._reasons = True
        waiting = asyncio.create_task(stop.wait())
        waiting.add_done_callback(lambda _: self._wake.set())
        in_order = False
        self._beats = loop
        try:
            while not stop.is_set():
                pause = self._turn()
                if self.stopped is not None:
                    break
                if pause == 0:
                    await asyncio.sleep(0)
                    continue
                await self._wake.wait(pause)
                if self._broken is not None:
                    raise self._broken
                if self._through:
                    break
            in_order = True
        finally:
            _busy.discard(self)
            loop.end()
            waiting.cancel()
            self._wake.close()
            await self._leave(in_order)

    def _turn(self) -> float | None:
        """Reason about what has come, and carry out what comes of it.

        Returns the wall seconds until the next turn if nothing else comes: 0 for at once, None for never.
        """
        self._beats.beat()
        self._wake.clear()
        hand = self._hand
        if hand is None:
            return self._reason()
        hand.begin()
        try:
            return self._reason()
        finally:
            hand.end()

    def _reason(self) -> float | None:
        """What a turn is."""
        mind, clock, control = self._mind, self._clock, self._control
        if control.may_reason():
            _busy.add(self)
            self._go_on(reason(mind, clock, len(_busy), self._tracing.ran))
        else:
            self._step()
        ready = mind.ready and not control.paused
        if not ready:
            _busy.discard(self)
        look_at = self._keep()
        if ready:
            return 0.0
        due = None if control.paused else mind.wake_at
        pauses = [] if due is None else [max(0.0, clock.to_wall(due - clock.now()))]
        pauses += [pause for pause in (look_at, self._beats.period, control.left) if pause is not None]
        return min(pauses, default=None)

    def _turn_at_once(self) -> None:
        """Have a turn in the place of the task that sleeps: in the pass of the event loop in which something came."""
        self._turning = False
        if not self._wake.asleep:
            self._wake.set()
            return
        try:
            pause = self._turn()
        except BaseException as error:
            self._broken = error
            self._wake.set()
            return
        self._through = self.stopped is not None
        if pause == 0 or self._through:
            self._wake.set()
        else:
            self._wake.within(pause)

    def _rouse(self) -> None:
        """Something has come for the mind."""
        if self._turning:
            return
        if self._wake.asleep and self._bus.afterwards(self._turn_at_once):
            self._turning = True
        else:
            self._wake.set()

    def _go_on(self, effects: list[Effect]) -> None:
        """Carry out what a run of the mind wants done."""
        self._mind.beliefs.mark(self._mind.now)
        for effect in effects:
            self._carry_out(effect)

    def _step(self) -> None:
        """Run the cycles that an operator asks of a mind that is paused."""
        while steps := self._control.take_step():
            self._go_on(self._run_one())
            for step in steps:
                if not step.done():
                    step.set_result("")

    def _run_one(self) -> list[Effect]:
        """Run one cycle."""
        first, now = self._mind.cycle + 1, self._clock.now()
        effects = self._mind.run(now, 1)
        if self._tracing.ran is not None:
            self._tracing.ran(first, now, effects)
        return effects

    def _ordered(self, order: str) -> None:
        """An operator has done something to the mind."""
        self._tracing.ordered(order)
        self._viewer.forget()
        self._wake.set()

    def _keep(self) -> float | None:
        """Begin a save if one is due. Returns the wall seconds until it is to be looked at again."""
        if self._checkpointer is not None:
            paused = self._control.paused and self._mind.atomic is None
            return self._checkpointer.look(quiet=paused or not self._mind.ready)
        self._mailing.forget()
        return None

    async def _leave(self, in_order: bool) -> None:
        """Keep what there is, let the mail leave, end; after `.stopMAS` nothing is to come back."""
        for note in self._mind.drops.unlogged(self._mind.now):
            self._carry_out(note)
        self._mailing.inbox.withdraw()
        if self._checkpointer is not None:
            await self._end_atomic_plan()
            await self._checkpointer.finish()
        else:
            self._mailing.forget()
        await self._mailing.outbox.drain(LEAVE)
        await self._tasks.end()
        if self._checkpointer is not None:
            await self._checkpointer.finish()
        self._tracing.close(in_order=in_order)

    async def _end_atomic_plan(self) -> None:
        """An atomic plan is kept whole: what is left of one that does not wait is done, within `ATOMIC_END`."""
        mind = self._mind
        until = asyncio.get_running_loop().time() + ATOMIC_END
        while mind.atomic is not None and mind.ready and asyncio.get_running_loop().time() < until:
            for effect in self._run_one():
                if not isinstance(effect, PerformAction):  # the next life decides about it
                    self._carry_out(effect)
            await asyncio.sleep(0)

    async def part_with(self, forget: bool) -> None:
        """Close what the agent has on disk; `forget`: it is over, and begins anew when it is started again."""
        if self._checkpointer is not None:
            await self._checkpointer.close(forget)

    def close(self) -> None:
        """Leave the bus for good: nobody of this name is here any more."""
        self._viewer.withdraw()
        self._control.withdraw()
        self._bus.withdraw(self._token)

    def copy_from(self, other: AgentHost) -> None:
        """Take over what another agent believes and how it acts (``.clone``)."""
        self._mind.copy_from(other._mind)
        self._tracing.cloned(other.part.name)

    def included(self, request: int, read: Included) -> CompiledProgram:
        """Return the program that the mind has asked for by a request of this number."""
        self._tracing.included(request, read)
        return read.program

    def take(self, item: Input) -> None:
        """Feed the mind something that does not come by the agent's own mail or robot: who is there."""
        self._feed(item)

    def _take_mail(self, mail: Mail) -> None:
        self._roster.met(mail.sender)
        self._feed(mail)

    def _done(self, item: ActionDone) -> None:
        """An action has ended."""
        self._tracing.done(item)
        self._feed(item)

    def _feed(self, item: Input) -> None:
        self._mind.feed(item)
        self._rouse()

    # --- out of the mind ---

    def _carry_out(self, effect: Effect) -> None:
        self._tracing.did(effect)
        match effect:
            case Print(text=text):
                self._prints.append(text)
                for line in text.split("\n"):  # each with its agent: none may look like a line of somebody else
                    stdout().write(escape_line(line), agent=self.part.name)
            case Log(level=level):
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
        """Stop the team, at once or after a delay that the agent is told of (Jason: `+jag_shutting_down(Ms)`)."""

        def now() -> None:
            self.stopped = self.stopped or order
            self._wake.set()

        if delay <= 0:
            now()
            return
        self._feed(SignalRaised.named("jag_shutting_down", delay * 1000.0))
        asyncio.get_running_loop().call_later(self._clock.to_wall(delay), now)

    async def _ask_team(self, request: TeamRequest) -> None:
        try:
            self._feed(await self._team(self, request))
        except Exception as error:  # the intention must not wait for ever for an answer that cannot come
            why = f"defect in agentd: {type(error).__name__}: {error}"
            self._feed(TeamReply(request.id, None, "unknown", why))
            raise

    # --- into the mind ---

    def _perceive(self, perception: Perception) -> None:
        try:
            literal = perceived(perception)
        except BadTerm as bad:
            self.counters["bad_percepts"] += 1
            log.warning("agent=%s bad_percept name=%s why=%s", self.part.name, perception.name, bad)
            return
        match perception.update:
            case "replace":
                self._feed(PerceptReplaced(literal, perception.key))
            case "add":
                self._feed(PerceptAdded(literal))
            case "remove":
                self._feed(PerceptRemoved(literal, perception.key))

    def _bridge_up(self) -> None:
        self._feed(PerceptReplaced(_BRIDGE_UP))
        if self._perceiving is not None:
            self._perceiving.doubt()

    def _bridge_gone(self) -> None:
        if self._perceiving is not None:
            self._perceiving.forget()
        self._feed(PerceptRemoved(_BRIDGE_UP))

    # --- for observers ---

    def view(self) -> MindView:
        """Return what the agent believes and intends now."""
        return self._viewer.view()

    def health(self) -> Health:
        """Return what the agent has counted, for its health."""
        counters = Counter(self.counters)
        percepts = self._perceiving or self._by_hand
        parts = {
            "percepts": percepts,
            "actions": self._action_requests,
            "mail": self._mailing,
            "kept": self._checkpointer,
        }
        for prefix, part in parts.items():
            if part is not None:
                counters.update({f"{prefix}_{name}": count for name, count in part.counters.items()})
        mind = self._mind
        counters["cycles"] = mind.cycle
        counters["trace_dropped"] = self._tracing.course.dropped
        missed = self._perceiving.percepts.missed if self._perceiving else 0
        reasons = mind.ready and not self._control.paused
        waiting = len(mind.events) + len(mind.mailbox) if reasons else 0  # an atomic plan that waits keeps the rest
        return Health(
            drops=sum(mind.drops.counts.values()) + stdout().dropped,
            bad_input=self.counters["bad_percepts"] + self._mailing.counters["bad"],
            counters={**{name: float(count) for name, count in sorted(counters.items())}, "percepts_missed": missed},
            notes=self.notes(),
            lag=self._backlog.lag(mind.cycle, waiting, self._clock.wall()),
            idle=self._idle,
        )

    @property
    def _idle(self) -> bool | None:
        """Whether the agent has nothing to do and nothing in mind; None while that is not its own doing."""
        if not self._reasons or self._control.paused:
            return None
        return self._mind.idle and not self._mind.suspended

    def notes(self) -> tuple[Note, ...]:
        """Return the warnings that hold now."""
        kept = () if self._checkpointer is None else self._checkpointer.notes()
        percepts = self._perceiving or self._by_hand
        by_hand = () if percepts is None else percepts.notes()
        return (*self._control.notes(), *by_hand, *kept)


_busy: set[AgentHost] = set()
"""Agents of this process that reason, or whose last slice ended before they were done."""
_BRIDGE_UP = Literal(signature("bridge", 1), (atom("up"),))
_LEVELS = {"error": logging.ERROR, "warning": logging.WARNING, "info": logging.INFO, "debug": logging.DEBUG}
