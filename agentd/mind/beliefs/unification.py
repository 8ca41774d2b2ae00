"""Unification of terms, with or without decorations and annotations, and of code as terms.

Bindings are written into `Var` cells and noted on a *trail*, a list of the cells bound, so that they can be undone.
Every function that may bind takes the trail as an argument.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT, signature
from agentd.language.terms.from_ast import Instantiation, calculate, instantiate
from agentd.language.terms.terms import (
    ARITHMETIC,
    EMPTY,
    FIRST_NODES,
    MOST_NODES,
    TRUE,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Term,
    Var,
    deref,
    further,
    make_list,
)

Trail = list[Var]


def undo(trail: Trail, mark: int) -> None:
    """Free every variable bound since the trail had the length ``mark``."""
    while len(trail) > mark:
        trail.pop().ref = None


def bound_again(trail: Trail, mark: int, answer: Any) -> Iterator[Any]:
    """Give an answer; afterwards everything that was bound since ``mark`` is bound again."""
    bound = [(variable, variable.ref) for variable in trail[mark:]]
    yield answer
    del trail[mark:]
    for variable, term in bound:
        variable.ref = term
        trail.append(variable)


def value(term: Term) -> Any:
    """Return a term with its chain of variables followed, and the result of arithmetic that can be computed now."""
    term = deref(term)
    if type(term) is Expression and term.operator in ARITHMETIC:
        computed = calculate(term.operator, term.operands)
        return computed if type(computed) is float else term
    return term


def unify(left: Any, right: Any, trail: Trail) -> bool:
    """Make two terms equal by binding variables. Annotations of the left must be a subset of those of the right.

    False leaves the bindings made so far on the trail, for the caller to `undo`.
    """
    pending: list[tuple[Any, Any]] | None = None
    budget, rest = FIRST_NODES, MOST_NODES
    while True:
        left, right = deref(left), deref(right)
        if left is not right:
            kind = type(left)
            if kind is float or kind is str:
                if left != right and not _unify_other(left, right, trail):
                    return False
            elif kind is Literal and type(right) is Literal:
                if left.sig is not right.sig:
                    return False
                if left.annots and not subset(left.annots, right.annots, trail):
                    return False
                if left.args:
                    if pending is None:
                        pending = []
                    pending.extend(zip(reversed(left.args), reversed(right.args), strict=True))
            elif kind is List and type(right) is List:
                if left is EMPTY or right is EMPTY:
                    return False
                if pending is None:
                    pending = []
                pending.append((left.rest(), right.rest()))
                pending.append((left.items[left.at], right.items[right.at]))
            elif not _unify_other(left, right, trail):
                return False
        if not pending:
            return True
        budget -= 1
        if not budget:
            budget, rest = further(rest, pending, "unified")
        left, right = pending.pop()


def alternatives(term: Term, values: Iterable[Any], trail: Trail) -> Iterator[None]:
    """One solution for each of the values that a term unifies with; bindings are undone between them."""
    mark = len(trail)
    for value in values:
        if unify(term, value, trail):
            yield None
        undo(trail, mark)


def _unify_other(left: Term, right: Term, trail: Trail) -> bool:
    """Return the rare pairs: variables, expressions, decorated variables, code."""
    if type(left) is Open:
        return _unify_open(left, right, trail, left_side=True)
    if type(right) is Open:
        return _unify_open(right, left, trail, left_side=False)
    if type(left) is Var:
        return bind(left, right, trail)
    if type(right) is Var:
        return bind(right, left, trail)
    if type(left) is Expression or type(right) is Expression:
        return _unify_expressions(value(left), value(right), trail)
    if type(left) is Code and type(right) is Code:
        return _unify_code(left, right, trail)
    if type(left) is Collection or type(left) is float:
        return bool(left == right)
    return False


def bind(variable: Var, term: Term, trail: Trail) -> bool:
    """Bind a free variable. A plain variable takes no literal of another namespace."""
    term = value(term)
    if term is variable:
        return True
    if type(term) is Literal and term.sig.namespace != DEFAULT:
        return False
    if type(term) is Var and term.depth > variable.depth:
        variable, term = term, variable
    variable.ref = term
    trail.append(variable)
    return True


def _unify_expressions(left: Term, right: Term, trail: Trail) -> bool:
    if type(left) is Expression and type(right) is Expression:
        if left.operator != right.operator or len(left.operands) != len(right.operands):
            return False
        return all(unify(a, b, trail) for a, b in zip(left.operands, right.operands, strict=True))
    if type(left) is Expression or type(right) is Expression:
        return False
    return unify(left, right, trail)


def _unify_open(pattern: Open, other: Any, trail: Trail, left_side: bool) -> bool:
    """Unify a decorated variable with a term: remove the decorations and unify the remainder."""
    other = value(other)
    if type(other) is Var:
        other.ref = pattern
        trail.append(other)
        return True
    if type(other) is not Literal:
        if pattern.literal is None and pattern.annots is None and not pattern.negated and pattern.namespace is None:
            return unify(pattern.variable, other, trail)
        return False
    if pattern.literal is not None:
        if pattern.namespace is not None and not _unify_namespace(pattern.namespace, other.sig.namespace, trail):
            return False
        bare = _renamed(other, pattern.literal.sig.namespace, other.sig.negated)
        return unify(pattern.literal, bare, trail) if left_side else unify(bare, pattern.literal, trail)
    if pattern.negated and not other.sig.negated:
        return False
    if pattern.namespace is not None:
        if not _unify_namespace(pattern.namespace, other.sig.namespace, trail):
            return False
    elif other.sig.namespace != DEFAULT:
        return False
    if pattern.annots is not None and not subset(pattern.annots, other.annots, trail):
        return False
    bare = _renamed(other, DEFAULT, other.sig.negated and not pattern.negated)
    if pattern.annots is not None:
        bare = bare.bare()
    return unify(pattern.variable, bare, trail)


def _unify_namespace(namespace: Term, actual: str, trail: Trail) -> bool:
    if isinstance(namespace, str):
        return namespace == actual
    return unify(namespace, Literal(signature(actual)), trail)


def _renamed(literal: Literal, namespace: str, negated: bool) -> Literal:
    sig = literal.sig
    if sig.namespace == namespace and sig.negated == negated:
        return literal
    return Literal(signature(sig.functor, sig.arity, negated, namespace), literal.args, literal.annots)


def subset(left: tuple[Term, ...], right: tuple[Term, ...], trail: Trail) -> bool:
    """Return whether each annotation on the left unifies with one on the right (first fit, no backtracking).

    A `Rest` at the end of the left is bound to the remaining annotations of the right.
    """
    for _ in subsets(left, right, trail):
        return True
    return False


def subsets(left: tuple[Any, ...], right: tuple[Any, ...], trail: Trail) -> Any:
    """One solution after another of ``left`` being a subset of ``right``; bindings are undone between them."""
    if not left:
        yield None
        return
    first, others = left[0], left[1:]
    mark = len(trail)
    if type(first) is Rest:
        if unify(first.tail, make_list(right), trail):
            yield None
        undo(trail, mark)
        return
    keep = bool(others) and type(others[-1]) is Rest
    for i, candidate in enumerate(right):
        if unify(first, candidate, trail):
            yield from subsets(others, right[:i] + right[i + 1 :] if keep else right, trail)
        undo(trail, mark)


def in_default(term: Term) -> bool:
    """Return whether a plain variable takes a term: no literal of another namespace (rule 100)."""
    term = deref(term)
    return type(term) is not Literal or term.sig.namespace == DEFAULT


def open_structure(term: Term, sig: Any, trail: Trail) -> Any:
    """Return the arguments of a term that shall be a structure of this signature; None if it is something else.

    A free variable becomes such a structure, with new variables as arguments.
    """
    term = value(term)
    if type(term) is Literal:
        return term.args if term.sig is sig else None
    if type(term) is Var:
        args = tuple(Var() for _ in range(sig.arity))
        return args if bind(term, Literal(sig, args), trail) else None
    return None


def open_bare(term: Term, sig: Any, trail: Trail) -> Any:
    """`open_structure` of a term that shall have no annotations."""
    term = value(term)
    return None if type(term) is Literal and term.annots else open_structure(term, sig, trail)


def open_list(term: Term, trail: Trail) -> Any:
    """Head and tail of a term that shall be a non-empty list, else None. A free variable becomes such a list."""
    term = deref(term)
    if type(term) is List:
        return None if term is EMPTY else (term.items[term.at], term.rest())
    if type(term) is Var:
        head, tail = Var(), Var()
        bind(term, List((head,), tail), trail)
        return head, tail
    return None


def _unify_code(left: Code, right: Code, trail: Trail) -> bool:
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
    """``{ H; T }`` splits a body; a variable at the end of the left side is bound to the remaining formulas.

    The value of such a variable prints without braces, as in Jason.
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


def _lone_variable(formula: object, values: dict[str, Any]) -> Any:
    if isinstance(formula, nodes.Step) and not formula.operator.value and isinstance(formula.term, nodes.Variable):
        return instantiate(formula.term, values)
    return None


def _unify_formulas(a: Any, a_values: dict[str, Any], b: Any, b_values: dict[str, Any], trail: Trail) -> bool:
    if isinstance(a, nodes.Step) and isinstance(b, nodes.Step):
        if a.operator is not b.operator:
            return False
        return unify(instantiate(a.term, a_values), instantiate(b.term, b_values), trail)
    return bool(a == b)
