"""Relations and arithmetic on terms of which the compiler knows too little: ``==``, ``<``, ``=..``, ``+``."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree.signatures import DEFAULT, signature
from agentd.language.terms.format import text
from agentd.language.terms.from_ast import calculate
from agentd.language.terms.order import compare, sorted_annots
from agentd.language.terms.terms import EMPTY, Code, Expression, Literal, Open, Var, deref, equal, make_list, proper
from agentd.mind.beliefs.term_copy import closed, resolve
from agentd.mind.beliefs.unification import Trail, unify, value
from agentd.mind.data.code_terms import parts_of
from agentd.mind.state import MindState


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


def same(left: Any, right: Any) -> bool:
    """``==``: equality without binding, arithmetic computed. Linked free variables are not equal (rule 25)."""
    if type(left) is Literal and type(right) is Literal:
        if left.sig is not right.sig:
            return False
        if left is right:
            return True
    if type(left) is Var and type(right) is Var and left is not right and type(deref(left)) is Var:
        return False
    return equal(resolve(left), resolve(right))


def univ(left: Any, right: Any, trail: Trail) -> bool:
    """``=..``: a literal or plan and the list of its parts."""
    term = value(left)
    if type(term) is Open:
        term = closed(term)
    if type(term) is Literal:
        sig = term.sig
        name = Literal(signature(("~" if sig.negated else "") + sig.functor))
        parts = [name, make_list(term.args), make_list(term.annots)]
        wanted = proper(right)
        if wanted is None or len(wanted) != 3:
            parts.insert(0, Literal(signature(sig.namespace)))
        return unify(make_list(parts), right, trail)
    if type(term) is Code:
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


def arithmetic(mind: MindState, operator: str, *operands: Any) -> Any:
    """An operation in generated code whose operands are not simply numbers."""
    result = calculate(operator, operands)
    if result != result:
        for operand in operands:
            operand = value(operand)
            if type(operand) is not float and type(operand) is not Var and type(operand) is not Expression:
                mind.warn_once(f"'{text(operand)}' is not a number; {operator} gives NaN")
    return result
