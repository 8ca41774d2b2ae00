"""What many runs say together: shares and their intervals, causes, distributions, the difference of two missions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from argosy.trial.single_run import Outcome

Z: Final = 1.959964
"""Of a two-sided interval of 95 %."""
NO_FAULT: Final = "vehicle seed"
"""Of the chance by which a vehicle's other faults strike."""
MOST_BINS: Final = 24
"""Bins of a histogram."""
_VARYING: Final = re.compile(r"\b(?=[0-9a-f]*[0-9])[0-9a-f]{8,}\b|-?\d+(?:\.\d+)?")
"""Ids and numbers in texts: two failures that differ in these alone have one cause."""


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
    """Return the exact two-sided p of McNemar's test (1947), from the runs in which one of two missions succeeds."""
    differing = only_first + only_second
    tail = sum(math.comb(differing, k) for k in range(min(only_first, only_second) + 1))
    return min(1.0, float(2 * tail / 2**differing))


class Cause(NamedTuple):
    """A reason why runs failed."""

    text: str
    """Of the first run that failed by it."""
    seeds: list[int]


def cause_of(outcome: Outcome) -> str:
    """Return why a run failed: its first violation, else the end of its mission."""
    if outcome.violations:
        return f"{outcome.violations[0].rule}: {outcome.violations[0].text}"
    return (outcome.why.splitlines() or [""])[0] or "no reason is known"


def same_cause(one: Outcome, other: Outcome) -> bool:
    """Return whether a second run broke the rule that the first one broke first, or failed by the same cause."""
    if one.violations:
        return one.violations[0].rule in {violation.rule for violation in other.violations}
    return (
        other.failed and not other.violations and _VARYING.sub("#", cause_of(other)) == _VARYING.sub("#", cause_of(one))
    )


def causes(outcomes: Iterable[Outcome]) -> list[Cause]:
    """Return the reasons of all failures, the most frequent first; reasons that differ in numbers only are one."""
    found: dict[str, Cause] = {}
    for one in outcomes:
        if not one.success:
            text = cause_of(one)
            found.setdefault(_VARYING.sub("#", text), Cause(text, [])).seeds.append(one.seed)
    return sorted(found.values(), key=lambda cause: -len(cause.seeds))


def quantiles(values: Sequence[float]) -> tuple[float, float, float, float]:
    """Return minimum, median, 95th percentile and maximum. Raises ValueError for no values."""
    if not values:
        raise ValueError("no values")
    ranked = sorted(values)
    return ranked[0], ranked[(len(ranked) - 1) // 2], ranked[math.ceil(0.95 * len(ranked)) - 1], ranked[-1]


class Distribution(NamedTuple):
    """The values of one figure over all runs that succeeded."""

    name: str
    unit: str
    values: list[float]


def distributions(outcomes: Sequence[Outcome]) -> list[Distribution]:
    """Return what was measured in the runs that succeeded: of the others one run ends early, another late."""
    good = [one for one in outcomes if one.success]
    found = (
        Distribution("duration", "s", [one.seconds for one in good]),
        Distribution("distance flown", "m", [one.flown for one in good if one.flown is not None]),
        Distribution("battery left", "%", [100 * one.battery for one in good if one.battery is not None]),
        Distribution("nearest approach", "m", [one.nearest for one in good if one.nearest is not None]),
        Distribution("messages", "", [float(one.messages) for one in good]),
    )
    return [one for one in found if one.values]


def histogram(values: Sequence[float]) -> list[tuple[float, float, int]]:
    """Return bins of equal width as lower edge, upper edge and count; equal values have one bin of width 0."""
    low, high = min(values), max(values)
    if low == high:
        return [(low, high, len(values))]
    bins = min(MOST_BINS, max(5, math.ceil(2 * len(values) ** (1 / 3))))
    counts = [0] * bins
    for value in values:
        counts[min(bins - 1, int((value - low) / (high - low) * bins))] += 1
    width = (high - low) / bins
    return [(low + width * number, low + width * (number + 1), count) for number, count in enumerate(counts)]


class FaultShare(NamedTuple):
    """How often a kind of fault was drawn, and how the runs with it ended."""

    kind: str
    faults: int
    runs: int
    failed: int


def fault_shares(outcomes: Iterable[Outcome]) -> list[FaultShare]:
    """Return the kinds of faults that were drawn, by name."""
    found: dict[str, FaultShare] = {}
    for one in outcomes:
        kinds = [kind for fault in one.faults if (kind := fault_kind(fault)) != NO_FAULT]
        for kind in set(kinds):
            had = found.get(kind, FaultShare(kind, 0, 0, 0))
            faults = had.faults + kinds.count(kind)
            found[kind] = FaultShare(kind, faults, had.runs + 1, had.failed + (not one.success))
    return [found[kind] for kind in sorted(found)]


def fault_kind(fault: object) -> str:
    """Return the name of a kind of fault, as fault files have it; of a vehicle's own also which: `vehicle loss`."""
    tag = str(getattr(type(fault), "__struct_config__").tag)  # noqa: B009 - mypy knows no such attribute of a class
    own = str(getattr(fault, "fault", "")).partition("=")[0]
    return f"{tag} {own}".strip()
