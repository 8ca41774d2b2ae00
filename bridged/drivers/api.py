"""What the bridge and a driver say to each other: readings up, actions down, outcomes back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

from commd.bus.bus import Bus
from commd.common.clock import Clock
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.mission.model import Robot
from schemas.wire.records import Cause, Note, Order

Scalar = bool | int | float | str
Value = Scalar | list[Any]
"""An argument of an action, after it was checked against the manifest: lists are lists of values."""

FinalState = Literal["succeeded", "failed", "refused", "cancelled", "timed_out"]

__all__ = [
    "Driver",
    "DriverKind",
    "Execution",
    "FinalState",
    "OnReading",
    "Order",
    "Outcome",
    "Pausable",
    "Reading",
    "Scalar",
    "Setup",
    "Value",
    "defers",
]

SAFETY: tuple[Order, ...] = ("hold", "rtl", "land")
"""The orders from the least safe to the safest: what stays in the air needs somebody, what comes down does not."""


def defers(order: Order | None, under_way: Order | None) -> bool:
    """Whether an order that nobody insists on leaves the motion that is under way alone, because it is safer."""
    return order is not None and under_way is not None and SAFETY.index(under_way) > SAFETY.index(order)


@dataclass(frozen=True, slots=True)
class Reading:
    """What the robot said just now about one source of the manifest; no fields = it holds no longer."""

    source: str
    fields: Mapping[str, object] | None
    driver: str = ""
    """Who says it, if not the robot's own driver; the bridge fills it in: two drivers may have a source of one name."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an execution ended, and why if it did not succeed."""

    state: FinalState
    reason: str = ""
    """For people."""
    cause: Cause = "driver"
    """Of one that did not succeed."""
    order: Order | None = None
    """The order that overrides it."""


@dataclass(eq=False)
class Execution:
    """An action or order that a driver carries out. The driver sets what happened; the bridge reads it."""

    name: str
    outcome: Outcome | None = None
    feedback: dict[str, float] = field(default_factory=dict)
    """Progress in numbers, such as the distance to go in metres."""
    waits_for: str = ""
    """What it waits for now, in words: the reason if it runs out of time."""
    cause: str = ""
    """Why it cannot go on now, in the robot's own words (`Compass not calibrated`); empty = nothing hinders it."""
    ended: Callable[[], None] | None = None
    """Called once when the outcome is known."""

    @property
    def over(self) -> bool:
        """Whether the outcome is known."""
        return self.outcome is not None

    def end(self, outcome: Outcome) -> None:
        """Set the outcome; the first one stands."""
        if self.outcome is None:
            self.outcome = outcome
            if self.ended is not None:
                self.ended()


OnReading = Callable[[Reading], None]


@dataclass(frozen=True)
class Setup:
    """What a driver of one robot is given."""

    name: str
    """Of the robot."""
    manifest: Manifest
    """Only the percepts and actions of this driver."""
    robot: Robot
    """What the mission says of it."""
    folder: Path
    """Of the mission file: paths in `robot` are relative to it."""
    clock: Clock
    on_reading: OnReading
    """To be called with what the robot says."""
    on_step: Callable[[], None]
    """To be called after the driver has looked at its executions."""
    bus: Bus | None = None
    """The board's bus; none in tests of drivers that do not need it."""
    state: Path = Path()
    """Folder for what must outlive this process."""
    simulated: bool = False
    """The robot is its simulated twin in this run."""
    shared: dict[str, Any] = field(default_factory=dict)
    """What the drivers of one process share, by the name of the driver: several robots on one link."""


class DriverKind(Protocol):
    """What a module offers that is a driver: one of ours, or one named by an entry point of `argosy.drivers`."""

    def check_manifest(self, manifest: Manifest) -> Iterable[Finding]:
        """Say what is wrong with this driver's percepts and actions, each at its line."""

    def check_robot(self, robot: Robot) -> Iterable[tuple[str, str]]:
        """Say what is wrong with what the mission says of the robot: the field, such as `link`, and the problem."""

    def make_driver(self, setup: Setup) -> Driver:
        """Make a driver of a manifest and a robot that nothing is wrong with. Raises OSError, ValueError in words."""


class Driver(Protocol):
    """A robot's driver. It does its I/O in `run` and calls back from the event loop; everything else is immediate."""

    orders: frozenset[Order]
    """Those that it can carry out itself; others are actions of the manifest."""

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action whose arguments have been checked."""

    def refuses(self, entry: ActionEntry) -> Outcome | None:
        """Why an action cannot begin now; None if it can.

        Others have the robot until an agent takes control again, or it cannot be told from another one.
        """

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> Execution:
        """Begin one of its `orders`, which stand above every action; whatever runs ends as `ending`.

        The operator's orders `insist`; the others end when a pilot, a ground station or a failsafe takes over, and
        succeed at once where a safer motion is under way (`defers`), whoever began it.
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
    def airborne(self) -> bool:
        """Whether the robot is armed and off the ground, as it shows itself."""

    @property
    def under_way(self) -> Order | None:
        """The order whose motion the robot's own state shows, whoever began it; None = none, or it cannot be heard."""

    @property
    def overridden(self) -> str:
        """In what (a mode) others than the bridge and its agents have the active robot; empty if nobody has."""

    def speak_for_agent(self, present: bool) -> None:
        """Say whether an agent is there: without one the driver claims to be nobody's ground station."""

    async def run(self) -> None:
        """Carry the robot's traffic until cancelled. Raises OSError if its link cannot be opened: then it is run again.

        Any other error, and an end by itself, is a defect: the driver is not run again.
        """

    def adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest, of which nothing is wrong; what runs goes on by the old one."""

    def counters(self) -> dict[str, float]:
        """Figures for health."""

    def notes(self) -> Sequence[Note]:
        """Return the warnings that hold now: docs/guides/monitoring.md lists the codes."""


@runtime_checkable
class Pausable(Protocol):
    """What a driver may offer besides `Driver`: a hold that can be undone; else `hold` is ordered for a pause."""

    def pause(self, interrupted: Collection[Execution]) -> Execution:
        """Hold the robot where it is, and end these executions of its own without a word: they are asked for again."""

    def resume(self) -> Execution:
        """Bring the robot back into the state from which `pause` took it, ready for what is asked for again."""
