"""The vehicle's own fence: a polygon that it must not leave, stored by the mission protocol as its second list."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, Value
from bridged.drivers.mavlink.actions.confirmation import home_reported
from bridged.drivers.mavlink.actions.context import SUCCEEDED, BoundAction, ProcedureContext, ProcedureRun, Steps
from bridged.drivers.mavlink.actions.mission_actions import FENCE, count_items, mission_protocol, send_items
from bridged.drivers.mavlink.actions.mission_items import Item
from schemas.geo import is_inside

MAX_CORNERS = 70
"""As many as ArduPilot's fences have at most in all."""
Corner = tuple[float, float]


def upload_fence(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`fence_upload`: the corners are acknowledged and counted back; what the fence does is the vehicle's parameter.

    A fence around another place would be breached immediately, so home and the vehicle must be inside.
    """
    try:
        corners = _corners(action.arguments["points"])
    except ValueError as error:
        return Outcome("refused", str(error))
    yield from home_reported(flight, run)
    for what, place in (("home", flight.vehicle.home), ("the vehicle", flight.vehicle.position)):
        if place is None:
            return Outcome("refused", f"where {what} is, is not known yet")
        if not is_inside((place.longitude, place.latitude), [corner[::-1] for corner in corners]):
            return Outcome("refused", f"{what} is outside of the fence")

    def begun(sent: int) -> None:
        run.leaves = f"the upload was broken off at corner {sent} of {len(corners)}: what fence it holds is not known"

    with mission_protocol(flight, run, FENCE):
        yield from send_items(flight, run, tuple(_item(corner, len(corners)) for corner in corners), FENCE, begun)
        run.leaves = ""
        held = yield from count_items(flight, run, FENCE)
    if held == len(corners):
        return SUCCEEDED
    if held is None:
        return Outcome("failed", "the vehicle acknowledged the fence, but does not report it")
    return Outcome("failed", f"{len(corners)} corners were acknowledged, the vehicle holds {held}")


def _item(corner: Corner, count: int) -> Item:
    latitude, longitude = (round(degrees * 1e7) for degrees in corner)
    command, frame = dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, dialect.MAV_FRAME_GLOBAL_INT
    return Item(command, frame, (float(count), 0.0, 0.0, 0.0), latitude, longitude)


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
