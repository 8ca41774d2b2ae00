"""Run an intention: one formula of its innermost plan, the end of plans, waiting, failure (rules 83 to 93)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from agentd.language.terms.format import text
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.terms import Literal, Term
from agentd.mind.beliefs.term_copy import detach, resolve_all
from agentd.mind.beliefs.unification import undo
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data.effects import Log, Print
from agentd.mind.data.formula_failure import Failed, as_failed
from agentd.mind.data.intention import ANNOTS, ARGS, MARK, PLAN, RELEVANT, STEP, Event, Frame, Intention, Step
from agentd.mind.execution import goal_states
from agentd.mind.introspection.decision_log import MOST_FRAMES
from agentd.mind.introspection.failure_report import failure_report, rejected_plans
from agentd.mind.introspection.failure_text import (
    as_they_are,
    brief,
    code_of,
    error_annots,
    goal_text,
    without_facts,
    written,
)
from agentd.mind.plans.nested_plans import nested_plans
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.state import MindState
from schemas.wire.mind_records import WaitView

MOST_RETRIES: Final = 100
"""So often an intention's failure plan that fails itself is tried again before the intention ends."""
_MOST_GOALS: Final = 5
"""Goals named in the report of a failure that ends them."""
_MOST_NOTED: Final = 1000


def end_frames(mind: MindState, intention: Intention) -> bool:
    """Remove the plans that have ended. Return whether there is a formula to run now."""
    stack, trail, has_meta = intention.stack, intention.trail, mind.plans.has_meta
    while stack:
        top = stack[-1]
        if top[STEP] is not None:
            return True
        if has_meta or top[PLAN].special:
            if not _leave(mind, intention, top):
                return False
        else:
            stack.pop()
        if trail and len(trail) > top[MARK]:
            intention.trim(top[MARK])
    if mind.atomic is intention:
        mind.atomic = None
    return False


def _leave(mind: MindState, intention: Intention, frame: Frame) -> bool:
    """Take away a plan that needs more than that; False when its goal's condition does not hold yet, and it waits."""
    if frame[PLAN].condition is not None and not condition_holds(mind, intention, frame):
        await_something(mind, intention, WaitView(kind="goal_condition"))
        return False
    intention.stack.pop()
    mind.left(intention, frame)
    goal_states.ended(mind, frame[RELEVANT], frame[ARGS], frame[ANNOTS])
    return True


def condition_holds(mind: MindState, intention: Intention, frame: Frame) -> bool:
    """Return whether the condition of the goal that a frame is for holds now."""
    mark, mind.steps_left = len(intention.trail), MOST_STEPS
    try:
        return bool(frame[PLAN].condition(mind, intention.trail, frame))
    except Exception as error:  # as in a context: a condition that cannot be computed does not hold
        plan = frame[PLAN].syntax
        mind.warn_once(f"{plan.position}: the condition of the goal cannot be computed: {as_failed(error)}")
        return False
    finally:
        undo(intention.trail, mark)


# --- waiting ---


def await_something(mind: MindState, intention: Intention, awaited: WaitView, token: Any = None) -> None:
    """Suspend an intention until `resume_waiting` or `fail_waiting`.

    ``token`` is what `dropping.drop` must cancel.
    """
    intention.waiting, intention.since = awaited, mind.now
    mind.waiting[intention.id] = (intention, token)
    if mind.plans.has_meta:
        goal_states.of_goals(mind, intention, "waiting", goal_states.reason_of(intention))


def resume_waiting(mind: MindState, intention: Intention) -> None:
    """Resume an intention whose wait is over, unless it is suspended."""
    mind.waiting.pop(intention.id, None)
    waited, intention.waiting = intention.waiting, None
    intention.action = None
    if intention.suspended is not None:
        mind.suspended[intention.id] = intention
        return
    if waited is not None and mind.plans.has_meta:
        goal_states.of_goals(mind, intention, "executing")
    if end_frames(mind, intention):
        mind.running.append(intention)


