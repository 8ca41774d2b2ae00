"""Run-time terms: equality, hashes, the standard order, and the way over the bus and back."""

from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.parse import parse_term
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.order import compare, distinct, ordered, sorted_annots
from agentd.language.terms.terms import Literal, equal
from schemas.wire.codec import Codec, Wire
from schemas.wire.records import Perception
from schemas.wire.terms import Source, Structure
from tests.agentd.generated_terms import any_terms, ground, made_again
from tests.support.amount import some_of

FEW = settings(max_examples=some_of(100, 2), deadline=None, derandomize=True)
SLOW_TO_MAKE = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


@FEW
@given(ground)
def test_a_term_equals_its_copy_and_has_its_hash(term: Any) -> None:
    other = made_again(term)
    assert term == other
    assert hash(term) == hash(other)


@FEW
@given(ground, ground)
def test_terms_are_equal_just_when_neither_comes_before_the_other(one: Any, other: Any) -> None:
    assert equal(one, other) == (compare(one, other) == 0)
    if equal(one, other):
        assert hash(one) == hash(other)


@FEW
@given(ground, ground, ground)
def test_the_standard_order_is_total(a: Any, b: Any, c: Any) -> None:
    assert compare(a, a) == 0
    assert (compare(a, b) > 0) == (compare(b, a) < 0)
    low, middle, high = ordered([a, b, c])
    assert compare(low, middle) <= 0
    assert compare(middle, high) <= 0
    assert compare(low, high) <= 0
    assert distinct([a, b, c, a, b, c]) == distinct([c, b, a])


@pytest.mark.parametrize("wire", ["json", "msgpack"])
@FEW
@given(term=ground)
def test_a_ground_term_comes_back_from_the_bus_as_it_went(term: Any, wire: Wire) -> None:
    codec = Codec(Perception)
    sent = Perception(name="b", parameters=(to_wire(term),))
    back = codec.decode(codec.encode(sent, wire), codec.encodings[wire])
    assert equal(from_wire(back.parameters[0]), term)


@settings(FEW, suppress_health_check=SLOW_TO_MAKE)
@example(instantiate(parse_term("a[|R]")))
@given(any_terms)
def test_any_term_that_crosses_the_bus_is_sent_on_as_it_came(term: Any) -> None:
    try:
        sent = to_wire(term)
    except BadTerm:
        return
    assert to_wire(from_wire(sent)) == sent


def test_code_in_a_message_that_takes_long_to_parse_is_refused() -> None:
    source = Source("plan", f"{{ +!g <- {'a; ' * 15_000}a }}")
    assert from_wire([source, source])
    with pytest.raises(BadTerm, match="more than 100000 characters of code"):
        from_wire([source, Structure("f", (source, source))])


@FEW
@given(ground, ground)
def test_annotations_are_a_set(one: Any, other: Any) -> None:
    left = Literal(signature("b"), (), sorted_annots([one, other, one]))
    right = Literal(signature("b"), (), sorted_annots([other, one]))
    assert left == right
