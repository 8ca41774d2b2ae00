"""What is printed reads back as itself: terms, literals, triggers, plans, programs; values as a program shows them."""

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from agentd.language.parse import parse_literal, parse_plan, parse_program, parse_term, parse_trigger
from agentd.language.syntax_tree.nodes import Program
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.format import text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import equal
from tests.agentd.generated_programs import literals, plans, programs, terms, triggers
from tests.agentd.generated_terms import printable
from tests.support.amount import some_of

SLOW_TO_MAKE = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)
SOME = settings(max_examples=some_of(60), deadline=None, derandomize=True, suppress_health_check=SLOW_TO_MAKE)


@pytest.mark.parametrize(
    ("parse", "nodes"),
    [
        (parse_term, terms),
        (parse_literal, literals(terms)),
        (parse_trigger, triggers(terms)),
        (parse_plan, plans(terms)),
    ],
    ids=["term", "literal", "trigger", "plan"],
)
@SOME
@given(data=st.data())
def test_what_is_printed_reads_back_as_itself(parse: Any, nodes: Any, data: st.DataObject) -> None:
    node = data.draw(nodes)
    assert parse(source_text(node)) == node


@settings(SOME, max_examples=some_of(20))
@given(programs)
def test_a_printed_program_reads_back_as_itself(program: Program) -> None:
    assert parse_program(source_text(program), "a.asl").items == program.items


@SOME
@given(printable)
def test_a_value_as_print_shows_it_reads_back_as_itself(term: Any) -> None:
    assert equal(instantiate(parse_term(text(term))), term)
