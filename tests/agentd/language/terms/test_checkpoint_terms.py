"""Terms as a checkpoint keeps them: every term that a mind may hold comes back equal, or it is said why not."""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agentd.language.parse import parse_program
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.source_annotations import SELF, told_by
from agentd.language.terms.terms import (
    EMPTY,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Var,
    atom,
    make_list,
)
from agentd.mind.persistence.term_codec import (
    BadBytes,
    CannotKeep,
    read_terms,
    terms_from_bytes,
    terms_to_bytes,
    write_terms,
)
from tests.agentd.generated_terms import any_terms, ground
from tests.agentd.minds import term


def again(one: Any) -> Any:
    (found,) = terms_from_bytes(terms_to_bytes([one]))
    return found


def test_a_long_text_that_is_in_a_term_many_times_is_not_kept() -> None:
    assert again(make_list(["x" * 1_000_000] * 2)) == make_list(["x" * 1_000_000] * 2)
    with pytest.raises(CannotKeep, match="more than 1000000 parts"):
        terms_to_bytes([make_list(["x" * 1_000_000] * 40)])


@given(ground)
def test_a_ground_term_comes_back_equal(one: Any) -> None:
    assert again(one) == one


@given(any_terms)
def test_any_term_that_a_program_can_write_comes_back_as_it_was(one: Any) -> None:
    found = again(one)
    assert type(found) is type(one)
    assert text(found) == text(one)


@given(any_terms)
def test_code_comes_back_with_the_same_syntax(one: Any) -> None:
    if type(one) is Code:
        assert again(one).syntax == one.syntax


@pytest.mark.parametrize("number", [0.0, -0.0, 1e308, -1.5, math.inf, -math.inf, math.nan, 5e-324])
def test_a_number_comes_back_to_the_last_bit(number: float) -> None:
    found = again(number)
    assert type(found) is float
    assert found.hex() == number.hex()


@pytest.mark.parametrize("name", ["Bob", "two words", "'it''s'", "", "ünïcode", ".print", "a.b.c", "with\nline"])
def test_an_atom_of_any_name_comes_back_though_no_program_could_write_it(name: str) -> None:
    assert again(atom(name)) == atom(name)


def test_variables_that_are_the_same_stay_the_same_and_others_stay_apart() -> None:
    x, y = Var("X"), Var("X")
    first, second = terms_from_bytes(terms_to_bytes([Literal(signature("p", 3), (x, y, x)), x]))
    assert first.args[0] is first.args[2] is second
    assert first.args[0] is not first.args[1]
    assert first.args[0].name == "X"


def test_a_bound_variable_is_kept_as_its_value() -> None:
    x = Var("X")
    x.ref = atom("here")
    assert again(Literal(signature("at", 1), (x,))) == term("at(here)")


def test_common_sources_come_back_as_the_one_object_that_comparisons_look_for() -> None:
    assert again(Literal(signature("p"), (), SELF)).annots is SELF
    assert again(Literal(signature("p"), (), told_by("ann"))).annots is told_by("ann")
    nested = term("p[source(ann)[source(bob)]]")
    assert again(nested) == nested


def test_a_term_that_was_known_to_be_ground_is_known_to_be_ground() -> None:
    assert again(term("p(f(1),[a,g(2)])")).ground
    assert not again(term("p(f(X))")).ground


@pytest.mark.parametrize(
    "collection",
    [
        Collection("map", {atom("k"): 1.0, "s": make_list([atom("v")]), 2.0: Collection("set", [])}),
        Collection("set", [1.0, atom("a")]),
        Collection("queue", [atom("b"), atom("a")]),
        Collection("priority", []),
    ],
)
def test_a_map_set_or_queue_comes_back_and_is_known_to_change_in_place(collection: Collection) -> None:
    data, changeable = write_terms([Literal(signature("has", 1), (collection,))])
    (found,), read_changeable = read_terms(data)
    assert found.args[0] == collection
    assert found.args[0].kind == collection.kind
    assert changeable
    assert read_changeable
    assert not write_terms([atom("a")])[1]


