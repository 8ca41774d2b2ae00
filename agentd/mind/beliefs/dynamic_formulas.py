"""Formulas, relations and functions evaluated at run time.

`solve` walks a formula that a variable holds or a question contains. Relations and arithmetic are for operands of which
the compiler knows too little. Functions are those of the library and those that a program defines by a rule.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from operator import ge, gt, le, lt
from typing import Any, Final

from agentd.language.syntax_tree.signatures import DEFAULT, signature
from agentd.language.terms.format import text
from agentd.language.terms.from_ast import calculate
from agentd.language.terms.order import compare, sorted_annots
from agentd.language.terms.terms import (
    EMPTY,
    Code,
    Expression,
    Literal,
    Open,
    Term,
    Var,
    deref,
    equal,
    make_list,
    proper,
)
from agentd.mind.beliefs.term_copy import closed, resolve
from agentd.mind.beliefs.unification import Trail, subsets, undo, unify, value
from agentd.mind.beliefs.work_limit import work
from agentd.mind.plans.plan_terms import parts_of
from agentd.mind.state import MindState


def solve(mind: MindState, formula: Term, trail: Trail) -> Iterator[None]:
    """One solution after another of a formula; bindings are undone between them and kept at the last yield."""
    formula = deref(formula)
    mark = len(trail)
    work(mind, 1)
    if mind.asked is not None:
        mind.asked.work()
    if type(formula) is Open:
        formula = closed(formula)
    if type(formula) is Literal:
        yield from _literal(mind, formula, trail)
    elif type(formula) is Open and formula.literal is not None:
        for sig_literal in _namespaces(mind, formula, trail):
            yield from _literal(mind, sig_literal, trail)
    elif type(formula) is Expression:
        yield from _expression(mind, formula, trail)
    undo(trail, mark)


def _namespaces(mind: MindState, formula: Open, trail: Trail) -> Iterator[Literal]:
    """Yield the literal in each namespace that its namespace variable may be bound to."""
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


def _literal(mind: MindState, formula: Literal, trail: Trail) -> Iterator[None]:
    sig = formula.sig
    if sig.functor == "true" and not sig.arity:
        yield
        return
    if "." in sig.functor and not sig.functor.startswith("'"):
        yield from _internal_action(mind, formula, trail)
        return
    if mind.asked is not None:
        mind.asked.copies(formula)
    predicate = mind.beliefs.known(sig)
    if predicate is None:
        return
    args = tuple([resolve(a) for a in formula.args])
    for found, annots in predicate.literals((True,) * sig.arity, args, mind, trail):
        if mind.asked is not None:
            mind.asked.work()
        mark = len(trail)  # per answer: a rule needs its bindings to find the next one
        if unify(formula.bare(), Literal(sig, found), trail):
            yield from subsets(formula.annots, annots, trail)
        undo(trail, mark)


def _internal_action(mind: MindState, formula: Literal, trail: Trail) -> Iterator[None]:
    asked = mind.asked
    if asked is not None:
        asked.action(formula.sig.functor, formula.args)  # before it is looked for: that may import a package
    action = mind.compiler.action(formula.sig.functor, formula.sig.arity)
    if action is None:
        return
    mark = len(trail)
    outcome = action.guarded()(mind, trail, *formula.args)
    if action.backtracks:
        for _ in outcome:
            if asked is not None:
                asked.work()
            yield
    elif outcome:
        yield
    undo(trail, mark)


def _expression(mind: MindState, formula: Expression, trail: Trail) -> Iterator[None]:
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
    elif len(operands) == 2:
        if mind.asked is not None:
            mind.asked.copies(formula)
        left, right = (computed(mind, operand) for operand in operands)
        if relation_holds(operator, left, right, trail):
            yield


def computed(mind: MindState, term: Term) -> Any:
    """Return a side of a relation with the functions in it computed, now that their variables may have values."""
    term = deref(term)
    if type(term) is Expression:
        return Expression(term.operator, tuple([computed(mind, operand) for operand in term.operands]))
    if type(term) is not Literal or not _is_function(mind, term.sig.functor, term.sig.arity):
        return term
    function = mind.compiler.function(term.sig.functor, term.sig.arity)
    value = function(mind, *[deref(computed(mind, argument)) for argument in resolve(term).args])
    return term if value is None else value


def _is_function(mind: MindState, name: str, arity: int) -> bool:
    if mind.asked is None:
        return bool(mind.compiler.is_function(name, arity))
    own = mind.compiler.is_own_function(name, arity)
    return bool(mind.asked.function(name, own or (name, arity) in mind.compiler.functions(), own))


# --- relations and arithmetic ---


def relation_holds(operator: str, left: Term, right: Term, trail: Trail) -> bool:
    """Return whether a relation holds; ``=`` and ``=..`` may bind."""
    match operator:
        case "=":
            return unify(left, right, trail)
        case "=..":
            return univ(left, right, trail)
        case "==":
            return same(left, right)
        case "\\==":
            return not same(left, right)
    return operator in _ORDERS and bool(_ORDERS[operator](order(left, right), 0))


_ORDERS: Final = {"<": lt, "<=": le, ">": gt, ">=": ge}


def order(left: Term, right: Term) -> int:
    """Return the standard order of two terms, arithmetic computed first. NaN is before and after nothing."""
    return compare(value(left), value(right))


def same(left: Term, right: Term) -> bool:
    """``==``: equality without binding, arithmetic computed. Linked free variables are not equal (rule 25)."""
    if type(left) is Literal and type(right) is Literal:
        if left.sig is not right.sig:
            return False
        if left is right:
            return True
    if type(left) is Var and type(right) is Var and left is not right and type(deref(left)) is Var:
        return False
    return equal(resolve(left), resolve(right))


def univ(left: Term, right: Term, trail: Trail) -> bool:
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


def _from_parts(parts: list[Term] | None) -> Any:
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
    """Return an operation in generated code whose operands are not simply numbers."""
    result = calculate(operator, operands)
    if result != result:
        for operand in operands:
            operand = value(operand)
            if type(operand) is not float and type(operand) is not Var and type(operand) is not Expression:
                mind.warn_once(f"'{text(operand)}' is not a number; {operator} gives NaN")
    return result


# --- functions ---


class FunctionsOf(Mapping[tuple[str, int], Callable[..., Any]]):
    """The functions that a mind's program may call, by name and number of arguments, bound to the mind."""

    def __init__(self, mind: MindState) -> None:
        self._mind = mind

    def __getitem__(self, key: tuple[str, int]) -> Callable[..., Any]:
        compute = self._mind.compiler.find_function(*key)
        if compute is None:
            raise KeyError(key)
        return partial(compute, self._mind)

    def __iter__(self) -> Iterator[tuple[str, int]]:
        return iter(self._mind.compiler.functions())

    def __len__(self) -> int:
        return len(self._mind.compiler.functions())


