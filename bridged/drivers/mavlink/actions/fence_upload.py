"""The vehicle's own fence and rally points, the second and third list of the mission protocol; plan files with them."""

from __future__ import annotations

import logging
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, Value
from bridged.drivers.mavlink.actions.confirmation import home_reported
from bridged.drivers.mavlink.actions.context import (
    SUCCEEDED,
    BoundAction,
    Ended,
    Part,
    ProcedureContext,
    ProcedureRun,
    Steps,
)
from bridged.drivers.mavlink.actions.mission_actions import (
    FENCE,
    LISTS,
    RALLY,
    count_items,
    mission_protocol,
    send_items,
    upload_within_limits,
)
from bridged.drivers.mavlink.actions.mission_items import Item
from bridged.drivers.mavlink.plan_files import BadPlan, find_plan, read_plan
from bridged.drivers.mavlink.vehicle.state import Place
from schemas.geo import is_inside

log = logging.getLogger("mavlink")
POLYGON_IN, POLYGON_OUT = (
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
CIRCLE_IN = dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
MAX_CORNERS = 70
"""As many as ArduPilot's fences have at most in all."""
Corner = tuple[float, float]


def upload_fence(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`fence_upload`: the corners are acknowledged and counted back; what the fence does is the vehicle's parameter."""
    try:
        corners = _corners(action.arguments["points"])
    except ValueError as error:
        return Outcome("refused", str(error))
    yield from _store_fence(flight, run, tuple(_item(corner, len(corners)) for corner in corners))
    return SUCCEEDED


def upload_plan(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`plan_upload`: the items of a plan file in the mission's folder, and its fence and rally points if it has them.

    Says what is not taken. What the file has none of stays as the vehicle has it.
    """
    name = action.arguments["file"]
    try:
        if not isinstance(name, str):
            raise BadPlan(f"expected the name of a plan file, got {name!r}")
        plan = read_plan(find_plan(flight.files.mission, name), name)
    except BadPlan as error:
        return Outcome("refused", str(error), "request")
    outcome = yield from upload_within_limits(flight, run, plan.items)
    if outcome is not SUCCEEDED:
        return outcome
    try:
        if plan.fence:
            yield from _store_fence(flight, run, plan.fence)
        if plan.rally:
            yield from _store(flight, run, plan.rally, RALLY)
    except Ended as ended:
        return Outcome("failed", f"the mission is stored, but {ended.outcome.reason}")
    if plan.remark:
        log.warning("robot=%s %s: %s", flight.files.robot, name, plan.remark)
    return replace(outcome, reason=plan.remark)


def _store_fence(flight: ProcedureContext, run: ProcedureRun, items: tuple[Item, ...]) -> Part:
    """Store a fence. One around another place would be breached immediately, so home and the vehicle must be inside."""
    yield from home_reported(flight, run)
    for what, place in (("home", flight.vehicle.home), ("the vehicle", flight.vehicle.position)):
        if place is None:
            raise Ended("refused", f"where {what} is, is not known yet")
        if not _allows(items, place):
            raise Ended("refused", f"{what} is outside of the fence")
    yield from _store(flight, run, items, FENCE)


def _store(flight: ProcedureContext, run: ProcedureRun, items: tuple[Item, ...], kind: int) -> Part:
    """Store a list (MAV_MISSION_TYPE) and count it back."""
    what = LISTS[kind]

    def begun(sent: int) -> None:
        run.leaves = f"the upload was broken off at item {sent} of {len(items)}: what {what} it holds is not known"

    with mission_protocol(flight, run, kind):
        yield from send_items(flight, run, items, kind, begun)
        run.leaves = ""
        held = yield from count_items(flight, run, kind)
    if held != len(items):
        reported = "does not report it" if held is None else f"holds {held} items"
        raise Ended("failed", f"the {what} of {len(items)} items was acknowledged, but the vehicle {reported}")


def _allows(items: tuple[Item, ...], place: Place) -> bool:
    """Whether a place is within a shape that includes, if there are any, and in none that excludes."""
    rest, inside = items, list[bool]()
    while rest:
        first, is_polygon = rest[0], rest[0].command in (POLYGON_IN, POLYGON_OUT)
        shape = rest[: max(1, int(first.parameters[0])) if is_polygon else 1]
        rest = rest[len(shape) :]
        if is_polygon:
            corners = [(corner.x / 1e7, corner.y / 1e7) for corner in shape]
            within = is_inside((place.latitude, place.longitude), corners)
        else:
            within = place.distance(first.place) <= first.parameters[0]
        if first.command in (POLYGON_IN, CIRCLE_IN):
            inside.append(within)
        elif within:
            return False
    return any(inside) or not inside


def _item(corner: Corner, count: int) -> Item:
    latitude, longitude = (round(degrees * 1e7) for degrees in corner)
    return Item(POLYGON_IN, dialect.MAV_FRAME_GLOBAL_INT, (float(count), 0.0, 0.0, 0.0), latitude, longitude)


def _corners(value: Value) -> list[Corner]:
    if not isinstance(value, list) or not 3 <= len(value) <= MAX_CORNERS:
        raise ValueError(f"a fence is a list of 3 to {MAX_CORNERS} corners, each [Latitude, Longitude]")
    corners = []
    for number, corner in enumerate(value, 1):
        match corner:
            case [int() | float() as latitude, int() | float() as longitude] if (
                abs(latitude) <= 90 and abs(longitude) <= 180
            ):
                corners.append((float(latitude), float(longitude)))
            case _:
                raise ValueError(
                    f"corner {number} of the fence: expected [Latitude, Longitude] in degrees, got {corner}"
                )
    return corners
