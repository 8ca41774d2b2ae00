"""What is done to a robot without its agent: the operator's stop, the loss of the agent, the end of the bridge."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast, get_args

from bridged.body import Body
from bridged.desk import ActionDesk
from bridged.drivers.robot import Order, Outcome
from bridged.guarded import Guarded
from commd.clock import Clock
from schemas.durations import Duration
from schemas.findings import Findings
from schemas.mission import Mission

ORDER_PATIENCE = 10.0
"""Wall seconds in which the vehicle must confirm the mode of an order."""
ARMING_SHOWS = 1.5
"""Wall seconds after which a vehicle that was told to arm shows whether it did: its HEARTBEAT comes once a second."""
AGAIN = 1.0
"""Wall seconds before an order that failed is given again to a robot that is out of reach."""
LOOK = 0.2
"""Wall seconds between two looks whether a robot that was never heard is heard."""
FALLBACK: tuple[Order, ...] = ("rtl", "land", "hold")
"""What is tried next when the vehicle does not do the last that is ordered."""
log = logging.getLogger("orders")


@dataclass(frozen=True)
class Step:
    """One step of `on_agent_loss`: an order, and how long to leave it at that."""

    order: Order
    pause: float = 0.0
    """Mission seconds before the next step."""


def read_steps(mission: Mission, robot: str) -> tuple[Step, ...]:
    """Return the robot's `on_agent_loss`. Raises Findings for what is not `hold|land|rtl [DURATION]`."""
    steps, findings = [], []
    for index, text in enumerate(mission.robots[robot].on_agent_loss):
        order, _, pause = text.partition(" ")
        try:
            if order not in get_args(Order):
                raise ValueError(f"Expected hold, land or rtl, got `{order}`")
            steps.append(Step(cast(Order, order), Duration.read(pause) if pause else 0.0))
        except ValueError as error:
            where = ("robots", robot, "on_agent_loss", index)
            findings.append(mission.positions.finding(where, f"on_agent_loss: {error}"))
    if findings:
        raise Findings(findings)
    return tuple(steps)


