"""Text to tokens, by the terminals of the grammar.

The lexer also applies deviation D1 of the dialect: where a formula of a plan body begins on a new line and can only
begin there, and the `;` before it is missing, it puts one there and reports a warning.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from msgspec import Struct, field

from agentd.language.parser.fact_runs import FactRun
from agentd.language.parser.parse_tables import Tables
from agentd.language.syntax_tree.errors import Problem
from agentd.language.syntax_tree.source import Source
from schemas.files.findings import Finding

BROKEN = "BROKEN"
"""The type of what is no token; its problem is reported already."""

END_OF_TEXT = "$END"


class Broken(NamedTuple):
    """A problem, where reading goes on behind it, and the type of token that it is read as: ``""`` for none at all."""

    problem: Problem
    end: int
    kind: str = BROKEN


class Tokens(Struct):
    """Parallel lists, the last token is ``$END`` at the end of the last real one.

    ``runs`` holds the runs of facts that were recognised, by their offsets; each is represented by the two tokens of
    a belief.
    """

    types: list[str] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    first_in_line: set[int] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Finding] = field(default_factory=list)
    runs: dict[int, FactRun] = field(default_factory=dict)


class Lexicon(Struct, frozen=True):
    """The terminals of a grammar, ready to match; ``master`` has one group per type, operators in the group OP."""

    master: re.Pattern[str]
    fixed: dict[str, str]
    keywords: dict[str, str]
    ignored: frozenset[str]


def lexicon(tables: Tables) -> Lexicon:
    """Return the lexicon of a grammar."""
    operators = "|".join(re.escape(text) for text in sorted(tables.fixed, key=len, reverse=True))
    groups = [f"(?P<{name}>{pattern})" for name, pattern in tables.patterns.items()]
    master = re.compile("|".join([*groups, rf"(?P<{BROKEN}>/\*)|(?P<OP>{operators})"]))
    return Lexicon(master, tables.fixed, tables.keywords, frozenset(tables.ignored))


_BELIEF_CHANGE = re.compile(r"(\+\+|--|-\+|[+-])\s*[a-zA-Z_~'{:]")
"""A sign that may change a belief; before a number, a bracket or another sign it is arithmetic."""

_NO_OPERAND = re.compile(r"(\+\+|--|-\+|[+-])\s*(~|[a-z][a-zA-Z0-9_]*(?![a-zA-Z0-9_]|\s*[(:]|\.[a-z]))")
"""A sign before what is never computed with: a negation, or an atom."""

_CONDITIONAL = frozenset(("IF", "WHILE", "FOR", "ELIF", "ELSE"))
_GOAL = frozenset(("BANG", "BANG_BANG", "ADD_FIRST", "ADD_LAST"))
_BEFORE_FORMULA = frozenset(("ARROW", "SEMICOLON", "LBRACE", "RBRACE", "FORK_AND", "FORK_OR"))
_STARTS_FORMULA = (
    frozenset(("NOT", "IF", "WHILE", "FOR", "NAME", "QUOTED", "INTERNAL", "VARIABLE", "QUERY"))
    | {"PLUS", "MINUS", "PLUS_PLUS", "MINUS_MINUS", "MINUS_PLUS"}
    | _GOAL
)
_ENDS_FORMULA = frozenset(
    ("NAME", "QUOTED", "INTERNAL", "VARIABLE", "NUMBER", "STRING", "TRUE", "FALSE", "RPAR", "RSQB")
)
_INSIDE = frozenset(("LPAR", "LSQB", "COMMA", "COLON", "RULE_ARROW", "UNTIL", "AT"))
"""The tokens that show, before a formula has begun, that this is within brackets or in the head of a plan."""

_SIGNS = frozenset(("+", "-", "++", "--", "-+"))


def tokenize(
    source: Source,
    lexicon: Lexicon,
    broken: Callable[[Source, int], Broken],
    start: int = 0,
    end: int | None = None,
    find_run: Callable[[int], FactRun | None] | None = None,
) -> Tokens:
    """Return all tokens of a text, or those from offset ``start`` to before ``end`` (None: the end of the text).

    ``broken`` says what is wrong at an offset where no token begins, and how reading goes on. ``find_run`` gives
    the run of facts at an offset where an item of a program may begin.
    """
    tokens = Tokens()
    types, texts, starts = tokens.types, tokens.texts, tokens.starts
    fixed, keywords, ignored = lexicon.fixed, lexicon.keywords, lexicon.ignored
    text = source.text
    match = lexicon.master.match
    at, size = start, len(text) if end is None else end
    line_end = -1
    in_body = False
    at_item = find_run is not None
    while at < size:
        if at_item and find_run is not None:
            run = find_run(at)
            if run is not None:
                tokens.runs[at] = run
                types += ("NAME", "_END")
                texts += ("facts", ".")
                starts += (at, run.end)
                at = run.end
                continue
            at_item = False
        found = match(text, at, size)
        kind = found.lastgroup or BROKEN if found else BROKEN
        if found is None or kind == BROKEN:
            problem, after, kind = broken(source, at)
            tokens.problems.append(problem)
            if not kind:
                at = after
                continue
            word = text[at:after]
        else:
            after = found.end()
            if kind in ignored:
                at = after
                continue
            word = text[at:after]
            if kind == "OP":
                kind = fixed[word]
            elif kind == "NAME":
                kind = keywords.get(word, kind)
        if at > line_end:
            line_end = text.find("\n", at)
            if line_end < 0:
                line_end = size
            if in_body and kind in _STARTS_FORMULA and _misses_semicolon(text, at, word, types):
                types.append("SEMICOLON")
                texts.append(";")
                starts.append(at)
                tokens.warnings.append(_semicolon_warning(source, at))
            tokens.first_in_line.add(len(types))
        if kind == "ARROW":
            in_body = True
        elif kind == "_END":
            in_body = False
            at_item = find_run is not None
        types.append(kind)
        texts.append(word)
        starts.append(at)
        at = after
    types.append(END_OF_TEXT)
    starts.append(starts[-1] + len(texts[-1]) if texts else 0)
    texts.append("")
    return tokens


def _misses_semicolon(text: str, at: int, word: str, types: list[str]) -> bool:
    """Return whether a formula ends before a line's first token, and another one can only begin with it (D1).

    Not where a sign may go on with an expression (``X = 1`` and ``-Y`` below it), and, but for an action, not at the
    margin: a belief or a goal of the program begins there, and a dot is missing.
    """
    if types[-1] not in _ENDS_FORMULA or (word in _SIGNS and not _BELIEF_CHANGE.match(text, at)):
        return False
    first = _first_of_formula(types)
    if first is None or types[first] in _CONDITIONAL:
        return False
    literal = _first_of_literal(types)
    if literal == first:
        return True
    if at == 0 or text[at - 1] == "\n":
        return False
    goal = types[first] in _GOAL
    return word not in _SIGNS or goal or literal == first + 1 or _NO_OPERAND.match(text, at) is not None


def _first_of_formula(types: list[str]) -> int | None:
    """Return the index of the first token of the last one's formula; None within a bracket or a plan's head."""
    index = len(types) - 1
    while index >= 0 and types[index] not in _BEFORE_FORMULA:
        inside, index = index, _before_arguments(types, index)
        if index == inside:
            if types[index] in _INSIDE:
                return None
            index -= 1
    return index + 1 if 0 <= index < len(types) - 1 else None


def _first_of_literal(types: list[str]) -> int:
    """Return the index at which a literal or an internal action begins that the last token ends; -1 if it ends none."""
    index = _before_arguments(types, len(types) - 1)
    if index < 0 or types[index] not in ("NAME", "INTERNAL", "QUOTED"):
        return -1
    if index >= 2 and types[index - 1] == "SCOPE" and types[index - 2] == "NAME":
        index -= 2
    return index - 1 if types[index - 1] == "TILDE" else index


def _before_arguments(types: list[str], index: int) -> int:
    """Return the index before the arguments and annotations that end at ``index``; itself when there are none."""
    return before_brackets(types, before_brackets(types, index, "LSQB", "RSQB"), "LPAR", "RPAR")


def before_brackets(types: list[str], index: int, opening: str, closing: str) -> int:
    """Return the index before a bracketed part that ends at ``index``; ``index`` itself when there is none."""
    depth = 0
    while index >= 0 and (depth or types[index] == closing):
        depth += (types[index] == closing) - (types[index] == opening)
        index -= 1
        if not depth:
            break
    return index


def _semicolon_warning(source: Source, at: int) -> Finding:
    line, column = source.place(at)
    message = f"no ';' before the formula on line {line}: read as if there were one"
    return Finding(source.file, line, column, message, "warning", "missing-semicolon")
