"""Setpoints of the simulated PX4: what OFFBOARD follows."""

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.texts import CRITICAL

_IGNORE_POSITION, _IGNORE_VELOCITY = 0b111, 0b111000
_IGNORE_YAW, _IGNORE_YAW_RATE = 1 << 10, 1 << 11
"""Bits of type_mask (POSITION_TARGET_TYPEMASK)."""
_LOCAL, _BODY = 1, 8
"""Coordinate frames of SET_POSITION_TARGET_LOCAL_NED (MAV_FRAME)."""
_AMSL, _RELATIVE, _TERRAIN = 5, 6, 11
"""Coordinate frames of SET_POSITION_TARGET_GLOBAL_INT."""
_FOR_EVER = math.inf
"""A velocity is flown until the setpoints are lost."""


def local_setpoint(px4: Px4, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED: a place, or a velocity."""
    frame, mask = message.coordinate_frame, message.type_mask
    if frame not in (_LOCAL, _BODY):
        px4.send_text(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported", CRITICAL)
        return
    velocity = (message.vx, message.vy, message.vz)
    place = (message.x, message.y, message.z)
    if frame == _BODY:
        velocity = (*_turned(px4, message.vx, message.vy), message.vz)
        here = px4.motion.position
        north, east = _turned(px4, message.x, message.y)
        place = (here.north + north, here.east + east, message.z - here.up)
    if not mask & _IGNORE_POSITION and all(map(math.isfinite, place)):
        north, east, down = place
        px4.guide(GoTo(Vector(north, east, -down), _heading(px4, message), limits=px4.stream_limits))
    elif not mask & _IGNORE_VELOCITY and all(map(math.isfinite, velocity)):
        _drift(px4, message, velocity)


def global_setpoint(px4: Px4, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_GLOBAL_INT: a place, its altitude above the sea or above home; or a velocity."""
    frame, mask = message.coordinate_frame, message.type_mask
    if frame not in (_AMSL, _RELATIVE, _TERRAIN):
        px4.send_text(f"SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {frame}", CRITICAL)
        return
    if mask & _IGNORE_POSITION:
        velocity = (message.vx, message.vy, message.vz)
        if not mask & _IGNORE_VELOCITY and all(map(math.isfinite, velocity)):
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
    rate = None if message.type_mask & _IGNORE_YAW_RATE or not math.isfinite(message.yaw_rate) else message.yaw_rate
    px4.guide(Drift(Vector(north, east, -down), _FOR_EVER, _heading(px4, message, keep=False), rate))


def _heading(px4: Px4, message: dialect.MAVLink_message, *, keep: bool = True) -> float | None:
    """Return the heading that a setpoint wants in radians; without one a vehicle at a place keeps its own."""
    if message.type_mask & _IGNORE_YAW or not math.isfinite(message.yaw):
        return px4.motion.heading if keep else None
    return float(message.yaw) % (2 * math.pi)


def _turned(px4: Px4, forward: float, right: float) -> tuple[float, float]:
    cos, sin = math.cos(px4.motion.heading), math.sin(px4.motion.heading)
    return forward * cos - right * sin, forward * sin + right * cos