class Orders:
    """Carries out orders, one at a time: a later one takes over from a sequence that is under way."""

    def __init__(self, desk: ActionDesk, driver: Body, clock: Clock) -> None:
        self._desk, self._driver, self._clock = desk, driver, clock
        self._calls = Guarded(driver)
        self._sequence: asyncio.Task[None] | None = None
        self._left = ""
        self._unheard = ""
        self._stopping = False

    def notes(self) -> list[str]:
        """Warnings that hold now."""
        left = self._left if self._driver.overridden else ""
        return [note for note in (left, self._unheard) if note]

    async def carry_out(self, order: Order, reason: str, *, block: bool, insist: bool = False) -> Outcome:
        """Order it, and wait until the vehicle confirms it or `ORDER_PATIENCE` is over.

        Without `insist` it ends when a pilot, a ground station or a failsafe sets another mode.
        """
        execution = self._desk.order(order, reason, block=block, insist=insist)
        confirmed = asyncio.Event()
        execution.ended = confirmed.set
        if execution.outcome is None:
            try:
                await asyncio.wait_for(confirmed.wait(), ORDER_PATIENCE)
            except TimeoutError:
                pass
            except asyncio.CancelledError:  # called off: it must not go on against whoever has the robot now
                self._calls.stop(execution, Outcome("cancelled", "called off"), hold=False)
                raise
        waits = f": it waits for {execution.waits_for}" if execution.waits_for else ""
        said = f"the vehicle did not confirm {order} within {ORDER_PATIENCE:g} s{waits}"
        self._calls.stop(execution, Outcome("timed_out", said), hold=False)
        outcome = execution.outcome or Outcome("timed_out", said)
        log.log(
            logging.INFO if outcome.state == "succeeded" else logging.ERROR,
            "robot=%s %s (%s): %s %s",
            self._desk.robot,
            order,
            reason,
            outcome.state,
            outcome.reason,
        )
        return outcome

    async def operator(self, order: Order) -> Outcome:
        """The operator's order: it ends every action, and no agent acts until `release`."""
        if self._sequence is not None:  # its agent is lost, and is answered for by now
            self._desk.lease.let_go()
        self.call_off()
        return await self.carry_out(order, f"operator: {order}", block=True, insist=True)

    def release(self) -> Outcome:
        """The operator lets the agents act again, but not while the bridge leaves the robot."""
        if self._stopping:
            return Outcome("refused", "the bridge stops: it takes no action any more")
        self._desk.blocked = ""
        log.info("robot=%s released: actions are taken again", self._desk.robot)
        return Outcome("succeeded", "actions are taken again")

    def agent_lost(self, agent: str, why: str, steps: Sequence[Step]) -> None:
        """Do what the mission declares, step by step, until `call_off`."""
        log.error("robot=%s agent %s is lost (%s)", self._desk.robot, agent, why)
        arming = self._desk.arming
        self._desk.end_all(agent, Outcome("failed", f"agent {agent} is lost: {why}"))
        if (self._driver.active or arming or self._never_heard) and not self._desk.blocked:
            self.call_off()
            self._desk.lease.closed = f"agent {agent} is lost: the bridge brings the robot to safety first"
            self._sequence = asyncio.create_task(self._steps(agent, steps))
        else:
            self._desk.lease.let_go()

    def call_off(self) -> None:
        """Leave out the steps that are still to come: the agent is back, or somebody above it has spoken."""
        if self._sequence is not None:
            self._sequence.cancel()
            self._sequence = None
            self._desk.lease.closed = ""
        self._left = self._unheard = ""

    @property
    def _never_heard(self) -> bool:
        """Whether this life of the bridge cannot know what the robot does: a former one may have left it in flight."""
        return not self._driver.heard and not math.isfinite(self._driver.silence)

    async def _steps(self, agent: str, steps: Sequence[Step]) -> None:
        """Bring the robot to safety, whatever happens; then it is anybody's."""
        try:
            await self._bring_to_safety(agent, steps)
        except Exception:
            log.exception("robot=%s defect while the lost agent %s is answered for", self._desk.robot, agent)
        self._sequence, self._desk.lease.closed = None, ""
        self._desk.lease.let_go()

    async def _bring_to_safety(self, agent: str, steps: Sequence[Step]) -> None:
        if self._never_heard and not self._driver.active:
            self._unheard = f"agent {agent} is lost; the robot was never heard: it is brought to safety when it is"
            log.error("robot=%s %s", self._desk.robot, self._unheard)
            while self._never_heard:  # noqa: ASYNC110 - drivers do not tell when
                await asyncio.sleep(LOOK)
            self._unheard = ""
        if not self._driver.active:
            await asyncio.sleep(ARMING_SHOWS)
        outcome = Outcome("succeeded")
        for step in steps:
            outcome = await self._until_heard(step.order, agent)
            if self._driver.overridden:
                break
            await self._clock.sleep(step.pause)
        for order in self._others(steps[-1].order) if steps else ():
            if outcome.state == "succeeded" or not self._driver.active or self._driver.overridden:
                break
            said = "the vehicle did not do the last that was ordered, so"
            log.error("robot=%s %s %s is ordered instead", self._desk.robot, said, order)
            outcome = await self._until_heard(order, agent)
        if mode := self._driver.overridden:
            others = "which others set (pilot, ground station or failsafe)"
            self._left = f"agent {agent} is lost; the vehicle is left in {mode}, {others}: nothing is ordered"
            log.error("robot=%s %s", self._desk.robot, self._left)

    async def _until_heard(self, order: Order, agent: str) -> Outcome:
        """Give an order; a vehicle that is out of reach may come back, so it is told until it answers."""
        outcome, again = Outcome("failed", f"the robot has no order `{order}`"), False
        if order not in self._driver.orders:
            return outcome
        while self._driver.active and not self._driver.overridden:
            outcome = await self.carry_out(order, f"agent {agent} is lost: {order}", block=False)
            if outcome.state == "succeeded" or (self._driver.heard and (again or outcome.state != "timed_out")):
                break
            again = self._driver.heard
            if outcome.state == "failed":
                await asyncio.sleep(AGAIN)
        return outcome

    async def shut_down(self, order: Order) -> str:
        """Leave the robot safe at the end of the bridge. Returns in words what was left."""
        self.call_off()
        self._stopping, self._desk.blocked = True, "the bridge stops"
        if self._desk.arming and not self._driver.active:
            self._desk.end_all("", Outcome("failed", "the bridge stops"))
            await asyncio.sleep(ARMING_SHOWS)
        if not self._driver.active:
            return self._as_last_heard("not armed" if self._driver.arms else "left as it is")
        outcome, done = Outcome("failed", "the robot has no such order"), order
        for attempt in (order, *self._others(order)):
            if attempt not in self._driver.orders:
                continue
            if mode := self._driver.overridden:
                self._desk.end_all("", Outcome("failed", f"the bridge stops; {mode} is the pilot's"))
                return f"left to the pilot in {mode}, {self._as_last_heard('armed')}"
            outcome, done = await self.carry_out(attempt, f"the bridge stops: {attempt}", block=True), attempt
            if outcome.state == "succeeded":
                return f"{attempt}: {outcome.reason or 'the vehicle does it'}"
            if outcome.state == "timed_out":
                break  # it does not answer: another order would not be heard either
        state = "armed" if self._driver.arms else "it may be moving"
        return f"{self._as_last_heard(state)}, and it has not confirmed {done}: {outcome.reason}"

    def _others(self, order: Order) -> list[Order]:
        """What is tried when the robot does not do `order`, of what it can."""
        return [other for other in FALLBACK if other != order and other in self._driver.orders]

    def _as_last_heard(self, state: str) -> str:
        """What is known of the vehicle, in words that do not call it known when it is not."""
        silence = self._driver.silence
        if self._driver.heard:
            return state
        return f"{state} when last heard {silence:.0f} s ago" if math.isfinite(silence) else "never heard"
