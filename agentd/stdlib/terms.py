"""Kinds of terms, copies, annotations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from agentd.language.syntax_tree import nodes
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import is_source, source
from agentd.language.terms.terms import (
    ARITHMETIC,
    EMPTY,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Term,
    Var,
    atom,
    make_list,
    proper,
)
from agentd.mind.beliefs.term_copy import Copier, is_ground, resolve
from agentd.mind.beliefs.unification import Trail, alternatives, unify, value
from agentd.mind.data.formula_failure import argument
from agentd.mind.data.registry import ACTIONS, internal_action
from agentd.mind.state import MindState


def _is_atom(term: Term) -> bool:
    return type(term) is Literal and not term.args and not term.annots and not term.sig.negated


def _is_structure(mind: MindState, term: Term) -> bool:
    if type(term) is Literal:
        return bool(term.args or term.annots or term.sig.negated) and not _is_number(mind, term)
    return type(term) is List or type(term) is Code or _is_literal(mind, term)


def _is_number(mind: MindState, term: Term) -> bool:
    """Whether a term is a number, or arithmetic or a function that could not be computed: these count as one."""
    if type(term) is Literal:
        return bool(mind.compiler.is_function(term.sig.functor, term.sig.arity))
    return type(term) is float or (type(term) is Expression and term.operator in ARITHMETIC)


def _is_literal(mind: MindState, term: Term) -> bool:
    if type(term) is Literal:
        return not _is_number(mind, term)
    return type(term) is Expression and term.operator not in ARITHMETIC


_KINDS: Final[dict[str, Callable[[MindState, Any], bool]]] = {
    "number": _is_number,
    "atom": lambda mind, term: _is_atom(term) and not _is_number(mind, term),
    "literal": _is_literal,
    "string": lambda mind, term: type(term) is str,
    "list": lambda mind, term: type(term) is List,
    "set": lambda mind, term: type(term) is Collection and term.kind == "set",
    "map": lambda mind, term: type(term) is Collection and term.kind == "map",
    "structure": _is_structure,
    "rule": lambda mind, term: type(term) is Code and isinstance(term.syntax, nodes.Rule),
    "plan": lambda mind, term: type(term) is Code and isinstance(term.syntax, nodes.Plan),
    "queue": lambda mind, term: type(term) is Collection and term.kind in ("queue", "priority"),
    "ground": lambda mind, term: is_ground(term),
    "free": lambda mind, term: type(term) is Var,
}
"""The kinds of terms that ``.type`` gives, in this order."""


def _test(kind: str, what: str, *examples: str) -> None:
    """Register the action that tests whether a term is of a kind."""

    @internal_action(f".{kind}", 1, pure=True)
    def is_of_kind(mind: MindState, trail: Trail, term: Term) -> bool:
        return _KINDS[kind](mind, value(term))

    is_of_kind.__doc__ = "\n".join((f"``.{kind}(T)``: {what}.", "", *(f"?- .{kind}{each}" for each in examples)))


_test("atom", "an atom such as ``home``", "(home) holds", '("home") fails')
_test("number", "a number", "(3.5) holds")
_test("string", "a string", '("home") holds')
_test("list", "a list", "([a]) holds")
_test("literal", "an atom, a structure, or one negated by ``~``", "(~at(3)) holds")
_test(
    "structure",
    "it has arguments or annotations, or is negated, a list, or code in braces",
    "(at(3)) holds",
    "(home) fails",
)


@internal_action(".ground", 1, pure=True)
def ground(mind: MindState, trail: Trail, term: Term) -> bool:
    """``.ground(T)``: no variable in it is free.

    ?- .ground(at(X)) fails
    """
    return is_ground(term)


@internal_action(".internal_action", 1, pure=True)
def is_internal_action(mind: MindState, trail: Trail, term: Term) -> bool:
    """``.internal_action(T)``: T would be an internal action.

    ?- .internal_action(.print(a)) holds
    """
    term = value(term)
    return type(term) is Literal and (term.sig.functor in ACTIONS or term.sig.functor.startswith("."))


@internal_action(".type", 2, backtracks=True, pure=True)
def kind_of(mind: MindState, trail: Trail, term: Term, kind: Term) -> Iterator[None]:
    """``.type(T, K)``: each kind of the term.

    ?- .type(5, K) gives K = number; K = ground
    """
    shown = value(term)
    found = [name for name, holds in _KINDS.items() if holds(mind, shown)]
    yield from alternatives(kind, map(atom, found), trail)


@internal_action(".copy_term", 2, pure=True)
@internal_action(".rename_apart", 2, pure=True)
def copy_term(mind: MindState, trail: Trail, term: Term, result: Term) -> bool:
    """``.copy_term(T, R)``, ``.rename_apart(T, R)``: the same literal with variables of its own."""
    literal = argument(Literal, term, "only literals can be copied", "unknown")
    return unify(result, Copier(fresh=True).copy(literal), trail)


@internal_action(".add_annot", 3, pure=True)
def add_annot(mind: MindState, trail: Trail, term: Term, annot: Any, result: Term) -> bool:
    """``.add_annot(T, A, R)``: with the annotation A too; of a list, each literal of it.

    ?- .add_annot(at(3), by(gps), R) gives R = at(3)[by(gps)]
    """
    more = resolve(annot)
    return unify(result, _with_annots(term, lambda annots: sorted_annots((*annots, more))), trail)


def _with_annots(term: Term, change: Callable[[tuple[Any, ...]], tuple[Any, ...]]) -> Any:
    """A literal, or each literal of a list, with its annotations changed."""
    term = resolve(term)
    if type(term) is Literal:
        return term.with_annots(change(term.annots))
    members = proper(term) if term is not EMPTY else None
    return term if members is None else make_list([_with_annots(m, change) for m in members])


@internal_action(".add_nested_source", 3, pure=True)
def add_nested_source(mind: MindState, trail: Trail, term: Term, who: Term, result: Term) -> bool:
    """``.add_nested_source(T, S, R)``: S wraps the sources that were there.

    ?- .add_nested_source(at(3)[source(ann)], bob, R) gives R = at(3)[source(bob)[source(ann)]]
    """
    outer = source(resolve(who))

    def nested(annots: tuple[Any, ...]) -> tuple[Any, ...]:
        inner = tuple(a for a in annots if is_source(a))
        return sorted_annots((*_without_sources(annots), outer.with_annots(inner)))

    return unify(result, _with_annots(term, nested), trail)


@internal_action(".remove_source_annot", 2, pure=True)
def remove_source_annot(mind: MindState, trail: Trail, term: Term, result: Term) -> bool:
    """``.remove_source_annot(T, R)``: without its sources.

    ?- .remove_source_annot(at(3)[source(ann),by(gps)], R) gives R = at(3)[by(gps)]
    """
    return unify(result, _with_annots(term, _without_sources), trail)


def _without_sources(annots: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(a for a in annots if not is_source(a))
