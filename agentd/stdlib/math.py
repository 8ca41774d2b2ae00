"""Functions of numbers and of lists of numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from agentd.language.terms.numbers import java_round
from agentd.language.terms.terms import Term, deref, proper
from agentd.mind.data.registry import function
from agentd.mind.state import MindState

_NAN = math.nan


def _guarded(compute: Callable[[float], float], outside: float = _NAN) -> Callable[[float], float]:
    """Infinity and NaN instead of errors."""

    def guarded(x: float) -> float:
        try:
            return float(compute(x))
        except (ValueError, OverflowError):
            return outside

    return guarded


def _whole(compute: Callable[[float], int]) -> Callable[[float], float]:
    def whole(x: float) -> float:
        return float(compute(x)) if math.isfinite(x) else x

    return whole


_OF_ONE: dict[str, tuple[Callable[[float], float], str]] = {
    "math.abs": (abs, "without its sign"),
    "math.round": (java_round, "the nearest whole number, halves upwards"),
    "math.floor": (_whole(math.floor), "the next whole number below"),
    "math.ceil": (_whole(math.ceil), "the next whole number above"),
    "math.sqrt": (_guarded(math.sqrt), "the square root; of a negative number, NaN"),
    "math.log": (lambda x: -math.inf if x == 0 else _guarded(math.log)(x), "the natural logarithm"),
    "math.sin": (_guarded(math.sin), "the sine of radians"),
    "math.cos": (_guarded(math.cos), "the cosine of radians"),
    "math.tan": (_guarded(math.tan), "the tangent of radians"),
    "math.asin": (_guarded(math.asin), "the arc sine, in radians"),
    "math.acos": (_guarded(math.acos), "the arc cosine, in radians"),
    "math.atan": (math.atan, "the arc tangent, in radians"),
}


def _register(name: str, compute: Callable[[float], float], what: str) -> None:
    @function(name, 1, pure=True)
    def of_one(mind: MindState, x: Term) -> Any:
        return compute(x) if type(x) is float else None

    of_one.__doc__ = f"``{name}(X)``: {what}."


for _name, (_compute, _what) in _OF_ONE.items():
    _register(_name, _compute, _what)


@function("math.pi", 0, pure=True)
def pi(mind: MindState) -> float:
    """``math.pi``: 3.14159...

    ?- X = math.round(math.pi * 100) gives X = 314
    """
    return math.pi


@function("math.e", 0, pure=True)
def e(mind: MindState) -> float:
    """``math.e``: 2.71828..."""
    return math.e


@function("math.random", 0, 1)
def random(mind: MindState, factor: Term = 1.0) -> Any:
    """``math.random``, ``math.random(F)``: a random number from 0 to 1, or to F."""
    return mind.random.random() * factor if type(factor) is float else None


def _numbers(term: Term) -> list[float] | None:
    """The numbers of a list, other members skipped; None if it is no list."""
    members = proper(term)
    return None if members is None else [m for m in map(deref, members) if type(m) is float]


@function("math.max", 1, 2, pure=True)
def maximum(mind: MindState, first: Term, second: Term | None = None) -> Any:
    """``math.max(A, B)``, ``math.max(L)``: the greater of two numbers, the greatest of a list.

    Of an empty list it is the smallest positive double, as in Jason.

    ?- X = math.max(2, 5) gives X = 5
    ?- X = math.max([2,7,5]) gives X = 7
    """
    if second is not None:
        return max(first, second) if type(first) is float and type(second) is float else None
    numbers = _numbers(first)
    return None if numbers is None else max(numbers, default=5e-324)


@function("math.min", 1, 2, pure=True)
def minimum(mind: MindState, first: Term, second: Term | None = None) -> Any:
    """``math.min(A, B)``, ``math.min(L)``: the smaller of two numbers, the smallest of a list.

    ?- X = math.min([2,7,5]) gives X = 2
    """
    if second is not None:
        return min(first, second) if type(first) is float and type(second) is float else None
    numbers = _numbers(first)
    return None if numbers is None else min(numbers, default=1.7976931348623157e308)


def _mean(numbers: list[float]) -> float:
    return sum(numbers) / len(numbers) if numbers else _NAN


def _deviation(numbers: list[float]) -> float:
    if len(numbers) < 2:
        return _NAN
    mean = _mean(numbers)
    return math.sqrt(sum((x - mean) ** 2 for x in numbers) / (len(numbers) - 1))


def _register_of_list(name: str, compute: Callable[[list[float]], float], what: str, example: str) -> None:
    @function(name, 1, pure=True)
    def of_list(mind: MindState, items: Term) -> Any:
        numbers = _numbers(items)
        return None if numbers is None else compute(numbers)

    of_list.__doc__ = f"{what}.\n\n?- X = math.{example}"


_SUM, _DEVIATION = "the sum of the numbers of a list", "the sample's standard deviation (n-1) of the numbers of a list"
_AVERAGE = "``math.average(L)``, ``math.mean(L)``: the mean of the numbers of a list; of none, NaN"
_register_of_list("math.sum", lambda some: float(sum(some)), f"``math.sum(L)``: {_SUM}", "sum([1,2,3.5]) gives X = 6.5")
_register_of_list("math.average", _mean, _AVERAGE, "average([1,2,6]) gives X = 3")
_register_of_list("math.mean", _mean, _AVERAGE, "average([1,2,6]) gives X = 3")
_register_of_list("math.std_dev", _deviation, f"``math.std_dev(L)``: {_DEVIATION}", "std_dev([1,3,5]) gives X = 2")


@function("math.median", 1, pure=True)
def median(mind: MindState, items: Term) -> Any:
    """``math.median(L)``: the middle of a list of numbers.

    ?- X = math.median([9,1,2]) gives X = 2
    """
    numbers, members = _numbers(items), proper(items)
    if not numbers or members is None or len(numbers) != len(members):
        return None
    ranked, middle = sorted(numbers), len(numbers) // 2
    return ranked[middle] if len(ranked) % 2 else (ranked[middle - 1] + ranked[middle]) / 2
