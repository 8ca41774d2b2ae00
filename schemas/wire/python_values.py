"""Python values as terms of the wire, for programs that are not agents."""

from __future__ import annotations

from typing import Any

from schemas.wire.terms import KINDS, Map, Term, number


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
