"""Running an intention: one formula of its innermost plan, and the end of plans that have no more."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agentd.language.terms.format import text
from agentd.mind.beliefs.unification import undo
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data.formula_failure import Failed, as_failed
from agentd.mind.data.frames import ANNOTS, ARGS, MARK, PLAN, RELEVANT, STEP, Frame, Step
from agentd.mind.data.intention import Intention
from agentd.mind.execution import failure, goal_states
from agentd.mind.introspection.failure_text import code_of

if TYPE_CHECKING:
    from agentd.mind.mind import Mind


def run_intention(mind: Mind, intention: Intention) -> None:
    """One formula of one intention."""
    frame = intention.stack[-1]
    step = frame[STEP]
    if step is not None:
        mind.steps_left = MOST_STEPS
        frame[STEP] = step.next
        intention.last = step
        mind.current = intention
        try:
            if step.run(mind, intention, frame):
                return
        except Exception as error:  # an internal action may raise anything; it must not end the mind
            _step_failed(mind, intention, step, frame, as_failed(error))
            return
    if intention.stack[-1][STEP] is None and not end_frames(mind, intention):
        return
    mind.running.append(intention)


def _step_failed(mind: Mind, intention: Intention, step: Step, frame: Frame, failed: Failed) -> None:
    if failed.error == "test_goal_failed" and not failed.args[0].startswith("Failed"):
        code = code_of(step, frame)
        failed = Failed("test_goal_failed", f"Failed to test '{text(code)}'", code=code)
    failure.step_failed(mind, intention, step, frame, failed)


def end_frames(mind: Mind, intention: Intention) -> bool:
    """Take away the plans that have ended; the ones below go on. Whether there is a formula to run now."""
    stack, has_meta = intention.stack, mind.plans.has_meta
    while stack:
        top = stack[-1]
        if top[STEP] is not None:
            return True
        if has_meta or top[PLAN].special:
            if not _leave(mind, intention, top):
                return False
        else:
            stack.pop()
        if len(intention.trail) > top[MARK]:
            intention.trim(top[MARK])
    if mind.atomic is intention:
        mind.gone(intention)
    return False


def _leave(mind: Mind, intention: Intention, frame: Frame) -> bool:
    """Take away a plan that needs more than that; False when its goal's condition does not hold yet, and it waits."""
    if frame[PLAN].condition is not None and not condition_holds(mind, intention, frame):
        mind.await_something(intention, "goal condition")
        return False
    intention.stack.pop()
    mind.left(intention, frame)
    goal_states.ended(mind, frame[RELEVANT], frame[ARGS], frame[ANNOTS])
    return True


def condition_holds(mind: Mind, intention: Intention, frame: Frame) -> bool:
    """Whether the condition of the goal that a frame is for holds now."""
    mark, mind.steps_left = len(intention.trail), MOST_STEPS
    try:
        return bool(frame[PLAN].condition(mind, intention.trail, frame))
    except Exception as error:  # as in a context: what cannot be computed does not hold
        plan = frame[PLAN].syntax
        mind.warn_once(f"{plan.position}: the condition of the goal cannot be computed: {as_failed(error)}")
        return False
    finally:
        undo(intention.trail, mark)
