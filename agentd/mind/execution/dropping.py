"""Find and end intentions by their goals: ``.drop_intention``, ``.succeed_goal``, goal conditions (``<:``, rule 94)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import Literal, Term
from agentd.mind.beliefs.term_copy import detach, resolve_all
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.data.effects import CancelAction
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import (
    ANNOTS,
    ARGS,
    MARK,
    PLAN,
    RELEVANT,
    STEP,
    Event,
    Frame,
    Intention,
    Question,
    Timer,
    Wait,
    values_of,
)
from agentd.mind.execution import goal_states
from agentd.mind.execution.execution import condition_holds, end_frames, fail, fail_event
from agentd.mind.execution.intention_terms import ahead
from agentd.mind.execution.waiting import forget, forget_question
from agentd.mind.introspection.failure_text import error_annots
from agentd.mind.state import MindState

_ACHIEVING = (Operator.ACHIEVE, Operator.ACHIEVE_NEW_FOCUS)


def drop(mind: MindState, intention: Intention) -> None:
    """End an intention without any event; its action is cancelled and its branches go with it."""
    _take_back(mind, intention)
    if mind.recorder is not None:
        mind.recorder.dropped(intention.stack)
    mind.gone(intention)
    intention.stack.clear()


def _take_back(mind: MindState, intention: Intention) -> None:
    """Take an intention out of all queues, and cancel what it waits for."""
    token: Any = mind.waiting.pop(intention.id, (None, None))[1]
    if isinstance(token, Wait):
        forget(mind, token)
    elif isinstance(token, Timer):
        mind.timers.cancel(token)
    elif hasattr(token, "branches"):
        for branch in list(token.branches):
            drop(mind, branch)
    elif isinstance(token, int):
        mind.requests.pop(token, None)
    elif isinstance(token, Question):
        forget_question(mind, token)
    if intention.action is not None:
        mind.action_client.pop(intention.action, None)
        mind.effects.append(CancelAction(intention.action))
        intention.action = None
    if intention in mind.running:
        mind.running.remove(intention)
    mind.suspended.pop(intention.id, None)
    if any(e[3] is intention for e in mind.events):
        keep_events(mind, [e for e in mind.events if e[3] is not intention])
    intention.waiting = intention.suspended = intention.held = None


def keep_events(mind: MindState, kept: list[Event]) -> None:
    """Leave these events alone in the queue."""
    mind.events.clear()
    mind.events.extend(kept)


def goal_of(event: Event) -> Literal | None:
    """Return the goal that an event is to achieve, if it is one, with variables of its own where it has free ones."""
    relevant, args, annots, _ = event
    if relevant.goal != "!" or relevant.operator != "+":
        return None
    return Literal(relevant.sig, *_apart(args, annots))


def _apart(args: tuple[Term, ...], annots: tuple[Term, ...]) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
    """Copies of a goal's arguments and annotations: bindings of a query do not reach the plans of the goal."""
    if not annots or annots is SELF:
        return detach(args), annots
    both = detach((*args, *annots))
    return both[: len(args)], both[len(args) :]


def fits(goal: Term, literal: Literal | None, trail: Trail) -> bool:
    """Return whether a goal that is asked for unifies with one; nothing is bound if not."""
    mark = len(trail)
    if literal is not None and unify(goal, literal, trail):
        return True
    undo(trail, mark)
    return False


def goal_frames(intention: Intention) -> Iterator[tuple[int, Literal]]:
    """Yield the goals that an intention has a plan for, innermost first, with their places in the stack.

    A failure plan counts as its goal, which ends only with the failure plan.
    """
    for place in range(len(intention.stack) - 1, -1, -1):
        frame = intention.stack[place]
        relevant = frame[RELEVANT]
        if relevant.goal == "!" and relevant.operator != "^":
            yield place, Literal(relevant.sig, *_apart(frame[ARGS], frame[ANNOTS]))


def find_goal(intention: Intention, goal: Literal, trail: Trail) -> int | None:
    """Return the place of a goal in the stack; its bindings are kept."""
    for place, literal in goal_frames(intention):
        if fits(goal, literal, trail):
            return place
    return None


def pursues(intention: Intention, event: Event | None, goal: Literal, trail: Trail) -> bool:
    """Return whether an intention has a plan for a goal, or ``event`` is for it; its bindings are kept."""
    held = event is not None and fits(goal, goal_of(event), trail)
    return held or find_goal(intention, goal, trail) is not None


def intended(mind: MindState, goal: Term, trail: Trail, suspended: bool = False) -> Iterator[Intention]:
    """Yield the intentions with a goal, bindings undone between them."""
    for intention in mind.all_intentions():
        if intention.suspended is not None and not suspended:
            continue
        mark = len(trail)
        for _, literal in goal_frames(intention):
            if unify(goal, literal, trail):
                yield intention
            undo(trail, mark)


def desired(mind: MindState, goal: Term, trail: Trail) -> Iterator[Intention | None]:
    """As `intended`, and goals whose event still waits (None when it is to start an intention)."""
    for event in mind.all_events():
        mark = len(trail)
        if fits(goal, goal_of(event), trail):
            yield event[3]
        undo(trail, mark)
    yield from intended(mind, goal, trail, suspended=True)


def drop_intention(mind: MindState, goal: Literal, trail: Trail) -> bool:
    """End every intention with this goal. True if the current one is among them."""
    own = False
    for intention in mind.all_intentions():
        mark = len(trail)
        if find_goal(intention, goal, trail) is not None:
            own |= intention is mind.current
            goal_states.dropped(mind, intention)
            drop(mind, intention)
        undo(trail, mark)
    return own


