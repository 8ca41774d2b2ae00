"""How a cost grows with a size: straight lines and powers by least squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

Points = Sequence[tuple[float, float]]
"""Sizes and what they cost."""


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


def line(points: Points) -> Line:
    """Return the line with the least squares of relative errors: a small size counts as much as a large one.

    Raises ValueError for fewer than two sizes.
    """
    weights = [1.0 / max(cost, 1e-9) ** 2 for _, cost in points]
    total = sum(weights)
    if len({size for size, _ in points}) < 2:
        raise ValueError("a line needs two sizes")
    mean_size = sum(w * size for w, (size, _) in zip(weights, points, strict=True)) / total
    mean_cost = sum(w * cost for w, (_, cost) in zip(weights, points, strict=True)) / total
    above = sum(w * (s - mean_size) * (c - mean_cost) for w, (s, c) in zip(weights, points, strict=True))
    each = above / sum(w * (s - mean_size) ** 2 for w, (s, _) in zip(weights, points, strict=True))
    return Line(mean_cost - each * mean_size, each)


def power(points: Points) -> float:
    """Return the p of `size ** p` that what grows of a cost follows best: 1 = in proportion, 2 = with the square.

    What the smallest size costs counts as the base, less what one of it costs. Raises ValueError for fewer than three
    sizes.
    """
    ordered = sorted(points)
    if len({size for size, _ in ordered}) < 3:
        raise ValueError("a power needs three sizes")
    (first, lowest), *rest = ordered
    grown = [(math.log(size - first), math.log(max(cost - lowest, 1e-9))) for size, cost in rest if size > first]
    mean_x, mean_y = (sum(values) / len(grown) for values in zip(*grown, strict=True))
    together: float = sum((x - mean_x) * (y - mean_y) for x, y in grown)
    return together / float(sum((x - mean_x) ** 2 for x, _ in grown))
