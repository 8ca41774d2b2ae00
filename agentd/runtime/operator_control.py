"""Let an operator pause, step and resume a mind, and give it goals and beliefs, if the mission has `inject: true`.

A pause stops the mind between two cycles. Its actions continue, its timers run and fire later, its mail waits at commd
as that of a busy mind does, and its state is saved. A pause times out, so that a forgotten one cannot block the agent;
sooner if the mind has a robot, for nothing reacts to that robot's percepts meanwhile.
"""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Callable
from typing import Final, TypeAlias

from agentd.conversion.term_conversion import MAX_DEPTH, BadTerm, to_wire
from agentd.language.parse import parse_literal
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Structure
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Literal
from agentd.mind.beliefs.term_copy import is_ground
from agentd.mind.data.inputs import BeliefAdded, GoalAdded
from agentd.mind.execution.messages import told_annots
from agentd.runtime.mind_runner import MindRunner
from commd.bus.bus import Bus, Query
from commd.common.clock import Clock
from schemas.wire import keys
from schemas.wire.mind_records import MindOrder
from schemas.wire.records import Note, Outcome

log = logging.getLogger("control")

LONGEST_PAUSE: Final = 600.0
"""Wall seconds after which a paused mind continues by itself."""
LONGEST_WITH_ROBOT: Final = 60.0
"""The same for a mind with a robot."""
MOST_WAITING: Final = 20_000
"""Inputs that may wait for a paused mind; with more it continues by itself."""
NOTED_FOR: Final = 60.0
"""Wall seconds for which health notes that a mind has continued by itself."""
STEP_PATIENCE: Final = 5.0
"""Wall seconds after which the operator gets the answer that a step has not been made."""
LARGEST: Final = 4096
"""Bytes of an order: parsing it blocks the event loop, and with it every agent of the process."""
DEEPEST: Final = MAX_DEPTH
"""Nesting of brackets and terms in a goal or belief: the trace of a mind cannot hold more."""
LOGGED: Final = 200
"""Characters of an order in the log."""
OPERATOR: Final = "operator"
"""The source of the operator's goals and beliefs."""
NOT_ALLOWED: Final = "the mission does not say `inject: true`: only then its minds take orders"


Step: TypeAlias = "asyncio.Future[str]"
"""A step that was ordered: the result says why it was not made; empty: it was."""
MOST_STEPS: Final = 100
"""Steps that may wait."""
_BRACKETS: Final = re.compile(r"[][(){}]|\"(?:[^\"\\]|\\.)*\"")
"""Brackets, and strings, whose brackets do not count."""


