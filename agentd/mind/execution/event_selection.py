"""Selecting the plan for an event: the first that is relevant and applicable becomes a frame of an intention."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import LargeLists, Literal, Term
from agentd.mind.beliefs.term_copy import resolve_all
from agentd.mind.beliefs.unification import undo
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import MARK, PLAN, RELEVANT, STEP, Event, Frame, Intention
from agentd.mind.execution import goal_states
from agentd.mind.execution.dropping import watch
from agentd.mind.execution.execution import condition_holds, end_frames, goal_failed, resume_waiting
from agentd.mind.execution.messages import failed_event, handle_event
from agentd.mind.execution.waiting import hear
from agentd.mind.introspection.failure_report import unhandled_report
from agentd.mind.introspection.failure_text import context_failed, facts_of
from agentd.mind.introspection.term_snapshot import held_all
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState


def take_event(mind: MindState, event: Event) -> bool:
    """Find the plan for an event and put it on its intention. False: nothing happened, take the next event."""
    relevant, args, annots, intention = event
    library, mind.steps_left = mind.plans, MOST_STEPS
    trail: list[Any] = [] if intention is None else intention.trail
    mark = len(trail) if trail else 0
    frame = plan = None
    if mind.listeners and relevant.goal:
        hear(mind, relevant, args, annots)
    try:
        if library.select is not None:
            frame = library.select(mind, trail, event)
        else:
            for plan in relevant.plans:
                frame = plan.select(mind, trail, relevant, args, annots)
                if frame is not None:
                    break
                if len(trail) > mark:
                    undo(trail, mark)
    except Exception as error:  # an internal action may raise anything; it must not end the mind
        context_failed(mind, relevant, plan, error)
        undo(trail, mark)
        frame = None if plan is None else _of_the_others(mind, trail, event, plan)
    if frame is None:
        return _no_plan(mind, relevant, args, annots, intention)
    if trail:
        frame[MARK] = mark
    if intention is None:
        intention = mind.new_intention()
        if trail:
            intention.trail = trail
    stack = intention.stack
    if stack and stack[-1][STEP] is None and stack[-1][RELEVANT].tail is relevant.call and not stack[-1][PLAN].special:
        if len(trail) > stack[-1][MARK]:
            _take_place(intention, frame)
        else:
            stack[-1] = frame
    else:
        stack.append(frame)
    if library.has_meta or frame[PLAN].special:
        _entered(mind, intention, frame)
        if not stack:
            return True
    if intention.suspended is None:
        mind.running.append(intention)
    else:
        mind.suspended[intention.id] = intention
    return True


def take_event_recorded(mind: MindState, event: Event) -> bool:
    """`take_event` for minds that record their decisions (`agentd.mind.introspection.decision_log`); the same from
    `_no_plan` on.

    It is a function of its own so that neither pays for the other: both are on the path of every event.
    """
    relevant, args, annots, intention = event
    library, recorder = mind.plans, mind.recorder
    mind.steps_left = MOST_STEPS
    assert recorder is not None
    if recorder.large_lists != LargeLists.made:
        recorder.let_go()
    trail: list[Any] = [] if intention is None else intention.trail
    mark = len(trail) if trail else 0
    frame = plan = rejected = None
    if mind.listeners and relevant.goal:
        hear(mind, relevant, args, annots)
    if library.select is not None:
        try:
            frame = library.select(mind, trail, event)
        except Exception as error:  # as below; the function notes what it decides
            context_failed(mind, relevant, None, error)
            undo(trail, mark)
    else:
        shown = args
        for term in args:
            if type(term) is not float and type(term) is not str and not (type(term) is Literal and term.ground):
                shown = held_all(args)
                break
        try:
            for plan in relevant.plans:
                found = plan.trace(mind, trail, relevant, args, annots)
                if type(found) is list:
                    frame = found
                    break
                if len(trail) > mark:
                    undo(trail, mark)
                if rejected is None:
                    rejected = [(plan, found)]
                else:
                    rejected.append((plan, found))
        except Exception as error:  # an internal action may raise anything; it must not end the mind
            undo(trail, mark)
            frame = recorder.select_after(trail, event, plan, rejected or [], error)
        else:
            if frame is None or shown is not args or len(trail) > mark:
                recorder.decided(event, shown, rejected, frame, len(trail) > mark)
            else:
                if annots is not SELF and not (len(annots) == 1 and type(annots[0]) is Literal and annots[0].ground):
                    annots = held_all(annots)
                if intention is not None:
                    stack = intention.stack
                    below = stack[-1] if stack else None
                    recorder.note((mind.cycle, mind.now, event, below, intention.last, rejected, frame, annots))
                else:
                    begun, origin = mind.intention_count + 1, recorder.origin_of(event)
                    recorder.note((mind.cycle, mind.now, event, None, None, rejected, frame, annots, begun, origin))
    if frame is None:
        return _no_plan(mind, relevant, args, annots, intention)
    if trail:
        frame[MARK] = mark
    if intention is None:
        intention = mind.new_intention()
        if trail:
            intention.trail = trail
    stack = intention.stack
    if stack and stack[-1][STEP] is None and stack[-1][RELEVANT].tail is relevant.call and not stack[-1][PLAN].special:
        if len(trail) > stack[-1][MARK]:
            _take_place(intention, frame)
        else:
            stack[-1] = frame
    else:
        stack.append(frame)
    if library.has_meta or frame[PLAN].special:
        _entered(mind, intention, frame)
        if not stack:
            return True
    if intention.suspended is None:
        mind.running.append(intention)
    else:
        mind.suspended[intention.id] = intention
    return True


def _of_the_others(mind: MindState, trail: list[Any], event: Event, failed: Plan) -> Frame | None:
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


def _take_place(intention: Intention, frame: Frame) -> None:
    """Put a frame in the place of the one that called it last, and forget the bindings that only that one undoes."""
    caller = intention.stack.pop()
    intention.trim(caller[MARK])
    frame[MARK] = min(frame[MARK], len(intention.trail))
    intention.stack.append(frame)


def _entered(mind: MindState, intention: Intention, frame: Frame) -> None:
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


def _no_plan(
    mind: MindState, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...], intention: Intention | None
) -> bool:
    """An event without an applicable plan."""
    if not relevant.goal or relevant.operator == "^":
        if intention is None:
            return False
        resume_waiting(mind, intention)
        return True
    if relevant.sig is mind.plans.kqml.sig and relevant.goal == "!":
        return _built_in(mind, relevant, args, annots, intention)
    if relevant.operator == "+":
        goal_failed(mind, (relevant, args, annots, intention))
        return True
    event = f"{relevant.text}{Literal(relevant.sig, resolve_all(args))}"
    mind.effects.append(unhandled_report(mind, (relevant, args, annots, intention)))
    if intention is not None:
        mind.gone(intention)
        if intention.branch is not None:
            reason = Failed("no_applicable", f"no applicable plan handles {event}")
            intention.branch.failed(mind, intention, annots, event, reason)
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
