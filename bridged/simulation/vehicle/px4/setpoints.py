"""Setpoints of the simulated PX4: what OFFBOARD follows."""

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.command_messages import heading_of, turn_rate_of, wants_place, wants_velocity
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.texts import CRITICAL

_LOCAL, _BODY = 1, 8
"""Coordinate frames of SET_POSITION_TARGET_LOCAL_NED (MAV_FRAME)."""
_AMSL, _RELATIVE, _TERRAIN = 5, 6, 11
"""Coordinate frames of SET_POSITION_TARGET_GLOBAL_INT."""
_FOR_EVER = math.inf
"""A velocity is flown until the setpoints are lost."""


def local_setpoint(px4: Px4, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED: a place, or a velocity."""
    frame = message.coordinate_frame
    if frame not in (_LOCAL, _BODY):
        px4.send_text(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported", CRITICAL)
        return
    velocity = (message.vx, message.vy, message.vz)
    place = (message.x, message.y, message.z)
    if frame == _BODY:
        velocity = (*px4.motion.turned(message.vx, message.vy), message.vz)
        here = px4.motion.position
        north, east = px4.motion.turned(message.x, message.y)
        place = (here.north + north, here.east + east, message.z - here.up)
    if wants_place(message) and all(map(math.isfinite, place)):
        north, east, down = place
        px4.guide(GoTo(Vector(north, east, -down), _heading(px4, message), limits=px4.stream_limits))
    elif wants_velocity(message) and all(map(math.isfinite, velocity)):
        _drift(px4, message, velocity)


def global_setpoint(px4: Px4, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_GLOBAL_INT: a place, its altitude above the sea or above home; or a velocity."""
    frame = message.coordinate_frame
    if frame not in (_AMSL, _RELATIVE, _TERRAIN):
        px4.send_text(f"SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {frame}", CRITICAL)
        return
    if not wants_place(message):
        velocity = (message.vx, message.vy, message.vz)
        if wants_velocity(message) and all(map(math.isfinite, velocity)):
            _drift(px4, message, velocity)
        return
    if not math.isfinite(message.alt):
        return
    home = px4.home or px4.chart.origin
    altitude = message.alt if frame == _AMSL else home.alt + message.alt
    goal = px4.chart.at(message.lat_int / 1e7, message.lon_int / 1e7, altitude)
    px4.guide(GoTo(goal, _heading(px4, message), limits=px4.stream_limits))


def _drift(px4: Px4, message: dialect.MAVLink_message, velocity: tuple[float, float, float]) -> None:
    north, east, down = velocity
    px4.guide(Drift(Vector(north, east, -down), _FOR_EVER, heading_of(message), turn_rate_of(message)))


def _heading(px4: Px4, message: dialect.MAVLink_message) -> float:
    """Return the heading at a place in radians: without a wish the vehicle keeps its own."""
    heading = heading_of(message)
    return px4.motion.heading if heading is None else heading
