"""Percepts: beliefs with source(percept), changed only where something has changed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from agentd.language.syntax_tree.signatures import Signature
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import PERCEPT
from agentd.language.terms.terms import Literal
from agentd.mind.beliefs.term_copy import detach, resolve_all
from agentd.mind.data.inputs import PerceptAdded, PerceptRemoved, PerceptReplaced, PerceptsChanged
from agentd.mind.execution.belief_updates import raise_event
from agentd.mind.state import MindState, Perceived

Addition = tuple[Perceived, tuple[Any, ...], tuple[Any, ...]]
"""A percept that is new: where it is kept, its arguments, and the annotations that the belief got."""


def perceived(mind: MindState, sig: Signature) -> Perceived:
    """The percepts of a signature."""
    found = mind.percepts.get(sig)
    if found is None:
        plans = mind.plans
        found = Perceived(mind.beliefs.predicate(sig), plans.relevant("+", "", sig), plans.relevant("-", "", sig))
        mind.percepts[sig] = found
    return found


def forget(mind: MindState, sig: Signature, args: tuple[Any, ...]) -> None:
    """A belief is gone that may have been a percept: told anew, it is new."""
    place = mind.percepts.get(sig)
    if place is not None and args in place.args:
        place.drop(args)


def change(mind: MindState, item: PerceptsChanged, added: list[Addition]) -> None:
    """Take and add percepts. Deletion events are raised at once; those of ``added`` are to follow them."""
    known = mind.percepts
    for (sig, args), literal in item.percepts.items():
        place = known.get(sig) or perceived(mind, sig)
        if literal is None:
            if args in place.args:
                _remove(mind, place, args)
        elif args not in place.args:
            _add(mind, place, literal, args, added)


def update(mind: MindState, item: PerceptReplaced | PerceptAdded | PerceptRemoved, added: list[Addition]) -> None:
    """As `change`, for the percepts that a literal and a key describe."""
    literal = item.literal
    place, args = perceived(mind, literal.sig), _arguments(literal)
    match item:
        case PerceptReplaced(key=key):
            for old in place.agreeing(args, key):
                if old != args:
                    _remove(mind, place, old)
        case PerceptRemoved(key=key):
            annots = _of_percept(literal.annots)
            for old in place.agreeing(args, key):
                _remove(mind, place, old, annots)
            return
    if args not in place.args:
        _add(mind, place, literal, args, added)


def raise_additions(mind: MindState, added: Iterable[Addition]) -> None:
    """Raise the events of percepts that are new."""
    heard = mind.listeners or mind.plans.has_nested
    for place, args, annots in added:
        if heard:
            raise_event(mind, None, place.gained, args, annots)
        elif place.gained.plans:
            mind.post(place.gained, args, annots)


def _arguments(literal: Literal) -> tuple[Any, ...]:
    if literal.ground:
        return literal.args
    for arg in literal.args:
        if type(arg) is not float and type(arg) is not str:
            return detach(resolve_all(literal.args))
    return literal.args


def _of_percept(annots: tuple[Any, ...]) -> tuple[Any, ...]:
    """Annotations with source(percept): `PERCEPT` itself where there is nothing else, which is how beliefs know one."""
    if annots is PERCEPT or not annots or annots == PERCEPT:
        return PERCEPT
    return sorted_annots((*annots, *PERCEPT))


def _add(mind: MindState, place: Perceived, literal: Literal, args: tuple[Any, ...], added: list[Addition]) -> None:
    place.put(args)
    annots = _of_percept(literal.annots)
    new = place.predicate.add(args, annots)
    if new is not None:
        mind.changes += 1
        added.append((place, args, new))


def _remove(mind: MindState, place: Perceived, args: tuple[Any, ...], annots: tuple[Any, ...] = PERCEPT) -> None:
    """A percept holds no longer: the belief loses source(percept), and stays if another source holds it.

    Its event has ``annots``: those that the news of its end had.
    """
    place.drop(args)
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
