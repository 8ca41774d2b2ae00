"""Arithmetic on doubles and their text, as Java does both (rules 1 to 15 of the dialect's numbers)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

_LONG = 2.0**63
_INT_MAX = 2**31 - 1
_INT_MIN = -(2**31)


class UndefinedNumber(ArithmeticError):
    """``x div 0``: the one operation without a value (deviation D2: it fails the plan)."""


def number_text(value: float) -> str:
    """Return a number as it prints: whole values without a point, others as Java's ``Double.toString``."""
    if value != value:
        return "NaN"
    if value in (math.inf, -math.inf):
        return "Infinity" if value > 0 else "-Infinity"
    if value == int(value) and abs(value) <= _LONG:
        return str(min(int(value), 2**63 - 1))
    return double_text(value)


def double_text(value: float) -> str:
    """Java's ``Double.toString``: ``1.0E20``, ``0.0015``, ``1.5``; exponents below 1e-3 and from 1e7 on."""
    if value != value or value in (math.inf, -math.inf):
        return number_text(value)
    sign = "-" if math.copysign(1.0, value) < 0 else ""
    mantissa, _, exponent = f"{abs(value)!r}".partition("e")
    if len(mantissa) == 1:  # Java writes two digits at least, those nearest to the value: 4.9E-324
        mantissa, _, exponent = f"{abs(value):.1e}".partition("e")
    whole, _, fraction = mantissa.partition(".")
    digits = (whole + fraction).lstrip("0")
    if not digits:
        return sign + "0.0"
    # The value is 0.DIGITS * 10**point.
    point = len(whole.lstrip("0")) + int(exponent or 0)
    if not whole.lstrip("0"):
        point -= len(fraction) - len(fraction.lstrip("0"))
    digits = digits.rstrip("0") or "0"
    if 1e-3 <= abs(value) < 1e7:
        if point <= 0:
            return f"{sign}0.{'0' * -point}{digits}"
        return f"{sign}{digits[:point].ljust(point, '0')}.{digits[point:] or '0'}"
    return f"{sign}{digits[0]}.{digits[1:] or '0'}E{point - 1}"


def divide(a: float, b: float) -> float:
    """``/`` of any two numbers, `a` by `b`: Infinity and NaN instead of errors."""
    if b:
        return a / b
    if a != a or b != b or a == 0.0:
        return math.nan
    return math.copysign(math.inf, a) * math.copysign(1.0, b)


def java_int(value: float) -> int:
    """Java's cast to 32 bits: truncating, clipped, NaN is 0."""
    if value != value:
        return 0
    if value >= _INT_MAX:
        return _INT_MAX
    return _INT_MIN if value <= _INT_MIN else int(value)


def integer_divide(a: float, b: float) -> float:
    """``div``: both operands cast to 32 bits, truncating.

    Raises `UndefinedNumber` when the divisor is 0 after the cast.
    """
    dividend, divisor = java_int(a), java_int(b)
    if divisor == 0:
        raise UndefinedNumber("division by zero in 'div'")
    quotient = abs(dividend) // abs(divisor)
    return float(quotient if (dividend < 0) == (divisor < 0) else -quotient)


def remainder(a: float, b: float) -> float:
    """``mod``: the floating remainder of `a` by `b`, with the sign of `a`; NaN if `b` is 0."""
    if not b or a in (math.inf, -math.inf):
        return math.nan
    return math.fmod(a, b)


def power(a: float, b: float) -> float:
    """``**``, with Infinity and NaN instead of errors."""
    try:
        value = a**b
    except OverflowError:
        return -math.inf if a < 0 and b % 2 == 1 else math.inf
    except ZeroDivisionError:
        return math.inf
    return value if isinstance(value, float) else math.nan


OPERATIONS: Final[dict[str, Callable[[float, float], float]]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": divide,
    "div": integer_divide,
    "mod": remainder,
    "**": power,
}
"""What the arithmetic operators of two operands compute."""


def java_round(value: float) -> float:
    """``Math.round``: halves up, clipped to 64 bits, NaN is 0."""
    if value != value:
        return 0.0
    if abs(value) >= _LONG:
        return math.copysign(_LONG, value)
    return float(math.floor(value + 0.5)) if abs(value) < 2**52 else value
