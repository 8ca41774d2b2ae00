"""Java's text formats for ``.printf``: ``%[place$][flags][width][.digits]conversion``.

Jason hands every number over as a double, so the conversions for integers and characters fit no value at all.
"""

from __future__ import annotations

import math
import re
from decimal import ROUND_HALF_UP, Decimal, localcontext
from typing import Any, Final, NamedTuple

from agentd.language.terms.format import whole_text
from agentd.language.terms.numbers import double_text, number_text
from agentd.language.terms.terms import List, Term, deref, split
from agentd.mind.beliefs.work_limit import joined, substituted
from agentd.mind.data.formula_failure import Failed

_PLACE: Final = re.compile(r"%(?:(\d+)\$|(<))?([-#+ 0,(]*)(\d*)(?:\.(\d+))?([a-zA-Z%])|%")
_MOST: Final = 10_000
"""Greatest width of a place, and greatest number of digits after the point."""
_DIGITS: Final = 800
"""More decimal digits than any double has, before and after the point together with what a place asks for."""


class _Place(NamedTuple):
    """One place of a format."""

    written: str
    flags: str
    width: int
    digits: int | None
    kind: str


def java_format(form: str, values: list[Term]) -> str:
    """``form`` with its places filled by ``values``, resolved terms. Fails with ``unknown`` where Java throws."""
    following = 0
    last = -1

    def piece(match: re.Match[str]) -> str:
        nonlocal following, last
        index, same, flags, width, digits, kind = match.groups()
        if kind is None:
            _fail("a % that begins no place; write %% for a percent sign")
        place = _Place(match.group(), flags, _size(width), _size(digits) if digits else None, kind)
        if kind == "n":
            return "\n"
        if kind == "%":
            return _justified("%", place)
        if not same:
            last = int(index) - 1 if index else following
            following += not index
        if not 0 <= last < len(values):
            _fail(f"there is no value for {place.written}")
        return _converted(values[last], place)

    return substituted(".printf", _PLACE, piece, form)


def _size(digits: str) -> int:
    size = int(digits or 0)
    if size > _MOST:
        _fail(f"a place may not be wider than {_MOST}")
    return size


def _fail(why: str) -> Any:
    raise Failed("unknown", f"the format of .printf: {why}")


def _converted(value: Term, place: _Place) -> str:
    match place.kind.lower():
        case "s":
            shown = double_text(value) if type(value) is float else java_text(value)
        case "b":
            shown = "true"
        case "e" | "f" | "g" if place.kind != "F":
            return _number(value, place)
        case "d" | "o" | "x" | "c":
            return str(_fail(f"{place.written} takes no floating point number, and every number is one; write %.0f"))
        case _:
            return str(_fail(f"{place.written} is no conversion that .printf knows"))
    if place.digits is not None:
        shown = shown[: place.digits]
    return _justified(shown.upper() if place.kind.isupper() else shown, place)


def java_text(value: Term) -> str:
    """A term as Java shows the object that Jason hands over: strings bare, lists with a blank after the comma."""
    if type(value) is float:
        return number_text(value)
    if type(value) is List:
        members, _ = split(value)
        return f"[{joined('.printf', (java_text(deref(m)) for m in members), ', ')}]"
    return value if type(value) is str else whole_text(value)


def _justified(shown: str, place: _Place) -> str:
    if "-" in place.flags:
        if not place.width:
            _fail(f"{place.written} needs a width")
        return shown.ljust(place.width)
    return shown.rjust(place.width)


def _number(value: Any, place: _Place) -> str:
    if type(value) is not float:
        _fail(f"{place.written} needs a number, not {java_text(value)}")
    if ("-" in place.flags and "0" in place.flags) or ("+" in place.flags and " " in place.flags):
        _fail(f"{place.written} has flags that exclude each other")
    negative = math.copysign(1.0, value) < 0
    if math.isfinite(value):
        shown = _magnitude(Decimal(repr(abs(value))), place)
    else:
        shown = "NaN" if math.isnan(value) else "Infinity"
        negative = value < 0
    before = "-" if negative else "+" if "+" in place.flags else " " if " " in place.flags else ""
    after = ""
    if negative and "(" in place.flags:
        before, after = "(", ")"
    if "0" in place.flags and math.isfinite(value):
        shown = shown.zfill(place.width - len(before) - len(after))
    shown = before + shown + after
    return _justified(shown.upper() if place.kind.isupper() else shown, place)


def _magnitude(number: Decimal, place: _Place) -> str:
    digits = 6 if place.digits is None else place.digits
    with localcontext() as context:
        context.prec = _DIGITS + digits
        match place.kind.lower():
            case "f":
                return _fixed(number, digits, "," in place.flags)
            case "e":
                return _scientific(number, digits)
            case _:
                digits = digits or 1
                rounded = number.quantize(Decimal(1).scaleb(number.adjusted() - digits + 1), ROUND_HALF_UP)
                if not number or Decimal("0.0001") <= rounded < Decimal(10) ** digits:
                    whole = rounded.adjusted() + 1 if number else 1
                    return _fixed(number, max(0, digits - whole), "," in place.flags)
                return _scientific(number, digits - 1)


def _fixed(number: Decimal, digits: int, grouped: bool) -> str:
    rounded = number.quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP)
    return f"{rounded:,f}" if grouped else f"{rounded:f}"


def _scientific(number: Decimal, digits: int) -> str:
    exponent = number.adjusted() if number else 0
    rounded = number.scaleb(-exponent).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP)
    if rounded >= 10:
        exponent += 1
        rounded = number.scaleb(-exponent).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP)
    return f"{rounded:f}e{'-' if exponent < 0 else '+'}{abs(exponent):02d}"
