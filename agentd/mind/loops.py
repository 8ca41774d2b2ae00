"""The rounds of ``for``: its solutions are found at the start; one that rests on a fact since deleted is left out."""

from __future__ import annotations

from typing import Any

from agentd.mind.beliefs import Predicate

Row = tuple[Predicate, tuple[Any, ...]]


def present(rows: tuple[Row, ...]) -> tuple[Row, ...]:
    """Those of the rows of a solution that are facts (others come from rules)."""
    return tuple([row for row in rows if row[1] in row[0].entries])


def next_round(solutions: list[tuple[Any, ...]]) -> tuple[Any, ...] | None:
    """The next solution whose facts still hold; its last member are those facts. None after the last one."""
    while solutions:
        solution = solutions.pop()
        if all(args in predicate.entries for predicate, args in solution[-1]):
            return solution
    return None
