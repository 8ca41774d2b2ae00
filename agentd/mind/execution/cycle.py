"""The reasoning cycle: inputs, due timers, conditions, one message, one event, one formula of one intention.

What each cycle does is written here in one function: a call of another one for each event and each formula would take a
tenth of a mind's time.
"""

from __future__ import annotations

from typing import Any

from agentd.language.terms.terms import Literal, Term
from agentd.mind.beliefs.term_copy import resolve_all
from agentd.mind.beliefs.unification import undo
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import MARK, PLAN, RELEVANT, STEP, Event, Frame, Intention
from agentd.mind.execution import goal_states
from agentd.mind.execution.dropping import check_goal_conditions, watch
from agentd.mind.execution.execution import condition_holds, end_frames, formula_failed, goal_failed, resume_waiting
from agentd.mind.execution.input_handling import take_inputs
from agentd.mind.execution.messages import failed_event, handle_event, receive
from agentd.mind.execution.waiting import check_conditions, hear
from agentd.mind.introspection.failure_report import unhandled_report
from agentd.mind.introspection.failure_text import context_failed, facts_of
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState


def run_cycles(mind: MindState, cycles: int) -> None:
    """Run at most ``cycles`` cycles; stop after the first that has an effect or leaves nothing to do."""
    inputs, mailbox, events, running, timers, conditions, goal_conditions = mind.queues
    effects, library, origins, turns = mind.effects, mind.plans, mind.origins, mind.turns
    atomic: Intention | None = None
    frame: Any  # None for an event that no plan is for
    cycle = mind.cycle
    last = cycle + cycles
    while cycle < last:
        cycle += 1
        mind.cycle = cycle
        if (
            inputs
            and take_inputs(mind)
            and not (events or running or mailbox or inputs or goal_conditions)
            and mind.atomic is None
            and not (timers and timers[0].due <= mind.now)
        ):  # percepts that no plan is for: as most cycles of an agent with a robot are
            if conditions and mind.changes != mind.changes_seen:
                mind.changes_seen = mind.changes
                check_conditions(mind)
            if not (running or events or effects):
                mind.still += 1
                return
        if timers and timers[0].due <= mind.now:
            mind.timers.run(mind.now)
        if (conditions or goal_conditions) and mind.changes != mind.changes_seen:
            mind.changes_seen = mind.changes
            check_conditions(mind)
            check_goal_conditions(mind)
        if mind.atomic is not atomic:
            atomic = mind.atomic
            turns = mind.turns if atomic is None else AtomicTurns(mind, atomic)
        if mailbox and (turns is None or turns.message()):
            mail = mailbox.popleft()
            if mind.on_input is not None:
                mind.on_input(mind.cycle, mail)
            if mind.recorder is not None:
                mind.recorder.given(mind.cycle, mail)
            receive(mind, mail)
            if atomic is not None and atomic.waiting is not None:
                if effects:
                    return
                continue
        while events and (turns is None or turns.event()):
            event = events.popleft()
            relevant, args, annots, intention = event
            mind.steps_left = MOST_STEPS
            if intention is None:
                trail: list[Any] = []
                mark = 0
            else:
                trail = intention.trail
                mark = len(trail)
            if mind.listeners and relevant.goal:
                hear(mind, relevant, args, annots)
            if origins is not None:
                origins.take(event)
            try:
                if library.select is not None:
                    plan = None
                    frame = library.select(mind, trail, event)
                else:
                    for plan in relevant.plans:
                        select = plan.select
                        frame = select(mind, trail, relevant, args, annots)
                        if frame is not None:
                            break
                        if len(trail) > mark:
                            undo(trail, mark)
                    else:
                        frame = None
            except Exception as error:  # an internal action may raise anything; it must not end the mind
                context_failed(mind, relevant, plan, error)
                undo(trail, mark)
                frame = None if plan is None else _of_the_others(mind, trail, event, plan)
            if frame is None:
                taken = _no_plan(mind, event)
                if origins is not None:
                    origins.taken(event)
                if taken:
                    intention = None
                    break
                continue
            if trail:
                frame[MARK] = mark
            if intention is None:
                mind.intention_count = number = mind.intention_count + 1
                stack = [frame]
                intention = Intention(number, stack, trail)
            else:
                stack = intention.stack
                if not stack:
                    stack.append(frame)
                else:
                    caller = stack[-1]
                    if caller[STEP] is not None or caller[RELEVANT].tail is not relevant.call or caller[PLAN].special:
                        stack.append(frame)
                    elif len(trail) > caller[MARK]:
                        _take_place(intention, frame)
                    else:
                        stack[-1] = frame
            if library.has_meta or frame[PLAN].special:
                _begin_special(mind, intention, frame)
            elif turns is None and intention.suspended is None:
                if origins is not None:
                    origins.taken(event)
                if running:
                    running.append(intention)
                    intention = running.popleft()
                    stack = intention.stack
                    frame = stack[-1]
                break  # its turn is now, or that of the one that has waited longest
            if origins is not None:
                origins.taken(event)
            if intention.suspended is not None:
                if stack:
                    mind.suspended[intention.id] = intention
            elif stack:
                running.append(intention)
            intention = None
            break
        else:
            intention = None
        if intention is None:
            if turns is None:
                if not running or mind.atomic is not None:
                    if effects or not (events or inputs or mailbox):
                        return
                    continue
            elif not turns.intention():
                if effects or turns.over():
                    return
                continue
            intention = running.popleft()
            stack = intention.stack
            frame = stack[-1]
        step = frame[STEP]
        if step is not None:
            mind.steps_left = MOST_STEPS
            frame[STEP] = step.next
            intention.last = step
            mind.current = intention
            run = step.run
            try:
                waits = run(mind, intention, frame)
            except Exception as error:  # an internal action may raise anything; it must not end the mind
                formula_failed(mind, intention, step, frame, error)
                waits = True
            if waits:
                if effects:
                    return
                continue
            frame = stack[-1]
        if frame[STEP] is None:  # the body has ended
            if library.has_meta or frame[PLAN].special or len(intention.trail) > frame[MARK]:
                if end_frames(mind, intention):
                    running.append(intention)
            else:
                stack.pop()
                if (stack and stack[-1][STEP] is not None) or end_frames(mind, intention):
                    running.append(intention)
        else:
            running.append(intention)
        if effects:
            return


