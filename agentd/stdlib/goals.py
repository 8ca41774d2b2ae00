"""Intentions and desires: asking for them, ending, suspending."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, Term, Var, atom, deref
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.data.formula_failure import argument
from agentd.mind.data.intention import PLAN, STEP, Event, Intention
from agentd.mind.data.registry import internal_action
from agentd.mind.execution import dropping
from agentd.mind.execution.dropping import drop
from agentd.mind.execution.execution import resume_waiting
from agentd.mind.execution.goal_states import dropped, of_goals, reason_of
from agentd.mind.execution.intention_terms import stack_of, state_of
from agentd.mind.plans.nested_plans import intention_in_hand
from agentd.mind.state import MindState

_INTENTION = signature("intention", 2)
_SUSPENDED = atom("suspend_ia")


def _goal(term: Term) -> Literal:
    return argument(Literal, term, "a goal is needed")


def _any_goal(term: Term) -> Any:
    """A goal, or a free variable for each."""
    return term if type(deref(term)) is Var else _goal(term)


def _each(found: Iterator[Any], number: Term, trail: Trail) -> Iterator[None]:
    for intention in found:
        if number is None:
            yield None
            continue
        mark = len(trail)
        if intention is not None and unify(number, float(intention.id), trail):
            yield None
        undo(trail, mark)


@internal_action(".desire", (1, 2), backtracks=True, pure=True)
def desire(mind: MindState, trail: Trail, goal: Any, number: Any = None) -> Iterator[None]:
    """``.desire(G[, Id])``: G is pursued, or its event still waits; each time, with the number of its intention."""
    yield from _each(dropping.desired(mind, _any_goal(goal), trail), number, trail)


@internal_action(".intend", (1, 2), backtracks=True, pure=True)
def intend(mind: MindState, trail: Trail, goal: Any, number: Any = None) -> Iterator[None]:
    """``.intend(G[, Id])``: some intention has a plan for G; each of them, with its number."""
    yield from _each(dropping.intended(mind, _any_goal(goal), trail), number, trail)


@internal_action(".drop_intention", (0, 1), suspends=True)
def drop_intention(mind: MindState, trail: Trail, goal: Term | None = None) -> bool | None:
    """``.drop_intention(G)``: ends every intention with G, without any event; its action is cancelled.

    ``.drop_intention``: the own one.
    """
    if goal is None:
        dropped(mind, mind.own_intention)
        drop(mind, mind.own_intention)
        return True
    return dropping.drop_intention(mind, _goal(goal), trail) or None


@internal_action(".drop_desire", 1, suspends=True)
def drop_desire(mind: MindState, trail: Trail, goal: Term) -> bool | None:
    """``.drop_desire(G)``: ``.drop_event`` and ``.drop_intention``."""
    return dropping.drop_desire(mind, _goal(goal), trail) or None


@internal_action(".drop_event", 1, suspends=True)
def drop_event(mind: MindState, trail: Trail, goal: Term) -> bool | None:
    """``.drop_event(G)``: takes G out of the events that wait, with the intentions that wait for it."""
    return dropping.drop_event(mind, _goal(goal), trail) or None


@internal_action(".drop_all_intentions", 0)
def drop_all_intentions(mind: MindState, trail: Trail) -> bool:
    """``.drop_all_intentions``: all but the own one, and those whose event still waits."""
    for intention in mind.all_intentions():
        if intention is not mind.current and not any(e[3] is intention for e in mind.events):
            drop(mind, intention)
    return True


@internal_action(".drop_all_events", 0)
def drop_all_events(mind: MindState, trail: Trail) -> bool:
    """``.drop_all_events``: all that wait, also those of ``.at``."""
    dropping.take_out(mind, mind.all_events())
    for timer in mind.future_events:
        mind.timers.cancel(timer)
    mind.future_events.clear()
    return True


@internal_action(".drop_all_desires", 0)
def drop_all_desires(mind: MindState, trail: Trail) -> bool:
    """``.drop_all_desires``: all events and all intentions but the own one."""
    drop_all_events(mind, trail)
    drop_all_intentions(mind, trail)
    return True


def _end(mind: MindState, goal: Term, trail: Trail, succeeded: bool) -> bool | None:
    pattern = _goal(goal)
    own = False
    for intention in mind.all_intentions():
        mark = len(trail)
        place = dropping.find_goal(intention, pattern, trail)
        undo(trail, mark)
        if place is not None:
            own |= intention is mind.current
            dropping.end_goal(mind, intention, place, succeeded)
    for event in mind.all_events():
        if dropping.asked_for(pattern, event, trail):
            dropping.end_event(mind, event, succeeded)
    return own or None


@internal_action(".succeed_goal", 1, suspends=True)
def succeed_goal(mind: MindState, trail: Trail, goal: Term) -> bool | None:
    """``.succeed_goal(G)``: ends G as achieved in every intention; its callers continue."""
    return _end(mind, goal, trail, True)


@internal_action(".fail_goal", 1, suspends=True)
def fail_goal(mind: MindState, trail: Trail, goal: Term) -> bool | None:
    """``.fail_goal(G)``: as if the plan for G had failed."""
    return _end(mind, goal, trail, False)


@internal_action(".drop_future_intention", 1, suspends=True)
def drop_future_intention(mind: MindState, trail: Trail, goal: Term) -> bool | None:
    """``.drop_future_intention(G)``: intentions whose innermost plan still has ``!G`` or ``!!G`` ahead."""
    pattern, own = _goal(goal), False
    for intention in mind.all_intentions():
        mark = len(trail)
        if dropping.has_ahead(intention, pattern, trail):
            own |= intention is mind.current
            drop(mind, intention)
        undo(trail, mark)
    return own or None


@internal_action(".current_intention", (1, 2))
def current_intention(mind: MindState, trail: Trail, first: Term, stack: Term | None = None) -> bool:
    """``.current_intention(intention(Id, Stack))``, ``.current_intention(Id, Stack)``: the own one."""
    own = mind.current
    if own is None:
        return False
    number, means = float(own.id), stack_of(mind, own)
    if stack is None:
        return unify(first, Literal(_INTENTION, (number, means)), trail)
    return unify(first, number, trail) and unify(stack, means, trail)


@internal_action(".intention", (2, 4), backtracks=True, pure=True)
def intention(
    mind: MindState, trail: Trail, number: Term, state: Term, stack: Term | None = None, own: Term | None = None
) -> Iterator[None]:
    """``.intention(Id, State[, Stack[, current]])``: each intention (or the own one), innermost plan first."""
    mark = len(trail)
    mine = [each for each in [intention_in_hand(mind)] if each is not None]
    for each in mine if own is not None else mind.all_intentions():
        fits = unify(number, float(each.id), trail) and unify(state, state_of(mind, each), trail)
        if fits and (stack is None or unify(stack, stack_of(mind, each), trail)):
            yield None
        undo(trail, mark)


@internal_action(".done", 0, suspends=True)
def done(mind: MindState, trail: Trail) -> bool | None:
    """``.done``: the own goal is achieved; the rest of the body is not run."""
    mind.own_intention.stack[-1][STEP] = None
    return None


@internal_action(".suspend", (0, 1), suspends=True)
def suspend(mind: MindState, trail: Trail, goal: Term | None = None) -> bool | None:
    """``.suspend``, ``.suspend(G)``: the own intention, or those with G, stop until ``.resume``.

    A goal that has no plan yet begins at ``.resume``. A variable in G takes the value of the first goal found.
    """
    if goal is None:
        if mind.atomic is mind.current:
            mind.atomic = None  # otherwise no intention could resume it
        _halt(mind, mind.own_intention, None)
        return True
    pattern, own = _goal(goal), False
    queued = {event[3].id: event for event in mind.events if event[3] is not None}
    for intention in mind.all_intentions():
        event = queued.get(intention.id)
        if intention.suspended is None and dropping.pursues(intention, event, pattern, trail):
            _halt(mind, intention, event)
            own |= intention is mind.current
    for event in list(mind.events):  # the states of goals are events, too
        if event[3] is None and dropping.fits(pattern, dropping.goal_of(event), trail):
            _halt(mind, mind.new_intention(), event)
    held = {id(intention.held) for intention in mind.suspended.values()}
    dropping.keep_events(mind, [event for event in mind.events if id(event) not in held])
    return own or None


def _halt(mind: MindState, intention: Intention, event: Event | None) -> None:
    """Suspend an intention, with the event of the goal that it waits for or is to begin with."""
    intention.suspended, intention.held = "suspended", event
    of_goals(mind, intention, "suspended", _SUSPENDED)
    if intention in mind.running:
        mind.running.remove(intention)
    if intention.waiting is None:
        mind.suspended[intention.id] = intention


@internal_action(".resume", 1)
def resume(mind: MindState, trail: Trail, goal: Term) -> bool:
    """``.resume(G)``: suspended intentions with G go on; a wait that ended meanwhile counts as ended.

    A variable in G takes the value of the first goal found, so that goals of other values stay suspended.
    """
    pattern = _goal(goal)
    for intention in mind.all_intentions():
        if intention.suspended is not None and dropping.pursues(intention, intention.held, pattern, trail):
            _release(mind, intention)
    return True


def _release(mind: MindState, intention: Intention) -> None:
    """Let a suspended intention go on, or go on waiting."""
    of_goals(mind, intention, "resumed")
    event, intention.suspended, intention.held = intention.held, None, None
    if mind.atomic is None and any(frame[PLAN].atomic for frame in intention.stack):
        mind.atomic = intention
    of_goals(mind, intention, "executing")
    if mind.suspended.pop(intention.id, None) is None:
        of_goals(mind, intention, "waiting", reason_of(intention))
    elif event is not None:
        mind.events.append(event)
    else:
        resume_waiting(mind, intention)


@internal_action(".suspended", 2, backtracks=True, pure=True)
def suspended(mind: MindState, trail: Trail, goal: Term, reason: Term) -> Iterator[None]:
    """``.suspended(G, R)``: the intentions with G that do not run, and why.

    R is ``wait(What)``, ``waiting_ask``, ``act`` or the like for one that waits, even if it was suspended meanwhile;
    otherwise ``suspend_ia``.
    """
    pattern = _goal(goal)
    mark = len(trail)
    for intention in mind.all_intentions():
        why = reason_of(intention)
        if (
            why is not None
            and dropping.pursues(intention, intention.held, pattern, trail)
            and unify(reason, why, trail)
        ):
            yield None
        undo(trail, mark)
