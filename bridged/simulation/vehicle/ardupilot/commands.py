"""Commands and setpoints of the simulated copter: effects and acknowledgements.

COMMAND_LONG and COMMAND_INT share one table: a COMMAND_LONG is read as one whose place is in degrees and whose altitude
is above home, as ArduPilot does.
"""

import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import telemetry
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.mission import do
from bridged.simulation.vehicle.command_messages import (
    FORCE,
    Command,
    heading_of,
    turn_rate_of,
    wants_place,
    wants_velocity,
)
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.messages import Streams
from bridged.simulation.vehicle.mission_items import GLOBAL_FRAMES, RELATIVE_FRAMES, whole
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo
from bridged.simulation.vehicle.notifications import Result, Severity


@dataclass(slots=True)
class CommandContext:
    """The copter that commands act on, and their messages besides the acknowledgement."""

    copter: ArduPilot
    streams: Streams
    ahead: list[dialect.MAVLink_message] = field(default_factory=list)  # sent before the acknowledgement
    after: list[dialect.MAVLink_message] = field(default_factory=list)
    reboot_wanted: bool = False

    def carry_out(self, command: Command) -> Result:
        """Carry out a command."""
        copter, (first, second, *_) = self.copter, command.params
        match command.number:
            case dialect.MAV_CMD_NAV_LOITER_UNLIM:
                return copter.set_mode(copter.LOITER)
            case dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                return copter.set_mode(copter.RTL)
            case dialect.MAV_CMD_NAV_LAND:
                return copter.land()
            case dialect.MAV_CMD_NAV_TAKEOFF:
                return copter.take_off(command.z) if command.frame in RELATIVE_FRAMES else Result.DENIED
            case dialect.MAV_CMD_DO_LAND_START:
                return copter.start_landing()
            case dialect.MAV_CMD_DO_SET_MODE:
                return copter.set_mode(whole(second)) if whole(first) & 1 else Result.DENIED
            case dialect.MAV_CMD_DO_SET_HOME:
                return _set_home(copter, command)
            case dialect.MAV_CMD_DO_REPOSITION:
                return _reposition(copter, command)
            case number if number in _AS_IN_A_MISSION:
                return do(copter, number, command.params)
            case dialect.MAV_CMD_DO_SET_MISSION_CURRENT:
                if not copter.jump_to(whole(first)):
                    return Result.FAILED
                self.after.append(telemetry.mission_current(copter))
                return Result.ACCEPTED
            case dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN if first in (1.0, 3.0):
                self.reboot_wanted = not copter.armed
                return Result.FAILED if copter.armed else Result.ACCEPTED
            case dialect.MAV_CMD_MISSION_START:
                return copter.start_mission()
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM if first in (0.0, 1.0):
                force = second == FORCE
                return copter.arm(force=force) if first else copter.disarm(force=force)
            case dialect.MAV_CMD_RUN_PREARM_CHECKS:
                if copter.armed:
                    return Result.TEMPORARILY_REJECTED
                for problem in copter.arming_problems():
                    copter.send_text(f"PreArm: {problem}", Severity.CRITICAL)
                return Result.ACCEPTED
            case dialect.MAV_CMD_GET_HOME_POSITION:
                return self._send(dialect.MAVLINK_MSG_ID_HOME_POSITION)
            case dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
                return self._send(dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            case dialect.MAV_CMD_REQUEST_MESSAGE:
                return self._send(whole(first))
            case dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
                wanted = whole(first)
                if not 0 <= wanted <= 65535:
                    return Result.FAILED
                interval = self.streams.interval_us(wanted)
                self.ahead.append(dialect.MAVLink_message_interval_message(wanted, interval))
                return Result.ACCEPTED if self.streams.knows(wanted) else Result.FAILED
            case dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                if not math.isfinite(second):
                    return Result.DENIED
                if self.streams.set(whole(first), second, copter.now):
                    return Result.ACCEPTED
                copter.send_text(f"No ap_message for mavlink id ({whole(first)})")
                return Result.DENIED
        return self._carried(command)

    def _carried(self, command: Command) -> Result:
        """Carry out a command to the payload."""
        copter, place = self.copter, None
        if command.number == dialect.MAV_CMD_DO_SET_ROI_LOCATION:
            above_sea = altitude(copter, command.frame, command.z)
            if above_sea is None:
                return Result.DENIED
            try:
                place = Place(command.lat, command.lon, above_sea)
            except ValueError:
                return Result.DENIED
        parameters = (*command.params, command.lat, command.lon, command.z)
        pictures = copter.payload.pictures
        result = copter.payload.carry_out(command.number, parameters, place, copter.now)
        if copter.payload.pictures != pictures:
            self.after.append(copter.payload.feedback(copter.place))
        return Result.UNSUPPORTED if result is None else result

    def _send(self, message: int) -> Result:
        """Send a message after the acknowledgement."""
        build = telemetry.BUILDERS.get(message)
        built = None if build is None else build(self.copter)
        if built is None:
            return Result.FAILED
        self.after.append(built)
        return Result.ACCEPTED


_AS_IN_A_MISSION = frozenset((
    dialect.MAV_CMD_CONDITION_YAW,
    dialect.MAV_CMD_DO_CHANGE_SPEED,
    dialect.MAV_CMD_DO_SET_SERVO,
    dialect.MAV_CMD_DO_REPEAT_SERVO,
    dialect.MAV_CMD_DO_FENCE_ENABLE,
    dialect.MAV_CMD_DO_GRIPPER,
))  # fmt: skip
"""Commands that do the same as items of a mission."""


def altitude(copter: ArduPilot, frame: int, z: float) -> float | None:
    """Return the altitude of `z` metres in `frame` (MAV_FRAME), in metres AMSL; None if it is none."""
    if not math.isfinite(z) or abs(z) > 100_000:
        return None
    if frame in GLOBAL_FRAMES:
        return z
    home = copter.home or copter.chart.origin
    return home.alt + z if frame in RELATIVE_FRAMES else None


def _reposition(copter: ArduPilot, command: Command) -> Result:
    if not command.by_int:
        return Result.UNSUPPORTED
    above_sea = altitude(copter, command.frame, command.z)
    if above_sea is None:
        return Result.DENIED
    try:
        goal = copter.chart.vector(Place(command.lat, command.lon, above_sea))
    except ValueError:
        return Result.DENIED
    if copter.mode is not copter.GUIDED:
        if not whole(command.params[1]) & 1:
            return copter.OUTSIDE_GUIDED
        if copter.set_mode(copter.GUIDED) is not Result.ACCEPTED:
            return Result.FAILED
    yaw = command.params[3]
    heading = yaw if math.isfinite(yaw) and yaw else None
    return Result.ACCEPTED if copter.guide(GoTo(goal, heading)) else Result.FAILED


def _set_home(copter: ArduPilot, command: Command) -> Result:
    if command.params[0] == 1.0:
        copter.set_home(copter.place)
        return Result.ACCEPTED
    above_sea = altitude(copter, command.frame if command.by_int else 0, command.z)
    if above_sea is None or (command.lat == 0 and command.lon == 0):
        return Result.DENIED
    try:
        copter.set_home(Place(command.lat, command.lon, above_sea))
    except ValueError:
        return Result.DENIED
    return Result.ACCEPTED


_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET = 1, 7, 8, 9
"""Coordinate frames of SET_POSITION_TARGET_LOCAL_NED (MAV_FRAME)."""

FASTEST = 100.0
"""m/s; a velocity beyond is nonsense."""


def global_setpoint(copter: ArduPilot, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_GLOBAL_INT: one goal, or a velocity."""
    if not copter.TAKES_SETPOINTS:
        return
    frame = message.coordinate_frame
    if frame not in GLOBAL_FRAMES + RELATIVE_FRAMES:
        copter.send_text(f"Unknown mavlink coordinate frame {frame}")
        return
    if not wants_place(message):
        _drift(copter, message, (message.vx, message.vy, message.vz))
        return
    above_sea = altitude(copter, frame, message.alt)
    if above_sea is None:
        return
    try:
        goal = copter.chart.vector(Place(message.lat_int / 1e7, message.lon_int / 1e7, above_sea))
    except ValueError:
        return
    copter.guide(GoTo(goal, heading_of(message)))


def local_setpoint(copter: ArduPilot, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED: metres from the origin, or from here; or a velocity."""
    if not copter.TAKES_SETPOINTS:
        return
    frame = message.coordinate_frame
    if frame not in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET):
        return
    north, east, down = message.x, message.y, message.z
    velocity = (message.vx, message.vy, message.vz)
    if frame in (_BODY, _BODY_OFFSET):
        north, east = copter.motion.turned(north, east)
        velocity = (*copter.motion.turned(message.vx, message.vy), message.vz)
    if not wants_place(message):
        _drift(copter, message, velocity)
        return
    if not all(math.isfinite(metres) and abs(metres) < 1e5 for metres in (north, east, down)):
        return
    goal = Vector(north, east, -down)
    if frame != _LOCAL:
        here = copter.motion.position
        goal = Vector(here.north + north, here.east + east, here.up - down)
    copter.guide(GoTo(goal, heading_of(message)))


def _drift(copter: ArduPilot, message: dialect.MAVLink_message, velocity: tuple[float, float, float]) -> None:
    if not wants_velocity(message):
        return
    if not all(math.isfinite(speed) and abs(speed) <= FASTEST for speed in velocity):
        return
    expires = copter.now + copter.setpoint_lasts
    north, east, down = velocity
    copter.guide(Drift(Vector(north, east, -down), expires, heading_of(message), turn_rate_of(message)))
