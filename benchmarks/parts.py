"""The table of the parts that `make bench` measures, and the interface of a part.

A part is a module with

- `Figures`: a dataclass of all measured figures, plain enough for JSON;
- `measure(quick) -> Figures`: with `quick` everything is tried, in little time: for tests, never for pages.
  Raises BenchmarkFailed;
- `blocks(origin, figures) -> dict[str, str]`: Markdown for the blocks of pages (`benchmarks.pages`), by their names;

and, where it has some,

- `pictures(figures) -> dict[str, str]`: SVG texts, by the names of their files;
- `goals(figures) -> list[Goal]`: the goals of its figures;
- `probe(quick) -> dict[str, float]`: its costs in a shorter run, less is better, by titles with the unit in brackets:
  for a comparison with an earlier revision (`benchmarks.earlier`);
- `in_short(figures) -> list[str]`, `in_comparison(figures) -> list[str]`: its rows in tables of several parts
  (`benchmarks.pages`).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any, Final


def table(head: str, rows: Iterable[str] = ()) -> list[str]:
    """Return the lines of a table: its head, the rule below it, and its rows, each as `| cell | cell |`."""
    return [head, "|" + "---|" * (head.count("|") - 1), *rows]


def row(*cells: object) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(map(str, cells))} |"


@dataclass(frozen=True)
class Goal:
    """What is asked of a figure, and whether it is met."""

    title: str
    wanted: str
    found: str
    met: bool
    why: str = ""
    """For one that is missed: the reason, as far as it is known, and what was tried."""
    decided: bool = True
    """Whether the measurement decides it: not if its uncertainty includes the goal; `met` is False then."""


def at_most(title: str, limit: float, value: float, unit: str, why: str = "", *, digits: int = 1) -> Goal:
    """Return the goal that a figure does not exceed a limit."""
    return Goal(title, f"{limit:g} {unit}".rstrip(), f"{value:,.{digits}f} {unit}".rstrip(), value <= limit, why)


def at_least(title: str, limit: float, value: float, unit: str = "", why: str = "", *, digits: int = 0) -> Goal:
    """Return the goal that a figure reaches a limit."""
    return Goal(title, f"{limit:,g} {unit}".rstrip(), f"{value:,.{digits}f} {unit}".rstrip(), value >= limit, why)


@dataclass(frozen=True)
class Part:
    """A part of the benchmarks."""

    name: str
    """Of its results file, and on the command line."""
    where: str
    """Its module."""
    minutes: float
    """What it takes, roughly."""

    def module(self) -> ModuleType:
        """Import it; it may need packages that others do not."""
        return import_module(self.where)

    def pictures(self, figures: Any) -> dict[str, str]:
        """Return its pictures."""
        return dict(self._made("pictures", figures, {}))

    def goals(self, figures: Any) -> list[Goal]:
        """Return what is asked of it."""
        return list(self._made("goals", figures, []))

    def rows(self, table: str, figures: Any) -> list[str]:
        """Return its rows in a table of several parts: `in_short` or `in_comparison`."""
        return list(self._made(table, figures, []))

    def _made(self, what: str, figures: Any, nothing: Any) -> Any:
        return getattr(self.module(), what, lambda _: nothing)(figures)


PARTS: Final[tuple[Part, ...]] = (
    Part("sizes", "benchmarks.measurements.sizes", 0.1),
    Part("usage", "benchmarks.measurements.usage", 30),
    Part("scale", "benchmarks.measurements.scale", 6),
    Part("declarations", "benchmarks.measurements.declarations", 1.5),
    Part("crowd", "benchmarks.measurements.crowd", 6),
    Part("loop", "benchmarks.measurements.loop", 4),
    Part("startup", "benchmarks.measurements.startup", 2),
    Part("footprint", "benchmarks.measurements.footprint", 1.5),
    Part("reasoner", "benchmarks.reasoner.part", 5.5),
    Part("small-boards", "benchmarks.measurements.small_boards", 11),
    Part("bridge", "benchmarks.measurements.bridge", 1.2),
    Part("mail", "benchmarks.measurements.mail", 3),
    Part("looking", "benchmarks.measurements.looking", 2.5),
    Part("viewers", "benchmarks.measurements.viewers", 2),
    Part("trial", "benchmarks.measurements.trial", 15),
    Part("earlier", "benchmarks.earlier", 25),
)
"""In the order in which they run."""


def goal_rows(goals: Iterable[Goal], *, part: str = "", busy: bool = False) -> list[str]:
    """Return the rows of goals: `part` is the text of the first column, if there is one."""
    first = f"| {part} " if part else ""
    on = " (busy machine)" if busy else ""
    return [f"{first}| {one.title} | {one.wanted} | {one.found} | {_verdict(one)}{on} |" for one in goals]


def line_of_goals(goals: list[Goal]) -> list[str]:
    """Return a table of goals; none for no goals."""
    return table("| figure | goal | measured | |", goal_rows(goals)) if goals else []


def progress(text: str) -> None:
    """Print the progress of a part in one line on stderr."""
    print(f"  {text}", file=sys.stderr, flush=True)


def _verdict(goal: Goal) -> str:
    if goal.met:
        return "met"
    return f"**{'missed' if goal.decided else 'not decided'}** {goal.why or NO_REASON}"


NO_REASON: Final = "(no reason is given)"
"""The text for a missed goal without a `why`; `tests/benchmarks/test_pages.py` does not let it through."""
