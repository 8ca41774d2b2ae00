"""Mistakes that show in a few tokens, whatever the place in the grammar; each function tells one of them, or None."""

from __future__ import annotations

from collections.abc import Callable

from agentd.language.lalr import machine
from agentd.language.lexer import END_OF_TEXT
from agentd.language.place import Place


def _keyword_as_name(place: Place) -> str | None:
    if place.text not in machine().tables.keywords or "NAME" not in place.expected:
        return None
    if place.text in ("else", "elif"):
        return f"an {place.text} without its if; no ; stands before {place.text}"
    if place.text == "not":
        if place.before == "not":
            return "not takes one formula without another not; write not (not a)"
        return None
    return f"'{place.text}' is a keyword and cannot be used as a name"


def _not_equal(place: Place) -> str | None:
    if place.text == "!" and place.after in ("=", "=="):
        return "inequality is written \\== and not !="
    return None


def _assignment(place: Place) -> str | None:
    if place.text == ":" and place.after == "=":
        return "a variable gets its value by = and not by :="
    if place.text == "is" and place.kind_before == "VARIABLE":
        return "there is no 'is'; = computes: X = Y + 1"
    return None


def _number_and_name(place: Place) -> str | None:
    if place.kind_before != "NUMBER" or not place.adjoins:
        return None
    if place.kind in ("NAME", "VARIABLE", "INTERNAL"):
        if place.before == "0" and place.text[0] in "xX":
            return f"there are no hexadecimal numbers: {place.before}{place.text}"
        return f"a name cannot begin with a digit: {place.before}{place.text}"
    if place.kind == "_END" and not _ends_line(place):
        return f"a number does not end with a dot; write {place.before} or {place.before}.0"
    return None


def _digit_for_name(place: Place) -> str | None:
    starts, texts = place.tokens.starts, place.tokens.texts
    if place.kind != "NUMBER" or "NAME" not in place.expected or "NUMBER" in place.expected or not place.after:
        return None
    if starts[place.index + 1] == starts[place.index] + len(place.text) and place.after[0].isalpha():
        return f"a name cannot begin with a digit: {place.text}{texts[place.index + 1]}"
    return None


def only_scope(place: Place) -> bool:
    """Whether the variable before can only be the namespace of something."""
    return list(place.expected) == [machine().tables.fixed["::"]]


def variable_alone(place: Place) -> str:
    operator = place.tokens.texts[place.index - 2] if place.index > 1 else ""
    if operator == "@":
        return "a plan label must be an atom; it begins with a small letter"
    if operator in ("!", "?"):
        return "a variable cannot be an initial goal; a name begins with a small letter"
    return "a variable cannot be a belief; a name begins with a small letter"


def _rule_arrow(place: Place) -> str | None:
    if place.text != ":-":
        return None
    for index in range(place.index - 1, -1, -1):
        if place.tokens.types[index] == "_END":
            break
        if place.tokens.texts[index] == "<-":
            return "a rule stands in a plan body only in braces: +{ head :- body }"
    return "a plan body is introduced by <- and not by :-"


def _variable_with_arguments(place: Place) -> str | None:
    if place.text == "(" and place.kind_before == "VARIABLE":
        return f"a variable cannot be followed by arguments; the name {place.before} must begin with a small letter"
    return None


def _internal_action(place: Place) -> str | None:
    if place.kind == "INTERNAL":
        if place.before == "~":
            return f"the internal action {place.text} cannot be strongly negated; write not {place.text}"
        if place.before in ("!", "!!", "?", "+", "-", "+<", "+>"):
            return f"{place.before} cannot be applied to an internal action; write {place.text} without it"
    if place.text == "[" and _functor_before(place) == "INTERNAL":
        return "an internal action cannot have annotations"
    return None


def _missing_dot(place: Place) -> str | None:
    if not place.begins_line or not place.index or place.kind_before == "_END":
        return None
    begins = place.text == "@" or (place.text in ("+", "-", "^") and place.after in ("!", "?"))
    follows = place.text in ("!", "?") and place.before in ("+", "-", "^")
    if begins or follows:
        return _NO_DOT
    return None


