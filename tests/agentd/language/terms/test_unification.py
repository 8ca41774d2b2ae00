"""Unification: what a textbook says of plain terms, and the subset rule of annotations."""

from typing import Any

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.order import is_in, sorted_annots
from agentd.language.terms.terms import EMPTY, List, Literal, Rest, Var, elements, equal
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, undo, unify
from tests.agentd.generated_terms import ground, plain_pairs, variables_of
from tests.agentd.minds import run
from tests.support.amount import some_of

FEW = settings(max_examples=some_of(100, 2), deadline=None, derandomize=True)


def by_the_book(left: Any, right: Any) -> dict[Var, Any] | None:
    """The most general unifier of plain terms, by Robinson; None if there is none. Assumes that none is cyclic."""
    bindings: dict[Var, Any] = {}

    def follow(term: Any) -> Any:
        while isinstance(term, Var) and term in bindings:
            term = bindings[term]
        return term

    def occurs(variable: Var, term: Any) -> bool:
        term = follow(term)
        return term is variable or any(occurs(variable, part) for part in _parts(term))

    pending = [(left, right)]
    while pending:
        one, other = (follow(term) for term in pending.pop())
        if one is other:
            continue
        if isinstance(other, Var):
            one, other = other, one
        if isinstance(one, Var):
            assume(not occurs(one, other))  # X = f(X) succeeds here, as in Jason (rule 27)
            bindings[one] = other
        elif type(one) is not type(other) or _name(one) != _name(other):
            return None
        elif isinstance(one, float | str):
            if one != other:
                return None
        else:
            pending += zip(_parts(one), _parts(other), strict=True)
    return bindings


def _name(term: Any) -> Any:
    return term.sig if isinstance(term, Literal) else term is EMPTY


def _parts(term: Any) -> tuple[Any, ...]:
    if isinstance(term, Literal):
        return term.args
    return (term.head, term.rest()) if isinstance(term, List) and term is not EMPTY else ()


@FEW
@given(plain_pairs())
def test_plain_terms_unify_just_when_the_textbook_says_so_and_are_equal_then(pair: tuple[Any, Any]) -> None:
    expected = by_the_book(*pair)
    assert unify(*pair, []) == (expected is not None)
    if expected is not None:
        assert equal(resolve(pair[0]), resolve(pair[1]))


@FEW
@given(plain_pairs())
def test_unifying_plain_terms_is_symmetric(pair: tuple[Any, Any]) -> None:
    by_the_book(*pair)
    trail: Trail = []
    forth = unify(*pair, trail)
    undo(trail, 0)
    assert unify(pair[1], pair[0], []) == forth


@FEW
@given(plain_pairs())
def test_unifying_once_more_binds_nothing_more(pair: tuple[Any, Any]) -> None:
    by_the_book(*pair)
    trail: Trail = []
    assume(unify(*pair, trail))
    bound = len(trail)
    assert unify(*pair, trail)
    assert len(trail) == bound


@FEW
@given(plain_pairs())
def test_after_undoing_no_variable_is_bound_whether_it_failed_or_not(pair: tuple[Any, Any]) -> None:
    free = variables_of(pair[0]) | variables_of(pair[1])
    trail: Trail = []
    unify(*pair, trail)
    undo(trail, 0)
    assert all(variable.ref is None for variable in free)


@FEW
@given(plain_pairs())
def test_compiled_unification_does_the_same_and_leaves_no_bindings_when_it_fails(pair: tuple[Any, Any]) -> None:
    expected = by_the_book(*pair)
    left, right = text(pair[0]), text(pair[1])
    world = run(f"!g.\n+!g <- if ({left} = {right}) {{ .print(yes) }} else {{ .print(X, Y, Z) }}.")
    assert world.prints == ["yes" if expected is not None else "X<no-value>Y<no-value>Z<no-value>"]
    world = run(f"!g.\n+!g : {left} = {right} <- .print(yes).\n+!g : true <- .print(X, Y, Z).")
    assert world.prints == ["yes" if expected is not None else "X<no-value>Y<no-value>Z<no-value>"]


@FEW
@given(ground, ground)
def test_ground_terms_without_annotations_unify_just_when_they_are_equal(one: Any, other: Any) -> None:
    one, other = _bare(one), _bare(other)
    trail: Trail = []
    assert unify(one, other, trail) == equal(one, other)
    assert trail == []


def _bare(term: Any) -> Any:
    if isinstance(term, Literal):
        return Literal(term.sig, tuple(map(_bare, term.args)))
    return List(tuple(map(_bare, term.items)), EMPTY) if isinstance(term, List) and term is not EMPTY else term


annotations = st.lists(ground.map(_bare), max_size=4)


@FEW
@given(annotations, annotations, st.booleans())
def test_annotations_of_the_left_must_be_a_subset_of_the_rights(left: list[Any], right: list[Any], part: bool) -> None:
    if part:
        right = [*left, *right]
    few, many = sorted_annots(left), sorted_annots(right)
    holds = all(is_in(list(many), annotation) for annotation in few)
    name = signature("b")
    assert unify(Literal(name, (), few), Literal(name, (), many), []) == holds
    inside = signature("f", 1)
    nested = (Literal(inside, (Literal(name, (), annots),)) for annots in (few, many))
    assert unify(*nested, []) == holds


@FEW
@given(annotations, annotations)
def test_what_is_left_over_of_the_annotations_goes_to_the_tail(left: list[Any], more: list[Any]) -> None:
    few, many = sorted_annots(left), sorted_annots([*left, *more])
    tail, name = Var("R"), signature("b")
    assert unify(Literal(name, (), (*few, Rest(tail))), Literal(name, (), many), [])
    rest = list(elements(tail))
    assert sorted_annots([*few, *rest]) == many
    assert len(few) + len(rest) == len(many)
