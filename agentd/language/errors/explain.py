"""The message for a token that no rule of the grammar goes on with: where the mistake is, and what to write.

``syntax_errors.txt`` is the table of patterns of tokens, each with the message for a program that stops where it fits;
it says how its rows are written.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence, Set
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

from agentd.language.errors.error_context import BEGIN_TERM, CLOSERS, END_TERM, SIGNS, ErrorContext, sign_at
from agentd.language.errors.lexical import COUNTING, foreign_sign
from agentd.language.parser.lalr import machine
from agentd.language.parser.lexer import END_OF_TEXT, Tokens, before_brackets
from agentd.language.syntax_tree.errors import near, shown
from agentd.language.syntax_tree.source import Source
from schemas.humanize import joined

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
    """A token of a pattern: by its type, its text or an expression; ``gap`` is set if other tokens may follow it."""

    types: frozenset[str]
    texts: frozenset[str]
    expression: re.Pattern[str] | None
    marked: bool
    begins_line: bool
    adjoins: bool
    arguments: bool
    gap: str

    def fits(self, error: ErrorContext, index: int, signs: str = "") -> bool:
        """Return whether a token is such a one; ``signs`` are those around it, which may be one of another language."""
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
        """Return the indices of the tokens that the pattern names, where it fits; else None."""
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
                index = before_brackets(error.tokens.types, index, "LPAR", "RPAR")
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
            if (index in error.tokens.first_in_line) != element.begins_line or not element.fits(error, index):
                return None
        return list(indices)


@lru_cache(maxsize=1)
def rows() -> tuple[Row, ...]:
    """Return the rows of the table, read for the first error."""
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    return tuple(_row(line) for line in lines if line and not line.startswith("//"))


def matches(error: ErrorContext) -> Iterator[tuple[str, list[int]]]:
    """Yield the messages of the rows that fit, in the order of the table, and the tokens that their patterns name."""
    for row in rows():
        found = row.fits(error)
        if found is not None:
            yield row.message, found


def _row(line: str) -> Row:
    pattern, message = line.split(" # ", 1)
    where, *words = pattern.split()
    where, _, accepted = where.partition("+")
    parts, *opened = where.split("/")
    elements = [
        _element(word, after if after in _GAPS else "")  # a gap belongs to the element before it
        for word, after in zip(words, [*words[1:], ""], strict=True)
        if word not in _GAPS
    ]
    mark = next(index for index, element in enumerate(elements) if element.marked)
    return Row(
        line,
        frozenset(parts.split(",")) if parts != "item" else _PARTS_OF_ITEMS,
        frozenset(opened),
        accepted,
        tuple(reversed(elements[:mark])),
        elements[mark],
        tuple(elements[mark + 1 :]),
        message.strip(),
    )


_PARTS_OF_ITEMS = frozenset(("label", "trigger", "goal", "belief", "context", "rule", "body", "braces"))


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
    return Element(types, texts, expression, "^" in prefixes, "$" in prefixes, "%" in prefixes, arguments, gap)


@lru_cache(maxsize=1)
def _classes() -> dict[str, Set[str]]:
    """Return the types of tokens by the words in capitals that name them in a pattern."""
    tables = machine().tables
    types = {*tables.patterns, *tables.fixed.values(), *tables.keywords.values()}
    others = {"ANY": types, "OTHER": types - END_TERM, "KEYWORD": {*tables.keywords.values()} - {"NOT"}}
    return {kind: {kind} for kind in types} | _CLASSES | others


_ITEMS = {"belief": "belief", "goal": "initial goal", "rule": "rule"}


def explain(
    source: Source, tokens: Tokens, index: int, states: Sequence[int], offsets: Sequence[int]
) -> tuple[int, int, str]:
    """Line, column and message for the token at ``index``, for which the last of ``states`` has no action."""
    error = ErrorContext(source, tokens, index, states, offsets)
    if index and tokens.types[index - 1] == "VARIABLE" and error.expected == {"SCOPE"}:
        index -= 1  # the variable is read as a namespace, and is meant to be something else
        error = ErrorContext(source, tokens, index, states[:-1], offsets[:-1])
    sign = _sign_without_semicolon(error)
    if sign is not None:
        return *source.place(tokens.starts[sign]), f"a ; is missing before '{tokens.texts[sign]}'"
    return *source.place(tokens.starts[index]), _message(error)


def _message(error: ErrorContext) -> str:
    """Return the message of the first row of the table that fits and has its words; else what would be accepted."""
    for message, found in matches(error):
        parts = re.split(r"\{([\w:]+)\}", message)
        words = [word for name in parts[1::2] if (word := _word(name, error, found)) is not None]
        if len(words) == len(parts) // 2:
            parts[1::2] = words
            return "".join(parts)
    if not error.text:
        item = {"start": "program", "braces": "directive"}.get(error.part, error.part)
        return f"the text ends in the middle of a {item}; expected {expected(error.expected)}"
    after = f" after '{shown(error.before)}'" if error.before else ""
    return f"{error.found} is not allowed here{after}; expected {expected(error.expected)}"


def _sign_without_semicolon(error: ErrorContext) -> int | None:
    """Return the index of the sign in ``+a +b`` over two lines, which was read as a sum before it went wrong."""
    if error.part != "body" or error.opened is not None or error.text in ("<-", ":"):
        return None
    tokens, found = error.tokens, None
    for index in range(error.index - 1, 0, -1):
        text = tokens.texts[index]
        if text in (";", "<-", "}"):
            begins = tokens.texts[index + 1] in SIGNS and tokens.types[index + 2] in ("NAME", "QUOTED", "TILDE")
            return found if begins else None
        if index in tokens.first_in_line and text in ("+", "-"):
            found = index
    return None


def _word(name: str, error: ErrorContext, found: Sequence[int]) -> str | None:
    """Return a word of a message: a token of the pattern by its number, ``:`` its text, or what is at the error."""
    name, _, way = name.partition(":")
    if name.isdigit():
        return shown(_written(error.tokens.texts[found[int(name) - 1]], way))
    match name:
        case "found":
            return error.found
        case "signs":
            return error.signs
        case "foreign":  # None for a sign of the language: the row does not apply
            sign = sign_at(error.source.text, error.tokens.starts[error.index])
            return None if sign in COUNTING and error.part != "body" else foreign_sign(sign)
        case "near":
            return near(error.tokens.texts[found[0]].lower(), ("if", "elif", "else", "while", "for"))
        case "line":
            return str(error.source.place(error.tokens.starts[found[0]])[0])
        case "part":
            return error.part
        case "item":
            return _ITEMS.get(error.part, "plan")
        case "opened":
            return error.opened_at()
        case "closer":
            return CLOSERS[error.tokens.texts[error.opened or 0]]
    raise ValueError(name)


def _written(text: str, way: str) -> str:
    match way:
        case "small":
            return text[:1].lower() + text[1:]
        case "lower":
            return text.lower()
        case "undotted":
            return text.removeprefix(".")
        case "digits":
            return text.replace("_", "")
    return text


_NAMES = {
    "NAME": "a name",
    "QUOTED": "a quoted name",
    "VARIABLE": "a variable",
    "NUMBER": "a number",
    "STRING": "a string",
    "INTERNAL": "an internal action",
    "RELATION": "a comparison",
    "_END": "'.'",
    END_OF_TEXT: "the end of the text",
}


def expected(types: Collection[str]) -> str:
    """Types of tokens, the alike ones by one word."""
    tables = machine().tables
    texts = {kind: text for text, kind in (*tables.fixed.items(), *tables.keywords.items())}
    kinds = {kind for kind in types if kind in texts or kind in _NAMES}
    if not kinds >= _ITEM:
        kinds.discard(END_OF_TEXT)  # only a text that is one plan could end elsewhere
    names: list[str] = []
    for group, word in _GROUPS:
        if group <= kinds:
            names.append(word)
            kinds -= group | _PART_OF.get(word, frozenset())
    names += [_NAMES.get(kind) or f"'{texts[kind]}'" for kind in sorted(kinds, key=lambda k: (k != "_END", k))]
    if len(names) > 6:
        names = [*names[:6], "..."]
    return joined(names, "or")


_TERM = frozenset(("NUMBER", "STRING", "NAME", "VARIABLE"))
_IN_TERM = frozenset(
    ("QUOTED", "INTERNAL", "TRUE", "FALSE", "TILDE", "LPAR", "LSQB", "LBRACE", "PLUS", "MINUS", "PLUS_PLUS")
) | frozenset(("MINUS_MINUS", "MINUS_PLUS", "SCOPE", "NOT"))
_STEP = frozenset(("BANG", "BANG_BANG", "QUERY", "IF", "WHILE", "FOR", "ADD_FIRST", "ADD_LAST"))
_OPERATORS = frozenset(("PLUS", "MINUS", "TIMES", "DIVIDE", "POWER", "DIV", "MOD"))
_ITEM = frozenset(("AT", "BANG", "NAME", "PLUS"))
_GROUPS: tuple[tuple[frozenset[str], str], ...] = (
    (_ITEM, "a belief, a goal, a plan"),
    (_TERM | _STEP, "a formula of a plan body"),
    (_TERM, "a term"),
    (_OPERATORS, "an operator"),
    (frozenset(("NAME", "VARIABLE")), "a literal or variable"),
    (frozenset(("NAME",)), "a literal"),
)
_PART_OF = {
    "a belief, a goal, a plan": frozenset(
        ("QUOTED", "TILDE", "SCOPE", "VARIABLE", "MINUS", "CARET", "LBRACE", "QUERY")
    ),
    "a formula of a plan body": _IN_TERM,
    "a term": _IN_TERM,
    "an operator": frozenset(("PLUS_PLUS", "MINUS_MINUS", "MINUS_PLUS", "RELATION", "AMPERSAND", "VBAR")),
    "a literal or variable": frozenset(("QUOTED", "TILDE", "SCOPE")),
    "a literal": frozenset(("QUOTED", "TILDE", "SCOPE", "VARIABLE")),
}
