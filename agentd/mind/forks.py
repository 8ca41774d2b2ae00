"""``|&|`` and ``|||``: branches of a body that run side by side as intentions of their own."""

from __future__ import annotations

from typing import Any

from agentd.mind.dropping import drop
from agentd.mind.failed import Failed
from agentd.mind.frames import STEP, VARIABLES, Frame, Step
from agentd.mind.intentions import Intention
from agentd.mind.waiting import fail_parent, resume_waiting


class Fork:
    """The branches of one fork, and the intention that waits for them."""

    def __init__(self, parent: Intention, frame: Frame, all_needed: bool, failing: Step | None) -> None:
        self.parent, self.frame, self.all_needed, self.failing = parent, frame, all_needed, failing
        self.branches: list[Intention] = []

    def ended(self, mind: Any, branch: Intention, frame: Frame) -> None:
        """A branch has come to its join. The parent goes on with the variables of the one that counted last."""
        self.branches.remove(branch)
        if self.all_needed and self.branches:
            return
        for other in list(self.branches):
            drop(mind, other)
        self.branches.clear()
        self.frame[VARIABLES:] = frame[VARIABLES:]
        resume_waiting(mind, self.parent)

    def failed(self, mind: Any, branch: Intention, extra: tuple[Any, ...], where: str, failure: Failed) -> None:
        """A branch has failed without a handler of its own: fatal for ``|&|``, tolerated by ``|||`` except the last."""
        if branch in self.branches:
            self.branches.remove(branch)
        if not self.all_needed and self.branches:
            return
        for other in list(self.branches):
            drop(mind, other)
        self.branches.clear()
        fail_parent(mind, self.parent, extra, where, failure)


def fork(mind: Any, intention: Intention, frame: Frame, operator: str, firsts: tuple[Step, ...]) -> bool:
    """Start the branches; the intention waits for their join."""
    state = Fork(intention, frame, operator == "|&|", firsts[0] if firsts else None)
    for first in firsts:
        branch = mind.new_intention()
        copy = list(frame)
        copy[STEP] = first
        branch.stack.append(copy)
        branch.branch = state
        state.branches.append(branch)
        mind.running.append(branch)
    mind.await_something(intention, "fork", state)
    return True


def join(mind: Any, intention: Intention, frame: Frame) -> bool:
    """The last step of each branch."""
    intention.stack.clear()
    mind.gone(intention)
    if intention.branch is not None:
        intention.branch.ended(mind, intention, frame)
    return True
