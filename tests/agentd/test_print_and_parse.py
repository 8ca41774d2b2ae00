"""What is printed reads back as itself: terms, plans, programs."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings

from agentd.language.parser import parse_program, parse_term
from agentd.language.printer import source_text
from agentd.language.syntax import Program, Term
from tests.agentd.generated_programs import programs, terms

SLOW_TO_MAKE = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


@settings(max_examples=500, deadline=None, suppress_health_check=SLOW_TO_MAKE)
@given(terms)
def test_a_printed_term_reads_back_as_itself(term: Term) -> None:
    assert parse_term(source_text(term)) == term


@settings(max_examples=200, deadline=None, suppress_health_check=SLOW_TO_MAKE)
@given(programs)
def test_a_printed_program_reads_back_as_itself(program: Program) -> None:
    assert parse_program(source_text(program), "a.asl").items == program.items