def fail_waiting(mind: MindState, intention: Intention, failed: Failed) -> None:
    """Fail the formula that an intention waits in."""
    mind.waiting.pop(intention.id, None)
    intention.waiting = None
    intention.action = None
    frame = intention.stack[-1]
    assert intention.last is not None
    step_failed(mind, intention, intention.last, frame, failed)


def fail_parent(mind: MindState, intention: Intention, extra: tuple[Term, ...], where: str, failed: Failed) -> None:
    """Fail an intention of which a branch of a fork has failed."""
    mind.waiting.pop(intention.id, None)
    intention.waiting = None
    fail(mind, intention, extra, where, failed)


# --- failure ---


def formula_failed(mind: MindState, intention: Intention, step: Step, frame: Frame, error: Exception) -> None:
    """Fail a formula whose function has raised an error."""
    failed = as_failed(error)
    if failed.error == "test_goal_failed" and not failed.message:
        code = code_of(step, frame)
        failed = Failed("test_goal_failed", f"Failed to test '{text(code)}'", code=code)
    step_failed(mind, intention, step, frame, failed)


def step_failed(mind: MindState, intention: Intention, step: Step, frame: Frame, failure: Failed) -> None:
    """Fail the intention's innermost plan, of which a formula has failed."""
    code = failure.code if failure.code is not None else code_of(step, frame)
    failure.step, failure.code = step, code
    position = step.syntax.position
    annots = error_annots(failure, code, position.line, position.file)
    where = f"{position}: {brief(written(step, code))}"
    fail(mind, intention, annots, where, failure)


def goal_failed(mind: MindState, event: Event) -> None:
    """Fail a goal whose event found no plan. Its own ``-!g`` is asked first, then those of the goals below."""
    relevant, args, annots, intention = event
    literal = Literal(relevant.sig, as_they_are(args), as_they_are(annots))
    error, kind = ("no_applicable", "applicable") if relevant.plans else ("no_relevant", "relevant")
    message = f"Found a goal for which there is no {kind} plan: {relevant.text}{text(literal)}"
    failure = Failed(error, message, code=literal)
    handled = _handles(mind, relevant.counterpart("-"), intention)
    if not (handled or (intention is not None and _has_handler(intention))):
        failure.tried = rejected_plans(mind, event)
    fail_event(mind, event, failure)


def fail_event(mind: MindState, event: Event, failure: Failed) -> None:
    """Fail a goal before it has a plan; ``failure.code`` is the goal."""
    relevant, args, annots, intention = event
    line, source, where = 0, "", f"{relevant.text}{text(failure.code)}"
    failure.goal = relevant
    if intention is not None and intention.stack:
        if intention.last is not None:
            position = intention.last.syntax.position
            line, source = position.line, position.file
        where = f"{source}:{line}: {where}"
        failure.step = intention.last
    extra = error_annots(failure, failure.code, line, source)
    handler = relevant.counterpart("-")
    if _handles(mind, handler, intention):
        if mind.plans.has_meta:
            goal_states.failed(mind, intention, failure, handled=True)
        facts = sorted_annots(tuple(annots) + extra)
        if relevant.goal == "?" and intention is not None:
            mind.events.append((handler, detach(args), resolve_all(facts), None))
            _end_unanswered(mind, intention, extra, where, failure)
        else:
            mind.events.append((handler, args, facts, intention))
    elif intention is not None:
        fail(mind, intention, extra, where, failure)
    else:
        if mind.plans.has_meta:
            goal_states.failed(mind, None, failure, handled=False)
        _note(mind, None, failure, (), None)
        mind.effects.append(failure_report(mind, failure, (), (), ""))


def _handles(mind: MindState, handler: Any, intention: Intention | None) -> bool:
    """Return whether there are failure plans for a goal, be it in the plan that called it (the innermost one now)."""
    if handler.plans or not mind.plans.has_nested:
        return bool(handler.plans)
    return any(True for _ in nested_plans(mind, handler, intention))


def _note(
    mind: MindState, intention: Intention | None, failure: Failed, frames: Sequence[Frame], handler: Relevant | None
) -> None:
    """Remember a failure, in minds that do."""
    if mind.recorder is not None:
        mind.recorder.failed(intention, failure, frames, handler)


