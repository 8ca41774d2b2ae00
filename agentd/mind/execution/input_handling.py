"""Take inputs: percepts, results of actions, answers, goals and beliefs.

Percepts are beliefs with source(percept), which change only where something has changed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from agentd.language.syntax_tree.signatures import Signature, signature
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import PERCEPT
from agentd.language.terms.terms import Literal, Term, atom
from agentd.mind.beliefs.term_copy import detach, resolve_all, with_source
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import (
    ActionDone,
    BeliefAdded,
    GoalAdded,
    Input,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    PerceptsChanged,
    SignalRaised,
    TeamReply,
)
from agentd.mind.execution.belief_updates import add_belief, raise_event
from agentd.mind.execution.execution import fail_waiting, resume_waiting
from agentd.mind.execution.goal_execution import add_goal
from agentd.mind.execution.waiting import take_reply
from agentd.mind.state import MindState, Perceived


def take_inputs(mind: MindState) -> bool:
    """Take all inputs but mail: deletions of percepts raise their events before additions.

    Return whether there were only percepts.
    """
    inputs, on_input = mind.inputs, mind.on_input
    added: list[Addition] = []
    percepts_only = True
    while inputs:
        item: Any = inputs.popleft()
        if on_input is not None:
            on_input(mind.cycle, item)
        kind = type(item)
        if kind is PerceptsChanged:
            _change(mind, item, added)
        elif kind in _PERCEPTS:
            _update(mind, item, added)
        else:
            percepts_only = False
            if mind.recorder is not None:
                mind.recorder.given(mind.cycle, item)
            _OTHERS[kind](mind, item)
    if added:
        listening = mind.listeners or mind.plans.has_nested
        for place, args, annots in added:
            if listening:
                raise_event(mind, None, place.gained, args, annots)
            elif place.gained.plans:
                mind.post(place.gained, args, annots)
    return percepts_only


def heeds(mind: MindState, item: Input) -> bool:
    """Return whether anything of the mind may wait for an input."""
    return type(item) not in _PERCEPTS or heeds_percept(mind, item.literal.sig)  # type: ignore[union-attr]


def heeds_percept(mind: MindState, predicate: Signature) -> bool:
    """Return whether a plan, a condition or a wait may be for a percept.

    Another one becomes a belief whenever the next inputs are taken: nothing in the mind sees the difference.
    """
    if mind.conditions or mind.goal_conditions or mind.listeners:
        return True
    plans, place = mind.plans, mind.percepts.get(predicate)
    return place is None or bool(place.gained.plans or place.lost.plans or plans.has_nested or plans.sleeps)


def _end_action(mind: MindState, done: ActionDone) -> None:
    """Resume the intention that waits for an action, or fail the formula that it waits in."""
    intention = mind.action_client.pop(done.id, None)
    if intention is None or intention.action != done.id:
        return
    if done.ok:
        resume_waiting(mind, intention)
        return
    facts = [Literal(signature("reason", 1), (done.reason,))] if done.reason else []
    if done.state:
        facts.append(Literal(signature("state", 1), (atom(done.state),)))
    if done.cause:
        facts.append(Literal(signature("cause", 1), (atom(done.cause),)))
    fail_waiting(mind, intention, Failed("action_failed", done.reason, tuple(facts)))


# --- percepts ---


Addition = tuple[Perceived, tuple[Any, ...], tuple[Any, ...]]
"""A percept that is new: where it is kept, its arguments, and the annotations that the belief got."""


def perceived(mind: MindState, sig: Signature) -> Perceived:
    """Return the percepts of a signature."""
    found = mind.percepts.get(sig)
    if found is None:
        plans = mind.plans
        found = Perceived(mind.beliefs.predicate(sig), plans.relevant("+", "", sig), plans.relevant("-", "", sig))
        mind.percepts[sig] = found
    return found


def forget(mind: MindState, sig: Signature, args: tuple[Term, ...]) -> None:
    """Forget a percept whose belief was removed: if it is perceived again, it is new."""
    place = mind.percepts.get(sig)
    if place is not None:
        place.drop(args)


def _change(mind: MindState, item: PerceptsChanged, added: list[Addition]) -> None:
    """Remove and add percepts. Deletion events are raised here; the additions are collected in ``added``."""
    known = mind.percepts
    for (sig, args), literal in item.percepts.items():
        place = known.get(sig)
        if place is None:
            place = perceived(mind, sig)
        if literal is None:
            if place.drop(args):
                _remove(mind, place, args)
        elif place.put(args):
            _add(mind, place, literal, args, added)


def _update(mind: MindState, item: PerceptReplaced | PerceptAdded | PerceptRemoved, added: list[Addition]) -> None:
    """As `_change`, for the percepts that a literal and a key describe."""
    literal = item.literal
    place, args = mind.percepts.get(literal.sig), literal.args if literal.ground else _arguments(literal)
    if place is None:
        place = perceived(mind, literal.sig)
    match item:
        case PerceptReplaced(key=key):
            for old in place.agreeing(args, key):
                if old != args and place.drop(old):
                    _remove(mind, place, old)
        case PerceptRemoved(key=key):
            annots = _of_percept(literal.annots)
            for old in place.agreeing(args, key):
                if place.drop(old):
                    _remove(mind, place, old, annots)
            return
    if place.put(args):
        _add(mind, place, literal, args, added)


def _arguments(literal: Literal) -> tuple[Term, ...]:
    for arg in literal.args:
        if type(arg) is not float and type(arg) is not str:
            return detach(resolve_all(literal.args))
    return literal.args


def _of_percept(annots: tuple[Term, ...]) -> tuple[Term, ...]:
    """Annotations with source(percept): `PERCEPT` itself if there are no others, as beliefs compare by identity."""
    if not annots or annots == PERCEPT:
        return PERCEPT
    return sorted_annots((*annots, *PERCEPT))


def _add(mind: MindState, place: Perceived, literal: Literal, args: tuple[Term, ...], added: list[Addition]) -> None:
    """Believe a percept that is new."""
    predicate = place.predicate
    add = predicate.add_ground if literal.ground else predicate.add
    annots = literal.annots
    new = add(args, annots if annots is PERCEPT else _of_percept(annots))
    if new is not None:
        mind.changes += 1
        added.append((place, args, new))


def _remove(mind: MindState, place: Perceived, args: tuple[Term, ...], annots: tuple[Term, ...] = PERCEPT) -> None:
    """Remove a percept: the belief loses source(percept), and stays if another source holds it.

    Its event has ``annots``: those that the news of its end had.
    """
    predicate = place.predicate
    fact = predicate.entries.get(args)
    if fact is None:
        return
    if fact.annots is PERCEPT:
        predicate.remove(fact)
    elif PERCEPT[0] in fact.annots:
        predicate.take_annots(fact, PERCEPT)
    else:
        return
    mind.changes += 1
    if place.lost.plans or mind.listeners or mind.plans.has_nested:
        raise_event(mind, None, place.lost, args, annots)


def _raise_signal(mind: MindState, signal: SignalRaised) -> None:
    literal = signal.literal
    mind.post(mind.plans.relevant("+", "", literal.sig), literal.args, with_source(literal.annots))


_PERCEPTS: Final = frozenset({PerceptReplaced, PerceptAdded, PerceptRemoved})
_OTHERS: Final[dict[type, Callable[[MindState, Any], None]]] = {
    ActionDone: _end_action,
    TeamReply: take_reply,
    GoalAdded: lambda mind, item: add_goal(mind, item.literal),
    BeliefAdded: lambda mind, item: add_belief(mind, item.literal),
    SignalRaised: _raise_signal,
}
