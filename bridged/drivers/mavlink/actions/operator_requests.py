"""What operators read and set of a vehicle besides actions: all parameters, one parameter, the stored mission.

Nothing of it becomes a percept.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.context import (
    SUCCEEDED,
    BoundAction,
    Procedure,
    ProcedureContext,
    ProcedureRun,
    Steps,
)
from bridged.drivers.mavlink.actions.mission_actions import download, mission_protocol
from bridged.drivers.mavlink.actions.parameters import guard, pull, write_parameter
from bridged.drivers.mavlink.vehicle.safety_parameters import is_vehicles_own, safety_kind
from schemas.wire.vehicle_records import PlanItem

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,15}")
"""MAVLink has room for 16 characters, and cuts what is longer."""
ARMED = "the vehicle is armed; parameters are set while it is not"


def read_parameters(into: dict[str, float]) -> ProcedureRun:
    """Return a run that puts every parameter of the vehicle into a mapping."""

    def steps(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
        yield from pull(flight, run, into.__setitem__)
        return SUCCEEDED

    return _run_of("reading parameters", steps)


def read_plan(into: list[PlanItem]) -> ProcedureRun:
    """Return a run that appends the items of the vehicle's mission, home first."""

    def steps(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
        with mission_protocol(flight, run):
            items = yield from download(flight, run)
        for item in items:
            one, two, three, four = (value if math.isfinite(value) else None for value in item.parameters)
            parameters = (one, two, three, four)
            into.append(
                PlanItem(
                    command=item.command, frame=item.frame, parameters=parameters, x=item.x, y=item.y, z=item.z,
                    autocontinue=item.autocontinue,
                )
            )  # fmt: skip
        return SUCCEEDED

    return _run_of("reading the stored mission", steps)


def set_parameter(name: str, value: float, *, allow_safety: bool) -> ProcedureRun:
    """Return a run that sets a parameter of a vehicle that is not armed, until it reports the value."""

    def steps(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
        if flight.vehicle.armed:
            return Outcome("refused", ARMED, "busy")
        if not _NAME.fullmatch(name):
            return Outcome("refused", f"expected the name of a parameter, got {name[:40]!r}", "request")
        if is_vehicles_own(name.upper()):
            return Outcome("refused", f"{name} is changed by the vehicle itself, and is not set", "request")
        if guarded := guard(flight, name, value):
            return Outcome("refused", guarded, "limits")
        if (kind := safety_kind(name.upper())) and not allow_safety:
            return Outcome("refused", f"{name} is a parameter of the vehicle's safety ({kind})", "request")
        yield from write_parameter(flight, run, name, value)
        return SUCCEEDED

    return _run_of("setting a parameter", steps)


def _run_of(name: str, steps: Callable[[ProcedureContext, ProcedureRun, BoundAction], Steps]) -> ProcedureRun:
    return ProcedureRun(name, procedure=Procedure(steps), action=BoundAction(), moves=False)