def has_ahead(intention: Intention, goal: Literal, trail: Trail) -> bool:
    """Return whether the innermost plan of an intention has ``!goal`` or ``!!goal`` still before it."""
    if not intention.stack:
        return False
    frame = intention.stack[-1]
    for step in ahead(frame[STEP]):
        node = step.syntax
        if isinstance(node, nodes.Step) and node.operator in _ACHIEVING:
            mark = len(trail)
            if unify(goal, instantiate(node.term, values_of(frame)), trail):
                return True
            undo(trail, mark)
    return False


def drop_event(mind: MindState, goal: Literal, trail: Trail) -> bool:
    """Take goals out of the events that wait, with the intentions that wait for them. True if the current one is."""
    gone = [event for event in mind.all_events() if asked_for(goal, event, trail)]
    take_out(mind, gone)
    waiting = [event[3] for event in gone if event[3] is not None]
    for intention in waiting:
        intention.stack.clear()
        mind.gone(intention)
    return any(intention is mind.current for intention in waiting)


def asked_for(goal: Literal, event: Event, trail: Trail) -> bool:
    """Return whether an event is for a goal; nothing is bound."""
    mark = len(trail)
    found = fits(goal, goal_of(event), trail)
    undo(trail, mark)
    return found


def take_out(mind: MindState, gone: Collection[Event]) -> None:
    """Take events out of the queue, or away from the intentions that hold them while they are suspended."""
    numbers = {id(event) for event in gone}
    keep_events(mind, [event for event in mind.events if id(event) not in numbers])
    for intention in [each for each in mind.suspended.values() if each.held is not None and id(each.held) in numbers]:
        intention.held = intention.suspended = None
        del mind.suspended[intention.id]


def drop_desire(mind: MindState, goal: Literal, trail: Trail) -> bool:
    """Drop a goal that is intended or waits in the queue. Return whether there was one."""
    own = drop_event(mind, goal, trail)
    return drop_intention(mind, goal, trail) or own


def fail_too_deep(mind: MindState, intention: Intention) -> None:
    """Fail the innermost goal of an intention with too many plans."""
    stack = intention.stack
    _take_back(mind, intention)
    mind.gone(intention)
    failure = Failed("recursion_too_deep", f"{len(stack)} goals are open, one inside the other")
    step = intention.last
    place = stack[-1][PLAN].syntax.position if step is None else step.syntax.position
    code = Literal(stack[-1][RELEVANT].sig, stack[-1][ARGS])
    failure.step, failure.goal, failure.code = step, stack[-1][RELEVANT], code
    fail(mind, intention, error_annots(failure, code, place.line, place.file), str(place), failure)


def end_goal(mind: MindState, intention: Intention, place: int, succeeded: bool) -> None:
    """End the goal at ``place`` of the stack (0: the outermost), as achieved or failed.

    The frames above it are removed, its wait is cancelled.
    """
    stack, trail = intention.stack, intention.trail
    waited = intention.waiting is not None
    _take_back(mind, intention)
    mind.gone(intention)
    if mind.recorder is not None:
        mind.recorder.dropped(stack[place + 1 :])
    del stack[place + 1 :]
    frame = stack[place]
    if succeeded:
        goal_states.ended(mind, frame[RELEVANT], frame[ARGS], frame[ANNOTS])
        stack.pop()
        _go_on(mind, intention)
        if waited:
            goal_states.of_goals(mind, intention, "executing")
        return
    literal = Literal(frame[RELEVANT].sig, frame[ARGS], frame[ANNOTS])
    failure = _failed_by_hand(literal)
    failure.goal = frame[RELEVANT]
    fail(mind, intention, error_annots(failure, literal, 0, ""), f"{frame[PLAN].head}", failure)
    undo(trail, min(len(trail), frame[MARK]))


def end_event(mind: MindState, event: Event, succeeded: bool) -> None:
    """End a goal that has no plan yet, as achieved or failed."""
    relevant, args, annots, intention = event
    take_out(mind, [event])
    if not succeeded:
        fail_event(mind, event, _failed_by_hand(Literal(relevant.sig, resolve_all(args), resolve_all(annots))))
        return
    goal_states.ended(mind, relevant, args, annots)
    if intention is not None:
        _go_on(mind, intention)


def _failed_by_hand(goal: Literal) -> Failed:
    return Failed("goal_failed", "the goal was failed by .fail_goal", code=goal)


def _go_on(mind: MindState, intention: Intention) -> None:
    """Continue the plans below a goal that is over."""
    if intention.stack and end_frames(mind, intention):
        mind.running.append(intention)


# --- goal conditions ---


_PRUNE_AT = 64
"""The list of watched goals is pruned each time it has grown by this number."""


def watch(mind: MindState, intention: Intention, frame: Frame) -> None:
    """Ask the condition of a goal again when beliefs change. Goals that have ended otherwise are forgotten in time."""
    watched = mind.goal_conditions
    watched.append((intention, frame))
    if len(watched) % _PRUNE_AT == 0:
        watched[:] = [(other, its) for other, its in watched if any(f is its for f in other.stack)]


def check_goal_conditions(mind: MindState) -> None:
    """After beliefs have changed: end the goals whose conditions hold now, wherever their plans are."""
    left = []
    for intention, frame in mind.goal_conditions:
        place = next((n for n, other in enumerate(intention.stack) if other is frame), None)
        if place is None:
            continue
        if condition_holds(mind, intention, frame):
            end_goal(mind, intention, place, True)
        else:
            left.append((intention, frame))
    mind.goal_conditions[:] = left
