"""Forks and loops of plan bodies.

The branches of ``|&|`` and ``|||`` are intentions of their own. The solutions of ``for`` are found at the start; one
that rests on a deleted fact is skipped. Variables bound by a round of ``for`` or ``while`` are free again in the next
round and after the loop (rule 76).
"""

from __future__ import annotations

from typing import Any

from agentd.language.terms.terms import Term, Var, deref
from agentd.mind.beliefs.belief_base import Predicate
from agentd.mind.beliefs.term_copy import Copier, is_ground
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.data.effects import Log
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import STEP, VARIABLES, Frame, Intention, Step
from agentd.mind.execution.dropping import drop
from agentd.mind.execution.execution import await_something, fail_parent, resume_waiting
from agentd.mind.state import MindState
from schemas.wire.mind_records import WaitView


class Fork:
    """The branches of one fork, and the intention that waits for them."""

    def __init__(self, parent: Intention, frame: Frame, all_needed: bool) -> None:
        self.parent, self.frame, self.all_needed = parent, frame, all_needed
        self.branches: list[Intention] = []
        self._free = [(place, v) for place, v in enumerate(frame) if place >= VARIABLES and type(deref(v)) is Var]
        """The variables that are free when the fork begins: each branch has its own, one branch's count (rule 80)."""

    def frame_of_branch(self, first: Step) -> Frame:
        """Return a copy of the frame for a branch."""
        copy = list(self.frame)
        copy[STEP] = first
        fresh: dict[Var, Var] = {}
        for place, variable in self._free:
            cell = deref(variable)
            copy[place] = fresh.setdefault(cell, Var(cell.name))
        return copy

    def _is_over(self, mind: MindState, branch: Intention, waits: bool) -> bool:
        """Take a branch out; return False if the fork `waits` for others, else drop these."""
        if branch in self.branches:
            self.branches.remove(branch)
        if waits and self.branches:
            return False
        for other in list(self.branches):
            drop(mind, other)
        self.branches.clear()
        return True

    def ended(self, mind: MindState, branch: Intention, frame: Frame) -> None:
        """End a branch at its join. The parent continues with the variables of the last branch that counted."""
        if not self._is_over(mind, branch, self.all_needed):
            return
        self.frame[VARIABLES:] = frame[VARIABLES:]
        for place, variable in self._free:
            unify(variable, frame[place], self.parent.trail)
            self.frame[place] = variable
        resume_waiting(mind, self.parent)

    def failed(self, mind: MindState, branch: Intention, extra: tuple[Term, ...], where: str, failure: Failed) -> None:
        """End a branch that has failed without a handler of its own: fatal for ``|&|``, tolerated by ``|||``.

        When all branches of ``|||`` have failed the intention ends without asking any handler, as Jason's does (rule
        82), but not without a word.
        """
        if not self._is_over(mind, branch, not self.all_needed):
            return
        if self.all_needed:
            fail_parent(mind, self.parent, extra, where, failure)
            return
        text = f"{where}: {failure.error}: all branches of ||| have failed; the intention ends, no handler is asked"
        mind.effects.append(Log("error", text, ends=True))
        outer = self.parent.branch
        drop(mind, self.parent)
        if outer is not None:
            outer.failed(mind, self.parent, extra, where, failure)


def fork(mind: MindState, intention: Intention, frame: Frame, operator: str, firsts: tuple[Step, ...]) -> bool:
    """Start the branches; the intention waits for their join."""
    if mind.crowded:
        raise Failed("too_many_intentions", "there are as many events and intentions as there may be")
    state = Fork(intention, frame, operator == "|&|")
    for first in firsts:
        branch = mind.new_intention()
        branch.stack.append(state.frame_of_branch(first))
        branch.branch = state
        state.branches.append(branch)
        mind.running.append(branch)
    await_something(mind, intention, WaitView(kind="fork"), state)
    return True


def join(mind: MindState, intention: Intention, frame: Frame) -> bool:
    """Return the last step of each branch."""
    intention.stack.clear()
    mind.gone(intention)
    if intention.branch is not None:
        intention.branch.ended(mind, intention, frame)
    return True


# --- loops ---


Row = tuple[Predicate, tuple[Any, ...]]

Kept = tuple[int, list[tuple[int, Any, Any]]]
"""The length of the trail when a loop began, and the free variables in the frame: place, content, cell."""


def begin_rounds(trail: Trail, frame: Frame, places: tuple[int, ...]) -> Kept:
    """Note which of these places of a frame hold no value, or one with free variables, for `free_again`."""
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
    """Undo the bindings of a round of a loop."""
    mark, free = kept
    if len(trail) > mark:
        undo(trail, mark)
    for place, held, cell in free:
        frame[place] = held
        if cell is not None:
            cell.ref = None  # a binding by a plan that has ended well is on no trail any more


def present(rows: tuple[Row, ...]) -> tuple[Row, ...]:
    """Return the rows of a solution that are facts; others are answers of rules."""
    return tuple([row for row in rows if row[1] in row[0].entries])


def next_round(solutions: list[tuple[Any, ...]]) -> tuple[Any, ...] | None:
    """Return the next solution whose facts still hold; its last member are those facts. None after the last one."""
    while solutions:
        solution = solutions.pop()
        if all(args in predicate.entries for predicate, args in solution[-1]):
            return solution
    return None
