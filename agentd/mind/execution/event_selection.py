"""Selecting the plan for an event: the first that is relevant and applicable becomes a frame of an intention."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.terms import Literal, Term
from agentd.mind.beliefs.term_copy import resolve_all
from agentd.mind.beliefs.unification import undo
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import MARK, PLAN, STEP, Event, Frame, Intention
from agentd.mind.execution import goal_states
from agentd.mind.execution.dropping import watch
from agentd.mind.execution.execution import condition_holds, end_frames, goal_failed, resume_waiting
from agentd.mind.execution.messages import failed_event, handle_event
from agentd.mind.introspection.failure_report import unhandled_report
from agentd.mind.introspection.failure_text import context_failed, facts_of
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState


def of_the_others(mind: MindState, trail: list[Any], event: Event, failed: Plan) -> Frame | None:
    """The frame of the first applicable plan after one whose context could not be computed."""
    relevant, args, annots, _ = event
    mark = len(trail)
    for plan in relevant.plans[relevant.plans.index(failed) + 1 :]:
        try:
            frame: Frame | None = plan.select(mind, trail, relevant, args, annots)
        except Exception as error:
            context_failed(mind, relevant, plan, error)
            frame = None
        if frame is not None:
            return frame
        undo(trail, mark)
    return None


def take_place(intention: Intention, frame: Frame) -> None:
    """Put a frame in the place of the one that called it last, and forget the bindings that only that one undoes."""
    caller = intention.stack.pop()
    intention.trim(caller[MARK])
    frame[MARK] = min(frame[MARK], len(intention.trail))
    intention.stack.append(frame)


def begin_special(mind: MindState, intention: Intention, frame: Frame) -> None:
    """A plan that needs more than a frame is about to begin."""
    plan: Plan = frame[PLAN]
    if mind.plans.has_meta:
        goal_states.begun(mind, frame)
    if plan.atomic:
        mind.atomic = intention
    if plan.condition is not None:
        if condition_holds(mind, intention, frame):
            frame[STEP] = None
            end_frames(mind, intention)
        else:
            watch(mind, intention, frame)


def no_plan(mind: MindState, event: Event) -> bool:
    """Handle an event without an applicable plan. False: nothing happened, the next event is to be taken."""
    relevant, args, annots, intention = event
    if not relevant.goal or relevant.operator == "^":
        if intention is None:
            return False
        resume_waiting(mind, intention)
        return True
    if relevant.sig is mind.plans.kqml.sig and relevant.goal == "!":
        return _built_in(mind, relevant, args, annots, intention)
    if relevant.operator == "+":
        goal_failed(mind, event)
        return True
    mind.effects.append(unhandled_report(mind, event))
    if intention is not None:
        mind.gone(intention)
        if intention.branch is not None:
            written = f"{relevant.text}{Literal(relevant.sig, resolve_all(args))}"
            reason = Failed("no_applicable", f"no applicable plan handles {written}")
            intention.branch.failed(mind, intention, annots, written, reason)
    return True


def _built_in(
    mind: MindState, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...], intention: Intention | None
) -> bool:
    """A message, or a failure to handle one, that no plan of the program is applicable to."""
    if relevant.operator == "+":
        handle_event(mind, args, intention)
        return True
    failed_event(mind, args, *facts_of(annots))
    if intention is not None:
        resume_waiting(mind, intention)
    return True
