"""Variables that occur only once, most often a misspelt name, and variables that never get a value."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator
from typing import NamedTuple, TypeAlias

from agentd.check.finding_kinds import Kind, warning
from agentd.check.symbol_table import Survey
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import children, walk
from schemas.files.findings import Finding

_Node: TypeAlias = nodes.Term | nodes.Body | nodes.BodyFormula | nodes.Plan | nodes.Rule | nodes.Trigger

_IN_STRING = re.compile(r"#\{([A-Z]\w*)\}")
"""How ``.puts`` names variables in its text."""


def singletons(survey: Survey) -> Iterator[Finding]:
    """Yield a warning for each named variable that occurs once in its plan (with its sub-plans), rule or belief."""
    for scope in _scopes(survey):
        counts: Counter[str] = Counter()
        first: dict[str, nodes.Variable] = {}
        for node in walk(scope):
            if isinstance(node, nodes.Variable):
                counts[node.name] += 1
                first[node.name] = node
            elif isinstance(node, nodes.String):
                counts.update(_IN_STRING.findall(node.value))
        yield from (_only_once(one) for name, one in first.items() if counts[name] == 1 and not one.anonymous)


def _scopes(survey: Survey) -> list[_Node]:
    """Return the parts of a program that variables belong to."""
    nested = {id(sub) for placed in survey.plans for sub in placed.plan.subplans}
    terms = {id(placed.plan) for family in survey.families for placed in family}
    plans = [p.plan for p in survey.plans if id(p.plan) in terms and id(p.plan) not in nested]
    return [*plans, *survey.rules, *(belief.literal for belief in survey.beliefs)]


def _only_once(variable: nodes.Variable) -> Finding:
    name = variable.name
    message = f"the variable {name} occurs only once; is it misspelt? if not, write _ or _{name}"
    return warning(Kind.SINGLETON_VARIABLE, variable.position, message)


def named_variables(survey: Survey, actions: Collection[str]) -> frozenset[Finding]:
    """Return the warnings of `singletons` about variables whose name an action sends as text: ``arm_motors(True)``."""
    return frozenset(
        _only_once(term)
        for mention in survey.actions
        for term in mention.literal.args
        if mention.name in actions and isinstance(term, nodes.Variable)
    )


class _Use(NamedTuple):
    """A node, the innermost ``not`` around it, and whether a variable in it is only compared.

    ``place`` counts the formulas in the order of execution; 0 for a node that holds several.
    """

    node: _Node
    negation: int
    compared: bool
    place: int = 0


_SEVERAL = nodes.Plan | nodes.Trigger | nodes.Body | nodes.Step | nodes.And | nodes.Or | nodes.Not | nodes.If
"""Nodes whose formulas are executed in turn; not rules, whose bodies may bind the variables of their heads."""


def unbound_variables(survey: Survey) -> Iterator[Finding]:
    """Variables that occur twice or more, at a place where a value is needed before any can be given.

    ``X > 3`` compares; ``b(X)``, ``X = 3``, ``.member(X, L)`` and ``!g(X)`` may give X its value: there and in what
    follows. A formula in a ``not`` gives none outside of it.
    """
    for scope in _scopes(survey):
        yield from _unbound_in(scope)


def _unbound_in(scope: _Node) -> Iterator[Finding]:
    count: Counter[str] = Counter()
    given: dict[str, dict[int, int]] = {}
    compared: dict[str, list[tuple[int, int, nodes.Variable]]] = {}
    places = 0
    pending = [_Use(scope, 0, False)]
    while pending:
        node, negation, comparing, place = pending.pop()
        if place == 0 and not isinstance(node, _SEVERAL | nodes.While | nodes.For):
            places += 1
            place = places
        if isinstance(node, nodes.Variable):
            count[node.name] += 1
            if comparing and node.annotations is None:
                compared.setdefault(node.name, []).append((negation, place, node))
            else:
                given.setdefault(node.name, {}).setdefault(negation, place)
        elif isinstance(node, nodes.String):
            count.update(_IN_STRING.findall(node.value))
        inside = id(node) if isinstance(node, nodes.Not) else negation
        compares = isinstance(node, nodes.Arithmetic) or (comparing and isinstance(node, nodes.Variable))
        compares |= isinstance(node, nodes.Relation) and node.operator in _COMPARISONS
        pending += (_Use(child, inside, compares, place) for child in reversed(children(node)))
    for name, uses in compared.items():
        sources = given.get(name, {})
        lost = [
            use
            for negation, place, use in uses
            if not any(sources.get(where, place + 1) <= place for where in (0, negation))
        ]
        if lost and count[name] > 1 and not name.startswith("_"):
            first = min(lost, key=lambda use: (use.position.line, use.position.column))
            why = "nothing before this place gives it one" if sources else "it is only compared or computed with"
            text = f"the variable {name} has no value here: {why}"
            yield warning(Kind.UNBOUND_VARIABLE, first.position, text)


_COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "\\=="))
