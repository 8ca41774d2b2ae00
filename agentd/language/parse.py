"""AgentSpeak text to syntax trees.

Every entry point raises `SyntaxErrors` with all that is wrong with the text: after a problem in a program, parsing goes
on with the next plan.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from agentd.language.parser.ast_builder import Builder
from agentd.language.parser.build_terms import is_formula
from agentd.language.parser.fact_runs import has_many_facts, run_finder
from agentd.language.parser.lalr import Stopped, machine
from agentd.language.parser.lexer import BROKEN, Broken, Lexicon, Tokens, lexicon, tokenize
from agentd.language.parser.parse_tables import load
from agentd.language.syntax_tree.errors import SYNTAX, Problem, SyntaxErrors, problem_at, problem_on
from agentd.language.syntax_tree.nodes import Formula, Item, Plan, Program, Structure, Term, Trigger
from agentd.language.syntax_tree.signatures import THIS_NS
from agentd.language.syntax_tree.source import Source, read_source
from schemas.files.findings import Finding
from schemas.files.text_files import other_kind

MOST_PROBLEMS = 20
"""More problems than this are seldom read; parsing stops there."""
LONGEST_SHARED = 100_000
"""Characters of a file whose syntax tree is kept for the next agent that runs it; that of a larger one is not."""


def parse_program(text: str, file: str, at: tuple[int, int] | None = None) -> Program:
    """Parse a whole source file. ``file`` is the name under which its findings and positions are reported.

    ``at`` is line and column of a text that is a value in that file.
    """
    return _program(Source(text, file, at))


def parse_file(path: str | Path) -> Program:
    """`parse_program` of a file. Raises OSError as ``open`` does, `SyntaxErrors` also when it is not UTF-8 text."""
    return parse_source(lambda: read_source(path), path)


def parse_source(read: Callable[[], Source], path: str | Path) -> Program:
    """`parse_file` for a caller that reads the file itself, as `agentd.language.syntax_tree.source.read_source`
    does."""
    if other := other_kind(path, ".asl"):
        text = f"expected a program in AgentSpeak; {other}"
        raise SyntaxErrors([Problem(Finding(str(path), 0, 0, text, kind=SYNTAX), "", 0)])
    try:
        source = read()
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        message = (
            f"byte {error.start} of the file ({error.object[error.start]:#04x}) is not UTF-8 text; save it as UTF-8"
        )
        if error.object.startswith((b"\xff\xfe", b"\xfe\xff")):
            message = "the file is UTF-16 text; save it as UTF-8"
        raise SyntaxErrors([Problem(Finding(str(path), line, 0, message, kind=SYNTAX), "", 0)]) from None
    return _program(source) if len(source.text) > LONGEST_SHARED else _shared(source.text, source.file)


@lru_cache(maxsize=64)
def _shared(text: str, file: str) -> Program:
    """Parse a file once for all agents of the process that run it: a syntax tree never changes."""
    return _program(Source(text, file))


def _empty(file: str) -> Finding:
    return Finding(file, 0, 0, "the program is empty: its agent does nothing", "warning", "empty-program")


def parse_term(text: str, file: str = "<term>") -> Term:
    """Parse a term, also a logical formula or code in braces."""
    term: Term = _parse(Source(text, file), "lone_expression")
    return term


def parse_formula(text: str, file: str = "<formula>") -> Formula:
    """Parse a logical formula, such as the context of a plan."""
    source = Source(text, file)
    term: Term = _parse(source, "lone_expression")
    if is_formula(term):
        return term
    raise SyntaxErrors([problem_at(source, 0, "expected a formula that can be true or false")])


def parse_literal(text: str, file: str = "<literal>") -> Structure:
    """Parse a literal: an atom or structure, optionally negated, annotated or in a namespace. No internal action."""
    literal: Structure = _parse(Source(text, file), "lone_literal")
    return literal


def parse_plan(text: str, file: str = "<plan>") -> Plan:
    """One plan; its final dot may be missing."""
    plan: Plan = _parse(Source(text, file), "lone_plan")
    return plan


def parse_trigger(text: str, file: str = "<trigger>") -> Trigger:
    """Parse a trigger such as ``+!g(X)``, bare or in braces."""
    trigger: Trigger = _parse(Source(text, file), "lone_trigger")
    return trigger


def _program(source: Source) -> Program:
    if not has_many_facts(source.text):
        return _whole(source, recognise_facts=False)
    try:
        return _whole(source, recognise_facts=True)
    except SyntaxErrors:  # the messages need the tokens around an error
        return _whole(source, recognise_facts=False)


def _whole(source: Source, recognise_facts: bool) -> Program:
    tokens = tokenize(source, _lexicon(), _broken, find_run=run_finder(source, _items) if recognise_facts else None)
    program = _built(source, tokens, "program")
    assert isinstance(program, Program)
    warnings = tokens.warnings if program.items else [*tokens.warnings, _empty(source.file)]
    return replace(program, warnings=tuple(warnings), scoped="::" in source.text, this_ns=THIS_NS in source.text)


def _items(source: Source, start: int, end: int) -> tuple[Item, ...]:
    program = _built(source, tokenize(source, _lexicon(), _broken, start, end), "program")
    assert isinstance(program, Program)
    return program.items


@lru_cache(maxsize=1)
def _lexicon() -> Lexicon:
    return lexicon(load())


def _broken(source: Source, at: int) -> Broken:
    from agentd.language.errors.lexical import broken  # a program without errors starts without it

    return broken(source, at)


def _parse(source: Source, start: str) -> Any:
    return _built(source, tokenize(source, _lexicon(), _broken), start)


def _built(source: Source, tokens: Tokens, start: str) -> Any:
    builder = Builder(source, tokens.starts[-1], tokens.runs)
    recovery = _Recovery(source, tokens, start == "program")
    try:
        value = machine().run(tokens, start, builder, recovery)
    except Stopped:
        value = None
    builder.finish()
    problems = [*tokens.problems, *recovery.problems, *builder.problems]
    if problems:
        raise SyntaxErrors(_one_per_line(problems), value if isinstance(value, Program) else None)
    return value


def _one_per_line(problems: list[Problem]) -> list[Problem]:
    """Return the first problem of each line: the others are most often its echo."""
    found: dict[int, Problem] = {}
    for problem in sorted(problems):
        found.setdefault(problem.finding.line, problem)
    return list(found.values())[:MOST_PROBLEMS]


class _Recovery:
    """Reports a token that is not allowed, and finds the next place where a plan may begin."""

    def __init__(self, source: Source, tokens: Tokens, whole: bool) -> None:
        self.problems: list[Problem] = []
        self._source = source
        self._tokens = tokens
        self._whole = whole
        self._resumed: int | None = None

    def __call__(self, index: int, states: list[int], offsets: list[int], at_item: bool) -> int | None:
        tokens = self._tokens
        kind = tokens.types[index]
        echo = kind == BROKEN or (tokens.texts[index] == "}" and self._closes_what_was_skipped(index))
        if not echo:
            from agentd.language.errors.explain import (
                explain,  # a program without errors starts without the table of errors
            )

            line, column, message = explain(self._source, tokens, index, states, offsets)
            self.problems.append(problem_on(self._source, line, column, message))
        if not self._whole or len(self.problems) >= MOST_PROBLEMS:
            return None
        self._resumed = self._next_item(index, at_item)
        return self._resumed

    def _closes_what_was_skipped(self, index: int) -> bool:
        """Return whether a brace closes one that was opened before parsing went on after a problem."""
        if self._resumed is None:
            return False
        skipped, read = self._tokens.texts[: self._resumed], self._tokens.texts[self._resumed : index]
        return skipped.count("{") > skipped.count("}") and read.count("{") == read.count("}")

    def _next_item(self, index: int, at_item: bool) -> int:
        """Return the index of the next token that probably begins an item, or of the end of the text."""
        types, texts, first = self._tokens.types, self._tokens.texts, self._tokens.first_in_line
        for i in range(index + 1 if at_item else index, len(types) - 1):
            if i not in first:
                continue
            begins_plan = texts[i] == "@" or (texts[i] in _SIGNS and texts[i + 1] in ("!", "?"))
            begins_plan = begins_plan or (texts[i], texts[i + 1]) == ("{", "include")
            begins_item = types[i] in ("NAME", "QUOTED") or texts[i] in _ITEM_SIGNS
            if begins_plan or (i > index and types[i - 1] == "_END" and begins_item):
                return i
        return len(types) - 1


_SIGNS = frozenset("+-^")
_ITEM_SIGNS = _SIGNS | {"!", "~", "{"}
