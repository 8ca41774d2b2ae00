"""What could stand at a place, in words: the alike tokens by one word."""

from __future__ import annotations

from collections.abc import Collection

from agentd.language.lalr import machine
from agentd.language.lexer import END_OF_TEXT

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
