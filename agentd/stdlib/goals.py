"""Intentions and desires: asking for them, ending, suspending."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language.signatures import signature
from agentd.language.terms import Literal, deref
from agentd.mind import dropping
from agentd.mind.dropping import drop
from agentd.mind.failed import wrong_arguments
from agentd.mind.frames import PLAN
from agentd.mind.goal_states import of_goals
from agentd.mind.intention_terms import reason_of, stack_of, state_of
from agentd.mind.taken import intention_in_hand
from agentd.mind.unifier import Trail, undo, unify
from agentd.mind.waiting import resume_waiting
from agentd.stdlib.registry import internal_action

_INTENTION = signature("intention", 2)


def _goal(term: Any) -> Literal:
    term = deref(term)
    if type(term) is not Literal:
        wrong_arguments("a goal is needed")
    return term


def _each(found: Iterator[Any], number: Any, trail: Trail) -> Iterator[None]:
    for intention in found:
        if number is None:
            yield None
            continue
        mark = len(trail)
        if intention is not None and unify(number, float(intention.id), trail):
            yield None
        undo(trail, mark)


@internal_action(".desire", (1, 2), backtracks=True)
def desire(mind: Any, trail: Trail, goal: Any, number: Any = None) -> Iterator[None]:
    """``.desire(G[, Id])``: G is pursued, or its event still waits; each time, with the number of its intention."""
    yield from _each(dropping.desired(mind, _goal(goal), trail), number, trail)


@internal_action(".intend", (1, 2), backtracks=True)
def intend(mind: Any, trail: Trail, goal: Any, number: Any = None) -> Iterator[None]:
    """``.intend(G[, Id])``: some intention has a plan for G; each of them, with its number."""
    yield from _each(dropping.intended(mind, _goal(goal), trail), number, trail)


def _own_end(mind: Any, own: bool) -> bool | None:
    """What a step returns that may have dropped its own intention."""
    return True if own else None


@internal_action(".drop_intention", (0, 1), suspends=True)
def drop_intention(mind: Any, trail: Trail, goal: Any = None) -> bool | None:
    """``.drop_intention(G)``: ends every intention with G, without any event; its action is cancelled.

    ``.drop_intention``: the own one.
    """
    if goal is None:
        of_goals(mind, mind.current, "dropped", "finished")
        drop(mind, mind.current)
        return True
    return _own_end(mind, dropping.drop_intention(mind, _goal(goal), trail))


@internal_action(".drop_desire", 1, suspends=True)
def drop_desire(mind: Any, trail: Trail, goal: Any) -> bool | None:
    """``.drop_desire(G)``: ``.drop_event`` and ``.drop_intention``."""
    return _own_end(mind, dropping.drop_desire(mind, _goal(goal), trail))


@internal_action(".drop_event", 1, suspends=True)
def drop_event(mind: Any, trail: Trail, goal: Any) -> bool | None:
    """``.drop_event(G)``: takes G out of the events that wait, with the intentions that wait for it."""
    return _own_end(mind, dropping.drop_event(mind, _goal(goal), trail))


@internal_action(".drop_all_intentions", 0)
def drop_all_intentions(mind: Any, trail: Trail) -> bool:
    """``.drop_all_intentions``: all but the own one, and those whose event still waits."""
    for intention in mind.all_intentions():
        if intention is not mind.current and not any(e[3] is intention for e in mind.events):
            drop(mind, intention)
    return True


@internal_action(".drop_all_events", 0)
def drop_all_events(mind: Any, trail: Trail) -> bool:
    """``.drop_all_events``: all that wait, also those of ``.at``."""
    mind.events.clear()
    for timer in mind.future_events:
        timer.cancelled = True
    mind.future_events.clear()
    return True


@internal_action(".drop_all_desires", 0)
def drop_all_desires(mind: Any, trail: Trail) -> bool:
    """``.drop_all_desires``: all events and all intentions but the own one."""
    drop_all_events(mind, trail)
    drop_all_intentions(mind, trail)
    return True


def _end(mind: Any, goal: Any, trail: Trail, succeeded: bool) -> bool | None:
    pattern = _goal(goal)
    own = False
    for intention in mind.all_intentions():
        mark = len(trail)
        place = dropping.find_goal(intention, pattern, trail)
        undo(trail, mark)
        if place is not None:
            own |= intention is mind.current
            dropping.end_goal(mind, intention, place, succeeded)
    return _own_end(mind, own)


@internal_action(".succeed_goal", 1, suspends=True)
def succeed_goal(mind: Any, trail: Trail, goal: Any) -> bool | None:
    """``.succeed_goal(G)``: G is over as achieved wherever it stands, and its callers go on."""
    return _end(mind, goal, trail, True)


@internal_action(".fail_goal", 1, suspends=True)
def fail_goal(mind: Any, trail: Trail, goal: Any) -> bool | None:
    """``.fail_goal(G)``: as if the plan for G had failed."""
    return _end(mind, goal, trail, False)


@internal_action(".drop_future_intention", 1, suspends=True)
def drop_future_intention(mind: Any, trail: Trail, goal: Any) -> bool | None:
    """``.drop_future_intention(G)``: intentions whose innermost plan still has ``!G`` or ``!!G`` ahead."""
    pattern, own = _goal(goal), False
    for intention in mind.all_intentions():
        mark = len(trail)
        if dropping.has_ahead(intention, pattern, trail):
            own |= intention is mind.current
            drop(mind, intention)
        undo(trail, mark)
    return _own_end(mind, own)


@internal_action(".current_intention", (1, 2))
def current_intention(mind: Any, trail: Trail, first: Any, stack: Any = None) -> bool:
    """``.current_intention(intention(Id, Stack))``, ``.current_intention(Id, Stack)``: the own one."""
    own = mind.current
    if own is None:
        return False
    number, means = float(own.id), stack_of(mind, own)
    if stack is None:
        return unify(first, Literal(_INTENTION, (number, means)), trail)
    return unify(first, number, trail) and unify(stack, means, trail)


@internal_action(".intention", (2, 4), backtracks=True)
def intention(mind: Any, trail: Trail, number: Any, state: Any, stack: Any = None, own: Any = None) -> Iterator[None]:
    """``.intention(Id, State[, Stack[, current]])``: each intention (or the own one), innermost plan first."""
    mark = len(trail)
    mine = [each for each in [intention_in_hand(mind)] if each is not None]
    for each in mine if own is not None else mind.all_intentions():
        fits = unify(number, float(each.id), trail) and unify(state, state_of(mind, each), trail)
        if fits and (stack is None or unify(stack, stack_of(mind, each), trail)):
            yield None
        undo(trail, mark)


@internal_action(".done", 0, suspends=True)
def done(mind: Any, trail: Trail) -> bool | None:
    """``.done``: the own goal is achieved; the rest of the body is not run."""
    mind.current.stack[-1][0] = None
    return None


@internal_action(".suspend", (0, 1), suspends=True)
def suspend(mind: Any, trail: Trail, goal: Any = None) -> bool | None:
    """``.suspend``, ``.suspend(G)``: the own intention, or those with G, stop until ``.resume``."""
    if goal is None:
        if mind.atomic is mind.current:
            mind.atomic = None  # or nobody could ever resume it
        mind.current.suspended = "suspended"
        of_goals(mind, mind.current, "suspended")
        mind.suspended[mind.current.id] = mind.current
        return True
    pattern, own = _goal(goal), False
    for intention in mind.all_intentions():
        if not _has_goal(mind, intention, pattern, trail) or intention.suspended is not None:
            continue
        intention.suspended = "suspended"
        of_goals(mind, intention, "suspended")
        own |= intention is mind.current
        if intention in mind.running:
            mind.running.remove(intention)
            mind.suspended[intention.id] = intention
        elif intention is mind.current:
            mind.suspended[intention.id] = intention
    return _own_end(mind, own)


def _has_goal(mind: Any, intention: Any, goal: Literal, trail: Trail) -> bool:
    """Whether an intention has a plan for a goal, or waits for one; nothing is bound."""
    mark = len(trail)
    found = dropping.find_goal(intention, goal, trail) is not None or any(
        waiting is intention and relevant.goal == "!" and unify(goal, Literal(relevant.sig, args, annots), trail)
        for relevant, args, annots, waiting in mind.events
    )
    undo(trail, mark)
    return found


@internal_action(".resume", 1)
def resume(mind: Any, trail: Trail, goal: Any) -> bool:
    """``.resume(G)``: suspended intentions with G go on; a wait that ended meanwhile counts as ended."""
    pattern = _goal(goal)
    for intention in mind.all_intentions():
        if intention.suspended is not None and _has_goal(mind, intention, pattern, trail):
            intention.suspended = None
            if mind.atomic is None and any(frame[PLAN].atomic for frame in intention.stack):
                mind.atomic = intention
            of_goals(mind, intention, "resumed")
            if mind.suspended.pop(intention.id, None) is not None:
                resume_waiting(mind, intention)
    return True


@internal_action(".suspended", 2, backtracks=True)
def suspended(mind: Any, trail: Trail, goal: Any, reason: Any) -> Iterator[None]:
    """``.suspended(G, R)``: the intentions with G that do not run, and why."""
    pattern = _goal(goal)
    mark = len(trail)
    for intention in mind.all_intentions():
        why = reason_of(mind, intention)
        if why is not None and dropping.find_goal(intention, pattern, trail) is not None and unify(reason, why, trail):
            yield None
        undo(trail, mark)
