"""What was measured of one row, and how its figures are written."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.processes import Speeds
from benchmarks.reasoner.rows import Row

Figure = Callable[[Speeds], float]


@dataclass(frozen=True)
class Result:
    """What was measured for a row: per subject its runs, in the order in which they were interleaved."""

    row: Row
    runs: dict[str, list[Speeds]]

    def median(self, key: str, figure: Figure) -> float | None:
        """The median of a figure over the runs of a subject; None if it was not run."""
        runs = self.runs.get(key)
        return statistics.median(map(figure, runs)) if runs else None

    def ratio(self, key: str, figure: Figure, base: Figure | None = None, to: str = "agentspeak") -> float | None:
        """The median over neighbouring runs of what a subject did for each unit that ``to`` did."""
        ours, theirs = self.runs.get(key), self.runs.get(to)
        if not ours or not theirs:
            return None
        return statistics.median(figure(a) / (base or figure)(b) for a, b in zip(ours, theirs, strict=True))


def cold(speeds: Speeds) -> float:
    """Operations per second in the first round."""
    return speeds.cold


def warm(speeds: Speeds) -> float:
    """Operations per second in the last two rounds."""
    return speeds.warm


def resident(speeds: Speeds) -> float:
    """Peak resident memory, MB."""
    return speeds.rss


def told_speed(value: float | None) -> str:
    """Return operations per second for a table."""
    return "-" if value is None else f"{value:,.0f}"


def told_times(value: float | None) -> str:
    """Return a ratio for a table."""
    return "-" if value is None else f"{value:.1f}x" if value < 100 else f"{value:,.0f}x"


def told_share(value: float | None) -> str:
    """Return a part of one for a table, in per cent."""
    return "-" if value is None else f"{value:.0%}"


def told_megabytes(value: float | None) -> str:
    """Return MB for a table."""
    return "-" if value is None else f"{value:.0f}"
