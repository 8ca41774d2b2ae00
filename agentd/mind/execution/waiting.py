"""Wait for a time, a formula or an event: ``.wait`` in its three forms."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.terms.terms import Code, Literal, Var, deref
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data.code_terms import trigger_literal
from agentd.mind.data.formula_failure import Failed, as_failed, wrong_arguments
from agentd.mind.data.intention import Awaited, Frame, Intention, Wait
from agentd.mind.execution.execution import await_something, fail_waiting, resume_waiting
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.state import MindState


def milliseconds(term: Any) -> float:
    """A time in milliseconds as a term, in seconds."""
    term = deref(term)
    if type(term) is not float:
        wrong_arguments("a time is a number of milliseconds")
    return max(0.0, term / 1000.0)


def wait_time(mind: MindState, intention: Intention, seconds: float) -> bool:
    """Wait for a time, then go on."""

    def over() -> None:
        resume_waiting(mind, intention)

    timer = mind.timers.at(mind.now + seconds, over)
    await_something(mind, intention, Awaited("time", seconds=seconds), timer)
    return True


def wait_until(
    mind: MindState, intention: Intention, frame: Frame, check: Any, limit: Any = None, elapsed: Any = None
) -> bool | None:
    """Wait until a formula has a solution; ``limit`` in ms. Past it, fail, or go on if ``elapsed`` is asked for."""
    seconds = None if limit is None else milliseconds(limit)
    mark = len(intention.trail)
    if check(mind, intention, frame):
        if elapsed is not None:
            _tell_elapsed(intention, elapsed, 0.0)
        return None
    undo(intention.trail, mark)
    wait = Wait(intention, frame, mind.now)
    wait.check, wait.elapsed = check, elapsed
    mind.conditions.append(wait)
    _start(mind, wait, seconds, Awaited("formula"))
    return True


def wait_event(mind: MindState, intention: Intention, trigger: Code, limit: Any = None, elapsed: Any = None) -> bool:
    """Wait until an event unifies with a trigger."""
    seconds = None if limit is None else milliseconds(limit)
    node = trigger.syntax
    if not isinstance(node, nodes.Trigger):
        wrong_arguments(".wait takes a time, a formula or an event in braces")
    wait = Wait(intention, None, mind.now)
    wait.pattern = (node.operator, node.goal, trigger_literal(trigger))
    wait.elapsed = elapsed
    mind.listeners.append(wait)
    _start(mind, wait, seconds, Awaited("event"))
    return True


def _start(mind: MindState, wait: Wait, seconds: float | None, awaited: Awaited) -> None:
    mind.timers.looks += 1  # at the time since when it waits
    if seconds is not None:
        wait.timer = mind.timers.at(mind.now + seconds, lambda: timed_out(mind, wait))
    await_something(mind, wait.intention, awaited, wait)


def forget(mind: MindState, wait: Wait) -> None:
    """Take a wait off all lists."""
    if wait.timer is not None:
        wait.timer.cancelled = True
    if wait in mind.conditions:
        mind.conditions.remove(wait)
    if wait in mind.listeners:
        mind.listeners.remove(wait)


def timed_out(mind: MindState, wait: Wait) -> None:
    forget(mind, wait)
    intention = wait.intention
    if wait.elapsed is not None:
        ended(mind, wait)
        return
    fail_waiting(mind, intention, Failed("wait_timeout", "timeout in .wait"))


def ended(mind: MindState, wait: Wait) -> None:
    """What was waited for has come (or the time is over and the program asked how long it was)."""
    forget(mind, wait)
    if wait.elapsed is not None:
        mind.timers.looks += 1
        _tell_elapsed(wait.intention, wait.elapsed, (mind.now - wait.since) * 1000.0)
    resume_waiting(mind, wait.intention)


def _tell_elapsed(intention: Intention, elapsed: Any, value: float) -> None:
    """Give the third argument of a wait the time that it took, in ms."""
    target = deref(elapsed)
    if type(target) is Var:
        unify(target, float(int(value)), intention.trail)


def check_conditions(mind: MindState) -> None:
    """Ask again every formula that is waited for, after beliefs have changed."""
    for wait in list(mind.conditions):
        if wait not in mind.conditions or wait.check is None:
            continue
        trail = wait.intention.trail
        mark = len(trail)
        mind.steps_left = MOST_STEPS
        try:
            holds = wait.check(mind, wait.intention, wait.frame)
        except Exception as error:  # as in a step: the formula fails, the mind goes on
            undo(trail, mark)
            forget(mind, wait)
            fail_waiting(mind, wait.intention, as_failed(error))
            continue
        if holds:
            ended(mind, wait)
        else:
            undo(trail, mark)


def hear(mind: MindState, relevant: Relevant, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
    """Tell those who wait for an event."""
    for wait in list(mind.listeners):
        assert wait.pattern is not None
        operator, goal, literal = wait.pattern
        if operator != relevant.operator or goal != relevant.goal:
            continue
        trail = wait.intention.trail
        mark = len(trail)
        if unify(literal, Literal(relevant.sig, args, annots), trail):
            ended(mind, wait)
        else:
            undo(trail, mark)
