"""Finding and ending intentions by their goals: ``.drop_intention``, ``.succeed_goal`` and relatives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language import syntax
from agentd.language.instantiate import instantiate
from agentd.language.syntax import Operator
from agentd.language.terms import Literal
from agentd.mind.effects import CancelAction
from agentd.mind.failed import Failed
from agentd.mind.failure import fail
from agentd.mind.failure_facts import error_annots
from agentd.mind.frames import ANNOTS, ARGS, MARK, PLAN, RELEVANT, STEP
from agentd.mind.goal_states import of_goals, raise_state
from agentd.mind.intention_terms import ahead
from agentd.mind.intentions import Intention, values_of
from agentd.mind.questions import Question
from agentd.mind.timers import Timer
from agentd.mind.unifier import Trail, undo, unify
from agentd.mind.waiting import Wait, forget

_ACHIEVING = (Operator.ACHIEVE, Operator.ACHIEVE_NEW_FOCUS)


def drop(mind: Any, intention: Intention) -> None:
    """End an intention without any event; its action is cancelled and its branches go with it."""
    _take_back(mind, intention)
    if mind.recorder is not None:
        mind.recorder.dropped(intention.stack)
    mind.gone(intention)
    intention.stack.clear()


def _take_back(mind: Any, intention: Intention) -> None:
    """Take an intention out of everything that it waits in; what it waits for is cancelled."""
    token: Any = mind.waiting.pop(intention.id, (None, None))[1]
    if isinstance(token, Wait):
        forget(mind, token)
    elif isinstance(token, Timer):
        token.cancelled = True
    elif hasattr(token, "branches"):
        for branch in list(token.branches):
            drop(mind, branch)
    elif isinstance(token, int):
        mind.requests.pop(token, None)
    elif isinstance(token, Question):
        token.forget(mind)
    if intention.action is not None:
        mind.performing.pop(intention.action, None)
        mind.effects.append(CancelAction(intention.action))
        intention.action = None
    if intention in mind.running:
        mind.running.remove(intention)
    mind.suspended.pop(intention.id, None)
    if any(e[3] is intention for e in mind.events):
        kept = [e for e in mind.events if e[3] is not intention]
        mind.events.clear()
        mind.events.extend(kept)
    intention.waiting = None


def goal_frames(intention: Intention) -> Iterator[tuple[int, Literal]]:
    """The goals that an intention has a plan for, innermost first, with their places in the stack.

    A failure plan stands for its goal: that is over only when the failure plan is.
    """
    for place in range(len(intention.stack) - 1, -1, -1):
        frame = intention.stack[place]
        relevant = frame[RELEVANT]
        if relevant.goal == "!" and relevant.operator != "^":
            yield place, Literal(relevant.sig, frame[ARGS], frame[ANNOTS])


def find_goal(intention: Intention, goal: Literal, trail: Trail) -> int | None:
    """Where in the stack a goal stands; its bindings are kept."""
    for place, literal in goal_frames(intention):
        mark = len(trail)
        if unify(goal, literal, trail):
            return place
        undo(trail, mark)
    return None


def intended(mind: Any, goal: Literal, trail: Trail, suspended: bool = False) -> Iterator[Intention]:
    """The intentions with a goal, bindings undone between them."""
    for intention in mind.all_intentions():
        if intention.suspended is not None and not suspended:
            continue
        mark = len(trail)
        for _, literal in goal_frames(intention):
            if unify(goal, literal, trail):
                yield intention
            undo(trail, mark)


def desired(mind: Any, goal: Literal, trail: Trail) -> Iterator[Intention | None]:
    """As `intended`, and goals whose event still waits (None when it is to start an intention)."""
    for relevant, args, annots, intention in list(mind.events):
        if relevant.goal != "!" or relevant.operator != "+":
            continue
        mark = len(trail)
        if unify(goal, Literal(relevant.sig, args, annots), trail):
            yield intention
        undo(trail, mark)
    yield from intended(mind, goal, trail, suspended=True)


def drop_intention(mind: Any, goal: Literal, trail: Trail) -> bool:
    """End every intention with this goal. True if the current one is among them."""
    own = False
    for intention in mind.all_intentions():
        mark = len(trail)
        if find_goal(intention, goal, trail) is not None:
            own |= intention is mind.current
            of_goals(mind, intention, "dropped", "finished")
            drop(mind, intention)
        undo(trail, mark)
    return own


def has_ahead(intention: Intention, goal: Literal, trail: Trail) -> bool:
    """Whether the innermost plan of an intention has ``!goal`` or ``!!goal`` still before it."""
    if not intention.stack:
        return False
    frame = intention.stack[-1]
    for step in ahead(frame[STEP]):
        node = step.syntax
        if isinstance(node, syntax.Step) and node.operator in _ACHIEVING:
            mark = len(trail)
            if unify(goal, instantiate(node.term, values_of(frame)), trail):
                return True
            undo(trail, mark)
    return False


def drop_event(mind: Any, goal: Literal, trail: Trail) -> bool:
    """Take goals out of the event queue, with the intentions that wait for them. True if the current one is."""
    own = False
    kept = []
    for event in list(mind.events):
        relevant, args, annots, intention = event
        mark = len(trail)
        fits = (
            relevant.goal == "!"
            and relevant.operator == "+"
            and unify(goal, Literal(relevant.sig, args, annots), trail)
        )
        undo(trail, mark)
        if not fits:
            kept.append(event)
        elif intention is not None:
            own |= intention is mind.current
            intention.stack.clear()
            mind.gone(intention)
    mind.events.clear()
    mind.events.extend(kept)
    return own


def drop_desire(mind: Any, goal: Literal, trail: Trail) -> bool:
    own = drop_event(mind, goal, trail)
    return drop_intention(mind, goal, trail) or own


def fail_too_deep(mind: Any, intention: Intention) -> None:
    """The innermost goal of an intention with too many plans fails."""
    stack = intention.stack
    _take_back(mind, intention)
    mind.gone(intention)
    failure = Failed("recursion_too_deep", f"{len(stack)} goals are open, one inside the other")
    step = intention.last
    place = stack[-1][PLAN].syntax.position if step is None else step.syntax.position
    code = Literal(stack[-1][RELEVANT].sig, stack[-1][ARGS])
    failure.step, failure.goal, failure.code = step, stack[-1][RELEVANT], code
    fail(mind, intention, error_annots(failure, code, place.line, place.file), str(place), failure)


def end_goal(mind: Any, intention: Intention, place: int, succeeded: bool) -> None:
    """A goal in the stack is over, achieved or failed: what stands above it goes, what it waited for is taken back."""
    stack, trail = intention.stack, intention.trail
    _take_back(mind, intention)
    mind.gone(intention)
    if mind.recorder is not None:
        mind.recorder.dropped(stack[place + 1 :])
    del stack[place + 1 :]
    frame = stack[place]
    if succeeded:
        if mind.plans.has_meta:
            for state in ("achieved", "finished"):
                raise_state(mind, frame[RELEVANT], frame[ARGS], frame[ANNOTS], state)
        stack.pop()
        while stack and stack[-1][0] is None:
            stack.pop()
        if stack:
            mind.running.append(intention)
        return
    literal = Literal(frame[RELEVANT].sig, frame[ARGS], frame[ANNOTS])
    failure = Failed("goal_failed", "the goal was failed by .fail_goal", code=literal)
    failure.goal = frame[RELEVANT]
    fail(mind, intention, error_annots(failure, literal, 0, ""), f"{frame[PLAN].head}", failure)
    undo(trail, min(len(trail), frame[MARK]))
