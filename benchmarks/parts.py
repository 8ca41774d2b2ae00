"""The table of what `make bench` measures, and what each part of it is.

A part is a module with

- `Figures`: a dataclass of all that it measures, plain enough for JSON;
- `measure(quick) -> Figures`: with `quick` each thing is tried, in little time: for tests, never for pages.
  Raises BenchmarkFailed;
- `blocks(origin, figures) -> dict[str, str]`: Markdown for the blocks of pages (`benchmarks.pages`), by their names;

and, where it has some,

- `pictures(figures) -> dict[str, str]`: SVG texts, by the names of their files;
- `goals(figures) -> list[Goal]`: what is asked of the figures;
- `probe(quick) -> dict[str, float]`: what it costs in a shorter run, less is better, by titles with the unit in
  brackets: for a comparison with an earlier revision (`benchmarks.earlier`);
- `in_short(figures) -> list[str]`, `in_comparison(figures) -> list[str]`: its rows in tables of several parts
  (`benchmarks.summary`).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any, Final

from benchmarks.pages import table


@dataclass(frozen=True)
class Goal:
    """What is asked of a figure, and whether it is met."""

    title: str
    wanted: str
    found: str
    met: bool
    why: str = ""
    """For one that is missed: the reason, as far as it is known, and what was tried. Told only then."""
    decided: bool = True
    """Whether what was measured can tell: not where its doubt holds the goal; `met` is False then."""


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
        return dict(self.module().pictures(figures)) if hasattr(self.module(), "pictures") else {}

    def goals(self, figures: Any) -> list[Goal]:
        """Return what is asked of it."""
        return list(self.module().goals(figures)) if hasattr(self.module(), "goals") else []

    def rows(self, table: str, figures: Any) -> list[str]:
        """Return its rows in a table of several parts: `in_short` or `in_comparison`."""
        return list(getattr(self.module(), table)(figures)) if hasattr(self.module(), table) else []


PARTS: Final[tuple[Part, ...]] = (
    Part("sizes", "benchmarks.paper.sizes", 0.1),
    Part("usage", "benchmarks.paper.usage_page", 30),
    Part("scale", "benchmarks.scale", 6),
    Part("crowd", "benchmarks.crowd", 8),
    Part("loop", "benchmarks.loop.part", 4),
    Part("startup", "benchmarks.startup", 2),
    Part("footprint", "benchmarks.footprint", 1.5),
    Part("reasoner", "benchmarks.reasoner.part", 5.5),
    Part("small-boards", "benchmarks.small_boards.part", 7),
    Part("bridge", "benchmarks.bridge", 1.2),
    Part("mail", "benchmarks.mail", 3),
    Part("board", "benchmarks.board", 1.5),
    Part("looking", "benchmarks.looking", 2.5),
    Part("page", "benchmarks.webpage", 1.5),
    Part("viewers", "benchmarks.viewers", 1.2),
    Part("trial", "benchmarks.trial", 1.5),
    Part("earlier", "benchmarks.earlier", 35),
)
"""In the order in which they run."""


@dataclass(frozen=True)
class Told:
    """The goals of a part for the table of all."""

    name: str
    link: str
    """To its figures; empty where there is none."""
    goals: list[Goal]
    busy: bool = False
    """Others were at work on the machine while it was measured."""
    measured: bool = True
    """Whether there are results of it."""


def line_of_goals(goals: list[Goal]) -> list[str]:
    """Return the rows of a table of goals."""
    rows = [f"| {goal.title} | {goal.wanted} | {goal.found} | {_verdict(goal)} |" for goal in goals]
    return table("| figure | goal | measured | |", rows) if goals else []


def table_of_goals(parts: list[Told]) -> list[str]:
    """Return the rows of a table of the goals of parts: of each its name, a link to its figures, and its goals."""
    rows = [
        f"| {f'[{one.name}]({one.link})' if one.link else one.name} | {goal.title} | {goal.wanted} | {goal.found} "
        f"| {_verdict(goal)}{' (busy machine)' if one.busy else ''} |"
        for one in parts
        for goal in one.goals
    ]
    rows += [f"| {one.name} | | | | **not measured** |" for one in parts if not one.measured]
    return table("| part | figure | goal | measured | |", rows)


def tell(text: str) -> None:
    """Say how far a part is, in one line on stderr."""
    print(f"  {text}", file=sys.stderr, flush=True)


def _verdict(goal: Goal) -> str:
    if goal.met:
        return "met"
    return f"**{'missed' if goal.decided else 'not decided'}** {goal.why or NO_REASON}"


NO_REASON: Final = "(no reason is given)"
"""What a page says of a missed goal without a `why`; `tests/benchmarks/test_pages.py` does not let it through."""
