"""Commands of the simulated PX4: effects and acknowledgements; and setpoints, which OFFBOARD follows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.command_messages import (
    FORCE,
    Command,
    heading_of,
    turn_rate_of,
    wants_place,
    wants_velocity,
)
from bridged.simulation.vehicle.messages import Messages, Streams
from bridged.simulation.vehicle.mission_items import whole
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Circle, Drift, GoTo
from bridged.simulation.vehicle.notifications import Done, Result
from bridged.simulation.vehicle.px4 import telemetry
from bridged.simulation.vehicle.px4.modes import Mode, selected
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.telemetry import AVAILABLE_MODES_ID
from bridged.simulation.vehicle.px4.texts import CRITICAL

GRIPPER_S = 1.1
"""Seconds until a gripper has moved (recorded)."""


@dataclass(slots=True)
class CommandContext:
    """The vehicle that commands act on, and their messages besides the acknowledgement."""

    px4: Px4
    streams: Streams
    ahead: Messages = field(default_factory=list)
    later: list[tuple[float, Done]] = field(default_factory=list)
    """Commands that are done later: after how many seconds, and their acknowledgement."""

    def carry_out(self, command: Command) -> Result:
        """Carry out a command."""
        px4, (first, second, third, _) = self.px4, command.params
        match command.number:
            case dialect.MAV_CMD_DO_SET_MODE:
                return set_mode(px4, whole(second) & 0xFF, whole(third) & 0xFF)
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM if first in (0.0, 1.0):
                force = second == FORCE
                return px4.arm(force=force) if first else px4.disarm("external command", force=force)
            case dialect.MAV_CMD_NAV_TAKEOFF:
                return px4.take_off(command.z) if px4.takes_off else Result.DENIED
            case dialect.MAV_CMD_NAV_LAND:
                px4.send_text("Landing at current position")
                return px4.set_mode(Mode.LAND)
            case dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                px4.send_text("Returning to launch")
                return px4.set_mode(Mode.RTL)
            case dialect.MAV_CMD_DO_REPOSITION:
                return _reposition(px4, command)
            case dialect.MAV_CMD_DO_CHANGE_ALTITUDE:
                return px4.change_altitude(first)
            case dialect.MAV_CMD_DO_CHANGE_SPEED:
                px4.flight.cruise_speed = second if second > 0 else px4.flight.cruise_speed
                return Result.ACCEPTED
            case dialect.MAV_CMD_DO_ORBIT:
                return px4.orbit(_circle(px4, command))
            case dialect.MAV_CMD_MISSION_START:
                return _start_mission(px4)
            case dialect.MAV_CMD_DO_SET_MISSION_CURRENT:
                if whole(first) > 0:  # 0 was acknowledged, and changed nothing
                    px4.navigator.jump_to(whole(first))
                return Result.ACCEPTED
            case dialect.MAV_CMD_DO_SET_HOME:
                if first == 1.0:
                    px4.set_home(px4.place)
                    return Result.ACCEPTED
                return _set_home(px4, command)
            case dialect.MAV_CMD_DO_SET_ACTUATOR:
                px4.outputs.set((*command.params, command.lat, command.lon))
                return Result.ACCEPTED
            case dialect.MAV_CMD_DO_GRIPPER:
                self.later.append((GRIPPER_S, Done(command.number, Result.ACCEPTED, command.peer)))
                return Result.IN_PROGRESS
            case dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN:
                return Result.DENIED
            case dialect.MAV_CMD_RUN_PREARM_CHECKS:
                px4.report_problems()
                return Result.ACCEPTED
        return self._about_messages(command.number, whole(first), second)

    def _about_messages(self, number: int, message: int, interval_us: float) -> Result:
        px4 = self.px4
        match number:
            case dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                if not math.isfinite(interval_us):
                    return Result.DENIED
                return Result.ACCEPTED if self.streams.set(message, interval_us, px4.now) else Result.FAILED
            case dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
                if not 0 <= message <= 65535:
                    return Result.FAILED
                self.ahead.append(dialect.MAVLink_message_interval_message(message, self.streams.interval_us(message)))
                return Result.ACCEPTED
            case dialect.MAV_CMD_REQUEST_MESSAGE if message == AVAILABLE_MODES_ID:
                self.ahead += telemetry.available_modes()
                return Result.ACCEPTED
            case dialect.MAV_CMD_REQUEST_MESSAGE:
                return self._send(message)
        return Result.UNSUPPORTED

    def _send(self, message: int) -> Result:
        """Send a message before the acknowledgement (recorded)."""
        builder = telemetry.REQUESTED.get(message)
        built = None if builder is None else builder(self.px4)
        if built is None:
            return Result.DENIED
        self.ahead.append(built)
        return Result.ACCEPTED


def set_mode(px4: Px4, main: int, sub: int) -> Result:
    """Change the mode by its two numbers."""
    mode = selected(main, sub)
    if mode is None:
        kind = "auto" if main == 4 else "main"
        px4.send_text(f"Unsupported {kind} mode", CRITICAL)
        return Result.TEMPORARILY_REJECTED
    if mode is Mode.TAKEOFF:
        return px4.take_off(math.nan)
    return px4.set_mode(mode)


def _reposition(px4: Px4, command: Command) -> Result:
    speed, flags, radius, yaw = command.params
    if not whole(flags) & 1 and px4.mode is not Mode.LOITER:
        return Result.DENIED
    if not any(map(math.isfinite, (command.lat, command.lon, command.z))):
        px4.reposition(None, speed, None, radius)
        return Result.ACCEPTED
    px4.reposition(_goal(px4, command), speed, yaw % (2 * math.pi) if math.isfinite(yaw) else None, radius)
    return Result.ACCEPTED


def _goal(px4: Px4, command: Command) -> Vector:
    """Return the goal of a command; what it does not give is that of the present place."""
    here = px4.place
    lat, lon, alt = (
        given if math.isfinite(given) else present
        for given, present in ((command.lat, here.lat), (command.lon, here.lon), (command.z, here.alt))
    )
    return px4.chart.at(lat, lon, alt)


def _circle(px4: Px4, command: Command) -> Circle:
    radius, speed, *_ = command.params
    radius = radius if math.isfinite(radius) and abs(radius) >= 1 else 10.0
    return Circle(_goal(px4, command), radius, min(10.0, abs(speed)) if math.isfinite(speed) and speed else 3.0)


def _start_mission(px4: Px4) -> Result:
    if not px4.missions.items or px4.missions.problem is not None:
        px4.send_text("Mission start denied! No valid mission", CRITICAL)
        return Result.DENIED
    return px4.set_mode(Mode.MISSION)


def _set_home(px4: Px4, command: Command) -> Result:
    if not all(map(math.isfinite, (command.lat, command.lon, command.z))):
        return Result.DENIED
    px4.set_home(px4.chart.place(px4.chart.at(command.lat, command.lon, command.z)))
    return Result.ACCEPTED


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
