"""Many values of one kind in few: what of them is kept in results and told on pages."""

from __future__ import annotations

import statistics
from collections.abc import Collection
from dataclasses import dataclass


@dataclass(frozen=True)
class Spread:
    """How values lie."""

    count: int
    mean: float
    p50: float
    p90: float
    p99: float
    max: float
    std: float = 0.0
    """Standard deviation, of these values alone (not of a population that they stand for)."""

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
    p50, p90, p99 = (percentile(ordered, part) for part in (0.5, 0.9, 0.99))
    mean, std = statistics.mean(ordered), statistics.pstdev(ordered)
    return Spread(len(ordered), mean, p50, p90, p99, ordered[-1], std)


NOTHING = Spread(0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Of no values, where that is no error."""
