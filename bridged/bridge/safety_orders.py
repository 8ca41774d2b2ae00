"""Orders above the agents: by the operator, for a lost or idle agent, and at the end of the bridge."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import cycle
from typing import Any, Literal, cast, get_args

from bridged.bridge.action_log import ActionLog
from bridged.bridge.action_server import ActionServer
from bridged.bridge.composite_driver import CompositeDriver
from bridged.drivers.api import Execution, Order, Outcome
from commd.common.clock import Clock
from commd.common.tasks import wait_at_most
from commd.process.log_handler import one_line
from schemas.files.findings import Findings
from schemas.files.units import Duration
from schemas.mission.model import NO_STEPS, Mission
from schemas.wire.log_lines import LeftAs, OrderEnded, RobotLeft, RobotReleased
from schemas.wire.records import Note

ORDER_PATIENCE = 10.0
"""Wall seconds in which the vehicle must confirm the mode of an order."""
ARMING_SHOWS, ARMING_PATIENCE = 0.5, 5.0
"""Wall seconds after a command to arm: a report of the vehicle's state that is later than the first shows whether it
has armed; after the second no report is waited for. HEARTBEATs come once a second, and some may be lost."""
AGAIN = 1.0
"""Wall seconds before a failed order is repeated, and between two looks whether a robot is home."""
LOOK = 0.2
"""Wall seconds between two looks whether a robot that was never heard is heard, or an agent has taken control."""
FIRST_HEARD = 10.0
"""Wall seconds that a bridge which leaves waits to hear a robot that a former run may have left in flight."""
COMING: tuple[Order, ...] = ("rtl", "land")
"""The motions that end on the ground, or at home, with nobody in charge."""
UNATTENDED = "robot_unattended"
"""Code of the alarm that a robot is in the air and its agents intend nothing with it."""
FALLBACK: tuple[Order, ...] = ("rtl", "land", "hold")
"""Orders that are tried next when the vehicle does not carry out the last one."""
log = logging.getLogger("orders")


StepField = Literal["on_agent_loss", "on_idle"]
STEP_FIELDS: tuple[StepField, ...] = get_args(StepField)


@dataclass(frozen=True)
class Step:
    """One step of `on_agent_loss` or `on_idle`: an order, and the pause after it."""

    order: Order
    pause: float = 0.0
    """Mission seconds before the next step."""


def read_steps(mission: Mission, robot: str, field: StepField) -> tuple[Step, ...]:
    """Return the robot's steps of a field. Raises Findings for what is not `hold|land|rtl [DURATION]`."""
    steps, findings = [], []
    texts = getattr(mission.robots[robot], field)
    for index, text in enumerate(() if texts == NO_STEPS else texts):
        order, _, pause = text.partition(" ")
        try:
            if order not in get_args(Order):
                raise ValueError(f"Expected hold, land or rtl, got `{order}`")
            steps.append(Step(cast(Order, order), Duration.read(pause) if pause else 0.0))
        except ValueError as error:
            findings.append(mission.positions.finding(("robots", robot, field, index), f"{field}: {error}"))
    if findings:
        raise Findings(findings)
    return tuple(steps)


def by_operator(order: Order) -> Outcome:
    """How actions end upon the operator's order."""
    return Outcome("failed", f"operator: {order}", "operator", order)


def _stops(more: str = "", order: Order | None = None) -> Outcome:
    """How actions end when the bridge does."""
    return Outcome("failed", f"the bridge stops{more}", "shutdown", order)


@dataclass(eq=False)
class _Asked:
    """What the operator has asked for."""

    what: str
    answered: asyncio.Event = field(default_factory=asyncio.Event)
    outcome: Outcome | None = None
    """None = it is not known, or the query was cancelled."""


