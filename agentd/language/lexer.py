"""Text to tokens, by the terminals of the grammar.

The lexer also applies deviation D1 of the dialect: where a formula of a plan body begins on a new line after an
internal or external action and the `;` is missing, it puts one there and reports a warning.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from agentd.language.errors import Problem
from agentd.language.source import Source
from agentd.language.tables import Tables
from schemas.findings import Finding

BROKEN = "BROKEN"
"""The type of what is no token; its problem is reported already."""

END_OF_TEXT = "$END"


@dataclass(slots=True)
class Tokens:
    """Parallel lists, the last token is ``$END`` at the end of the last real one."""

    types: list[str] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    first_in_line: set[int] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Finding] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Lexicon:
    """The terminals of a grammar, ready to match; ``master`` has one group per type, operators in the group OP."""

    master: re.Pattern[str]
    fixed: dict[str, str]
    keywords: dict[str, str]
    ignored: frozenset[str]
    arrow: str
    ends_body: str
    before_formula: frozenset[str]
    starts_formula: frozenset[str]


def lexicon(tables: Tables) -> Lexicon:
    operators = "|".join(re.escape(text) for text in sorted(tables.fixed, key=len, reverse=True))
    groups = [f"(?P<{name}>{pattern})" for name, pattern in tables.patterns.items()]
    fixed = tables.fixed
    words = ("IF", "WHILE", "FOR", "NAME", "QUOTED", "INTERNAL", "VARIABLE")
    signs = ("!", "!!", "?", "+<", "+>", "+", "-", "++", "--", "-+")
    return Lexicon(
        master=re.compile("|".join([*groups, rf"(?P<{BROKEN}>/\*)|(?P<OP>{operators})"])),
        fixed=fixed,
        keywords=tables.keywords,
        ignored=frozenset(tables.ignored),
        arrow=fixed["<-"],
        ends_body="_END",
        before_formula=frozenset(fixed[text] for text in ("<-", ";", "{", "}", "|&|", "|||")),
        starts_formula=frozenset([*words, *(fixed[text] for text in signs)]),
    )


_BELIEF_CHANGE = re.compile(r"(\+\+|--|-\+|[+-])\s*[a-zA-Z_~'{:]")
"""A sign that may change a belief; before a number, a bracket or another sign it is arithmetic."""

_SIGNS = frozenset(("+", "-", "++", "--", "-+"))


def tokenize(source: Source, lexicon: Lexicon) -> Tokens:
    """All tokens of a text; what is no token becomes ``BROKEN`` and a problem."""
    tokens = Tokens()
    types, texts, starts = tokens.types, tokens.texts, tokens.starts
    fixed, keywords, ignored = lexicon.fixed, lexicon.keywords, lexicon.ignored
    text = source.text
    match = lexicon.master.match
    at, size = 0, len(text)
    line_end = -1
    in_body = False
    while at < size:
        found = match(text, at)
        kind = found.lastgroup or BROKEN if found else BROKEN
        if found is None or kind == BROKEN:
            from agentd.language.broken import broken  # a good program starts without knowing of bad ones

            problem, end, kind = broken(source, at)
            tokens.problems.append(problem)
            if not kind:
                at = end
                continue
            word = text[at:end]
        else:
            end = found.end()
            if kind in ignored:
                at = end
                continue
            word = text[at:end]
            if kind == "OP":
                kind = fixed[word]
            elif kind == "NAME":
                kind = keywords.get(word, kind)
        if at > line_end:
            line_end = text.find("\n", at)
            if line_end < 0:
                line_end = size
            if in_body and kind in lexicon.starts_formula and _misses_semicolon(text, at, word, types, lexicon):
                types.append(fixed[";"])
                texts.append(";")
                starts.append(at)
                tokens.warnings.append(_semicolon_warning(source, at))
            tokens.first_in_line.add(len(types))
        if kind == lexicon.arrow:
            in_body = True
        elif kind == lexicon.ends_body:
            in_body = False
        types.append(kind)
        texts.append(word)
        starts.append(at)
        at = end
    types.append(END_OF_TEXT)
    starts.append(starts[-1] + len(texts[-1]) if texts else 0)
    texts.append("")
    return tokens


def _misses_semicolon(text: str, at: int, word: str, types: list[str], lexicon: Lexicon) -> bool:
    """Whether the tokens before a line's first one are an action and nothing else (D1)."""
    if word in _SIGNS and not _BELIEF_CHANGE.match(text, at):
        return False
    fixed = lexicon.fixed
    index = _before_brackets(types, len(types) - 1, fixed["["], fixed["]"])
    index = _before_brackets(types, index, fixed["("], fixed[")"])
    if index < 1 or types[index] not in ("NAME", "INTERNAL", "QUOTED"):
        return False
    if index >= 2 and types[index - 1] == fixed["::"] and types[index - 2] == "NAME":
        index -= 2
    return types[index - 1] in lexicon.before_formula


def _before_brackets(types: list[str], index: int, opening: str, closing: str) -> int:
    """The index before a bracketed part that ends at ``index``; ``index`` itself when there is none."""
    if index < 0 or types[index] != closing:
        return index
    depth = 0
    while index >= 0:
        if types[index] == closing:
            depth += 1
        elif types[index] == opening:
            depth -= 1
            if depth == 0:
                return index - 1
        index -= 1
    return index


def _semicolon_warning(source: Source, at: int) -> Finding:
    line, column = source.place(at)
    message = f"no ';' before the formula on line {line}: read as if it stood at the end of the action before it"
    return Finding(source.file, line, column, message, "warning", "missing-semicolon")
