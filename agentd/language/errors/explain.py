"""The message for a token that no rule of the grammar goes on with: where the mistake is, and what to write."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from agentd.language.errors.error_context import CLOSERS, SIGNS, ErrorContext, sign_at
from agentd.language.errors.lexical import COUNTING, foreign_sign
from agentd.language.errors.suggestions import near
from agentd.language.errors.token_patterns import matches
from agentd.language.parser.lalr import machine
from agentd.language.parser.lexer import END_OF_TEXT, Tokens
from agentd.language.syntax_tree.errors import shown
from agentd.language.syntax_tree.source import Source

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
    """The message of the first row of the table that fits and has its words; else what would be accepted."""
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
    """The index of the sign in ``+a +b`` over two lines, which was read as a sum before it went wrong."""
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
    """A word of a message: a token of the pattern by its number, ``:`` how it is written, or what is at the error."""
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
    return " or ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


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
