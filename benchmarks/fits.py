"""How a cost grows with a size: straight lines and powers by least squares of relative errors.

Relative, as what is measured here is off by a part of itself: a small size counts as much as a large one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

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

    def reaches(self, cost: float) -> float:
        """Return the size of a cost; infinite if it never comes to that."""
        return (cost - self.base) / self.each if self.each > 0 else math.inf

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

    def at(self, size: float) -> float:
        """Return the cost of a size."""
        return float(self.base + self.each * size**self.power)

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
    least = _least(points)
    weights = [1.0 / max(cost, least) ** 2 for _, cost in points]
    total = sum(weights)
    if len({size for size, _ in points}) < 2:
        raise ValueError("a line needs two sizes")
    mean_size = sum(w * size for w, (size, _) in zip(weights, points, strict=True)) / total
    mean_cost = sum(w * cost for w, (_, cost) in zip(weights, points, strict=True)) / total
    above = sum(w * (s - mean_size) * (c - mean_cost) for w, (s, c) in zip(weights, points, strict=True))
    each = above / sum(w * (s - mean_size) ** 2 for w, (s, _) in zip(weights, points, strict=True))
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
    if best.base < 0:
        best = Line(0.0, _through_nothing(scaled))
    if best.each < 0:
        best = _flat(points)
    least = _least(points)
    squares = sum(((best.at(size) - cost) / max(cost, least)) ** 2 for size, cost in scaled)
    return squares, Growth(exponent, best.off(scaled), best.base, best.each)


def _least(points: Points) -> float:
    """Return the cost below which errors are not relative to it any more: it is too small to be measured well."""
    return max(1e-9, 0.01 * max(cost for _, cost in points))


def _through_nothing(points: Points) -> float:
    """Return what each costs on the line through (0, 0)."""
    least = _least(points)
    weighted = [(size, cost, 1.0 / max(cost, least) ** 2) for size, cost in points]
    return sum(w * size * cost for size, cost, w in weighted) / sum(w * size**2 for size, _, w in weighted)


def _flat(points: Points) -> Line:
    """Return the line that does not grow."""
    least = _least(points)
    weights = [1.0 / max(cost, least) ** 2 for _, cost in points]
    return Line(sum(w * cost for w, (_, cost) in zip(weights, points, strict=True)) / sum(weights), 0.0)
