"""What is printed reads back as itself: terms, literals, triggers, plans, programs; values as a program shows them."""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, given, settings

from agentd.language.parse import parse_literal, parse_plan, parse_program, parse_term, parse_trigger
from agentd.language.syntax_tree.nodes import Plan, Program, Structure, Term, Trigger
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.format import text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import equal
from tests.agentd.generated_programs import literals, plans, programs, terms, triggers
from tests.agentd.generated_terms import printable
from tests.support.amount import some_of

SLOW_TO_MAKE = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)
SOME = settings(max_examples=some_of(60), deadline=None, derandomize=True, suppress_health_check=SLOW_TO_MAKE)


@settings(SOME, max_examples=some_of(200))
@given(terms)
def test_a_printed_term_reads_back_as_itself(term: Term) -> None:
    assert parse_term(source_text(term)) == term


@SOME
@given(literals(terms))
def test_a_printed_literal_reads_back_as_itself(literal: Structure) -> None:
    assert parse_literal(source_text(literal)) == literal


@SOME
@given(triggers(terms))
def test_a_printed_trigger_reads_back_as_itself(trigger: Trigger) -> None:
    assert parse_trigger(source_text(trigger)) == trigger


@SOME
@given(plans(terms))
def test_a_printed_plan_reads_back_as_itself(plan: Plan) -> None:
    assert parse_plan(source_text(plan)) == plan


@SOME
@given(programs)
def test_a_printed_program_reads_back_as_itself(program: Program) -> None:
    assert parse_program(source_text(program), "a.asl").items == program.items


@SOME
@given(printable)
def test_a_value_as_print_shows_it_reads_back_as_itself(term: Any) -> None:
    assert equal(instantiate(parse_term(text(term))), term)
