"""Formulas that only the run knows: held by a variable, sent in a question. They are walked, not compiled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language.instantiate import calculate
from agentd.language.order import compare, sorted_annots
from agentd.language.signatures import DEFAULT, signature
from agentd.language.term_text import text
from agentd.language.terms import EMPTY, Code, Expression, Literal, Open, Var, deref, make_list, proper
from agentd.mind.unifier import Trail, resolve, same, undo, unify, value


def solve(mind: Any, formula: Any, trail: Trail) -> Iterator[None]:
    """One solution after another of a formula; bindings are undone between them and kept at the last yield."""
    formula = deref(formula)
    mark = len(trail)
    if type(formula) is Literal:
        yield from _literal(mind, formula, trail)
    elif type(formula) is Open and formula.literal is not None:
        for sig_literal in _namespaces(mind, formula, trail):
            yield from _literal(mind, sig_literal, trail)
    elif type(formula) is Expression:
        yield from _expression(mind, formula, trail)
    undo(trail, mark)


def _namespaces(mind: Any, formula: Open, trail: Trail) -> Iterator[Literal]:
    """The literal in each namespace that its namespace variable may stand for."""
    literal = formula.literal
    assert literal is not None
    for predicate in mind.beliefs.predicates():
        sig = predicate.sig
        same_name = sig.functor == literal.sig.functor and sig.arity == literal.sig.arity
        if same_name and sig.negated == literal.sig.negated:
            mark = len(trail)
            if unify(formula.namespace, Literal(signature(sig.namespace)), trail):
                yield Literal(sig, literal.args, literal.annots)
            undo(trail, mark)


def _literal(mind: Any, formula: Literal, trail: Trail) -> Iterator[None]:
    sig = formula.sig
    if sig.functor == "true" and not sig.arity:
        yield
        return
    if "." in sig.functor and not sig.functor.startswith("'"):
        yield from _internal_action(mind, formula, trail)
        return
    predicate = mind.beliefs.known(sig)
    if predicate is None:
        return
    mark = len(trail)
    args = tuple([resolve(a) for a in formula.args])
    for found, annots in predicate.literals((True,) * sig.arity, args, mind, trail):
        if unify(formula, Literal(sig, found, annots), trail):
            yield
        undo(trail, mark)


def _internal_action(mind: Any, formula: Literal, trail: Trail) -> Iterator[None]:
    action = mind.compiler.action(formula.sig.functor, formula.sig.arity)
    if action is None:
        return
    mark = len(trail)
    outcome = action.guarded()(mind, trail, *formula.args)
    if action.backtracks:
        for _ in outcome:
            yield
    elif outcome:
        yield
    undo(trail, mark)


def _expression(mind: Any, formula: Expression, trail: Trail) -> Iterator[None]:
    operator, operands = formula.operator, formula.operands
    if operator == "&":
        for _ in solve(mind, operands[0], trail):
            yield from solve(mind, operands[1], trail)
    elif operator == "|":
        yield from solve(mind, operands[0], trail)
        yield from solve(mind, operands[1], trail)
    elif operator == "not":
        mark = len(trail)
        for _ in solve(mind, operands[0], trail):
            undo(trail, mark)
            return
        yield
    elif len(operands) == 2 and relation_holds(operator, operands[0], operands[1], trail):
        yield


def relation_holds(operator: str, left: Any, right: Any, trail: Trail) -> bool:
    """Whether a relation holds; ``=`` and ``=..`` may bind."""
    match operator:
        case "=":
            return unify(left, right, trail)
        case "=..":
            return univ(left, right, trail)
        case "==":
            return same(left, right)
        case "\\==":
            return not same(left, right)
        case "<":
            return order(left, right) < 0
        case "<=":
            return order(left, right) <= 0
        case ">":
            return order(left, right) > 0
        case ">=":
            return order(left, right) >= 0
    return False


def order(left: Any, right: Any) -> int:
    """The standard order of two terms, arithmetic computed first. NaN is before and after nothing."""
    return compare(value(left), value(right))


def arithmetic(mind: Any, operator: str, *operands: Any) -> Any:
    """An operation in generated code whose operands are not simply numbers."""
    result = calculate(operator, operands)
    if result != result:
        for operand in operands:
            operand = value(operand)
            if type(operand) is not float and type(operand) is not Var and type(operand) is not Expression:
                mind.warn_once(f"'{text(operand)}' is not a number; {operator} gives NaN")
    return result


def univ(left: Any, right: Any, trail: Trail) -> bool:
    """``=..``: a literal or plan and the list of its parts."""
    term = value(left)
    if type(term) is Literal:
        sig = term.sig
        name = Literal(signature(("~" if sig.negated else "") + sig.functor))
        parts = [name, make_list(term.args), make_list(term.annots)]
        wanted = proper(right)
        if wanted is None or len(wanted) != 3:
            parts.insert(0, Literal(signature(sig.namespace)))
        return unify(make_list(parts), right, trail)
    if type(term) is Code:
        from agentd.mind.code_terms import parts_of

        return unify(make_list(parts_of(term)), right, trail)
    if type(term) is Var:
        made = _from_parts(proper(right))
        return made is not None and unify(term, made, trail)
    return False


def _from_parts(parts: list[Any] | None) -> Any:
    if parts is None or len(parts) not in (3, 4):
        return None
    namespace = DEFAULT
    if len(parts) == 4:
        first = deref(parts.pop(0))
        if type(first) is not Literal:
            return None
        namespace = first.sig.functor
    name, args, annots = deref(parts[0]), proper(parts[1]), deref(parts[2])
    if type(name) is not Literal or args is None:
        return None
    functor, negated = name.sig.functor, name.sig.negated
    if functor.startswith("~"):
        functor, negated = functor[1:], True
    found = proper(annots) if annots is not EMPTY else []
    sig = signature(functor, len(args), negated, namespace)
    return Literal(sig, tuple(args), sorted_annots(found or ()))
