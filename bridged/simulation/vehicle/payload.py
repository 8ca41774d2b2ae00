"""What a simulated vehicle carries, attached to its autopilot: relays, a winch, a camera that triggers, and a gimbal.

Nothing of it is stepped: where a winch or a gimbal is follows from when it was commanded. Times are vehicle seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.geodesy import FlatMap, Place
from bridged.simulation.vehicle.mission_items import whole
from bridged.simulation.vehicle.notifications import Result

RELAYS = 6
WINCH_RATE = 1.0
"""m/s of line."""
WINCH_LINE = 50.0
"""Metres of line on the winch."""
GIMBAL_RATE = math.radians(60.0)
"""rad/s of each axis."""
STEEPEST = math.radians(90.0)
"""Radians up and down that a gimbal can look."""
Ids = tuple[int, int]
"""System and component."""


@dataclass(slots=True)
class Mover:
    """A figure that moves to its goal at a constant rate."""

    rate: float
    start: float = 0.0
    goal: float = 0.0
    since: float = 0.0

    def at(self, now: float) -> float:
        """Return where it is at `now`."""
        way, most = self.goal - self.start, self.rate * (now - self.since)
        return self.goal if abs(way) <= most else self.start + math.copysign(most, way)

    def go(self, goal: float, now: float) -> None:
        """Move to a goal from `now` on."""
        self.start, self.goal, self.since = self.at(now), goal, now


@dataclass(slots=True)
class Gimbal:
    """A gimbal of two axes, and its manager: pitch over the horizon, yaw from the bow, or a place that it looks at."""

    device: int = 1
    """gimbal_device_id: 1 to 6 of one that is attached, else its component."""
    by: Ids = (0, 0)
    """Who is in control of it."""
    pitch: Mover = field(default_factory=lambda: Mover(GIMBAL_RATE))
    yaw: Mover = field(default_factory=lambda: Mover(GIMBAL_RATE))
    locked: bool = False
    """Whether yaw counts from north."""
    looks_at: Place | None = None

    def configure(self, system: float, component: float) -> Result:
        """DO_GIMBAL_MANAGER_CONFIGURE: give the control to ids; -1 leaves it."""
        if system >= 0 and component >= 0:
            self.by = (int(system), int(component))
        return Result.ACCEPTED

    def point(self, pitch: float, yaw: float, flags: float, now: float) -> Result:
        """DO_GIMBAL_MANAGER_PITCHYAW by angles in degrees."""
        if not (math.isfinite(pitch) and math.isfinite(yaw)):
            return Result.DENIED
        self.looks_at, self.locked = None, bool(whole(flags) & dialect.GIMBAL_MANAGER_FLAGS_YAW_LOCK)
        self.pitch.go(max(-STEEPEST, min(STEEPEST, math.radians(pitch))), now)
        self.yaw.go(math.remainder(math.radians(yaw), 2 * math.pi), now)
        return Result.ACCEPTED

    def status(self, boot_ms: int) -> dialect.MAVLink_message:
        """GIMBAL_MANAGER_STATUS"""
        return dialect.MAVLink_gimbal_manager_status_message(boot_ms, self._flags, self.device, *self.by, 0, 0)

    def attitude(self, here: Place, heading: float, now: float) -> dialect.MAVLink_message:
        """GIMBAL_DEVICE_ATTITUDE_STATUS of a vehicle at a place with a heading in radians."""
        if self.looks_at is not None:
            away, self.locked = FlatMap(here).vector(self.looks_at), False
            self.pitch.goal = math.atan2(away.up, math.hypot(away.north, away.east))
            self.yaw.goal = math.remainder(math.atan2(away.east, away.north) - heading, 2 * math.pi)
        half_pitch, half_yaw = self.pitch.at(now) / 2, self.yaw.at(now) / 2
        cp, sp, cy, sy = math.cos(half_pitch), math.sin(half_pitch), math.cos(half_yaw), math.sin(half_yaw)
        q = [cp * cy, -sp * sy, sp * cy, cp * sy]
        attached = self.device if self.device <= 6 else 0
        return dialect.MAVLink_gimbal_device_attitude_status_message(
            0, 0, round(now * 1000), self._flags, q, 0, 0, 0, 0, math.nan, math.nan, attached
        )

    @property
    def _flags(self) -> int:
        horizon = dialect.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | dialect.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
        return int(horizon | (dialect.GIMBAL_DEVICE_FLAGS_YAW_LOCK if self.locked else 0))


class Payload:
    """Everything that is attached to one autopilot."""

    def __init__(self) -> None:
        self.relays = 0
        """Bits of those that are on."""
        self.winch = Mover(WINCH_RATE)
        self.gimbal = Gimbal()
        self.pictures = 0

    def carry_out(self, number: int, parameters: tuple[float, ...], place: Place | None, now: float) -> Result | None:
        """Carry out a command to the payload; None if it is none. `place`: of the command, above the sea."""
        first, second, third, fourth, fifth, *_ = parameters
        match number:
            case dialect.MAV_CMD_DO_SET_RELAY:
                return self._switch(whole(first), second >= 1.0)
            case dialect.MAV_CMD_DO_WINCH if second == dialect.WINCH_RELATIVE_LENGTH_CONTROL:
                self.winch.rate = abs(fourth) or WINCH_RATE
                self.winch.go(max(0.0, min(WINCH_LINE, self.winch.at(now) + third)), now)
                return Result.ACCEPTED
            case dialect.MAV_CMD_IMAGE_START_CAPTURE | dialect.MAV_CMD_DO_DIGICAM_CONTROL:
                self.pictures += 1
                return Result.ACCEPTED
            case dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE:
                return self.gimbal.configure(first, second)
            case dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                return self.gimbal.point(first, second, fifth, now)
            case dialect.MAV_CMD_DO_SET_ROI_LOCATION if place is not None:
                for axis in (self.gimbal.pitch, self.gimbal.yaw):
                    axis.go(axis.at(now), now)
                self.gimbal.looks_at = place
                return Result.ACCEPTED
            case dialect.MAV_CMD_DO_SET_ROI_NONE:
                self.gimbal.looks_at = None
                return self.gimbal.point(0.0, 0.0, 0.0, now)
        return None

    def feedback(self, place: Place) -> dialect.MAVLink_message:
        """CAMERA_FEEDBACK of the last picture."""
        at = (place.lat_e7, place.lon_e7, place.alt, 0.0)
        return dialect.MAVLink_camera_feedback_message(0, 0, 0, self.pictures, *at, 0, 0, 0, 0, 0, self.pictures)

    def relay_status(self, now: float) -> dialect.MAVLink_message:
        """RELAY_STATUS"""
        return dialect.MAVLink_relay_status_message(round(now * 1000), self.relays, (1 << RELAYS) - 1)

    def winch_status(self, now: float) -> dialect.MAVLink_message:
        """WINCH_STATUS"""
        out = self.winch.at(now)
        moving = 0 if out == self.winch.goal else dialect.MAV_WINCH_STATUS_MOVING
        status = dialect.MAV_WINCH_STATUS_HEALTHY | moving
        return dialect.MAVLink_winch_status_message(round(now * 1e6), out, 0, 0, 0, 0, 0, status)

    def _switch(self, relay: int, on: bool) -> Result:
        if not 0 <= relay < RELAYS:
            return Result.FAILED
        self.relays = self.relays | 1 << relay if on else self.relays & ~(1 << relay)
        return Result.ACCEPTED
