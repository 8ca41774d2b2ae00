"""Unification of code as terms: plans, triggers, bodies and rules, part by part."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.terms.from_ast import Instantiation, instantiate
from agentd.language.terms.terms import TRUE, Code
from agentd.mind.beliefs.unification import Trail, unify


def unify_code(left: Code, right: Code, trail: Trail) -> bool:
    """Unify code with code of the same kind, part by part."""
    a, b = left.syntax, right.syntax
    if type(a) is not type(b):
        return False
    if a == b and left.values == right.values:
        return True
    match a:
        case nodes.Trigger():
            return _unify_triggers(left, right, trail)
        case nodes.Body():
            return _unify_bodies(a.formulas, left.values, b.formulas, right.values, trail)
        case nodes.Plan():
            return _unify_plans(left, right, trail)
        case nodes.Rule():
            names = dict(left.values), dict(right.values)
            return unify(instantiate(a.head, names[0]), instantiate(b.head, names[1]), trail) and unify(
                instantiate(a.body, names[0]), instantiate(b.body, names[1]), trail
            )
    return False


def _unify_triggers(left: Code, right: Code, trail: Trail) -> bool:
    a, b = left.syntax, right.syntax
    if a.operator != b.operator or a.goal != b.goal:
        return False
    return unify(instantiate(a.literal, dict(left.values)), instantiate(b.literal, dict(right.values)), trail)


def _unify_plans(left: Code, right: Code, trail: Trail) -> bool:
    a, b = left.syntax, right.syntax
    if a.trigger.operator != b.trigger.operator or a.trigger.goal != b.trigger.goal:
        return False
    first, second = Instantiation(dict(left.values), {}), Instantiation(dict(right.values), {})
    pairs: list[tuple[Any, Any]] = [(first.term(a.trigger.literal), second.term(b.trigger.literal))]
    if a.label is not None and b.label is not None:
        pairs.insert(0, (first.term(a.label), second.term(b.label)))
    contexts = [TRUE if n.context is None else i.term(n.context) for n, i in ((a, first), (b, second))]
    pairs.append((contexts[0], contexts[1]))
    if not all(unify(x, y, trail) for x, y in pairs):
        return False
    return _unify_bodies(a.body.formulas, first.values, b.body.formulas, second.values, trail)


def _unify_bodies(
    left: tuple[Any, ...],
    left_values: dict[str, Any],
    right: tuple[Any, ...],
    right_values: dict[str, Any],
    trail: Trail,
) -> bool:
    """``{ H; T }`` takes a body apart; a variable that ends the left side takes all that is left.

    What a variable takes prints without braces, as in Jason.
    """
    for n in range(max(len(left), len(right))):
        mine = _lone_variable(left[n], left_values) if n < len(left) else None
        other = _lone_variable(right[n], right_values) if n < len(right) else None
        if mine is not None and n == len(left) - 1:
            return unify(mine, Code(nodes.Body(right[n:]), right_values, bare=True), trail)
        if other is not None and n == len(right) - 1:
            return unify(other, Code(nodes.Body(left[n:]), left_values, bare=True), trail)
        if n >= len(left) or n >= len(right):
            return False
        if mine is not None:
            fits = unify(mine, Code(nodes.Body((right[n],)), right_values, bare=True), trail)
        elif other is not None:
            fits = unify(other, Code(nodes.Body((left[n],)), left_values, bare=True), trail)
        else:
            fits = _unify_formulas(left[n], left_values, right[n], right_values, trail)
        if not fits:
            return False
    return True


def _lone_variable(formula: Any, values: dict[str, Any]) -> Any:
    if isinstance(formula, nodes.Step) and not formula.operator.value and isinstance(formula.term, nodes.Variable):
        return instantiate(formula.term, values)
    return None


def _unify_formulas(a: Any, a_values: dict[str, Any], b: Any, b_values: dict[str, Any], trail: Trail) -> bool:
    if isinstance(a, nodes.Step) and isinstance(b, nodes.Step):
        if a.operator is not b.operator:
            return False
        return unify(instantiate(a.term, a_values), instantiate(b.term, b_values), trail)
    return bool(a == b)
