"""Formulas that only the run knows: held by a variable, sent in a question. They are walked, not compiled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Expression, Literal, Open, deref
from agentd.mind.beliefs.relations import relation_holds
from agentd.mind.beliefs.term_copy import closed, resolve
from agentd.mind.beliefs.unification import Trail, subsets, undo, unify
from agentd.mind.beliefs.work_limit import work
from agentd.mind.state import MindState


def solve(mind: MindState, formula: Any, trail: Trail) -> Iterator[None]:
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


def _literal(mind: MindState, formula: Literal, trail: Trail) -> Iterator[None]:
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
    args = tuple([resolve(a) for a in formula.args])
    for found, annots in predicate.literals((True,) * sig.arity, args, mind, trail):
        if mind.asked is not None:
            mind.asked.work()
        mark = len(trail)  # of each answer anew: a rule needs what it has bound to find the next one
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
        left, right = (computed(mind, operand) for operand in operands)
        if relation_holds(operator, left, right, trail):
            yield


def computed(mind: MindState, term: Any) -> Any:
    """A side of a relation with the functions in it computed, now that their variables may have values."""
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
