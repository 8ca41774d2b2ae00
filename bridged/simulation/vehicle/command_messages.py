"""Commands and setpoints as any autopilot reads them: COMMAND_LONG, COMMAND_INT, SET_POSITION_TARGET."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

FORCE = 21196.0
"""Parameter 2 of COMPONENT_ARM_DISARM: without checks."""
_NOWHERE = 2**31 - 1
"""x or y of COMMAND_INT: no place."""
_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_YAW, _IGNORE_YAW_RATE = 0b111, 0b111000, 1 << 10, 1 << 11
"""Bits of type_mask (POSITION_TARGET_TYPEMASK)."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command; `lat` and `lon` in degrees, `z` in metres in `frame`; NaN: not given."""

    number: int
    params: tuple[float, float, float, float]
    lat: float
    lon: float
    z: float
    frame: int
    by_int: bool
    peer: tuple[int, int]

    @classmethod
    def of(cls, message: dialect.MAVLink_message) -> Command:
        """Read a COMMAND_LONG, whose altitude counts from home, or a COMMAND_INT."""
        params = (message.param1, message.param2, message.param3, message.param4)
        peer = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() == "COMMAND_LONG":
            place, frame = (message.param5, message.param6, message.param7), dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
            return cls(message.command, params, *place, frame, by_int=False, peer=peer)
        lat, lon = (math.nan if degrees == _NOWHERE else degrees / 1e7 for degrees in (message.x, message.y))
        return cls(message.command, params, lat, lon, message.z, message.frame, by_int=True, peer=peer)


def wants_place(message: dialect.MAVLink_message) -> bool:
    """Return whether a SET_POSITION_TARGET names a place."""
    return not message.type_mask & _IGNORE_POSITION


def wants_velocity(message: dialect.MAVLink_message) -> bool:
    """Return whether it names a velocity."""
    return not message.type_mask & _IGNORE_VELOCITY


def heading_of(message: dialect.MAVLink_message) -> float | None:
    """Return the heading that it names in radians, None if it names none."""
    if message.type_mask & _IGNORE_YAW or not math.isfinite(message.yaw):
        return None
    return float(message.yaw) % (2 * math.pi)


def turn_rate_of(message: dialect.MAVLink_message) -> float | None:
    """Return the rate of turn that it names in rad/s, None if it names none."""
    if message.type_mask & _IGNORE_YAW_RATE or not math.isfinite(message.yaw_rate):
        return None
    return float(message.yaw_rate)
