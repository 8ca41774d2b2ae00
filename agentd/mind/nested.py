"""Plans nested in ``{ }``: which are in sight of an event (rule 95)."""

from __future__ import annotations

from typing import Any

from agentd.mind.frames import PLAN, Frame
from agentd.mind.intentions import Intention
from agentd.mind.unifier import undo


def nested_frame(
    mind: Any, trail: Any, relevant: Any, args: Any, annots: Any, intention: Intention | None
) -> Frame | None:
    """The frame of a nested plan for an event, if one is in sight and applicable.

    A goal sees the plans nested in the plan that called it, and those around that plan. A belief event of its own sees
    those of every goal that is active.
    """
    if intention is not None:
        if not intention.stack:
            return None
        return _of_frame(mind, trail, relevant, args, annots, intention.stack[-1], intention)
    if relevant.goal:
        return None
    for other in mind.all_intentions():
        for frame in reversed(other.stack):
            found = _of_frame(mind, trail, relevant, args, annots, frame, None)
            if found is not None:
                return found
    return None


def _of_frame(
    mind: Any, trail: Any, relevant: Any, args: Any, annots: Any, frame: Frame, intention: Intention | None
) -> Frame | None:
    plan, around = frame[PLAN], frame
    while plan is not None:
        for inner in plan.subplans:
            if not mind.plans.answers(inner, relevant):
                continue
            mark = len(trail)
            found: Frame | None = inner.select(mind, trail, relevant, args, annots, around)
            if found is not None:
                return found
            undo(trail, mark)
        plan = plan.outer
        if plan is None or intention is None:
            return None
        enclosing = next((f for f in reversed(intention.stack) if f[PLAN] is plan), None)
        if enclosing is None:
            return None
        around = enclosing
    return None
