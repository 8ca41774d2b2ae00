"""Commands and setpoints of the simulated ArduPilot: effects and acknowledgements.

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
    """The ArduPilot that commands act on, and their messages besides the acknowledgement."""

    ardupilot: ArduPilot
    streams: Streams
    ahead: list[dialect.MAVLink_message] = field(default_factory=list)  # sent before the acknowledgement
    after: list[dialect.MAVLink_message] = field(default_factory=list)
    reboot_wanted: bool = False

    def carry_out(self, command: Command) -> Result:
        """Carry out a command."""
        ardupilot, (first, second, *_) = self.ardupilot, command.params
        match command.number:
            case dialect.MAV_CMD_NAV_LOITER_UNLIM:
                return ardupilot.set_mode(ardupilot.MODES.LOITER)
            case dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                return ardupilot.set_mode(ardupilot.MODES.RTL)
            case dialect.MAV_CMD_NAV_LAND:
                return ardupilot.land()
            case dialect.MAV_CMD_NAV_TAKEOFF:
                return ardupilot.take_off(command.z) if command.frame in RELATIVE_FRAMES else Result.DENIED
            case dialect.MAV_CMD_DO_LAND_START:
                return ardupilot.start_landing()
            case dialect.MAV_CMD_DO_SET_MODE:
                return ardupilot.set_mode(whole(second)) if whole(first) & 1 else Result.DENIED
            case dialect.MAV_CMD_DO_SET_HOME:
                return _set_home(ardupilot, command)
            case dialect.MAV_CMD_DO_REPOSITION:
                return _reposition(ardupilot, command)
            case number if number in _AS_IN_A_MISSION:
                return do(ardupilot, number, command.params)
            case dialect.MAV_CMD_DO_SET_MISSION_CURRENT:
                if not ardupilot.jump_to(whole(first)):
                    return Result.FAILED
                self.after.append(telemetry.mission_current(ardupilot))
                return Result.ACCEPTED
            case dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN if first in (1.0, 3.0):
                self.reboot_wanted = not ardupilot.armed
                return Result.FAILED if ardupilot.armed else Result.ACCEPTED
            case dialect.MAV_CMD_MISSION_START:
                return ardupilot.start_mission()
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM if first in (0.0, 1.0):
                force = second == FORCE
                return ardupilot.arm(force=force) if first else ardupilot.disarm(force=force)
            case dialect.MAV_CMD_RUN_PREARM_CHECKS:
                if ardupilot.armed:
                    return Result.TEMPORARILY_REJECTED
                for problem in ardupilot.arming_problems():
                    ardupilot.send_text(f"PreArm: {problem}", Severity.CRITICAL)
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
                return Result.ACCEPTED if wanted in self.streams.known else Result.FAILED
            case dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                if not math.isfinite(second):
                    return Result.DENIED
                if self.streams.set(whole(first), second, ardupilot.now):
                    return Result.ACCEPTED
                ardupilot.send_text(f"No ap_message for mavlink id ({whole(first)})")
                return Result.DENIED
        return self._carried(command)

    def _carried(self, command: Command) -> Result:
        """Carry out a command to the payload."""
        ardupilot, place = self.ardupilot, None
        if command.number == dialect.MAV_CMD_DO_SET_ROI_LOCATION:
            above_sea = altitude(ardupilot, command.frame, command.z)
            if above_sea is None:
                return Result.DENIED
            try:
                place = Place(command.lat, command.lon, above_sea)
            except ValueError:
                return Result.DENIED
        parameters = (*command.params, command.lat, command.lon, command.z)
        pictures = ardupilot.payload.pictures
        result = ardupilot.payload.carry_out(command.number, parameters, place, ardupilot.now)
        if ardupilot.payload.pictures != pictures:
            self.after.append(ardupilot.payload.feedback(ardupilot.place))
        return Result.UNSUPPORTED if result is None else result

    def _send(self, message: int) -> Result:
        """Send a message after the acknowledgement."""
        build = telemetry.BUILDERS.get(message)
        built = None if build is None else build(self.ardupilot)
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


def altitude(ardupilot: ArduPilot, frame: int, z: float) -> float | None:
    """Return the altitude of `z` metres in `frame` (MAV_FRAME), in metres AMSL; None if it is none."""
    if not math.isfinite(z) or abs(z) > 100_000:
        return None
    if frame in GLOBAL_FRAMES:
        return z
    home = ardupilot.home or ardupilot.chart.origin
    return home.alt + z if frame in RELATIVE_FRAMES else None


def _reposition(ardupilot: ArduPilot, command: Command) -> Result:
    if not command.by_int:
        return Result.UNSUPPORTED
    above_sea = altitude(ardupilot, command.frame, command.z)
    if above_sea is None:
        return Result.DENIED
    try:
        goal = ardupilot.chart.vector(Place(command.lat, command.lon, above_sea))
    except ValueError:
        return Result.DENIED
    if ardupilot.mode is not ardupilot.MODES.GUIDED:
        if not whole(command.params[1]) & 1:
            return ardupilot.OUTSIDE_GUIDED
        if ardupilot.set_mode(ardupilot.MODES.GUIDED) is not Result.ACCEPTED:
            return Result.FAILED
    yaw = command.params[3]
    heading = yaw if math.isfinite(yaw) and yaw else None
    return Result.ACCEPTED if ardupilot.guide(GoTo(goal, heading)) else Result.FAILED


def _set_home(ardupilot: ArduPilot, command: Command) -> Result:
    if command.params[0] == 1.0:
        ardupilot.set_home(ardupilot.place)
        return Result.ACCEPTED
    above_sea = altitude(ardupilot, command.frame if command.by_int else 0, command.z)
    if above_sea is None or (command.lat == 0 and command.lon == 0):
        return Result.DENIED
    try:
        ardupilot.set_home(Place(command.lat, command.lon, above_sea))
    except ValueError:
        return Result.DENIED
    return Result.ACCEPTED


_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET = 1, 7, 8, 9
"""Coordinate frames of SET_POSITION_TARGET_LOCAL_NED (MAV_FRAME)."""

FASTEST = 100.0
"""m/s; a velocity beyond is nonsense."""


def global_setpoint(ardupilot: ArduPilot, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_GLOBAL_INT: one goal, or a velocity."""
    if not ardupilot.TAKES_SETPOINTS:
        return
    frame = message.coordinate_frame
    if frame not in GLOBAL_FRAMES + RELATIVE_FRAMES:
        ardupilot.send_text(f"Unknown mavlink coordinate frame {frame}")
        return
    if not wants_place(message):
        _drift(ardupilot, message, (message.vx, message.vy, message.vz))
        return
    above_sea = altitude(ardupilot, frame, message.alt)
    if above_sea is None:
        return
    try:
        goal = ardupilot.chart.vector(Place(message.lat_int / 1e7, message.lon_int / 1e7, above_sea))
    except ValueError:
        return
    ardupilot.guide(GoTo(goal, heading_of(message)))


