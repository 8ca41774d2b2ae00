"""Whatever the text, the parser reads it or says what is wrong; whatever the tree, it prints and reads back."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings

from agentd.check import check_program
from agentd.language.errors import SyntaxErrors
from agentd.language.parser import parse_program, parse_term
from agentd.language.printer import source_text
from agentd.language.syntax import Program, Term
from tests.agentd.generated_programs import anything, programs, terms

SLOW_TO_MAKE = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


@settings(max_examples=2000, deadline=None, suppress_health_check=SLOW_TO_MAKE)
@given(anything)
def test_any_text_is_a_program_or_is_refused_in_words(text: str) -> None:
    try:
        program = parse_program(text, "a.asl")
    except SyntaxErrors as errors:
        lines = text.count("\n") + 1
        assert errors.findings
        for finding in errors.findings:
            assert finding.file == "a.asl"
            assert 1 <= finding.line <= lines + 1
            assert finding.message
            assert "\n" not in finding.message
    else:
        assert parse_program(source_text(program), "a.asl").items == program.items
        check_program(program, {}, {})


@settings(max_examples=500, deadline=None, suppress_health_check=SLOW_TO_MAKE)
@given(terms)
def test_a_printed_term_reads_back_as_itself(term: Term) -> None:
    assert parse_term(source_text(term)) == term


@settings(max_examples=200, deadline=None, suppress_health_check=SLOW_TO_MAKE)
@given(programs)
def test_a_printed_program_reads_back_as_itself(program: Program) -> None:
    assert parse_program(source_text(program), "a.asl").items == program.items