class SafetyOrders:
    """Carry out orders, one at a time: a later one takes over from a sequence that is under way.

    Only the operator's replace a safer motion: see `bridged.drivers.api.defers`.
    """

    def __init__(
        self,
        action_server: ActionServer,
        driver: CompositeDriver,
        action_log: ActionLog,
        clock: Clock,
        patience: float = 10.0,
    ) -> None:
        """`patience`: mission seconds that an agent which is back has to take control (`idle_after`)."""
        self._server, self._driver, self._own, self._action_log = action_server, driver, driver.own, action_log
        self._clock, self._patience = clock, patience
        self._robot = action_server.robot
        self._sequence: asyncio.Task[None] | None = None
        self._make_sequence: Callable[[], Coroutine[Any, Any, None]] | None = None
        """Makes the sequence under way: it begins again after a pause."""
        self._insisting: asyncio.Task[None] | None = None
        """Gives the operator's order or pause again, until the robot has answered."""
        self._asked: _Asked | None = None
        """The operator's last order, pause, `continue` or `release`."""
        self._execution: Execution | None = None
        """The present order of a sequence."""
        self._lost: tuple[str, Sequence[Step]] | None = None
        """The agent that was lost last and the steps for it, until an agent takes control."""
        self._back_at: float | None = None
        """When the lost agent came back, in mission seconds; none = it is not back."""
        self._ended: tuple[tuple[str, Sequence[Step]], float | None] | None = None
        """What `_lost` and `_back_at` were when an agent's last action ended a sequence; None = it has ended none."""
        self._alarm: Note | None = None
        self._left: Note | None = None
        self._unheard: Note | None = None
        self._deferred: Note | None = None
        self._stopping = False
        self._other = ""
        """Which other bridge the robot is left to."""
        self._secured = False
        """Whether the robot carries out the order of `shut_down`."""
        action_server.on_control, action_server.on_refused = self._on_control, self._on_refused
        if action_log.ordered:
            standing = by_operator(action_log.ordered)
            action_server.block(standing)
            told = "as ordered before the bridge restarted: no action is accepted until `release`"
            log.warning("robot=%s %s, %s", action_server.robot, standing.reason, told)

    def notes(self) -> list[Note]:
        """Return the warnings that hold now."""
        left, blocked = self._left if self._own.overridden else None, None
        if self._server.blocked:
            text = f"no action is accepted: {self._server.blocked.reason}"
            ordered = Note("operator_order", text, self._action_log.ordered or "")
            blocked = Note("bridge_stops", text) if self._stopping else ordered
        return [note for note in (left, self._unheard, self._deferred, self._alarm, blocked) if note is not None]

    @property
    def unattended(self) -> bool:
        """Whether only an agent's intention can decide what becomes of a robot in the air.

        Not while an action runs, a sequence of ours is carried out, the operator or a pilot has it or has paused it,
        somebody commands it by hand, or before any agent has flown it.
        """
        server = self._server
        others = self._own.overridden or server.blocked or server.paused or server.by_hand or self._stopping
        busy = others or server.running or self._loss
        return self._own.airborne and self._own.heard and not busy and bool(server.lease.answers)

    @property
    def lost_agent(self) -> str:
        """The agent that was lost last and for which the robot was brought to safety, until an agent takes control."""
        return "" if self._lost is None else self._lost[0]

    @property
    def _loss(self) -> bool:
        """Whether a sequence for a lost agent is under way."""
        return self._sequence is not None and bool(self._server.lease.closed)

    async def carry_out(self, order: Order, ending: Outcome, *, block: bool, insist: bool = False) -> Outcome:
        """Order it, and wait until the vehicle confirms it or `ORDER_PATIENCE` is over; actions end as `ending`.

        Without `insist` it ends when a pilot, a ground station or a failsafe sets another mode.
        """
        execution = self._server.order(order, ending, block=block, insist=insist)
        if not block:  # to call off a sequence leaves the operator's order alone
            self._execution = execution
        outcome = await self._confirmed(execution)
        confirmed = outcome.state == "succeeded"
        ended = OrderEnded(robot=self._robot, order=order, confirmed=confirmed, reason=one_line(outcome.reason))
        log.log(
            logging.INFO if confirmed else logging.ERROR,
            "robot=%s %s (%s): %s %s",
            self._robot,
            order,
            ending.reason,
            outcome.state,
            outcome.reason,
            extra={"event": ended} if ending.cause == "operator" else None,
        )
        return outcome

    async def _confirmed(self, execution: Execution) -> Outcome:
        """Wait until the robot confirms an order or `ORDER_PATIENCE` is over."""
        confirmed = asyncio.Event()
        execution.on_end(confirmed.set)
        if execution.outcome is None:
            try:
                async with asyncio.timeout(ORDER_PATIENCE):
                    await confirmed.wait()
            except TimeoutError:
                pass
            except asyncio.CancelledError:  # called off: it must not override who has the robot now
                self._driver.stop(execution, Outcome("cancelled", "called off"), hold=False)
                raise
        waits = f": it waits for {execution.waits_for}" if execution.waits_for else ""
        said = f"the vehicle did not confirm {execution.name} within {ORDER_PATIENCE:g} s{waits}"
        self._driver.stop(execution, Outcome("timed_out", said), hold=False)
        return execution.outcome or Outcome("timed_out", said)

    async def operator(self, order: Order) -> Outcome:
        """Carry out the operator's order: every action ends, and no agent acts until `release`.

        An order that the robot cannot hear is given again when it is heard. The sequence for a lost agent begins again
        on `release`, unless the robot is left by then.
        """
        asked = self._ask(order)
        if not self._stopping:
            self._action_log.order(order)
        back_at, may_move = self._back_at, self._loss or self._may_move
        self.call_off()
        if may_move and self._lost is not None and self._lost[0] == self._server.lease.answers and not self._stopping:
            self._back_at = back_at
            self._begin_loss(*self._lost)
        return await self._outcome_of(asked, self.carry_out(order, by_operator(order), block=True, insist=True))

    def release(self) -> Outcome:
        """Let the agents act again, but not while the bridge leaves the robot."""
        if self._stopping:
            return Outcome("refused", "the bridge stops: it accepts no more actions")
        self._server.blocked = None
        self._action_log.order(None)
        if not self._server.paused:
            self._ask("release")
        released = RobotReleased(robot=self._robot)
        log.info("robot=%s released: actions are accepted again", self._robot, extra={"event": released})
        waits = "; it is paused: they begin when it is told to `continue`" if self._server.paused else ""
        lost = f"; {self._server.lease.closed}" if self._loss else ""
        return Outcome("succeeded", f"actions are accepted again{waits}{lost}")

    async def pause(self) -> Outcome:
        """Pause the robot for the operator: it holds, its actions are kept and wait for `resume`."""
        if self._stopping:
            return Outcome("refused", "the bridge stops")
        if self._sequence is not None and self._make_sequence is not None:
            self._sequence.cancel()
            self._begin(self._make_sequence)
        asked = self._ask("pause")
        return await self._outcome_of(asked, self._confirmed(self._server.pause()))

    async def resume(self) -> Outcome:
        """Continue after a pause: bring the robot back into its mode, then begin its actions again.

        It stays paused if it does not confirm its mode. An order of the operator is given again instead.
        """
        if self._stopping:
            return Outcome("refused", "the bridge stops: it accepts no more actions")
        if not self._server.paused and (blocked := self._server.blocked):
            return Outcome("refused", f"it is not paused: {blocked.reason}; `release` gives it back to its agents")
        if not self._server.paused:
            return Outcome("succeeded", "it was not paused")
        asked = self._ask("continue")
        if order := self._action_log.ordered:
            return await self._outcome_of(asked, self.carry_out(order, by_operator(order), block=True, insist=True))
        return await self._outcome_of(asked, self._go_on())

    async def _go_on(self) -> Outcome:
        outcome = await self._confirmed(self._driver.resume())
        if outcome.state == "succeeded" and self._server.paused:
            self._server.go_on()
        return outcome

    def restore(self) -> None:
        """Pause or order a robot again, when it is heard, as the operator did in a former run of the bridge."""
        self._ask("restart")
        if self._server.paused or self._action_log.ordered:
            self._insisting = asyncio.create_task(self._insist())

    def _ask(self, what: str) -> _Asked:
        """Take in that the operator wants something else now."""
        if self._insisting is not None:
            self._insisting.cancel()
            self._insisting = None
        self._asked = _Asked(what)
        return self._asked

    async def _outcome_of(self, asked: _Asked, carrying: Coroutine[Any, Any, Outcome]) -> Outcome:
        """Return the outcome of what the operator asked; of the later one if the same replaced it."""
        try:
            outcome, newest = await carrying, self._asked
            if newest is not None and newest is not asked and outcome.cause == "operator":
                outcome = replace(outcome, reason=f"a later `{newest.what}` of the operator replaced it")
                if newest.what == asked.what:
                    await newest.answered.wait()
                    outcome = newest.outcome or outcome
            asked.outcome = self._insists_on(asked, outcome)
            return asked.outcome
        finally:
            asked.answered.set()

    def _insists_on(self, asked: _Asked, outcome: Outcome) -> Outcome:
        """Give the operator's order or pause again if the robot has not answered, and nothing else was asked since.

        Returns the outcome, which says so.
        """
        standing = self._server.paused or self._action_log.ordered
        if not (self._unanswered(outcome) and standing and asked is self._asked) or self._stopping:
            return outcome
        self.restore()
        what = "the pause" if self._server.paused else "it"
        return replace(outcome, reason=f"{outcome.reason}; {what} is given again when the robot is heard")

    async def _insist(self) -> None:
        """Give the operator's order or pause when the robot is heard, until it answers. Others keep the robot."""
        server, driver, waits = self._server, self._driver, False
        while (server.paused or self._action_log.ordered) and not self._stopping:
            order = self._action_log.ordered
            if self._own.heard and not server.paused and not driver.active:
                return
            if not self._own.heard or self._own.overridden:
                if self._own.heard and not waits:
                    waits, what = True, "the operator's pause" if server.paused else f"the operator's {order}"
                    log.warning("robot=%s %s waits: others have set %s", self._robot, what, self._own.overridden)
                await asyncio.sleep(LOOK)
                continue
            if server.paused:
                outcome = await self._confirmed(server.pause())
            elif order:
                outcome = await self.carry_out(order, by_operator(order), block=True)
            if not self._unanswered(outcome):
                return

    def _unanswered(self, outcome: Outcome) -> bool:
        """Whether the robot has not answered an order, which it or we may not have heard."""
        lost = outcome.state == "failed" and (outcome.cause == "link" or not self._own.heard)
        return outcome.state == "timed_out" or lost

    def agent_lost(self, agent: str, why: str, steps: Sequence[Step]) -> None:
        """Carry out the mission's steps, until an agent takes control or the operator or the bridge's end overrides.

        The agent's actions fail; the vehicle continues its motion until an order replaces it. Steps that are under way
        for this agent go on: one that crashes again and again must not begin them anew each time.
        """
        log.error("robot=%s agent %s is lost (%s)", self._robot, agent, why)
        arming = self._server.arming
        self._server.end_all(agent, Outcome("failed", f"agent {agent} is lost: {why}", "agent_lost"))
        if self._loss and self.lost_agent == agent and not arming:  # again, before it took control
            self._back_at = None
        elif (self._may_move or arming) and not self._stopping:
            self.call_off()
            self._lost = agent, steps
            self._begin_loss(agent, steps)
        else:
            self._server.lease.let_go()

    def agent_back(self, agent: str) -> None:
        """Give an agent that is back `patience` to take control; if it commands nothing, the sequence continues."""
        self._back_at = self._clock.now()
        if self._loss:
            said = f"the bridge goes on in {self._patience:g} s unless it takes control"
            log.warning("robot=%s agent %s is back; %s", self._robot, agent, said)

    def agents_idle(self, seconds: float, steps: Sequence[Step], *, lost: bool = False) -> None:
        """Raise the alarm and carry out the mission's steps for a robot in the air without any agent's intention.

        `seconds`: for how long, in mission seconds; 0 = it is attended, which ends the alarm. `lost`: the agent that
        answers for it is lost.
        """
        if not seconds or (self._alarm is None and self._driver.under_way in COMING):
            self._alarm = None
            return
        agent, first = self._server.lease.answers, self._alarm is None
        does = f"it is brought to safety ({', '.join(step.order for step in steps)})" if steps else "on_idle is none"
        why = f"agent {agent} is {'lost' if lost else 'there and intends nothing'}"
        text = f"in the air with nobody in charge: {why}; {does}"
        self._alarm = Note(UNATTENDED, text, value=round(seconds, 1))
        if first:
            log.error("robot=%s %s", self._robot, text)
            if steps:
                self._begin(partial(self._answer, f"agent {agent} is {'lost' if lost else 'idle'}", steps))

    def call_off(self) -> None:
        """End the sequence under way: an agent has taken control, or the operator or the bridge's end overrides."""
        if self._sequence is not None:
            self._sequence.cancel()
            self._sequence = None
            self._server.lease.closed = ""
            if self._execution is not None:  # before the next action begins, and not when the task ends
                self._driver.stop(self._execution, Outcome("cancelled", "called off"), hold=False)
        self._left = self._unheard = self._deferred = None
        self._back_at = None

    def _on_control(self) -> None:
        """End the sequence and forget the lost agent: an agent takes control."""
        self._ended = (self._lost, self._back_at) if self._lost is not None and self._loss else None
        self._lost = None
        self.call_off()

    def _on_refused(self) -> None:
        """Go on with the last step of the sequence that an action has ended which was refused: nobody has control."""
        if self._ended is not None and not self._stopping:
            (agent, steps), back_at = self._ended
            self.call_off()
            self._lost, self._back_at, self._ended = (agent, steps[-1:]), back_at, None
            self._begin_loss(*self._lost)

    def _begin_loss(self, agent: str, steps: Sequence[Step]) -> None:
        self._server.lease.closed = f"agent {agent} is lost: the bridge brings the robot to safety first"
        self._begin(partial(self._answer_loss, agent, steps))

    def _begin(self, make: Callable[[], Coroutine[Any, Any, None]]) -> None:
        self._make_sequence, self._sequence = make, asyncio.create_task(make())

    @property
    def _never_heard(self) -> bool:
        """Whether the robot was never heard: a former run of the bridge may have left it in flight."""
        return not self._own.heard and not math.isfinite(self._own.silence)

    @property
    def _may_move(self) -> bool:
        return self._driver.active or self._never_heard

    async def _answer_loss(self, agent: str, steps: Sequence[Step]) -> None:
        """Bring the robot to safety, then end the lease."""
        await self._answer(f"agent {agent} is lost", steps)
        self._server.lease.closed = ""
        self._server.lease.let_go()

    async def _answer(self, why: str, steps: Sequence[Step]) -> None:
        try:
            await self._bring_to_safety(why, steps)
        except Exception:
            log.exception("robot=%s defect while the robot is brought to safety (%s)", self._robot, why)
        self._sequence = None

    async def _bring_to_safety(self, why: str, steps: Sequence[Step]) -> None:
        if not self._may_move:
            await self._shows_arming()
        if self._operator_has_it:
            await self._wait_for_operator(why)
            if not self._may_move:  # it was landed meanwhile
                return
        if self._never_heard and not self._driver.active:
            self._unheard = Note("never_heard", f"{why}; the robot was never heard: it is brought to safety when it is")
            log.error("robot=%s %s", self._robot, self._unheard.text)
            while self._never_heard:  # noqa: ASYNC110 - drivers do not tell when
                await asyncio.sleep(LOOK)
            self._unheard = None
        outcome = Outcome("succeeded")
        for step in steps:
            while self._back_at is not None and self._clock.now() < self._back_at + self._patience:  # noqa: ASYNC110 - as above
                await asyncio.sleep(LOOK)  # an agent that is back may still take control, which ends the sequence
            outcome = await self._until_heard(step.order, why)
            if self._own.overridden:
                break
            await self._clock.sleep(step.pause)
        last = steps[-1].order if steps else "hold"
        known = [order for order in (*self._others(last), last) if order in self._driver.orders]
        comes = last in COMING and not set(known).isdisjoint(COMING)
        for order in cycle(known):  # it may hear us again, also long after we do
            if outcome.state == "succeeded" or not self._driver.active or self._own.overridden:
                break
            said = "the vehicle did not do the last that was ordered, so"
            log.error("robot=%s %s %s is ordered instead", self._robot, said, order)
            outcome = await self._until_heard(order, why)
            if comes and order not in COMING:  # it is not home yet
                outcome = replace(outcome, state="failed")
            await self._clock.sleep(AGAIN)
        if mode := self._own.overridden:
            others = "which others set (pilot, ground station or failsafe)"
            if self._driver.under_way in COMING:
                log.info("robot=%s %s; it comes home in %s, %s", self._robot, why, mode, others)
                return
            self._left = Note(
                "left_to_others", f"{why}; the vehicle is left in {mode}, {others}: nothing is ordered", mode
            )
            log.error("robot=%s %s", self._robot, self._left.text)

    @property
    def _operator_has_it(self) -> str:
        """What the operator has done to the robot, and until when; empty = nothing. It overrides sequences."""
        if self._server.paused:
            return "the robot is paused: it is brought to safety on `continue`"
        blocked = self._server.blocked
        return f"{blocked.reason}: it is brought to safety on `release`" if blocked else ""

    async def _wait_for_operator(self, why: str) -> None:
        """Wait while the operator blocks a robot that may move; an agent that is back may take control after that."""
        while self._may_move and (has := self._operator_has_it):
            if (deferred := Note("safety_deferred", f"{why}; {has}")) != self._deferred:
                self._deferred = deferred
                log.error("robot=%s %s", self._robot, deferred.text)
            await asyncio.sleep(LOOK)
        self._deferred = None
        if self._back_at is not None:
            self._back_at = self._clock.now()

    async def _until_heard(self, order: Order, why: str) -> Outcome:
        """Give an order until the vehicle answers: one that is out of reach may come back."""
        outcome, again = Outcome("failed", f"the robot has no order `{order}`"), False
        if order not in self._driver.orders:
            return outcome
        while self._driver.active and not self._own.overridden:
            ending = Outcome("failed", f"{why}: {order}", "agent_lost", order)
            outcome = await self.carry_out(order, ending, block=False)
            if outcome.state == "succeeded" or (self._own.heard and (again or outcome.state != "timed_out")):
                break
            again = self._own.heard
            if outcome.state == "failed":
                await asyncio.sleep(AGAIN)
        return outcome

    def leave_to_other(self, other: str) -> None:
        """End everything without an order to the robot: from now on `other` serves it."""
        self.call_off()
        self._ask("shutdown")
        self._stopping, self._other = True, other
        self._server.block(_stops())
        self._server.end_pause()
        self._server.end_all("", _stops(f": {other}"))

    async def shut_down(self, order: Order, stay: float = 0.0, leave: asyncio.Event | None = None) -> RobotLeft:
        """Order what leaves the robot safe at the end of the bridge. Returns how it was left.

        Stay for at most `stay` mission seconds until it is disarmed, is heard in a pilot's mode, or `leave` is set. If
        an agent answers for a robot that was not heard yet, wait up to `FIRST_HEARD` wall seconds for it.
        """
        if self._other:
            return self._left_as("piloted", f"left as it is: {self._other}")
        left, until, leave = await self._leave_safe(order), self._clock.now() + stay, leave or asyncio.Event()
        hear_by = self._clock.wall() + FIRST_HEARD if self._server.lease.answers else 0.0

        def stays() -> bool:
            if self._never_heard:
                return self._clock.wall() < hear_by
            return self._driver.active and not self._piloted

        while stays() and self._clock.now() < until and not leave.is_set():
            await wait_at_most(leave, AGAIN)
            if not self._secured and self._own.heard:
                left = await self._leave_safe(order)
        if stay and (self._piloted or not self._driver.active):  # nothing is ordered any more
            left = await self._leave_safe(order)
        if self._secured or self._piloted or not self._driver.active:
            self._action_log.order(None)  # not before: a bridge that is killed on its way out has left nobody in charge
        return left

    @property
    def _piloted(self) -> bool:
        """Whether others fly the robot, other than home or down: a failsafe is watched to the ground.

        Of a robot that is silent it is not known, and it may be heard again before the bridge has to go.
        """
        return bool(self._own.overridden) and self._own.heard and self._driver.under_way not in COMING

    async def _leave_safe(self, order: Order) -> RobotLeft:
        """Give the order, or those of `FALLBACK` if it fails. Returns how the robot was left."""
        self.call_off()
        self._stopping = True
        self._server.block(_stops())
        self._server.end_pause()
        shown = True
        if self._server.arming and not self._driver.active:
            self._server.end_all("", _stops())
            shown = await self._shows_arming()
        if not self._driver.active:
            said = self._as_last_heard("not armed" if self._driver.arms else "left as it is")
            said += "" if shown else ", and it was to arm since then"
            return self._left_as("disarmed" if self._own.heard and shown else "unconfirmed", said)
        outcome, done = Outcome("failed", "the robot has no such order"), order
        for attempt in (order, *self._others(order)):
            if attempt not in self._driver.orders:
                continue
            if mode := self._own.overridden:
                under_way = self._driver.under_way
                if under_way in COMING:
                    self._server.end_all("", _stops(f"; the vehicle comes home in {mode}"))
                    return self._left_as("ordered", f"the vehicle is in {mode}, which others set", under_way)
                self._server.end_all("", _stops(f"; {mode} is the pilot's"))
                return self._left_as("piloted", f"left to the pilot in {mode}, {self._as_last_heard('armed')}")
            outcome, done = await self.carry_out(attempt, _stops(f": {attempt}", attempt), block=True), attempt
            if outcome.state == "succeeded":
                self._secured = True
                return self._left_as("ordered", outcome.reason or "the vehicle does it", attempt)
            if outcome.state == "timed_out":
                break  # it does not answer: another order would not be heard either
        state = self._as_last_heard("armed" if self._driver.arms else "it may be moving")
        return self._left_as("unconfirmed", f"{state}, and it has not confirmed {done}: {outcome.reason}")

    async def _shows_arming(self) -> bool:
        """Wait for a report of the robot's state that shows whether it has armed as commanded. Returns if there is."""
        begun = self._clock.wall()
        while not self._driver.active and (waited := self._clock.wall() - begun) < ARMING_SHOWS + self._own.silence:
            if waited >= ARMING_PATIENCE:
                return False
            await asyncio.sleep(LOOK)
        return True

    def _left_as(self, state: LeftAs, said: str, order: Order | None = None) -> RobotLeft:
        text = f"{order}: {said}" if order else said
        return RobotLeft(robot=self._robot, state=state, order=order, text=one_line(text))

    def _others(self, order: Order) -> list[Order]:
        """Return the orders that the robot knows and that are tried when it does not carry out `order`."""
        return [other for other in FALLBACK if other != order and other in self._driver.orders]

    def _as_last_heard(self, state: str) -> str:
        """Return a state of the vehicle for people, with its age if it cannot be heard."""
        silence = self._own.silence
        if self._own.heard:
            return state
        return f"{state} when last heard {silence:.0f} s ago" if math.isfinite(silence) else "never heard"
