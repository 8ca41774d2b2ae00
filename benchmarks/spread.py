"""Statistics of measured values: spreads, intervals, and how a cost grows."""

from __future__ import annotations

import math
import statistics
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Spread:
    """How values lie."""

    count: int
    mean: float
    p50: float
    p99: float
    max: float

    def __str__(self) -> str:
        return f"{self.p50:.1f} / {self.p99:.1f}"


def percentile(values: Collection[float], part: float) -> float:
    """Return the value that so large a part of the values (0.5 = half) stays under. Raises ValueError for none.

    It is one of the values: no mean of neighbours is taken.
    """
    if not values:
        raise ValueError("no values")
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, round(part * len(ordered)))]


def spread(values: Collection[float]) -> Spread:
    """Return how values lie. Raises ValueError for none."""
    if not values:
        raise ValueError("no values")
    ordered = sorted(values)
    p50, p99 = (percentile(ordered, part) for part in (0.5, 0.99))
    return Spread(len(ordered), statistics.mean(ordered), p50, p99, ordered[-1])


NOTHING = Spread(0, 0.0, 0.0, 0.0, 0.0)
"""Of no values, where that is no error."""


DOUBT = 0.05


@dataclass(frozen=True)
class Interval:
    """A median and its interval."""

    low: float
    median: float
    high: float
    count: int
    """Of differences."""

    def text(self, unit: str, digits: int = 1) -> str:
        """Return it for a page."""
        return f"{self.median:.{digits}f}{unit} ({self.low:.{digits}f} to {self.high:.{digits}f})"

    def scaled(self, factor: float) -> Interval:
        """Return it in another unit; `factor` is positive."""
        return Interval(self.low * factor, self.median * factor, self.high * factor, self.count)

    def plus(self, other: Interval) -> Interval:
        """Return the sum, with the bounds added: rather too wide than too narrow."""
        low, median, high = self.low + other.low, self.median + other.median, self.high + other.high
        return Interval(low, median, high, min(self.count, other.count))


def interval(values: Sequence[float]) -> Interval:
    """Return the median of differences and its interval by the sign test, which supposes nothing of how they lie.

    Below six differences there is no such interval: it is from the least to the greatest. Raises ValueError for none.
    """
    ordered, count = sorted(values), len(values)
    if not ordered:
        raise ValueError("no differences")
    outside, chance = 0, 0.0
    for rank in range(count // 2):
        chance += math.comb(count, rank) / 2**count
        if 2 * chance > DOUBT:
            break
        outside = rank + 1
    first = max(0, outside - 1)
    return Interval(ordered[first], statistics.median(ordered), ordered[count - 1 - first], count)


Points = Sequence[tuple[float, float]]
"""Sizes and what they cost."""
STEEPEST: Final = 1.15
"""A power of the size that still counts as in proportion to it: what noise makes of 1."""
FLAT: Final = 1.3
"""A cost whose largest value is less than so many times its smallest does not grow."""
SIZES: Final = 4
"""Sizes that a power takes: it has three unknowns."""
_POWERS: Final = [step / 100 for step in range(5, 301)]


@dataclass(frozen=True)
class Line:
    """`base + each * size`."""

    base: float
    each: float

    def at(self, size: float) -> float:
        """Return the cost of a size."""
        return self.base + self.each * size

    def off(self, points: Points) -> float:
        """Return by how large a part of what was measured the line is off at worst."""
        least = _least(points)
        return max(abs(self.at(size) - cost) / max(cost, least) for size, cost in points)


@dataclass(frozen=True)
class Growth:
    """`base + each * size ** power`, neither of them negative."""

    power: float
    """1 = in proportion, 2 = with the square; 0 = it does not grow."""
    off: float
    """By how large a part of what was measured it is off at worst."""
    base: float
    each: float

    def reaches(self, cost: float) -> float:
        """Return the size of a cost; infinite if it never comes to that."""
        if not self.power or self.each <= 0:
            return math.inf
        return float((max(0.0, cost - self.base) / self.each) ** (1 / self.power))

    def __str__(self) -> str:
        return f"size ^ {self.power:.2f}" if self.power else "does not grow"


def line(points: Points) -> Line:
    """Return the line with the least squares of relative errors.

    Raises ValueError for fewer than two sizes.
    """
    if len({size for size, _ in points}) < 2:
        raise ValueError("a line needs two sizes")
    weighted = _weighted(points)
    total = sum(w for _, _, w in weighted)
    mean_size = sum(w * size for size, _, w in weighted) / total
    mean_cost = sum(w * cost for _, cost, w in weighted) / total
    above = sum(w * (size - mean_size) * (cost - mean_cost) for size, cost, w in weighted)
    each = above / sum(w * (size - mean_size) ** 2 for size, _, w in weighted)
    return Line(mean_cost - each * mean_size, each)


def power(points: Points) -> Growth:
    """Return the power of the size by which a cost grows: of all between 0.05 and 3 the one that is the least off.

    Raises ValueError for fewer than `SIZES` sizes.
    """
    if len({size for size, _ in points}) < SIZES:
        raise ValueError(f"a power needs {SIZES} sizes")
    costs = [cost for _, cost in points]
    if max(costs) <= FLAT * min(costs):
        flat = _flat(points)
        return Growth(0.0, flat.off(points), flat.base, 0.0)
    return min((_with(points, one) for one in _POWERS), key=lambda one: one[0])[1]


def _with(points: Points, exponent: float) -> tuple[float, Growth]:
    """Return the sum of squares of relative errors, and the best growth by this power."""
    scaled = [(size**exponent, cost) for size, cost in points]
    best = line(scaled)
    if best.base < 0:  # the line through (0, 0)
        weighted = _weighted(scaled)
        best = Line(0.0, sum(w * size * cost for size, cost, w in weighted) / sum(w * s**2 for s, _, w in weighted))
    if best.each < 0:
        best = _flat(points)
    least = _least(points)
    squares = sum(((best.at(size) - cost) / max(cost, least)) ** 2 for size, cost in scaled)
    return squares, Growth(exponent, best.off(scaled), best.base, best.each)


def _least(points: Points) -> float:
    """Return the cost below which errors are not relative to it any more: it is too small to be measured well."""
    return max(1e-9, 0.01 * max(cost for _, cost in points))


def _weighted(points: Points) -> list[tuple[float, float, float]]:
    """Return sizes and costs, each with the weight that makes its error a relative one."""
    least = _least(points)
    return [(size, cost, 1.0 / max(cost, least) ** 2) for size, cost in points]


def _flat(points: Points) -> Line:
    """Return the line that does not grow."""
    weighted = _weighted(points)
    return Line(sum(w * cost for _, cost, w in weighted) / sum(w for _, _, w in weighted), 0.0)