def _missing_dot_before_sign(place: Place) -> str | None:
    if place.text not in ("!", "?") or place.before not in ("+", "-"):
        return None
    if place.index - 1 in place.tokens.first_in_line:
        return _NO_DOT
    sign = place.before + place.text
    return f"{sign} begins a plan; is a '.' missing before it? in a body, a goal is {place.text}g"


_NO_DOT = "a plan begins here, but the one before it does not end with a '.'"


def _missing_semicolon(place: Place) -> str | None:
    """A formula begins right behind one that is complete, in a body."""
    if "SEMICOLON" not in place.expected or place.kind not in _BEGIN_FORMULA or place.kind_before not in _END_TERM:
        return None
    opened = _open_bracket(place)
    texts, types = place.tokens.texts, place.tokens.types
    if opened is not None and texts[opened] != "{":
        return None
    for index in range(place.index - 1, opened if opened is not None else -1, -1):
        if types[index] == "_END" or texts[index] == ":-":
            return None
        if texts[index] == "<-":
            break
    else:
        if opened is None:
            return None
    return f"a ; is missing before {place.found}"


_BEGIN_FORMULA = frozenset(
    (
        "NAME",
        "QUOTED",
        "INTERNAL",
        "VARIABLE",
        "BANG",
        "BANG_BANG",
        "QUERY",
        "IF",
        "WHILE",
        "FOR",
        "ADD_FIRST",
        "ADD_LAST",
    )
)
_END_TERM = frozenset(
    ("NAME", "QUOTED", "INTERNAL", "VARIABLE", "NUMBER", "STRING", "TRUE", "FALSE", "RPAR", "RSQB", "RBRACE")
)


def _unclosed(place: Place) -> str | None:
    """Something that ends a formula or a plan comes while a bracket is open, or a bracket closes another."""
    if place.text not in (";", ".", "<-", ":-", "}", ")", "]", "") or place.text == _CLOSERS.get(place.before):
        return None
    opened = _open_bracket(place)
    if opened is None:
        return f"a {place.text} that nothing opens" if place.text in (")", "]", "}") else None
    bracket = place.tokens.texts[opened]
    closer = _CLOSERS[bracket]
    line, column = place.source.place(place.tokens.starts[opened])
    if place.text == closer or (bracket == "{" and place.text in (";", ".", "<-", ":-")):
        return None
    end = place.found if place.text else "the end of the text"
    return f"the '{bracket}' of line {line}, column {column} is not closed before {end}; expected '{closer}'"


_CLOSERS = {"(": ")", "[": "]", "{": "}"}


def _open_bracket(place: Place) -> int | None:
    """The index of the innermost bracket that is open at the token."""
    closers: list[str] = []
    texts = place.tokens.texts
    for index in range(place.index - 1, -1, -1):
        text = texts[index]
        if text in (")", "]", "}"):
            closers.append(text)
        elif text in _CLOSERS:
            if not closers:
                return index
            closers.pop()
    return None


def _functor_before(place: Place) -> str:
    """The type of the token before the arguments that end before the place."""
    index = place.index - 1
    if index >= 0 and place.tokens.texts[index] == ")":
        depth = 0
        while index >= 0:
            text = place.tokens.texts[index]
            depth += (text == ")") - (text == "(")
            index -= 1
            if depth == 0:
                break
    return place.tokens.types[index] if index >= 0 else ""


def _ends_line(place: Place) -> bool:
    return place.index + 1 in place.tokens.first_in_line or place.tokens.types[place.index + 1] == END_OF_TEXT


TELLTALES: tuple[Callable[[Place], str | None], ...] = (
    _keyword_as_name,
    _not_equal,
    _assignment,
    _number_and_name,
    _digit_for_name,
    _variable_with_arguments,
    _internal_action,
    _missing_dot,
    _missing_dot_before_sign,
    _rule_arrow,
    _missing_semicolon,
    _unclosed,
)
