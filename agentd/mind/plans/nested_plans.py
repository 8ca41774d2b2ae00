"""Find the plan for an event: in order, with plans nested in ``{ }`` (rule 95), for contexts that ask for intentions.

A context that asks for its intention gets that of the event in hand, which is noted in such programs alone.
"""

from __future__ import annotations

from collections.abc import Iterator

from agentd.mind.beliefs.unification import Trail, undo
from agentd.mind.data.intention import PLAN, Event, Frame, Intention
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState


def select(mind: MindState, trail: Trail, event: Event) -> Frame | None:
    """Return the frame of the first applicable plan, with its bindings on the trail; nested plans come first.

    The contexts know the event as the one in hand.
    """
    relevant, args, annots, intention = event
    mind.plans.taken, mark = event, len(trail)
    try:
        for plan, around in candidates(mind, relevant, intention):
            frame: Frame | None = plan.select(mind, trail, relevant, args, annots, around)
            if frame is not None:
                return frame
            undo(trail, mark)
    finally:
        mind.plans.taken = None
    return None


def nested_plans(mind: MindState, relevant: Relevant, intention: Intention | None) -> Iterator[tuple[Plan, Frame]]:
    """Yield the nested plans that are in sight of an event, each with the frame of the plan around it.

    A goal sees the plans nested in the plan that called it, and those around that plan. A belief event of its own sees
    those of every goal that is active.
    """
    if intention is not None:
        if intention.stack:
            yield from _of_frame(mind, relevant, intention.stack[-1], intention)
    elif not relevant.goal:
        for other in mind.all_intentions():
            for frame in reversed(other.stack):
                yield from _of_frame(mind, relevant, frame, None)


def candidates(mind: MindState, relevant: Relevant, intention: Intention | None) -> Iterator[tuple[Plan, Frame | None]]:
    """Yield the plans that are relevant for an event as they are tried, nested ones with their outer frame."""
    if mind.plans.has_nested:
        yield from nested_plans(mind, relevant, intention)
    for plan in relevant.plans:
        yield plan, None


def _of_frame(
    mind: MindState, relevant: Relevant, frame: Frame, intention: Intention | None
) -> Iterator[tuple[Plan, Frame]]:
    plan, around = frame[PLAN], frame
    while plan is not None:
        for inner in plan.subplans:
            if mind.plans.answers(inner, relevant):
                yield inner, around
        plan = plan.outer
        if plan is None or intention is None:
            return
        enclosing = next((f for f in reversed(intention.stack) if f[PLAN] is plan), None)
        if enclosing is None:
            return
        around = enclosing


def intention_in_hand(mind: MindState) -> Intention | None:
    """Return the intention that is running, or whose event is being given a plan."""
    taken = mind.plans.taken
    return mind.current if taken is None else taken[3]
