"""The vehicle's own fence: a polygon that it must not leave, stored by the mission protocol as its second list."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, Value
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
    RESULTS,
    TRIES,
    TRY_EVERY,
    VEHICLE_GIVES_UP,
    count_items,
    mission_protocol,
    ours,
)
from schemas.geo import is_inside

MAX_CORNERS = 70
"""As many as ArduPilot's fences have at most in all."""
FENCE = dialect.MAV_MISSION_TYPE_FENCE
Corner = tuple[float, float]


def upload_fence(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`fence_upload`: the corners are acknowledged and counted back; what the fence does is the vehicle's parameter.

    A fence around another place would be broken at once, so home and the vehicle must be inside.
    """
    try:
        corners = _corners(action.arguments["points"])
    except ValueError as error:
        return Outcome("refused", str(error))
    for what, place in (("home", flight.vehicle.home), ("the vehicle", flight.vehicle.position)):
        if place is None:
            return Outcome("refused", f"where {what} is, is not known yet")
        if not is_inside((place.longitude, place.latitude), [corner[::-1] for corner in corners]):
            return Outcome("refused", f"{what} is outside of the fence")
    with mission_protocol(flight, run):
        yield from _send(flight, run, corners)
        held = yield from count_items(flight, run, FENCE)
    if held == len(corners):
        return SUCCEEDED
    if held is None:
        return Outcome("failed", "the vehicle acknowledged the fence, but does not report it")
    return Outcome("failed", f"{len(corners)} corners were acknowledged, the vehicle holds {held}")


def _send(flight: ProcedureContext, run: ProcedureRun, corners: list[Corner]) -> Part:
    count, asked_at, sent = len(corners), flight.now, 0
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_mission_count_message(*flight.addressee, count, FENCE))
        until = flight.now + flight.wait(*TRY_EVERY)
        while flight.now <= until:
            run.feedback = {"item": float(sent), "items": float(count)}
            run.waits_for = f"the vehicle to take corner {sent + 1} of {count}"
            yield
            message = flight.message
            if message is None or not message.get_type().startswith("MISSION_") or not ours(flight, message, FENCE):
                continue
            match message.get_type():
                case "MISSION_REQUEST" | "MISSION_REQUEST_INT" if message.seq < count:
                    sent, until = max(sent, message.seq + 1), flight.now + flight.wait(*VEHICLE_GIVES_UP)
                    flight.send(_item(flight, message.seq, corners))
                case "MISSION_ACK" if message.type == dialect.MAV_MISSION_ACCEPTED and sent == count:
                    return
                case "MISSION_ACK" if message.type != dialect.MAV_MISSION_ACCEPTED:
                    reason = RESULTS.get(message.type, f"result {message.type}")
                    raise Ended("refused", flight.with_texts(f"the vehicle refused the fence: {reason}", asked_at))
        if sent:
            raise Ended(
                "failed", f"the vehicle fell silent at corner {sent} of {count}: what fence it holds is not known"
            )
    raise Ended("failed", f"the vehicle did not request the fence, announced {TRIES} times")


def _item(flight: ProcedureContext, seq: int, corners: list[Corner]) -> dialect.MAVLink_message:
    latitude, longitude = (round(degrees * 1e7) for degrees in corners[seq])
    corner = dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    parameters = (float(len(corners)), 0.0, 0.0, 0.0)
    frame = dialect.MAV_FRAME_GLOBAL_INT
    return dialect.MAVLink_mission_item_int_message(
        *flight.addressee, seq, frame, corner, 0, 1, *parameters, latitude, longitude, 0.0, FENCE
    )


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
