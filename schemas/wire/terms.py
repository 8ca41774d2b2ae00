"""Terms on the wire and in files.

JSON stays readable for people and other tools: numbers, strings and lists are plain JSON, `true` and `false` are the
atoms of that name, everything else is an object with a `kind`: `{"kind": "atom", "name": "guided"}`. JSON knows neither
Infinity nor NaN, so those are `{"kind": "number", "text": "Infinity"}`. What the language can only write as source text
(rules, plans, triggers, bodies, expressions with free variables) travels as that text.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import msgspec

AtomName = Annotated[str, msgspec.Meta(pattern=r"^([a-z][A-Za-z0-9_]*|'[^'\n]*')\Z")]
"""A quoted atom keeps its quotes (Jason: 'abc' and abc are different)."""
VariableName = Annotated[str, msgspec.Meta(pattern=r"^[A-Z_][A-Za-z0-9_]*\Z")]
Namespace = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_]*\Z")]


class _Kind(msgspec.Struct, frozen=True, tag_field="kind", omit_defaults=True):
    """Terms that JSON has no notation of its own for."""


class Atom(_Kind, frozen=True, tag="atom"):
    """A symbolic constant."""

    name: AtomName


class Number(_Kind, frozen=True, tag="number"):
    """A number that JSON cannot write."""

    text: Literal["Infinity", "-Infinity", "NaN"]


class Structure(_Kind, frozen=True, tag="structure"):
    """A compound term or annotated, negated or namespaced literal: `ns::~functor(args)[annotations]`."""

    functor: AtomName
    args: tuple[Term, ...] = ()
    annotations: tuple[Term, ...] = ()
    negated: bool = False
    namespace: Namespace = ""


class Variable(_Kind, frozen=True, tag="variable"):
    """A free variable, perhaps with a sign, a namespace or annotations of its own."""

    name: VariableName
    annotations: tuple[Term, ...] = ()
    negated: bool = False
    namespace: Namespace = ""


class OpenList(_Kind, frozen=True, tag="open_list"):
    """A list whose tail is not a list: `[a,b|T]`. A closed list is a plain JSON array."""

    items: tuple[Term, ...]
    tail: Term


class Source(_Kind, frozen=True, tag="source"):
    """A term that only source text can express: `{ +!g : c <- !a }`, `{ h :- b }`, `(X+1)`."""

    of: Literal["plan", "rule", "trigger", "body", "expression"]
    text: str


class Map(_Kind, frozen=True, tag="map"):
    """A copy of a `.map` value, as pairs in the order of its keys."""

    entries: tuple[tuple[Term, Term], ...] = ()


class Set(_Kind, frozen=True, tag="set"):
    """A copy of a `.set` value, in the order of terms."""

    items: tuple[Term, ...] = ()


class Queue(_Kind, frozen=True, tag="queue"):
    """A copy of a `.queue` value, head first."""

    items: tuple[Term, ...] = ()
    priority: bool = False


Kind: TypeAlias = Atom | Number | Structure | Variable | OpenList | Source | Map | Set | Queue
KINDS = (Atom, Number, Structure, Variable, OpenList, Source, Map, Set, Queue)

if TYPE_CHECKING:
    Term: TypeAlias = bool | int | float | str | list["Term"] | Kind
else:

    class _AnyTerm(type):
        """Lets msgspec accept what `decode_hook` has checked: it asks isinstance() of the result."""

        def __instancecheck__(cls, value: object) -> bool:
            return True

    class Term(metaclass=_AnyTerm):
        """Marks a field that holds a term; `decode_hook` checks what came: msgspec has no recursive unions."""


def number(value: float) -> Term:
    """Return `value` as a term, tagged if JSON has no notation for it."""
    if math.isfinite(value):
        return value
    if math.isnan(value):
        return Number("NaN")
    return Number("Infinity") if value > 0 else Number("-Infinity")


def to_float(term: Term) -> float | None:
    """Return the number that `term` is, or None if it is not a number."""
    if isinstance(term, bool):
        return None
    if isinstance(term, int | float):
        return float(term)
    if isinstance(term, Number):
        return float(term.text)
    return None


def decode_hook(expected: type, value: Any) -> Any:
    """Turn decoded JSON or MessagePack into a term: msgspec's `dec_hook`. Raises ValueError that says what is wrong."""
    if expected.__name__ != "Term":
        raise NotImplementedError(f"no decoding for {expected!r}")
    if isinstance(value, _PLAIN):
        if type(value) is float and not math.isfinite(value):
            return number(value)
        if type(value) is int and not -(2**63) <= value < 2**63:
            raise ValueError("Expected a number, got an integer of more than 64 bits: write it with a point")
        return value
    if isinstance(value, list):
        return [decode_hook(expected, item) for item in value]
    if isinstance(value, dict):
        if "kind" not in value:
            raise ValueError("Expected a term: an object needs `kind`, one of " + ", ".join(_TAGS))
        tag = value["kind"]
        # Not to the union of all: msgspec analyses a union each time, ten times as long as the conversion.
        kind = _BY_TAG.get(tag, Kind) if isinstance(tag, str) else Kind
        try:
            return msgspec.convert(value, kind, dec_hook=decode_hook)
        except msgspec.ValidationError as error:
            raise ValueError(f"{tag}: {error}") from None  # so that msgspec adds the place of the term
    if isinstance(value, KINDS):
        return value
    raise ValueError(f"Expected a term, got `{'null' if value is None else type(value).__name__}`")


_PLAIN = (bool, int, float, str)
_TAGS = ("atom", "number", "structure", "variable", "open_list", "source", "map", "set", "queue")
_BY_TAG: dict[str, Any] = dict(zip(_TAGS, KINDS, strict=True))


def term_of(value: Any) -> Term:
    """Return the term for a Python value: a number, text, boolean, list, tuple or dict (a map); terms are as they are.

    A text is a string: `schemas.wire.term_text.read` makes a term of one that is written as in a program. Raises
    TypeError.
    """
    match value:
        case bool() | int() | str():
            return value
        case float():
            return number(value)
        case list() | tuple():
            return [term_of(one) for one in value]
        case dict():
            return Map(tuple((term_of(key), term_of(one)) for key, one in value.items()))
        case _ if isinstance(value, KINDS):
            return value
    raise TypeError(f"{value!r} cannot be a term: numbers, strings, booleans, lists, dicts and schemas.wire.terms can")
