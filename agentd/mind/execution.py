"""Running an intention: one formula of its innermost plan, and the end of plans that have no more."""

from __future__ import annotations

from typing import Any

from agentd.language.term_text import text
from agentd.mind import failure
from agentd.mind.failed import Failed, as_failed
from agentd.mind.failure_facts import code_of
from agentd.mind.frames import ANNOTS, ARGS, MARK, PLAN, RELEVANT, STEP, Frame
from agentd.mind.goal_states import raise_state
from agentd.mind.intentions import Intention
from agentd.mind.unifier import undo


def run_intention(mind: Any, intention: Intention) -> None:
    """One formula of one intention."""
    frame = intention.stack[-1]
    step = frame[STEP]
    if step is not None:
        frame[STEP] = step.next
        intention.last = step
        mind.current = intention
        try:
            if step.run(mind, intention, frame):
                return
        except Exception as error:  # an internal action may raise anything; it must not end the mind
            _step_failed(mind, intention, step, frame, as_failed(error))
            return
    if intention.stack[-1][STEP] is None:
        end_frames(mind, intention)
        if not intention.stack or intention.waiting is not None:
            return
    mind.running.append(intention)


def _step_failed(mind: Any, intention: Intention, step: Any, frame: Frame, failed: Failed) -> None:
    if failed.error == "test_goal_failed" and not failed.args[0].startswith("Failed"):
        code = code_of(step, frame)
        failed = Failed("test_goal_failed", f"Failed to test '{text(code)}'", code=code)
    failure.step_failed(mind, intention, step, frame, failed)


def end_frames(mind: Any, intention: Intention) -> None:
    """Take away the plans that have ended; the ones below go on."""
    stack, trail, has_meta = intention.stack, intention.trail, mind.plans.has_meta
    while stack:
        top = stack[-1]
        if top[STEP] is not None:
            return
        if has_meta or top[PLAN].special:
            if top[PLAN].condition is not None and not condition_holds(mind, intention, top):
                mind.await_something(intention, "goal condition")
                return
            stack.pop()
            mind.left(intention, top)
            if has_meta and top[RELEVANT].operator == "+" and top[RELEVANT].goal:
                raise_state(mind, top[RELEVANT], top[ARGS], top[ANNOTS], "achieved")
                raise_state(mind, top[RELEVANT], top[ARGS], top[ANNOTS], "finished")
        else:
            stack.pop()
        if trail and len(trail) > top[MARK]:
            intention.trim(top[MARK])
    mind.gone(intention)


def condition_holds(mind: Any, intention: Intention, frame: Frame) -> bool:
    """Whether the condition of the goal that a frame is for holds now."""
    mark = len(intention.trail)
    try:
        return bool(frame[PLAN].condition(mind, intention.trail, frame))
    except Exception as error:  # as in a context: what cannot be computed does not hold
        plan = frame[PLAN].syntax
        mind.warn_once(f"{plan.position}: the condition of the goal cannot be computed: {as_failed(error)}")
        return False
    finally:
        undo(intention.trail, mark)
