"""Functions of numbers and of lists of numbers."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from typing import Any

from agentd.language.numbers import java_round
from agentd.language.terms import deref, proper
from agentd.stdlib.registry import function

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


_OF_ONE: dict[str, Callable[[float], float]] = {
    "math.abs": abs,
    "math.round": java_round,
    "math.floor": _whole(math.floor),
    "math.ceil": _whole(math.ceil),
    "math.sqrt": _guarded(math.sqrt),
    "math.log": lambda x: -math.inf if x == 0 else _guarded(math.log)(x),
    "math.sin": _guarded(math.sin),
    "math.cos": _guarded(math.cos),
    "math.tan": _guarded(math.tan),
    "math.asin": _guarded(math.asin),
    "math.acos": _guarded(math.acos),
    "math.atan": math.atan,
}


def _register(name: str, compute: Callable[[float], float]) -> None:
    @function(name, 1)
    def of_one(mind: Any, x: Any) -> Any:
        return compute(x) if type(x) is float else None


for _name, _compute in _OF_ONE.items():
    _register(_name, _compute)


@function("math.pi", 0)
def pi(mind: Any) -> float:
    return math.pi


@function("math.e", 0)
def e(mind: Any) -> float:
    return math.e


@function("math.random", 0, 1)
def random(mind: Any, factor: Any = 1.0) -> Any:
    return mind.random.random() * factor if type(factor) is float else None


def _numbers(term: Any) -> list[float] | None:
    """The numbers of a list, other members skipped; None if it is no list."""
    members = proper(term)
    return None if members is None else [m for m in map(deref, members) if type(m) is float]


@function("math.max", 1, 2)
def maximum(mind: Any, first: Any, second: Any = None) -> Any:
    """The greatest of two numbers or of a list (of an empty one, the smallest positive double, as Jason)."""
    if second is not None:
        return max(first, second) if type(first) is float and type(second) is float else None
    numbers = _numbers(first)
    return None if numbers is None else max(numbers, default=5e-324)


@function("math.min", 1, 2)
def minimum(mind: Any, first: Any, second: Any = None) -> Any:
    if second is not None:
        return min(first, second) if type(first) is float and type(second) is float else None
    numbers = _numbers(first)
    return None if numbers is None else min(numbers, default=1.7976931348623157e308)


@function("math.sum", 1)
def total(mind: Any, items: Any) -> Any:
    numbers = _numbers(items)
    return None if numbers is None else float(sum(numbers))


@function("math.average", 1)
@function("math.mean", 1)
def average(mind: Any, items: Any) -> Any:
    numbers = _numbers(items)
    if numbers is None:
        return None
    return sum(numbers) / len(numbers) if numbers else _NAN


@function("math.median", 1)
def median(mind: Any, items: Any) -> Any:
    numbers, members = _numbers(items), proper(items)
    if numbers is None or members is None or len(numbers) != len(members):
        return None
    return float(statistics.median(numbers)) if numbers else None


@function("math.std_dev", 1)
def standard_deviation(mind: Any, items: Any) -> Any:
    """The sample's standard deviation (n-1)."""
    numbers = _numbers(items)
    if numbers is None:
        return None
    if len(numbers) < 2:
        return _NAN
    mean = sum(numbers) / len(numbers)
    return math.sqrt(sum((x - mean) ** 2 for x in numbers) / (len(numbers) - 1))