def test_code_keeps_the_values_of_its_variables_whatever_they_are() -> None:
    plan = term("{ +!g(X) : p(Y) <- .print(X, Y) }")
    code = Code(plan.syntax, {"Y": make_list([1.0, Collection("map", {"a": 1.0})]), "Z": Var("Free")})
    found = again(code)
    assert found.syntax == code.syntax
    assert found.values["Y"] == code.values["Y"]
    assert type(found.values["Z"]) is Var


def test_code_keeps_the_file_and_line_where_it_was_written() -> None:
    program = parse_program("a.\n\n\n+!g <- .print(1).\n", "mission/scout.asl")
    (plan,) = [item for item in program.items if isinstance(item, nodes.Plan)]
    found = again(Code(plan)).syntax
    assert (found.position.file, found.position.line) == ("mission/scout.asl", 4)


@pytest.mark.parametrize("depth", [100, 50_000])
def test_a_term_of_any_depth_comes_back(depth: int) -> None:
    one: Any = atom("x")
    for _ in range(depth):
        one = Literal(signature("f", 1), (one,))
    found, levels = again(one), 0
    while found.args:
        found, levels = found.args[0], levels + 1
    assert levels == depth


def test_a_cyclic_term_is_refused_in_words() -> None:
    x = Var("X")
    x.ref = Literal(signature("f", 1), (x,))
    with pytest.raises(CannotKeep, match="cyclic"):
        terms_to_bytes([x])


def test_a_map_that_holds_itself_is_refused_in_words() -> None:
    endless = Collection("map", {})
    endless.content["me"] = make_list([Collection("set", [endless])])
    with pytest.raises(CannotKeep, match="it is a map that contains itself"):
        terms_to_bytes([endless])


def test_a_map_that_stands_in_two_places_is_written_in_both() -> None:
    twice = Collection("map", {atom("k"): 1.0})
    pair = make_list([twice, Collection("queue", [twice]), twice])
    assert text(again(pair)) == text(pair)


def test_a_term_that_grows_beyond_measure_when_written_out_is_refused() -> None:
    one: Any = atom("x")
    for _ in range(40):
        one = Literal(signature("f", 2), (one, one))
    with pytest.raises(CannotKeep, match="parts"):
        terms_to_bytes([one])


def test_half_a_surrogate_pair_is_refused_in_words() -> None:
    with pytest.raises(CannotKeep, match="cannot be encoded"):
        terms_to_bytes(["\ud800"])


def test_what_is_no_term_is_refused_in_words() -> None:
    with pytest.raises(CannotKeep, match="a int is no term"):
        terms_to_bytes([Literal(signature("p", 1), (1,))])


def test_code_that_would_not_read_back_is_refused_when_it_is_kept_not_when_it_is_needed() -> None:
    odd = nodes.Body((nodes.Step(nodes.Operator.ADD, nodes.Structure("No Name")),))
    with pytest.raises(CannotKeep, match="No Name"):
        terms_to_bytes([Code(odd)])


@given(st.binary(max_size=40))
def test_bytes_that_are_no_terms_are_refused_and_nothing_else_happens(data: bytes) -> None:
    try:
        terms_from_bytes(data)
    except BadBytes:
        return
    msgspec.msgpack.decode(data)


_tokens = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 12) | st.floats() | st.text(max_size=2),
    lambda inner: st.lists(inner, max_size=5),
    max_leaves=10,
)


@given(st.lists(_tokens, max_size=6))
def test_tokens_that_are_no_terms_are_refused_and_nothing_else_happens(tokens: list[Any]) -> None:
    try:
        found = terms_from_bytes(msgspec.msgpack.encode(tokens))
    except BadBytes:
        return
    for one in found:
        assert type(one) in (float, str, Literal, List, Var, Expression, Code, Open, Rest, Collection) or one is EMPTY