class OperatorControl:
    """The operator's control of one mind."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        runner: MindRunner,
        allowed: bool,
        changed: Callable[[str], None],
        robot: str | None = None,
    ) -> None:
        """`allowed`: the mission has `inject: true`; `changed` gets each order as text; `robot` is the mind's."""
        self._clock, self._runner, self._mind, self._allowed = clock, runner, runner.mind, allowed
        self._changed = changed
        self._longest = LONGEST_PAUSE if robot is None else LONGEST_WITH_ROBOT
        self._alone = "" if robot is None else f"; until then nobody reacts to percepts of {robot}"
        """Warning about the robot of a paused mind."""
        self._since = self._until = 0.0
        """Wall times of the beginning and the latest end of the pause, if there is one."""
        self.paused = False
        """Whether the mind may make ordered steps only."""
        self._steps: list[Step] = []
        """Steps that were ordered and not made."""
        self._over: tuple[float, str] | None = None
        """Wall time and reason of the last pause that has ended by itself."""
        self.withdraw = bus.serve(keys.control(bus.fleet, self._mind.name), MindOrder, self._serve, at_most=LARGEST)

    @property
    def left(self) -> float | None:
        """Wall seconds until the mind continues by itself; None if it is not paused."""
        return max(0.0, self._until - self._clock.wall()) if self.paused else None

    def may_reason(self) -> bool:
        """End a pause that has timed out. Return whether there was such a one."""
        if self._clock.wall() >= self._until:
            self._go_on_by_itself(f"a pause lasts at most {self._longest:g} s")
        elif len(self._mind.inputs) > MOST_WAITING:
            self._go_on_by_itself(f"more than {MOST_WAITING} inputs waited for it")
        return not self.paused

    def take_step(self) -> Step | None:
        """Return the step that is to be made now, if there is one."""
        while self._steps:
            if not (step := self._steps.pop(0)).done():  # else it has timed out
                return step
        return None

    def notes(self) -> tuple[Note, ...]:
        """Return a note of the pause, or of one that has ended by itself in the last `NOTED_FOR` seconds."""
        now = self._clock.wall()
        if self.paused:
            left = max(0.0, self._until - now)
            since = round(now - self._since)
            text = f"paused by the operator for {since} s; it continues by itself in {left:.0f} s{self._alone}"
            return (Note("mind_paused", text, value=since),)
        if self._over is not None and now < self._over[0] + NOTED_FOR:
            return (Note("mind_went_on", f"paused by the operator, it continued by itself: {self._over[1]}"),)
        return ()

    async def _serve(self, query: Query[MindOrder]) -> None:
        if not query.concrete:
            query.reply_error("an order is for one mind: its key must not have a wildcard")
        elif query.record is None:
            query.reply_error(query.error or "an order was expected: do=pause, step, resume, goal or belief")
        elif not self._allowed:
            query.reply(Outcome(ok=False, reason=NOT_ALLOWED))
        else:
            query.reply(await self.carry_out(query.record))

    async def carry_out(self, order: MindOrder) -> Outcome:
        """Carry out an order. The outcome has the reason if that fails."""
        match order.do:
            case "pause":
                return self._pause()
            case "resume":
                return self._resume()
            case "step":
                return await self._step()
            case "goal" | "belief":
                return self._give(order)

    def _pause(self) -> Outcome:
        now = self._clock.wall()
        if not self.paused:
            self.paused, self._since, self._over = True, now, None
            self._until = now + self._longest
            self._log("pause")
            return Outcome(ok=True, reason=f"it continues by itself in {self._longest:g} s{self._alone}")
        left = f"it continues by itself in {max(0.0, self._until - now):.0f} s"
        return Outcome(ok=True, reason=f"it was paused already, and {left}{self._alone}")

    def _resume(self) -> Outcome:
        if not self.paused:
            return Outcome(ok=False, reason="it is not paused")
        self._end()
        self._log("resume")
        return Outcome(ok=True)

    async def _step(self) -> Outcome:
        if not self.paused:
            return Outcome(ok=False, reason="it is not paused: only then it can be stepped")
        if len(self._steps) >= MOST_STEPS:
            return Outcome(ok=False, reason=f"{MOST_STEPS} steps wait already")
        step: Step = asyncio.get_running_loop().create_future()
        self._steps.append(step)
        due = self._mind.wake_at
        idle = not self._mind.ready and (due is None or due > self._clock.now())
        self._log("step")
        try:
            async with asyncio.timeout(STEP_PATIENCE):
                if why := await step:
                    return Outcome(ok=False, reason=why)
        except TimeoutError:
            return Outcome(ok=False, reason=f"it has not been made within {STEP_PATIENCE:g} s")
        cycle = f"cycle {self._mind.cycle}"
        return Outcome(ok=True, reason=f"{cycle}: there was nothing to do" if idle else cycle)

    def _give(self, order: MindOrder) -> Outcome:
        """Give the mind a goal or belief of the operator."""
        sign = "!" if order.do == "goal" else "+"
        try:
            literal = _literal(order.text.strip().removeprefix(sign))
            to_wire(literal)
        except SyntaxErrors as errors:
            return Outcome(ok=False, reason=f"the {order.do} cannot be read: {errors.findings[0].message}")
        except BadTerm as bad:  # the trace could not hold it
            return Outcome(ok=False, reason=f"the {order.do} cannot be taken: {bad}")
        if order.do == "belief" and not is_ground(literal):
            return Outcome(ok=False, reason=f"a belief without variables was expected, got {literal}")
        if order.do == "goal" and (why := self._no_plan(literal)):
            return Outcome(ok=False, reason=why)
        theirs = literal.with_annots(told_annots(self._mind, literal, OPERATOR))
        self._runner.feed(GoalAdded(theirs) if order.do == "goal" else BeliefAdded(theirs))
        self._log(f"{order.do} {sign}{literal}")
        return Outcome(ok=True, reason="it is paused: it takes this when it continues" if self.paused else "")

    def _no_plan(self, goal: Literal) -> str:
        """Return why a goal would fail; empty if the program has a plan for it."""
        plans = self._mind.plans
        if plans.has_nested or plans.relevant("+", "!", goal.sig).plans:
            return ""
        triggers = [plan.syntax.trigger for plan in plans]
        achieved = [t.literal for t in triggers if t.operator == "+" and t.goal == "!"]
        structures = [one for one in achieved if isinstance(one, Structure)]
        same = {f"+!{one.functor}/{len(one.args)}" for one in structures if one.functor == goal.functor}
        others = f"; it has plans for {', '.join(sorted(same))}" if same else ""
        return f"its program has no plan for +!{goal.sig.indicator}{others}"

    def _go_on_by_itself(self, why: str) -> None:
        self._end()
        self._over = (self._clock.wall(), why)
        log.warning("agent=%s goes on by itself after the operator's pause: %s", self._mind.name, why)
        self._changed(f"resume by itself: {why}")

    def _end(self) -> None:
        self.paused = False
        for step in self._steps:
            if not step.done():
                step.set_result("the mind went on before this step was made")
        self._steps.clear()

    def _log(self, order: str) -> None:
        log.info("agent=%s operator=%s", self._mind.name, order if len(order) <= LOGGED else f"{order[:LOGGED]}...")
        self._changed(order)


def _literal(text: str) -> Literal:
    """Parse a goal or belief. Raises SyntaxErrors, and BadTerm for deeply nested brackets."""
    depth = 0
    for bracket in _BRACKETS.findall(text):
        depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(bracket, 0)
        if depth > DEEPEST:
            raise BadTerm(f"nested deeper than {DEEPEST}")
    literal = instantiate(parse_literal(text, "operator"))
    assert type(literal) is Literal
    return literal
