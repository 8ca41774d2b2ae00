"""Queries: collecting over their solutions. Those that are written out are loops of the compiler."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agentd.language.terms.terms import EMPTY, FALSE, TRUE, Expression, Literal, Term, deref, make_list
from agentd.mind.beliefs.dynamic_formulas import solve
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.beliefs.work_limit import distinct, ordered
from agentd.mind.data.formula_failure import wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.state import MindState


def _solutions(mind: MindState, template: Term, query: Term, trail: Trail) -> list[Term]:
    """The instances of a term for the solutions of a query that a variable holds."""
    if type(deref(query)) not in (Literal, Expression):
        wrong_arguments("a formula is needed as query")
    return [resolve(template) for _ in solve(mind, deref(query), trail)]


def _of_solutions(name: str, made: Callable[[list[Any]], list[Any]], what: str, example: str = "") -> None:
    """Register an action whose result is the first of what is made of all solutions; it fails where that is none."""

    @internal_action(name, 3, pure=True)
    def of_solutions(mind: MindState, trail: Trail, template: Term, query: Term, result: Term) -> bool:
        found = made(_solutions(mind, template, query, trail))
        return bool(found) and unify(result, found[0], trail)

    of_solutions.__doc__ = what + (f"\n\n?- {example}" if example else "")


_of_solutions(
    ".findall",
    lambda found: [make_list(found)],
    "``.findall(T, Query, L)``: T for each solution, in order, duplicates kept; ``[]`` without solutions.",
    ".findall(X, .member(X, [b,a,b]), L) gives L = [b,a,b]",
)
_of_solutions(
    ".setof",
    lambda found: [make_list(distinct(found))],
    "``.setof(T, Query, L)``: T for each solution, in standard order, each once.",
    ".setof(X, .member(X, [b,a,b]), L) gives L = [a,b]",
)
_of_solutions(
    ".min",
    ordered,
    "``.min(T, Query, X)``: the least T of all solutions; fails without solutions.",
    ".min(X, .member(X, [3,1,2]), M) gives M = 1",
)
_of_solutions(
    ".max",
    lambda found: ordered(found)[::-1],
    "``.max(T, Query, X)``: the greatest T of all solutions; fails without solutions.",
)


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
    if type(deref(query)) not in (Literal, Expression):
        wrong_arguments("a formula is needed as query")
    holds = any(True for _ in solve(mind, deref(query), trail))
    undo(trail, mark)
    return unify(result, TRUE if holds else FALSE, trail)
