"""Differences of neighbours: their median, and the interval that holds the true one with 95 %."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

DOUBT = 0.05


@dataclass(frozen=True)
class Interval:
    """A median and its interval."""

    low: float
    median: float
    high: float
    count: int
    """Of differences."""

    def told(self, unit: str, digits: int = 1) -> str:
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
