"""The interface of drivers: readings go up, actions go down, outcomes come back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol, get_args, runtime_checkable

from commd.bus.bus import Bus
from commd.common.clock import Clock
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.mission.model import Robot
from schemas.wire.records import Cause, Note, Order
from schemas.wire.vehicle_records import PlanItem

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
    "VehicleStore",
    "defers",
]

SAFETY: tuple[Order, ...] = ("hold", "rtl", "land")
"""The orders from the least safe to the safest: a robot in the air needs somebody, one that comes down does not."""


def defers(order: Order | None, under_way: Order | None) -> bool:
    """Whether an order that nobody insists on leaves the motion that is under way alone, because it is safer."""
    return order is not None and under_way is not None and SAFETY.index(under_way) > SAFETY.index(order)


@dataclass(frozen=True, slots=True)
class Reading:
    """A new value of one source of the manifest; no fields = it holds no longer."""

    source: str
    fields: Mapping[str, object] | None
    driver: str = ""
    """The driver, if not the robot's own; the bridge fills it in: two drivers may have a source of one name."""


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
    """An action or order that a driver carries out: it calls `end` once, and may set the other fields before."""

    name: str
    outcome: Outcome | None = None
    feedback: dict[str, float] = field(default_factory=dict)
    """Progress in numbers, such as the distance to go in metres."""
    waits_for: str = ""
    """The condition that it waits for, for people: the reason of a timeout."""
    cause: str = ""
    """Why it cannot continue now, in the robot's own words (`Compass not calibrated`); empty = nothing hinders it."""
    ended: Callable[[], None] | None = None
    """Called once when the outcome is known."""

    def __post_init__(self) -> None:
        if self.outcome is not None:
            self.outcome = _checked(self.outcome)

    @property
    def over(self) -> bool:
        """Whether the outcome is known."""
        return self.outcome is not None

    def end(self, outcome: Outcome) -> None:
        """Set the outcome, unless it is set."""
        if self.outcome is None:
            self.outcome = _checked(outcome)
            if self.ended is not None:
                self.ended()

    def on_end(self, ended: Callable[[], None]) -> None:
        """Let `ended` be called once when the outcome is known: at this moment if it is."""
        self.ended = ended
        if self.outcome is not None:
            ended()


def _checked(outcome: object) -> Outcome:
    """Return what a driver, which may be anybody's and not type-checked, says of an end; failed if it says nothing."""
    if not isinstance(outcome, Outcome):
        return Outcome("failed", f"the driver ended it by {outcome!r}, expected an Outcome")
    if outcome.state not in get_args(FinalState):
        return Outcome(
            "failed", f"the driver ended it as {outcome.state!r}, expected {' or '.join(get_args(FinalState))}"
        )
    if not isinstance(outcome.reason, str):
        return replace(outcome, reason=f"the driver's reason is no text: {outcome.reason!r}")
    return outcome


OnReading = Callable[[Reading], None]


@dataclass(frozen=True)
class Setup:
    """Everything that a driver of one robot needs."""

    name: str
    """Of the robot."""
    manifest: Manifest
    """Only the percepts and actions of this driver."""
    robot: Robot
    """Its entry in the mission."""
    folder: Path
    """Of the mission file: paths in `robot` are relative to it."""
    clock: Clock
    on_reading: OnReading
    """To be called with each reading."""
    on_turn: Callable[[], None]
    """To be called at each turn of the driver's own loop, every few seconds at least: the watchdog waits for it."""
    bus: Bus | None = None
    """The board's bus; None in tests of drivers that do not need it."""
    state: Path = Path()
    """Folder for what must outlive this process."""
    logs: Path = Path()
    """Folder for logs that are downloaded from the robot."""
    simulated: bool = False
    """The robot is its simulated twin in this run."""
    shared: dict[str, Any] = field(default_factory=dict)
    """State that the drivers of one process share, by driver: several robots on one link."""


class DriverKind(Protocol):
    """Interface of a driver module: one of ours, or one named by an entry point of `argosy.drivers`."""

    def check_manifest(self, manifest: Manifest) -> Iterable[Finding]:
        """Return what is wrong with this driver's percepts and actions, each at its line."""

    def check_robot(self, robot: Robot) -> Iterable[tuple[str, str]]:
        """Return what is wrong with the mission's entry of the robot: the field, such as `link`, and the problem."""

    def make_driver(self, setup: Setup) -> Driver:
        """Make a driver of a checked manifest and robot. Raises OSError or ValueError."""


class Driver(Protocol):
    """A robot's driver. I/O is done in `run`, callbacks come from the event loop; all other methods are immediate."""

    orders: frozenset[Order]
    """Those that it can carry out itself; others are actions of the manifest."""

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action whose arguments have been checked."""

    def refuses(self, entry: ActionEntry) -> Outcome | None:
        """Why an action cannot begin now; None if it can.

        Others have the robot until an agent takes control again, or it cannot be distinguished from another one.
        """

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> Execution:
        """Begin one of its `orders`, which override every action; running executions end as `ending`.

        The operator's orders `insist`; the others end when a pilot, a ground station or a failsafe takes over, and
        succeed immediately where a safer motion is under way (`defers`), whoever began it.
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
        """The order whose motion the robot's state shows, whoever began it; None = none, or not heard."""

    @property
    def overridden(self) -> str:
        """The mode in which others than the bridge and its agents fly the active robot; empty if nobody does."""

    def speak_for_agent(self, present: bool) -> None:
        """Take in whether an agent is present: without one the driver does not claim to be a ground station."""

    async def run(self) -> None:
        """Carry the robot's traffic until cancelled. Raises OSError if its link is not there: then it is run again.

        Any other error, and an end by itself, is a defect: the driver is not run again.
        """

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another, checked manifest; running executions keep the old one."""

    def counters(self) -> dict[str, float]:
        """Figures for health."""

    def notes(self) -> Sequence[Note]:
        """Return the warnings that hold now: docs/guides/monitoring.md lists the codes."""


@runtime_checkable
class VehicleStore(Protocol):
    """An optional part of a driver: what the vehicle itself stores, for operators. Nothing of it becomes a percept."""

    def read_parameters(self, into: dict[str, float]) -> Execution:
        """Read every parameter into a mapping; its feedback are the figures `params` and `of`."""

    def set_parameter(self, name: str, value: float, *, allow_safety: bool) -> Execution:
        """Set a parameter of a vehicle that is not armed, until it reports the value.

        Refused with the cause `busy` if it is armed; with `allow_safety` also one that its safety depends on.
        """

    def read_plan(self, into: list[PlanItem]) -> Execution:
        """Append the items of the stored mission, home first; its feedback are the figures `item` and `items`."""

    @property
    def identified_as(self) -> tuple[int, int]:
        """MAV_AUTOPILOT and MAV_TYPE of the vehicle; 0 while they are not known."""


@runtime_checkable
class Pausable(Protocol):
    """An optional part of a driver: a hold that can be undone. Without it a pause orders `hold`."""

    def pause(self, interrupted: Collection[Execution]) -> Execution:
        """Hold the robot where it is, and end these executions of its own: they are begun again later."""

    def resume(self) -> Execution:
        """Bring the robot back into the state before `pause`, ready for the interrupted executions."""
