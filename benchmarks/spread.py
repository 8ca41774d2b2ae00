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

    def __str__(self) -> str:
        return f"{self.p50:.1f} / {self.p99:.1f}"


def spread(values: Collection[float]) -> Spread:
    """Return how values lie. Raises ValueError for none."""
    if not values:
        raise ValueError("no values")
    ordered = sorted(values)
    p50, p90, p99 = (ordered[min(len(ordered) - 1, round(part * len(ordered)))] for part in (0.5, 0.9, 0.99))
    return Spread(len(ordered), statistics.mean(ordered), p50, p90, p99, ordered[-1])
