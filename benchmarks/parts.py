"""The table of what `make bench` measures, and what each part of it is.

A part is a module with

- `Figures`: a dataclass of all that it measures, plain enough for JSON;
- `measure(quick) -> Figures`: with `quick` each thing is tried, in little time: for tests, never for pages.
  Raises BenchmarkFailed;
- `blocks(origin, figures) -> dict[str, str]`: Markdown for the blocks of pages (`benchmarks.pages`), by their names;
- `pictures(figures) -> dict[str, str]`: SVG texts, by the names of their files;
- `goals(figures) -> list[Goal]`: what is asked of the figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Final


@dataclass(frozen=True)
class Goal:
    """What is asked of a figure, and whether it is met."""

    title: str
    wanted: str
    found: str
    met: bool
    why: str = ""
    """For one that is missed: the reason, and what was tried."""


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


PARTS: Final[tuple[Part, ...]] = ()
"""In the order in which they run."""


def part(name: str) -> Part:
    """Return the part of that name. Raises KeyError."""
    return {one.name: one for one in PARTS}[name]


def line_of_goals(goals: list[Goal]) -> list[str]:
    """Return the rows of a table of goals."""
    head = ["| figure | goal | measured | |", "|---|---|---|---|"]
    return head + [
        f"| {goal.title} | {goal.wanted} | {goal.found} | {'met' if goal.met else f'**missed** {goal.why}'.strip()} |"
        for goal in goals
    ]
