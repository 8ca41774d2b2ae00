"""The standard order of terms, which ``.sort``, ``<`` and annotations follow.

Numbers by value, then strings, lists, all other terms, and variables last. Literals: the default namespace first, then
functor, positive before negated, arguments from the left, arity, annotations.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from functools import cmp_to_key
from typing import Any

from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.terms.terms import EMPTY, FIRST_NODES, MOST_NODES, List, Literal, Rest, Var, deref, further

_RANK = {float: 0, str: 1, List: 2, Literal: 3, Var: 5, Rest: 6}


def compare(a: Any, b: Any) -> int:
    """Negative, zero or positive as ``a`` is before, equal to or after ``b``."""
    pending = [(a, b)]
    budget, rest = FIRST_NODES, MOST_NODES
    while pending:
        a, b = pending.pop()
        a, b = deref(a), deref(b)
        if a is b:
            continue
        budget -= 1
        if not budget:
            budget, rest = further(rest, pending, "compared")
        rank_a, rank_b = _RANK.get(type(a), 4), _RANK.get(type(b), 4)
        if rank_a != rank_b:
            return -1 if rank_a < rank_b else 1
        difference = _compare_shallow(a, b, rank_a, pending)
        if difference:
            return difference
    return 0


def _compare_shallow(a: Any, b: Any, rank: int, pending: list[tuple[Any, Any]]) -> int:
    if rank <= 1:
        return _sign(a, b)
    if rank == 3:
        return _compare_literals(a, b, pending)
    if rank == 2:
        if a is EMPTY or b is EMPTY:
            return -1 if a is EMPTY else 1
        pending.append((a.rest(), b.rest()))
        pending.append((a.items[a.at], b.items[b.at]))
        return 0
    if rank == 5:
        return _sign(a.name, b.name) or _sign(id(a), id(b))
    return _compare_others(a, b)


def _sign(a: Any, b: Any) -> int:
    return int(a > b) - int(a < b)


def _compare_literals(a: Literal, b: Literal, pending: list[tuple[Any, Any]]) -> int:
    if a.sig is not b.sig:
        s, t = a.sig, b.sig
        if s.namespace != t.namespace:
            return _sign((s.namespace != DEFAULT, s.namespace), (t.namespace != DEFAULT, t.namespace))
        if s.functor != t.functor:
            return _sign(s.functor, t.functor)
        if s.negated != t.negated:
            return 1 if s.negated else -1
    if a.annots or b.annots or len(a.args) != len(b.args):
        pending.append((_Rest(a), _Rest(b)))
    pending.extend(reversed(list(zip(a.args, b.args, strict=False))))
    return 0


class _Rest:
    """What decides between two literals whose common arguments agree: arity, then annotations."""

    def __init__(self, literal: Literal) -> None:
        self.arity, self.annots = len(literal.args), literal.annots


def _compare_others(a: Any, b: Any) -> int:
    if type(a) is _Rest and type(b) is _Rest:
        if a.arity != b.arity:
            return _sign(a.arity, b.arity)
        for x, y in zip(a.annots, b.annots, strict=False):
            difference = compare(x, y)
            if difference:
                return difference
        return _sign(len(a.annots), len(b.annots))
    return _sign(repr(a), repr(b))


key = cmp_to_key(compare)
"""A sort key for the standard order."""


def ordered(terms: list[Any]) -> list[Any]:
    """Return the terms in standard order, duplicates kept (a stable sort)."""
    kinds = set(map(type, terms))
    if kinds == {float} or kinds == {str}:
        return sorted(terms)
    return sorted(terms, key=key)


def distinct(terms: Iterable[Any]) -> list[Any]:
    """Return the terms in standard order without duplicates: a set as a list, or annotations."""
    found: list[Any] = []
    for term in ordered(list(terms)):
        if not found or compare(found[-1], term) != 0:
            found.append(term)
    return found


def place_in(members: list[Any], term: Any) -> int:
    """Return the index of a term in terms of standard order, or the index to insert it at."""
    return bisect_left(members, key(term), key=key)


def is_in(members: list[Any], term: Any) -> bool:
    """Return whether terms in standard order hold one that is equal to a term."""
    place = place_in(members, term)
    return place < len(members) and compare(members[place], term) == 0


def sorted_annots(terms: Iterable[Any]) -> tuple[Any, ...]:
    """Annotations as a literal holds them."""
    found = tuple(terms)
    return found if len(found) < 2 else tuple(distinct(found))
