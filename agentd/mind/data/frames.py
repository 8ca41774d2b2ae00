"""Frames: one per plan that an intention is running, as a flat list so that generated code makes one in one step.

The first places are named below; the variables of the plan follow from `VARIABLES` on. A frame's first place is the
*step to come*; None means that the body has ended.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

Frame: TypeAlias = list[Any]

STEP: Final = 0
PLAN: Final = 1
RELEVANT: Final = 2
"""The `agentd.mind.plans.plan_library.Relevant` of the event that the plan answers."""
ARGS: Final = 3
ANNOTS: Final = 4
MARK: Final = 5
"""How long the intention's trail was before the plan was selected: a failure undoes to here."""
VARIABLES: Final = 6


class Step:
    """A formula of a loaded plan: the generated function, the step after it, and what was written."""

    __slots__ = ("next", "plan", "run", "syntax")

    run: Callable[[Any, Any, Frame], Any]
    next: Step | None

    def __init__(self, syntax: Any, plan: Any) -> None:
        self.syntax, self.plan = syntax, plan
        self.next = None
        self.run = _not_loaded

    @property
    def line(self) -> int:
        return int(self.syntax.position.line)


def _not_loaded(mind: Any, intention: Any, frame: Frame) -> bool:
    raise RuntimeError("a step was run before its code was loaded")