def local_setpoint(ardupilot: ArduPilot, message: dialect.MAVLink_message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED: metres from the origin, or from here; or a velocity."""
    if not ardupilot.TAKES_SETPOINTS:
        return
    frame = message.coordinate_frame
    if frame not in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET):
        return
    north, east, down = message.x, message.y, message.z
    velocity = (message.vx, message.vy, message.vz)
    if frame in (_BODY, _BODY_OFFSET):
        north, east = ardupilot.motion.turned(north, east)
        velocity = (*ardupilot.motion.turned(message.vx, message.vy), message.vz)
    if not wants_place(message):
        _drift(ardupilot, message, velocity)
        return
    if not all(math.isfinite(metres) and abs(metres) < 1e5 for metres in (north, east, down)):
        return
    goal = Vector(north, east, -down)
    if frame != _LOCAL:
        here = ardupilot.motion.position
        goal = Vector(here.north + north, here.east + east, here.up - down)
    ardupilot.guide(GoTo(goal, heading_of(message)))


def _drift(ardupilot: ArduPilot, message: dialect.MAVLink_message, velocity: tuple[float, float, float]) -> None:
    if not wants_velocity(message):
        return
    if not all(math.isfinite(speed) and abs(speed) <= FASTEST for speed in velocity):
        return
    expires = ardupilot.now + ardupilot.setpoint_lasts
    north, east, down = velocity
    ardupilot.guide(Drift(Vector(north, east, -down), expires, heading_of(message), turn_rate_of(message)))
