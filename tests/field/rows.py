"""What a row of docs/measurements/faults.md says: what failed, what the vehicle showed and when, against
what was declared."""

import statistics
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from tests.soak.report import Judged
from tests.soak.report import table as markdown

MARGIN = 2.0
"""Seconds by which a figure may be later than declared: an order is given, taken and shown; two cores do everything."""
EARLY = 1.2
"""Seconds by which it may be earlier: patience counts from the last word, and words come once a second."""


@dataclass(frozen=True)
class Figure:
    """A moment after the fault, measured and declared, in seconds."""

    what: str
    measured: float
    declared: float | None = None
    why: str = ""
    """What the declared figure is made of."""

    def __str__(self) -> str:
        told = "" if self.declared is None else f" (declared {self.declared:g})"
        return f"{self.what} **{self.measured:.1f}**{told}"


@dataclass
class Row(Judged):
    """One fault."""

    fault: str
    injected: str
    figures: list[Figure] = field(default_factory=list)

    def figure(self, what: str, measured: float | None, declared: float | None = None, why: str = "") -> None:
        """Note a figure; one that is missing, or far from what was declared, is a problem."""
        if measured is None:
            self.problems.append(f"{what}: it did not happen")
            return
        self.figures.append(Figure(what, measured, declared, why))
        if declared is not None and not declared - EARLY <= measured <= declared + MARGIN:
            self.problems.append(f"{what} after {measured:.1f} s, declared {declared:g} s ({why})")


Maker = Callable[[Path], Row]
S = TypeVar("S")


def row_of(
    fault: str, injected: str, opens: Callable[[Path], AbstractContextManager[S]]
) -> Callable[[Callable[[Row, S], None]], Maker]:
    """Make a row of what is done to a scene, which begins in a folder of its own and ends with the row."""

    def decorate(body: Callable[[Row, S], None]) -> Maker:
        def make(folder: Path) -> Row:
            row = Row(fault, injected)
            with opens(folder) as scene:
                body(row, scene)
            return row

        make.__name__, make.__module__, make.__doc__ = body.__name__, body.__module__, body.__doc__
        return make

    return decorate


def table(runs: Sequence[Sequence[Row]]) -> list[str]:
    """The rows as Markdown; of several runs of a row the median of each figure, and in brackets the extremes."""
    lines = []
    for rows in runs:
        first = rows[0]
        measured, declared = [], []
        for figure in first.figures:
            values = [one.measured for row in rows for one in row.figures if one.what == figure.what]
            extremes = f" ({min(values):.1f} to {max(values):.1f})" if len(values) > 1 else ""
            measured.append(f"{figure.what} **{statistics.median(values):.1f}**{extremes}")
            if figure.declared is not None:
                declared.append(f"{figure.what} {figure.declared:g}: {figure.why}")
        seen = "<br>".join(first.seen)
        lines.append((first.fault, first.injected, "<br>".join(measured), "<br>".join(declared), seen))
    return markdown("what fails | how | seconds after it | declared | also observed", lines)