def _end_unanswered(
    mind: MindState, intention: Intention, extra: tuple[Term, ...], where: str, failure: Failed
) -> None:
    """End a test for which no ``+?g`` is applicable: ``-?g`` runs, but the intention that asked ends (rule 61)."""
    text = f"{where}: {failure.error}: {failure}; -? runs for it, the intention that asked ends"
    mind.effects.append(Log("error", text, ends=True))
    intention.stack.clear()
    mind.gone(intention)
    if intention.branch is not None:
        intention.branch.failed(mind, intention, extra, where, failure)


def fail(mind: MindState, intention: Intention, extra: tuple[Term, ...], where: str, failure: Failed) -> None:
    """Look for the handler from the innermost goal down; without one the intention is dropped with a warning."""
    stack = intention.stack
    depth = len(stack)
    frames = stack[: -1 - MOST_FRAMES : -1]
    if mind.plans.has_meta:
        goal_states.failed(mind, intention, failure, _has_handler(intention))
    goals = [] if _has_handler(intention) else [goal_text(frame) for frame in frames[:_MOST_GOALS]]
    because = ""
    while stack:
        top = stack.pop()
        undo(intention.trail, top[MARK])
        if top[PLAN].special:
            mind.left(intention, top)
        if not stack and intention.branch is not None:
            break  # the plan around a branch belongs to its parent, which fails in its turn
        if top[PLAN].on_failure is not None:
            top[PLAN].on_failure(mind, failure)
            break
        relevant = top[RELEVANT]
        if relevant.operator == "-":
            if not relevant.goal:
                because = "the plan of a deletion asks no handler"  # rule 92
                break
            if not stack and relevant.plans:
                if _handled_again(mind, intention, top, extra):
                    _note(mind, intention, failure, frames[:depth], relevant)
                    return
                because = f"its failure plan has failed {MOST_RETRIES} times"
        elif relevant.operator == "+" and relevant.goal:
            handler = relevant.counterpart("-")
            if _handles(mind, handler, intention):
                annots = sorted_annots((*top[ANNOTS], *extra))
                mind.events.append((handler, top[ARGS], annots, intention))
                _note(mind, intention, failure, frames[: depth - len(stack)], handler)
                return
            if relevant is mind.plans.kqml:
                communication_error(mind, failure.error, str(failure))
                resume_waiting(mind, intention)
                return
    mind.gone(intention)
    _note(mind, intention, failure, frames, None)
    if intention.branch is not None:
        intention.branch.failed(mind, intention, extra, where, failure)
        return
    mind.effects.append(failure_report(mind, failure, goals, frames, because))


def _has_handler(intention: Intention) -> bool:
    """Return whether a goal of an intention has failure plans: then no texts for the log are needed."""
    return any(
        f[RELEVANT].operator == "+" and f[RELEVANT].goal and f[RELEVANT].counterpart("-").plans
        for f in reversed(intention.stack)
    )


def _handled_again(mind: MindState, intention: Intention, handler: Frame, extra: tuple[Term, ...]) -> bool:
    """Raise the event of a failure plan again that has failed itself and has no goal below it.

    Jason repeats this for ever; here it ends after `MOST_RETRIES`.
    """
    relevant = handler[RELEVANT]
    tries = mind.failed_handlers.get(intention.id, 0) + 1
    if tries == 1:
        mind.warn_once(f"{handler[PLAN].head} at {handler[PLAN].syntax.position} has failed itself; it is tried again")
    elif tries > MOST_RETRIES:
        del mind.failed_handlers[intention.id]
        return False
    if len(mind.failed_handlers) >= _MOST_NOTED:
        mind.failed_handlers.clear()
    mind.failed_handlers[intention.id] = tries
    annots = sorted_annots((*without_facts(handler[ANNOTS]), *extra))
    mind.events.append((relevant, handler[ARGS], annots, intention))
    return True


def communication_error(mind: MindState, error: str, message: str) -> None:
    """Print the line that Jason prints when the handling of a message fails."""
    mind.effects.append(Print(f"Communication error -- {error}: {message}"))
