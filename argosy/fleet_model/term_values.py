"""Read numbers, places and texts from the terms of percepts and actions."""

from __future__ import annotations

import math

from schemas.wire.term_text import write
from schemas.wire.terms import Atom, Term, to_float

Position = tuple[float, float]
"""Latitude and longitude in degrees."""


def plain(term: Term) -> str:
    """Return a term for people: strings without quotes."""
    return term if isinstance(term, str) else write(term)


def is_true(term: Term) -> bool:
    """Whether a term is `true`: as a boolean, an atom or a string."""
    return term is True or term == Atom("true") or (isinstance(term, str) and term.lower() == "true")


def finite(term: Term) -> float | None:
    """Return a term as a number; None if it is not a number, infinite or too large for a float."""
    try:
        number = to_float(term)
    except OverflowError:  # an integer of more than 300 digits
        return None
    return number if number is not None and math.isfinite(number) else None


def position_of(latitude: Term, longitude: Term) -> Position | None:
    """Return degrees of latitude and longitude; None if the terms are not a place on earth."""
    one, two = finite(latitude), finite(longitude)
    if one is None or two is None or not (-90 <= one <= 90 and -180 <= two <= 180):
        return None
    return one, two
