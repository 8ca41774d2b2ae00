"""Setpoints: goals and velocities that are never acknowledged, and are dropped in silence when they cannot be flown."""

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.copter.copter import Copter
from bridged.simulation.copter.dynamics import Vector
from bridged.simulation.copter.flight_tasks import Drift, GoTo
from bridged.simulation.copter.geodesy import Place
from bridged.simulation.copter.mission import GLOBAL_FRAMES, RELATIVE_FRAMES
from bridged.simulation.copter.protocol.commands import altitude

_IGNORE_POSITION, _IGNORE_VELOCITY = 0b111, 0b111000
_IGNORE_YAW, _IGNORE_YAW_RATE = 1 << 10, 1 << 11
"""Bits of type_mask (POSITION_TARGET_TYPEMASK)."""

_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET = 1, 7, 8, 9
"""Coordinate frames of SET_POSITION_TARGET_LOCAL_NED (MAV_FRAME)."""

FASTEST = 100.0
"""m/s; a velocity beyond is nonsense."""


def global_setpoint(copter: Copter, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_GLOBAL_INT: one goal, or a velocity."""
    frame, mask = message.coordinate_frame, message.type_mask
    if frame not in GLOBAL_FRAMES + RELATIVE_FRAMES:
        copter.say(f"Unknown mavlink coordinate frame {frame}")
        return
    if mask & _IGNORE_POSITION:
        _drift(copter, message, (message.vx, message.vy, message.vz))
        return
    above_sea = altitude(copter, frame, message.alt)
    if above_sea is None:
        return
    try:
        goal = copter.chart.vector(Place(message.lat_int / 1e7, message.lon_int / 1e7, above_sea))
    except ValueError:
        return
    copter.guide(GoTo(goal, _heading(message)))


def local_setpoint(copter: Copter, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED: metres from the origin, or from here; or a velocity."""
    frame, mask = message.coordinate_frame, message.type_mask
    if frame not in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET):
        return
    north, east, down = message.x, message.y, message.z
    velocity = (message.vx, message.vy, message.vz)
    if frame in (_BODY, _BODY_OFFSET):
        north, east = _turned(copter, north, east)
        velocity = (*_turned(copter, message.vx, message.vy), message.vz)
    if mask & _IGNORE_POSITION:
        _drift(copter, message, velocity)
        return
    if not all(math.isfinite(metres) and abs(metres) < 1e5 for metres in (north, east, down)):
        return
    goal = Vector(north, east, -down)
    if frame != _LOCAL:
        here = copter.motion.position
        goal = Vector(here.north + north, here.east + east, here.up - down)
    copter.guide(GoTo(goal, _heading(message)))


def _drift(copter: Copter, message: dialect.MAVLink_message, velocity: tuple[float, float, float]) -> None:
    if message.type_mask & _IGNORE_VELOCITY:
        return
    if not all(math.isfinite(speed) and abs(speed) <= FASTEST for speed in velocity):
        return
    expires = copter.now + max(0.1, copter.parameters["GUID_TIMEOUT"])
    rate = None if message.type_mask & _IGNORE_YAW_RATE or not math.isfinite(message.yaw_rate) else message.yaw_rate
    north, east, down = velocity
    copter.guide(Drift(Vector(north, east, -down), expires, _heading(message), rate))


def _heading(message: dialect.MAVLink_message) -> float | None:
    if message.type_mask & _IGNORE_YAW or not math.isfinite(message.yaw):
        return None
    return float(message.yaw) % (2 * math.pi)


def _turned(copter: Copter, forward: float, right: float) -> tuple[float, float]:
    cos, sin = math.cos(copter.motion.heading), math.sin(copter.motion.heading)
    return forward * cos - right * sin, forward * sin + right * cos
