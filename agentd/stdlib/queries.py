"""Queries: collecting over their solutions. Those that are written out are loops of the compiler."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.order import distinct, ordered
from agentd.language.terms.terms import EMPTY, FALSE, TRUE, Expression, Literal, Term, deref, make_list
from agentd.mind.beliefs.dynamic_formulas import solve
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.data.formula_failure import wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.state import MindState


def _query(term: Term) -> Any:
    """A query held by a variable. Fails with ``wrong_arguments`` when it is no formula."""
    query = deref(term)
    if type(query) not in (Literal, Expression):
        wrong_arguments("a formula is needed as query")
    return query


def _solutions(mind: MindState, template: Term, query: Term, trail: Trail) -> list[Term]:
    found = []
    for _ in solve(mind, _query(query), trail):
        found.append(resolve(template))
    return found


@internal_action(".findall", 3, pure=True)
def findall(mind: MindState, trail: Trail, template: Term, query: Term, result: Term) -> bool:
    """``.findall(T, Query, L)``: T for each solution, in order, duplicates kept; ``[]`` without solutions.

    ?- .findall(X, .member(X, [b,a,b]), L) gives L = [b,a,b]
    """
    return unify(result, make_list(_solutions(mind, template, query, trail)), trail)


@internal_action(".setof", 3, pure=True)
def setof(mind: MindState, trail: Trail, template: Term, query: Term, result: Term) -> bool:
    """``.setof(T, Query, L)``: T for each solution, in standard order, each once.

    ?- .setof(X, .member(X, [b,a,b]), L) gives L = [a,b]
    """
    return unify(result, make_list(distinct(_solutions(mind, template, query, trail))), trail)


@internal_action(".min", 3, pure=True)
def minimum_of(mind: MindState, trail: Trail, template: Term, query: Term, result: Term) -> bool:
    """``.min(T, Query, X)``: the least T of all solutions; fails without solutions.

    ?- .min(X, .member(X, [3,1,2]), M) gives M = 1
    """
    found = ordered(_solutions(mind, template, query, trail))
    return bool(found) and unify(result, found[0], trail)


@internal_action(".max", 3, pure=True)
def maximum_of(mind: MindState, trail: Trail, template: Term, query: Term, result: Term) -> bool:
    """``.max(T, Query, X)``: the greatest T of all solutions; fails without solutions."""
    found = ordered(_solutions(mind, template, query, trail))
    return bool(found) and unify(result, found[-1], trail)


@internal_action(".count", 2, pure=True)
def count(mind: MindState, trail: Trail, query: Term, result: Term) -> bool:
    """``.count(Query, N)``: how many solutions there are.

    ?- .count(.member(X, [b,a,b]), N) gives N = 3
    """
    return unify(result, float(len(_solutions(mind, EMPTY, query, trail))), trail)


@internal_action(".eval", 2, pure=True)
def evaluate(mind: MindState, trail: Trail, result: Term, query: Term) -> bool:
    """``.eval(R, Formula)``: R is ``true`` or ``false``, as the formula holds.

    ?- .eval(R, 1 < 2 & 3 < 2) gives R = false
    """
    mark = len(trail)
    holds = FALSE
    for _ in solve(mind, _query(query), trail):
        holds = TRUE
        break
    undo(trail, mark)
    return unify(result, holds, trail)
