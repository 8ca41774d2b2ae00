"""The rounds of loops.

The solutions of ``for`` are found at the start; one that rests on a fact since deleted is left out. Variables that a
round of ``for`` or ``while`` bound are free again for the next and afterwards (rule 76).
"""

from __future__ import annotations

from typing import Any

from agentd.language.terms.terms import Var, deref
from agentd.mind.beliefs.belief_base import Predicate
from agentd.mind.beliefs.term_copy import Copier, is_ground
from agentd.mind.beliefs.unification import Trail, undo
from agentd.mind.data.intention import Frame

Row = tuple[Predicate, tuple[Any, ...]]

Kept = tuple[int, list[tuple[int, Any, Any]]]
"""How long the trail was when a loop began, and the free variables in the frame: place, what it held, the cell."""


def begin_rounds(trail: Trail, frame: Frame, places: tuple[int, ...]) -> Kept:
    """Note which of these places of a frame hold no value, or one with free variables: what `free_again` needs."""
    free = []
    for place in places:
        cell = deref(frame[place])
        if cell is None or type(cell) is Var:
            free.append((place, frame[place], cell))
        elif type(cell) is not float and type(cell) is not str and not is_ground(cell):
            inside: dict[Var, Var] = {}
            Copier(fresh=True, known=inside).copy(cell)
            free.extend([(place, frame[place], variable) for variable in inside])
    return len(trail), free


def free_again(trail: Trail, frame: Frame, kept: Kept) -> None:
    """Take back what a round of a loop has bound."""
    mark, free = kept
    if len(trail) > mark:
        undo(trail, mark)
    for place, held, cell in free:
        frame[place] = held
        if cell is not None:
            cell.ref = None  # a binding by a plan that has ended well is on no trail any more


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
