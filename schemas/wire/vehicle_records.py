"""Records of what a vehicle itself stores, its parameters and its mission, for operators."""

from __future__ import annotations

from schemas.wire.records import Cause, Finite, Header, Int64, Record


class ParameterRequest(Record, frozen=True, kw_only=True):
    """A request to set one parameter of a vehicle that is not armed; a query without it reads all of them."""

    name: str
    value: Finite
    allow_safety: bool = False
    """Whether it may be one that the vehicle's safety depends on, such as a failsafe."""


class VehicleParameters(Record, frozen=True, kw_only=True):
    """Parameters as a vehicle reports them. While they arrive there are replies without values; the last is `done`."""

    header: Header = Header()
    values: dict[str, Finite] = {}
    left_out: tuple[str, ...] = ()
    """Parameters whose value is no finite number."""
    came: Int64 = 0
    """Number of those that have arrived."""
    of: Int64 = 0
    """Number of all; 0 = not known yet."""
    done: bool = False
    problem: str = ""
    """Why they were not read, or the parameter was not set; empty = all was done."""
    cause: Cause | None = None
    """Of the problem; `rights` and `busy` (the vehicle is armed) hold for every parameter."""


class PlanItem(Record, frozen=True, kw_only=True):
    """An item of a vehicle's mission, with the fields of MISSION_ITEM_INT."""

    command: Int64
    frame: Int64
    parameters: tuple[Finite | None, Finite | None, Finite | None, Finite | None] = (0.0, 0.0, 0.0, 0.0)
    """None = not a number: the vehicle's choice."""
    x: Int64 = 0
    y: Int64 = 0
    z: Finite = 0.0
    autocontinue: Int64 = 1


class StoredPlan(Record, frozen=True, kw_only=True):
    """The mission that a vehicle stores. While it arrives there are replies without items; the last is `done`."""

    header: Header = Header()
    items: tuple[PlanItem, ...] = ()
    """The first is home."""
    autopilot: Int64 = 0
    """MAV_AUTOPILOT of the vehicle."""
    vehicle: Int64 = 0
    """MAV_TYPE of the vehicle."""
    came: Int64 = 0
    """Number of items that have arrived."""
    of: Int64 = 0
    """Number of all; 0 = not known yet."""
    done: bool = False
    problem: str = ""
    """Why it was not read; empty = it was."""
