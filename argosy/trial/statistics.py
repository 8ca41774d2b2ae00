"""What many runs say together: shares and their intervals, causes, distributions, the difference of two missions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from argosy.trial.single_run import Outcome

Z: Final = 1.959964
"""Of a two-sided interval of 95 %."""
_NUMBER: Final = re.compile(r"-?\d+(?:\.\d+)?")


class Interval(NamedTuple):
    """A share and its 95 % interval."""

    share: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.share:.3f} ({self.low:.3f} to {self.high:.3f})"


def wilson(successes: int, runs: int) -> Interval:
    """Return the share of successes with its Wilson interval (E. B. Wilson, 1927). Raises ValueError for no runs."""
    if runs < 1:
        raise ValueError("no runs")
    share = successes / runs
    middle = (share + Z**2 / (2 * runs)) / (1 + Z**2 / runs)
    half = Z / (1 + Z**2 / runs) * math.sqrt(share * (1 - share) / runs + Z**2 / (4 * runs**2))
    low = 0.0 if successes == 0 else max(0.0, middle - half)
    high = 1.0 if successes == runs else min(1.0, middle + half)
    return Interval(share, low, high)


def mcnemar(only_first: int, only_second: int) -> float:
    """Return the exact two-sided p of McNemar's test: of so many runs only one of two missions succeeded."""
    both = only_first + only_second
    if not both:
        return 1.0
    fewer = min(only_first, only_second)
    return min(1.0, 2.0 * sum(math.comb(both, k) for k in range(fewer + 1)) / float(2**both))


class Cause(NamedTuple):
    """A reason why runs failed."""

    text: str
    seeds: list[int]


def causes(outcomes: Iterable[Outcome]) -> list[Cause]:
    """Return the reasons of all failures, the most frequent first; reasons that differ in numbers only are one."""
    found: dict[str, Cause] = {}
    for one in outcomes:
        if not one.success:
            text = f"{one.violations[0].rule}: {one.violations[0].text}" if one.violations else one.why
            found.setdefault(_NUMBER.sub("#", text), Cause(text, [])).seeds.append(one.seed)
    return sorted(found.values(), key=lambda cause: -len(cause.seeds))


def quantiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Return median, 95th percentile and maximum. Raises ValueError for no values."""
    if not values:
        raise ValueError("no values")
    ranked = sorted(values)
    return ranked[(len(ranked) - 1) // 2], ranked[math.ceil(0.95 * len(ranked)) - 1], ranked[-1]
