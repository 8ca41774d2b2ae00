"""Intentions: stacks of frames."""

from __future__ import annotations

from typing import Any, TypeAlias

from agentd.language.syntax_tree.traversal import HIDDEN
from agentd.language.terms.terms import Literal, Var, deref
from agentd.mind.data.frames import ANNOTS, ARGS, PLAN, RELEVANT, STEP, Frame, Step

Event: TypeAlias = "tuple[Any, tuple[Any, ...], tuple[Any, ...], Intention | None]"
"""The `agentd.mind.plans.plan_library.Relevant` plans, arguments and annotations of an event, and the intention that
waits for it (or None)."""


class Intention:
    """One focus of the mind: the plans it is in the middle of, the innermost last."""

    __slots__ = (
        "action",
        "branch",
        "held",
        "id",
        "last",
        "since",
        "stack",
        "suspended",
        "trail",
        "waiting",
    )

    waiting: str | None
    """What it waits for, in words; None while it runs or waits for its own event."""
    suspended: str | None
    """Why it must not run although it could (``.suspend``)."""
    action: int | None
    """The id of the external action it waits for."""
    branch: Any
    """The `agentd.mind.execution.concurrency.Fork` that it is a branch of."""
    held: Event | None
    """The event of its next goal, which ``.suspend`` has taken out of the queue; with an empty stack its first one."""

    def __init__(self, number: int) -> None:
        self.id = number
        self.stack: list[Frame] = []
        self.last: Step | None = None
        """The formula that was run last: the one that it waits in, while it waits."""
        self.trail: list[Var] = []
        """The variables bound so far that a failure may have to free again."""
        self.waiting = self.suspended = self.action = self.branch = self.held = None
        self.since = 0.0
        """Mission seconds since when it waits for what `waiting` says."""

    def goals(self) -> list[tuple[Any, Literal]]:
        """The goals and events that its plans answer, innermost first, with their `Relevant`."""
        return [(f[RELEVANT], Literal(f[RELEVANT].sig, f[ARGS], f[ANNOTS])) for f in reversed(self.stack)]

    def trim(self, mark: int) -> None:
        """Forget the bindings since ``mark`` that no failure below needs to undo, after a frame has ended well."""
        trail, depth = self.trail, len(self.stack)
        trail[mark:] = [v for v in trail[mark:] if v.depth < depth]

    def position(self) -> str:
        """``file:line`` of the formula that comes next, or that it waits in."""
        for frame in reversed(self.stack):
            step = frame[STEP]
            source = step.syntax if step is not None else frame[PLAN].syntax
            return f"{source.position.file}:{source.position.line}"
        return ""


def values_of(frame: Frame) -> dict[str, Any]:
    """The variables of a frame that have a value, by name."""
    return {
        name: frame[place]
        for name, place in frame[PLAN].slots.items()
        if place < len(frame)
        and frame[place] is not None
        and type(deref(frame[place])) is not Var
        and not name.startswith(HIDDEN)
    }
