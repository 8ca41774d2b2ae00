"""Encode every term that a mind may hold as bytes, for checkpoints, and decode it to an equal term.

The bytes are MessagePack: a term is a flat list in postfix order (parts before the whole), so that terms of any depth
need no recursion. Numbers and strings stand for themselves, all else is an array:

    ["f"]  ["f", 2]  ["f", 2, 1]  ["f", 2, 1, true, "ns"]     a literal: functor, arguments, annotations, ~, namespace
    [number of the kind in `_KINDS`, ...]                       anything else

Maps, sets and queues are kept by copy. The wire (`agentd.conversion.term_conversion`) is for others and refuses more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

import msgspec

from agentd.language.parse import parse_plan, parse_term
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.printer import source_text
from agentd.language.syntax_tree.signatures import DEFAULT, signature
from agentd.language.terms.source_annotations import SELF, SOURCE_SELF, is_source, told_by
from agentd.language.terms.terms import (
    EMPTY,
    FIRST_NODES,
    MOST_NODES,
    PER_PART,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Var,
    deref,
    further,
    split,
)

MOST_LINES: Final = 100_000
"""The greatest line number kept of code."""

_ME, _EMPTY, _LIST, _VAR, _EXPRESSION, _CODE, _OPEN, _REST, _COLLECTION = range(9)
_MYSELF: Final = [_ME]
_CODES: Final[dict[str, Any]] = {
    "plan": nodes.Plan,
    "trigger": nodes.Trigger,
    "rule": nodes.Rule,
    "body": nodes.Body,
}
"""The syntax that code as a term may hold."""
_IN_BRACES: Final = {"trigger": nodes.TriggerTerm, "rule": nodes.RuleTerm, "body": nodes.BodyTerm}
"""The syntax of code in braces. Plans are written without: one with only a trigger would read as a trigger."""
_encode: Final = msgspec.msgpack.Encoder().encode
_decode: Final = msgspec.msgpack.Decoder(list[Any]).decode


class CannotKeep(ValueError):
    """A term cannot be kept in a checkpoint; the text is the reason."""


class BadBytes(ValueError):
    """Bytes cannot be decoded as terms; the text is the reason."""


def terms_to_bytes(terms: Iterable[Any]) -> bytes:
    """Return terms as bytes; equal variables in them stay equal. Raises CannotKeep for one that is cyclic or huge."""
    return write_terms(terms)[0]


def terms_from_bytes(data: bytes) -> list[Any]:
    """Return the terms that were made bytes. Raises BadBytes for anything else."""
    return read_terms(data)[0]


def write_terms(terms: Iterable[Any]) -> tuple[bytes, bool]:
    """As `terms_to_bytes`, and whether a map, set or queue is inside, which the run may change in place."""
    writer = _Writer()
    try:
        return _encode(writer.write(terms)), writer.changeable
    except RecursionError as error:
        raise CannotKeep(str(error)) from None
    except CannotKeep:
        raise
    except (ValueError, TypeError, OverflowError, msgspec.MsgspecError) as error:  # such as half a surrogate pair
        raise CannotKeep(f"it cannot be encoded: {error}") from None


def read_terms(data: bytes) -> tuple[list[Any], bool]:
    """As `terms_from_bytes`, and whether a map, set or queue is inside."""
    reader = _Reader()
    try:
        return reader.read(_decode(data)), reader.changeable
    except (msgspec.MsgspecError, LookupError, AttributeError, TypeError, ValueError, RecursionError) as error:
        raise BadBytes(f"{type(error).__name__}: {error}") from None


class _Writer:
    """Writes terms that share their variables."""

    def __init__(self) -> None:
        self._out: list[Any] = []
        self._variables: dict[Var, int] = {}
        self._around: set[int] = set()
        """The maps, sets and queues around the current term, by identity."""
        self.changeable = False

    def write(self, terms: Iterable[Any]) -> list[Any]:
        """Return the tokens of terms."""
        out = self._out
        work: list[Any] = list(terms)
        """Terms to be written, the next one last; tuples hold the token that ends a term after its parts, and the term
        itself if it may contain itself."""
        work.reverse()
        until_check, left = FIRST_NODES, MOST_NODES
        while work:
            term = work.pop()
            kind = type(term)
            if kind is float:
                out.append(term)
            elif kind is str:
                out.append(term)
                until_check -= len(term) // PER_PART
            elif kind is Literal:
                if term is SOURCE_SELF:
                    out.append(_MYSELF)
                elif term.args or term.annots:
                    work.append((_literal_token(term),))
                    work += term.annots[::-1]
                    work += term.args[::-1]
                else:
                    out.append(_literal_token(term))
            elif kind is tuple:
                out.append(term[0])
                if len(term) == 2:
                    self._around.discard(id(term[1]))
            else:
                self._open(term, work)
            until_check -= 1
            if until_check <= 0:
                left -= FIRST_NODES - until_check
                if left <= 0:
                    raise CannotKeep(f"it has more than {MOST_NODES} parts")
                further(1, work, "kept")
                until_check = FIRST_NODES
        return out

    def _open(self, term: Any, work: list[Any]) -> None:
        """Push the parts of a term, and below them the token that ends it."""
        match term:
            case Var():
                term = deref(term)
                if type(term) is Var:
                    number = self._variables.setdefault(term, len(self._variables))
                    self._out.append([_VAR, number, term.name])
                else:
                    work.append(term)
            case List():
                self._open_list(term, work)
            case Expression(operator=operator, operands=operands):
                work.append(([_EXPRESSION, operator, len(operands)],))
                work.extend(reversed(operands))
            case Code():
                self._open_code(term, work)
            case Open():
                self._open_open(term, work)
            case Rest(tail=tail):
                work.append(([_REST],))
                work.append(tail)
            case Collection(kind=kind, content=content):
                if id(term) in self._around:
                    raise CannotKeep(f"it is a {kind} that contains itself")
                self._around.add(id(term))
                self.changeable = True
                parts = [x for pair in content.items() for x in pair] if kind == "map" else list(content)
                work.append(([_COLLECTION, kind, len(parts)], term))
                work.extend(reversed(parts))
            case _:
                raise CannotKeep(f"a {type(term).__name__} is no term")

    def _open_list(self, term: List, work: list[Any]) -> None:
        if term is EMPTY:
            self._out.append([_EMPTY])
            return
        items, tail = split(term)
        work.append(([_LIST, len(items)],))
        work.append(tail)
        work.extend(reversed(items))

    def _open_code(self, term: Code, work: list[Any]) -> None:
        for name, node in _CODES.items():
            if isinstance(term.syntax, node):
                position = term.syntax.position
                text = source_text(_IN_BRACES[name](term.syntax) if name in _IN_BRACES else term.syntax)
                if _read_code(name, text, position.file, 1) != term.syntax:
                    raise CannotKeep(f"it does not read back from its text: {text}")
                values = term.values
                work.append(([_CODE, name, text, position.file, position.line, term.bare, *values],))
                work.extend(reversed(list(values.values())))
                return
        raise CannotKeep(f"a {type(term.syntax).__name__} is no code")

    def _open_open(self, term: Open, work: list[Any]) -> None:
        named = term.namespace if type(term.namespace) is str else None
        has_literal, has_namespace = term.literal is not None, term.namespace is not None and named is None
        parts = [term.variable]
        if has_literal:
            parts.append(term.literal)
        if has_namespace:
            parts.append(term.namespace)
        annots = -1 if term.annots is None else len(term.annots)
        work.append(([_OPEN, term.negated, named, has_literal, has_namespace, annots],))
        work.extend(reversed([*parts, *(term.annots or ())]))


def _literal_token(term: Literal) -> list[Any]:
    sig = term.sig
    if sig.negated or sig.namespace != DEFAULT:
        return [sig.functor, len(term.args), len(term.annots), sig.negated, sig.namespace]
    if term.annots:
        return [sig.functor, len(term.args), len(term.annots)]
    return [sig.functor, len(term.args)] if term.args else [sig.functor]


class _Reader:
    """Reads terms that share their variables."""

    def __init__(self) -> None:
        self._stack: list[Any] = []
        self._variables: dict[int, Var] = {}
        self.changeable = False

    def read(self, tokens: list[Any]) -> list[Any]:
        """Return the terms of tokens. Raises ValueError for tokens of no term."""
        stack = self._stack
        for token in tokens:
            if type(token) is not list:
                if type(token) is not float and type(token) is not str:
                    raise TypeError(f"{token!r} is no term")
                stack.append(token)
            elif type(token[0]) is str:
                stack.append(self._literal(*token))
            else:
                stack.append(_KINDS[token[0]](self, *token[1:]))
        return stack

    def _take(self, count: int) -> list[Any]:
        """Remove and return the last ``count`` terms, the parts of another one."""
        if not count:
            return []
        if not 0 < count <= len(self._stack):
            raise ValueError(f"{count} parts are missing")
        parts = self._stack[-count:]
        del self._stack[-count:]
        return parts

    def _literal(
        self, functor: str, arity: int = 0, noted: int = 0, negated: bool = False, namespace: str = DEFAULT
    ) -> Literal:
        annots = tuple(self._take(noted))
        args = tuple(self._take(arity))
        if len(annots) == 1 and is_source(annots[0]):
            annots = _one_source(annots)
        made = Literal(signature(functor, arity, negated, namespace), args, annots)
        made.ground = all(map(_known_ground, args)) and all(map(_known_ground, annots))
        return made

    def _list(self, count: int) -> List:
        (tail,) = self._take(1)
        items = tuple(self._take(count))
        made = List(items, tail)
        made.ground = _known_ground(tail) and all(map(_known_ground, items))
        return made

    def _var(self, number: int, name: str) -> Var:
        found = self._variables.get(number)
        if found is None:
            found = self._variables[number] = Var(name)
        return found

    def _expression(self, operator: str, count: int) -> Expression:
        return Expression(operator, tuple(self._take(count)))

    def _code(self, kind: str, text: str, file: str, line: int, bare: bool, *names: str) -> Code:
        values = dict(zip(names, self._take(len(names)), strict=True))
        return Code(_read_code(kind, text, file, line), values, bare)

    def _open(self, negated: bool, named: str | None, has_literal: bool, has_namespace: bool, noted: int) -> Open:
        annots = None if noted < 0 else tuple(self._take(noted))
        namespace = self._take(1)[0] if has_namespace else named
        literal = self._take(1)[0] if has_literal else None
        return Open(self._take(1)[0], annots, negated, namespace, literal)

    def _collection(self, kind: str, count: int) -> Collection:
        self.changeable = True
        parts = self._take(count)
        if kind == "map":
            return Collection(kind, dict(zip(parts[::2], parts[1::2], strict=True)))
        return Collection(kind, parts)


def _read_code(kind: str, text: str, file: str, line: int) -> Any:
    """Return the syntax of code from its text, with its original position."""
    source = "\n" * (min(line, MOST_LINES) - 1) + text
    try:
        node = parse_term(source, file) if kind in _IN_BRACES else parse_plan(source, file)
    except SyntaxErrors as errors:
        raise ValueError(f"`{text}`: {errors.findings[0].message}") from None
    found = getattr(node, kind) if kind in _IN_BRACES else node
    if not isinstance(found, _CODES[kind]):
        raise TypeError(f"`{text}` is no {kind}")
    return found


def _one_source(annots: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the one object for annotations that name one source: comparisons look at identity first."""
    if annots[0] is SOURCE_SELF:
        return SELF
    (who,) = annots[0].args
    plain = not annots[0].annots and type(who) is Literal and not (who.args or who.annots or who.sig.negated)
    return told_by(who.sig.functor) if plain and who.sig.namespace == DEFAULT else annots


def _known_ground(term: Any) -> bool:
    kind = type(term)
    return kind is float or kind is str or ((kind is Literal or kind is List) and term.ground)


_KINDS: Final[tuple[Callable[..., Any], ...]] = (
    lambda reader: SOURCE_SELF,
    lambda reader: EMPTY,
    _Reader._list,
    _Reader._var,
    _Reader._expression,
    _Reader._code,
    _Reader._open,
    lambda reader: Rest(reader._take(1)[0]),
    _Reader._collection,
)