class AtomicTurns:
    """The turns while an atomic plan runs: messages, and its own events and formulas alone."""

    def __init__(self, mind: MindState, atomic: Intention) -> None:
        self._mind, self._atomic = mind, atomic

    def message(self) -> bool:
        """Return whether a message may be taken; one whose event has no room waits for the plan's end."""
        return not self._mind.crowded

    def event(self) -> bool:
        """Move the plan's own event, if it waits for one, to the front."""
        atomic, events, running = self._atomic, self._mind.events, self._mind.running
        if running and running[-1] is atomic:
            return False
        for place in range(len(events) - 1, -1, -1):  # its own is the last one as a rule
            event = events[place]
            if event[3] is atomic:
                del events[place]
                events.appendleft(event)
                return True
        return False

    def intention(self) -> bool:
        """Move the plan's intention to the front, if it can run."""
        atomic, running = self._atomic, self._mind.running
        if running and running[-1] is atomic:  # as a rule
            running.pop()
        elif atomic in running:
            running.remove(atomic)
        else:
            return False
        running.appendleft(atomic)
        return True

    def over(self) -> bool:
        """Return whether the plan waits for something else than a message."""
        return self._mind.atomic is self._atomic and not self._mind.atomic_can_run


# --- the plan for an event ---


def _of_the_others(mind: MindState, trail: list[Any], event: Event, failed: Plan) -> Frame | None:
    """Return the frame of the first applicable plan after one whose context could not be computed."""
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


def _begin_special(mind: MindState, intention: Intention, frame: Frame) -> None:
    """Prepare to begin a plan that needs more than a frame."""
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


def _no_plan(mind: MindState, event: Event) -> bool:
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
    """Return a message, or a failure to handle one, that no plan of the program is applicable to."""
    if relevant.operator == "+":
        handle_event(mind, args, intention)
        return True
    failed_event(mind, args, *facts_of(annots))
    if intention is not None:
        resume_waiting(mind, intention)
    return True
