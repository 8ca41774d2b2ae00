"""The text of run-time terms, as ``.print`` shows them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from agentd.language.syntax_tree.printer import unbraced_text
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.numbers import number_text
from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import (
    ARITHMETIC,
    EMPTY,
    FIRST_NODES,
    MOST_CHARACTERS,
    MOST_NODES,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Shown,
    Var,
    deref,
    further,
    split,
)

_LONGEST_FLAT: Final = 100
"""Characters of a string in a term that `flat_text` writes."""
_EXACT: Final = 2.0**53
"""Up to here a float that is whole is the number that it shows."""
_MOST_FLAT: Final = 12
"""Arguments and annotations of its structures."""


class TooManyCharacters(ValueError):
    """A text of a term has more than `MOST_CHARACTERS`."""

    def __init__(self) -> None:
        super().__init__(f"a text of a term has more than {MOST_CHARACTERS} characters")


def text(term: Any) -> str:
    """Return the text of a term for people; strings keep their quotes (inner quotes are not escaped).

    That of a cyclic or too large term is cut off.
    """
    out: list[str] = []
    try:
        write(term, out)
    except (RecursionError, TooManyCharacters):
        out.append("...")
    return "".join(out)


def whole_text(term: Any) -> str:
    """Return the text of a term as a program gets it. Raises RecursionError for too many parts, TooManyCharacters."""
    out: list[str] = []
    write(term, out)
    return "".join(out)


Shown.text = text


def flat_text(term: Any, depth: int = 4) -> str | None:
    """Return the text of a term of numbers, strings, atoms and structures of them, nested at most ``depth`` deep.

    None for any other, or a deeper or long one.
    What most beliefs and events are, at a fraction of what `text` takes.
    """
    kind = type(term)
    if kind is float:
        return str(int(term)) if term.is_integer() and -_EXACT < term < _EXACT else number_text(term)
    if kind is str:
        return f'"{term}"' if len(term) <= _LONGEST_FLAT else None
    if kind is not Literal or not depth:
        return None
    found: str = term.sig.name
    if term.args:
        args = _flat_texts(term.args, depth)
        if args is None:
            return None
        found += f"({args})"
    annots = term.annots
    if annots is SELF:
        found += "[source(self)]"
    elif annots:
        written = _flat_texts(annots, depth)
        if written is None:
            return None
        found += f"[{written}]"
    return found


def _flat_texts(terms: tuple[Any, ...], depth: int) -> str | None:
    if len(terms) > _MOST_FLAT:
        return None
    found = []
    for term in terms:
        one = flat_text(term, depth - 1)
        if one is None:
            return None
        found.append(one)
    return ",".join(found)


def printed(term: Any) -> str:
    """Return the text of an argument of ``.print``: a string without quotes, a free variable as ``<no-value>``.

    Raises as `whole_text`.
    """
    term = deref(term)
    if type(term) is str:
        return term
    if type(term) is Var:
        return f"{term.name}<no-value>"
    return whole_text(term)


def write(term: Any, out: list[str]) -> None:
    """Append the text of a term in pieces. No recursion, so any depth can be written.

    Raises RecursionError for a cyclic term and for one of too many parts, TooManyCharacters.
    """
    pending: list[Any] = [term]
    budget, rest, left = FIRST_NODES, MOST_NODES, MOST_CHARACTERS
    while pending:
        budget -= 1
        if not budget:
            budget, rest = further(rest, pending, "written")
        term = pending.pop()
        kind = type(term)
        if kind is _Piece:
            piece = term.text
        elif kind is float:
            piece = number_text(term)
        elif kind is str:
            piece = f'"{term}"'
        elif kind is Var and term.ref is not None:
            pending.append(term.ref)
            continue
        elif kind in _PARTS:
            pending.extend(reversed(_PARTS[kind](term)))
            continue
        elif kind is Code:
            try:
                piece = code_text(term)
            except RecursionError:  # code that holds code that holds code ...
                piece = "{ ... }"
        else:
            piece = term.name if kind is Var else str(term)
        left -= len(piece)
        if left < 0:
            raise TooManyCharacters
        out.append(piece)


class _Piece:
    __slots__ = ("text",)

    def __init__(self, text: str) -> None:
        self.text = text


_OPEN, _CLOSE, _COMMA, _BAR = _Piece("("), _Piece(")"), _Piece(","), _Piece("|")
_LEFT, _RIGHT = _Piece("["), _Piece("]")


def _separated(terms: Any, before: _Piece, after: _Piece) -> list[Any]:
    pieces: list[Any] = [before]
    for i, term in enumerate(terms):
        if i:
            pieces.append(_COMMA)
        pieces.append(term)
    pieces.append(after)
    return pieces


def _of_literal(term: Literal) -> list[Any]:
    pieces: list[Any] = [_Piece(term.sig.name)]
    if term.args:
        pieces += _separated(term.args, _OPEN, _CLOSE)
    if term.annots:
        pieces += _annotations(term.annots)
    return pieces


def _annotations(annots: tuple[Any, ...]) -> list[Any]:
    """``[a,b]``, or ``[a|T]`` where the last one is the tail."""
    last = annots[-1]
    if type(last) is not Rest:
        return _separated(annots, _LEFT, _RIGHT)
    return [*_separated(annots[:-1], _LEFT, _BAR), last.tail, _RIGHT]


def _of_list(term: List) -> list[Any]:
    try:
        items, end = split(term)
    except RecursionError:
        return [_Piece("[...]")]
    return _separated(items, _LEFT, _RIGHT) if end is EMPTY else [*_separated(items, _LEFT, _BAR), end, _RIGHT]


def _of_expression(term: Expression) -> list[Any]:
    operator = term.operator
    if operator == "not":
        return [_Piece("not ("), term.operands[0], _CLOSE]
    if len(term.operands) == 1:
        return [_Piece(f"({operator}"), term.operands[0], _CLOSE]
    tight = operator in ARITHMETIC and not operator.isalpha()
    return [_OPEN, term.operands[0], _Piece(operator if tight else f" {operator} "), term.operands[1], _CLOSE]


def _of_open(term: Open) -> list[Any]:
    pieces: list[Any] = [_Piece("~")] if term.negated else []
    if term.namespace is not None:
        pieces += [term.namespace if type(term.namespace) is Var else _Piece(term.namespace), _Piece("::")]
    pieces.append(term.variable if term.literal is None else term.literal)
    if term.annots:
        pieces += _annotations(term.annots)
    return pieces


def _of_collection(term: Collection) -> list[Any]:
    if term.kind == "map":
        pieces: list[Any] = [_Piece("{")]
        for i, (key, value) in enumerate(term.content.items()):
            pieces += [*([_COMMA] if i else []), key, _Piece("="), value]
        return [*pieces, _Piece("}")]
    if term.kind == "set":
        return _separated(term.content, _Piece("{"), _Piece("}"))
    return _separated(term.content, _LEFT, _RIGHT)


_PARTS: Final[dict[type, Callable[[Any], list[Any]]]] = {
    Literal: _of_literal,
    List: _of_list,
    Expression: _of_expression,
    Open: _of_open,
    Collection: _of_collection,
}
"""What terms with others inside are written as: pieces of text and the terms between them."""


def code_text(code: Code) -> str:
    """Return a plan, trigger, body or rule, with the values that its variables had when it became a term.

    Raises RecursionError for code that holds code without end, TooManyCharacters.
    """
    left = MOST_CHARACTERS

    def written(node: Any) -> str:
        nonlocal left
        value = text(instantiate(node, code.values))
        left -= len(value)
        if left < 0:
            raise TooManyCharacters
        return value

    inner = unbraced_text(code.syntax, written)
    if code.bare:
        return inner
    return "{ }" if not inner else f"{{ {inner} }}"


def qualified(functor: str, namespace: str) -> str:
    """``ns::functor``, or the functor alone in the default namespace."""
    return functor if namespace == DEFAULT else f"{namespace}::{functor}"
