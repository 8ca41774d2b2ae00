"""Percepts: beliefs with source(percept), changed only where something has changed."""

from __future__ import annotations

from typing import Any

from agentd.language.order import sorted_annots
from agentd.language.sources import PERCEPT
from agentd.language.terms import Literal
from agentd.mind.changes import raise_event
from agentd.mind.inputs import PerceptAdded, PerceptRemoved, PerceptReplaced
from agentd.mind.resolving import detach, resolve_all

Addition = tuple[Any, tuple[Any, ...], tuple[Any, ...]]


def update(mind: Any, item: PerceptReplaced | PerceptAdded | PerceptRemoved) -> list[Addition]:
    """Change the percepts. Deletion events are raised at once; those of additions are returned, to follow them."""
    literal = item.literal
    args = detach(resolve_all(literal.args))
    present = mind.percepts.get(literal.sig)
    if present is None:
        present = mind.percepts[literal.sig] = {}
    match item:
        case PerceptReplaced(key=key):
            unchanged = args in present
            for old in _agreeing(present, args, key):
                if old != args:
                    _remove(mind, literal, old)
            return [] if unchanged else _add(mind, literal, args)
        case PerceptAdded():
            return [] if args in present else _add(mind, literal, args)
        case PerceptRemoved(key=key):
            for old in _agreeing(present, args, key):
                _remove(mind, literal, old)
    return []


def _agreeing(present: dict[tuple[Any, ...], None], args: tuple[Any, ...], key: tuple[int, ...]) -> list[Any]:
    """The percepts whose arguments at the positions ``key`` are these; one alone can be when the key is all of them."""
    if len(key) == len(args):
        return [args] if args in present else []
    return [percept for percept in present if all(percept[k] == args[k] for k in key)]


def _annots(literal: Literal) -> tuple[Any, ...]:
    return sorted_annots((*literal.annots, *PERCEPT)) if literal.annots else PERCEPT


def _add(mind: Any, literal: Literal, args: tuple[Any, ...]) -> list[Addition]:
    mind.percepts[literal.sig][args] = None
    new = mind.beliefs.predicate(literal.sig).add(args, _annots(literal))
    if new is None:
        return []
    mind.changes += 1
    return [(literal.sig, args, new)]


def _remove(mind: Any, literal: Literal, args: tuple[Any, ...]) -> None:
    """A percept holds no longer: the belief loses source(percept), and stays if another source holds it."""
    del mind.percepts[literal.sig][args]
    predicate = mind.beliefs.predicate(literal.sig)
    fact = predicate.entries.get(args)
    if fact is None or PERCEPT[0] not in fact.annots:
        return
    predicate.take_annots(fact, PERCEPT)
    mind.changes += 1
    raise_event(mind, None, mind.plans.relevant("-", "", literal.sig), args, PERCEPT)


def raise_additions(mind: Any, added: list[Addition]) -> None:
    for sig, args, annots in added:
        raise_event(mind, None, mind.plans.relevant("+", "", sig), args, annots)
