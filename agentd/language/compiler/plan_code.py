"""The generated code of a plan as data: its steps, and the places of its variables in a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from agentd.language.compiler.code_writer import Unit

FRAME_HEADER = 6
"""So many places of a frame come before its variables; see `agentd.mind.data.intention`."""


@dataclass
class StepCode:
    """A formula of a body: the function that runs it and the step that follows (by number; None ends the body)."""

    function: str
    syntax: Any
    next: int | None = None


@dataclass
class PlanCode:
    """The generated code of a plan, or of a body that runs inside a plan's frame."""

    unit: Unit
    slots: dict[str, int]
    """The place of each variable in a frame."""
    steps: list[StepCode] = field(default_factory=list)
    first: int | None = None
    size: int = FRAME_HEADER
    """How many places a frame has."""
    bound: dict[str, bool] = field(default_factory=dict)
    tried: list[tuple[Any, tuple[str, ...]]] = field(default_factory=list)
    """The literals of the context in order, with their variables that have a value when they are tried; empty for
    plans that are selected without a trace."""

    def slot(self, name: str) -> int:
        found = self.slots.get(name)
        if found is None:
            found = self.slots[name] = self.size
            self.size += 1
        return found

    def hidden_slot(self) -> int:
        """A place for something that is no variable of the program."""
        self.size += 1
        return self.size - 1