def call(function: Any, mind: MindState, trail: Trail, sig: Any, args: tuple[Term, ...]) -> Any:
    """Return a function of the program; a call that cannot be computed stays a term."""
    value = function(mind, *[deref(a) for a in args])
    return Literal(sig, args) if value is None else value


def by_rule(name: str, arity: int) -> Callable[..., Any]:
    """Return the function of ``arity`` arguments that asks the rule ``name`` for one more, its last argument."""
    sig = signature(name, arity + 1)
    mode = (True,) * arity + (False,)

    def compute(mind: MindState, *args: Any) -> Any:
        action = mind.compiler.action(name, arity + 1)
        if action is not None:
            return _by_action(mind, action, args)
        trail: list[Var] = []
        for found in mind.beliefs.predicate(sig).solve(mode, (*args, None), mind, trail):
            value = resolve(deref(found[-1]))
            undo(trail, 0)
            return value
        return None

    return compute


def _by_action(mind: MindState, action: Any, args: tuple[Term, ...]) -> Any:
    result = Var("Result")
    trail: list[Var] = []
    outcome = action.guarded()(mind, trail, *args, result)
    value = None
    if next(iter(outcome), 0) is None if action.backtracks else outcome:
        value = resolve(result)
    undo(trail, 0)
    return value
