"""What the bridge and a driver say to each other: readings up, actions down, outcomes back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from schemas.manifest import ActionEntry

Value = bool | int | float | str
"""An argument of an action, after it was checked against the manifest."""

FinalState = Literal["succeeded", "failed", "refused", "cancelled", "timed_out"]
Order = Literal["hold", "land", "rtl"]
"""What the mission, the operator or a shutdown can order without any agent."""


@dataclass(frozen=True, slots=True)
class Reading:
    """What the robot said just now about one source of the manifest; no fields = it holds no longer."""

    source: str
    fields: Mapping[str, object] | None


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an execution ended, and why in words if it did not succeed."""

    state: FinalState
    reason: str = ""


@dataclass(eq=False)
class Execution:
    """An action or order that a driver carries out. The driver sets what happened; the bridge reads it."""

    name: str
    outcome: Outcome | None = None
    feedback: dict[str, float] = field(default_factory=dict)
    """Progress in numbers, such as the distance to go in metres."""
    waits_for: str = ""
    """What it waits for now, in words: the reason if it runs out of time."""
    ended: Callable[[], None] | None = None
    """Called once when the outcome is known."""

    def end(self, outcome: Outcome) -> None:
        """Set the outcome; the first one stands."""
        if self.outcome is None:
            self.outcome = outcome
            if self.ended is not None:
                self.ended()


OnReading = Callable[[Reading], None]


class Driver(Protocol):
    """A robot's driver. It does its I/O in `run` and calls back from the event loop; everything else is immediate."""

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action whose arguments have been checked."""

    def refuses(self, entry: ActionEntry) -> str:
        """Why an action cannot begin now, empty if it can.

        Others have the robot until an agent takes control again, or it cannot be told from another one.
        """

    def order(self, order: Order, reason: str, *, insist: bool) -> Execution:
        """Begin an order that stands above every action; whatever runs fails with `reason`.

        The operator's orders `insist`; the others end when a pilot, a ground station or a failsafe takes over.
        """

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End a running execution now; `hold` makes the robot stay where it is if it moves."""

    @property
    def active(self) -> bool:
        """Whether leaving the robot alone now needs an order first: it is armed or in flight."""

    @property
    def heard(self) -> bool:
        """Whether the robot can be heard now."""

    @property
    def silence(self) -> float:
        """Wall seconds since the robot was heard last; infinite if it never was."""

    @property
    def overridden(self) -> str:
        """In what (a mode) others than the bridge and its agents have the active robot; empty if nobody has."""

    def speak_for_agent(self, present: bool) -> None:
        """Say whether an agent is there: without one the driver claims to be nobody's ground station."""

    async def run(self) -> None:
        """Carry the robot's traffic until cancelled. Raises OSError if its link cannot be opened."""

    def counters(self) -> dict[str, float]:
        """Figures for health."""

    def notes(self) -> list[str]:
        """Warnings that hold now, in words."""
