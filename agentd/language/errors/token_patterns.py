"""The table of syntax errors: patterns of tokens, each with the message for a program that stops where it fits.

``syntax_errors.txt`` is the table, and says how its rows are written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Set
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

from agentd.language.errors.error_context import BEGIN_TERM, END_TERM, ErrorContext
from agentd.language.parser.lalr import machine
from agentd.language.parser.lexer import END_OF_TEXT

TABLE = Path(__file__).with_name("syntax_errors.txt")

_CLASSES: Final[dict[str, Set[str]]] = {
    "TERM": END_TERM,
    "BEGIN": BEGIN_TERM,
    "FORMULA": (BEGIN_TERM - {"NUMBER", "STRING", "LSQB", "LPAR"})
    | {"BANG", "BANG_BANG", "QUERY", "IF", "WHILE", "FOR", "ADD_FIRST", "ADD_LAST", "NOT", "MINUS_PLUS"},
    "SIGN": {"PLUS", "MINUS", "CARET"},
    "CHANGE": {"PLUS", "MINUS", "PLUS_PLUS", "MINUS_MINUS", "MINUS_PLUS", "ADD_FIRST", "ADD_LAST"},
    "COMPUTE": {"PLUS", "MINUS", "TIMES", "DIVIDE", "POWER", "DIV", "MOD"},
    "ENDS": {"_END", "SEMICOLON", "COMMA", "RPAR", "RSQB", "RBRACE", "ARROW", "COLON", "RULE_ARROW", END_OF_TEXT}
    | {"AMPERSAND", "VBAR", "TIMES", "DIVIDE", "POWER", "RELATION", "DIV", "MOD", "FORK_AND", "FORK_OR"},
    "END": {END_OF_TEXT},
}
_PREFIXES = "^$%"
_GAPS = ("..", "...")


@dataclass(frozen=True, slots=True)
class Element:
    """A token of a pattern: by its type, its text or an expression; in ``gap`` the tokens that may stand behind it."""

    types: frozenset[str]
    texts: frozenset[str]
    expression: re.Pattern[str] | None
    begins_line: bool
    adjoins: bool
    arguments: bool
    gap: str

    def fits(self, error: ErrorContext, index: int, signs: str = "") -> bool:
        """Whether a token is such a one; ``signs`` are those around it, which may be one of another language."""
        tokens = error.tokens
        if (self.begins_line and index not in tokens.first_in_line) or (self.adjoins and not error.adjoins(index)):
            return False
        text = tokens.texts[index]
        if tokens.types[index] in self.types or text in self.texts or signs in self.texts:
            return True
        return self.expression is not None and any(map(self.expression.fullmatch, (text, signs)))


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the table; ``before`` has the nearest token first."""

    text: str
    parts: frozenset[str]
    opened: frozenset[str]
    accepted: str
    before: tuple[Element, ...]
    marked: Element
    after: tuple[Element, ...]
    message: str

    def fits(self, error: ErrorContext) -> list[int] | None:
        """The indices of the tokens that the pattern names, where it fits; else None."""
        if "*" not in self.parts and error.part not in self.parts:
            return None
        if not self.marked.fits(error, error.index, error.signs) or not self.opened <= error.open_around:
            return None
        if self.accepted and self.accepted not in error.expected:
            return None
        before, after = self._behind(error), self._ahead(error)
        return None if before is None or after is None else [*before, error.index, *after]

    def _behind(self, error: ErrorContext) -> list[int] | None:
        found: list[int] = []
        index = error.index - 1
        for element in self.before:
            if element.arguments:
                index = error.before_arguments(index)
            while element.gap and index >= 0 and not element.fits(error, index):
                if error.ends_gap(index, element.gap):
                    return None
                index -= 1
            if index < 0 or not element.fits(error, index):
                return None
            found.insert(0, index)
            index -= 1
        return found

    def _ahead(self, error: ErrorContext) -> list[int] | None:
        indices = range(error.index + 1, error.index + 1 + len(self.after))
        if indices.stop > len(error.tokens.types):
            return None
        for element, index in zip(self.after, indices, strict=True):
            if error.begins_line(index) != element.begins_line or not element.fits(error, index):
                return None
        return list(indices)


@lru_cache(maxsize=1)
def rows() -> tuple[Row, ...]:
    """The rows of the table, read for the first error."""
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    return tuple(_row(line) for line in lines if line and not line.startswith("//"))


def matches(error: ErrorContext) -> Iterator[tuple[str, list[int]]]:
    """The messages of the rows that fit, in the order of the table, and the tokens that their patterns name."""
    for row in rows():
        found = row.fits(error)
        if found is not None:
            yield row.message, found


def _row(line: str) -> Row:
    pattern, message = line.split(" # ", 1)
    where, *words = pattern.split()
    where, _, accepted = where.partition("+")
    parts, *opened = where.split("/")
    elements = list(_elements(words))
    mark = next(index for index, word in enumerate(word for word in words if word not in _GAPS) if _is_marked(word))
    return Row(
        line,
        frozenset(parts.split(",")) if parts != "item" else frozenset(_ITEM),
        frozenset(opened),
        accepted,
        tuple(reversed(elements[:mark])),
        elements[mark],
        tuple(elements[mark + 1 :]),
        message.strip(),
    )


_ITEM = ("label", "trigger", "goal", "belief", "context", "rule", "body", "braces")


def _is_marked(word: str) -> bool:
    return len(word) > 1 and "^" in word[: len(word) - len(word.lstrip(_PREFIXES))]


def _elements(words: list[str]) -> Iterator[Element]:
    """The elements of a pattern; a gap belongs to the one before it."""
    for word, after in zip(words, [*words[1:], ""], strict=True):
        if word not in _GAPS:
            yield _element(word, after if after in _GAPS else "")


def _element(word: str, gap: str) -> Element:
    body = word
    while len(body) > 1 and body[0] in _PREFIXES:
        body = body[1:]
    prefixes = word[: len(word) - len(body)]
    arguments = body.endswith("()")
    body = body.removesuffix("()")
    expression = None
    types: frozenset[str] = frozenset()
    texts: frozenset[str] = frozenset()
    if len(body) > 2 and body[0] == body[-1] == "/":
        expression = re.compile(body[1:-1])
    else:
        words, classes = body.split("|"), _classes()
        types = frozenset().union(*(classes[name] for name in words if name in classes))
        texts = frozenset(name for name in words if name not in classes)
    return Element(types, texts, expression, "$" in prefixes, "%" in prefixes, arguments, gap)


@lru_cache(maxsize=1)
def _classes() -> dict[str, Set[str]]:
    """The types of tokens by the words in capitals that name them in a pattern."""
    tables = machine().tables
    types = {*tables.patterns, *tables.fixed.values(), *tables.keywords.values()}
    others = {"ANY": types, "OTHER": types - END_TERM, "KEYWORD": {*tables.keywords.values()} - {"NOT"}}
    return {kind: {kind} for kind in types} | _CLASSES | others
