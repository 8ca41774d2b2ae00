"""Commands to the simulated copter: what each does and how it is acknowledged.

COMMAND_LONG and COMMAND_INT share one table: a COMMAND_LONG is read as one whose place is in degrees and whose altitude
is above home, as ArduCopter does.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.copter.copter import Copter
from bridged.simulation.copter.flight_modes import Mode
from bridged.simulation.copter.flight_tasks import GoTo
from bridged.simulation.copter.geodesy import Place
from bridged.simulation.copter.mission import GLOBAL_FRAMES, RELATIVE_FRAMES
from bridged.simulation.copter.protocol import telemetry
from bridged.simulation.copter.protocol.command_results import Result
from bridged.simulation.copter.protocol.do_commands import do, whole
from bridged.simulation.copter.protocol.notifications import Severity
from bridged.simulation.copter.protocol.streams import Streams

FORCE = 21196.0
"""Parameter 2 of COMPONENT_ARM_DISARM: without checks."""

RELATIVE_FRAME = 3
"""MAV_FRAME_GLOBAL_RELATIVE_ALT"""


@dataclass(frozen=True, slots=True)
class Command:
    """One command; `lat` and `lon` in degrees, `z` in metres in `frame`."""

    number: int
    params: tuple[float, float, float, float]
    lat: float
    lon: float
    z: float
    frame: int
    by_int: bool

    @classmethod
    def of_long(cls, message: dialect.MAVLink_message) -> "Command":
        """Reads COMMAND_LONG."""
        params = (message.param1, message.param2, message.param3, message.param4)
        return cls(
            message.command, params, message.param5, message.param6, message.param7, RELATIVE_FRAME, by_int=False
        )

    @classmethod
    def of_int(cls, message: dialect.MAVLink_message) -> "Command":
        """Reads COMMAND_INT."""
        params = (message.param1, message.param2, message.param3, message.param4)
        return cls(message.command, params, message.x / 1e7, message.y / 1e7, message.z, message.frame, by_int=True)


@dataclass(slots=True)
class Desk:
    """What commands act on, and the messages that they answer with besides the acknowledgement."""

    copter: Copter
    streams: Streams
    ahead: list[dialect.MAVLink_message] = field(default_factory=list)  # sent before the acknowledgement
    after: list[dialect.MAVLink_message] = field(default_factory=list)
    reboot_wanted: bool = False

    def carry_out(self, command: Command) -> Result:
        """Does what the command says."""
        action = _ACTIONS.get(command.number)
        return action(self, command) if action is not None else Result.UNSUPPORTED


def altitude(copter: Copter, frame: int, z: float) -> float | None:
    """Metres above mean sea level of an altitude in a frame; None if the frame has none or the value is no altitude."""
    if not math.isfinite(z) or abs(z) > 100_000:
        return None
    if frame in GLOBAL_FRAMES:
        return z
    home = copter.home or copter.chart.origin
    return home.alt + z if frame in RELATIVE_FRAMES else None


def _set_mode(desk: Desk, command: Command) -> Result:
    if not whole(command.params[0]) & 1:
        return Result.DENIED
    return desk.copter.set_mode(whole(command.params[1]))


def _enter(mode: Mode) -> "Action":
    return lambda desk, _: desk.copter.set_mode(mode)


def _arm(desk: Desk, command: Command) -> Result:
    force = command.params[1] == FORCE
    match command.params[0]:
        case 1.0:
            return desk.copter.arm(force=force)
        case 0.0:
            return desk.copter.disarm(force=force)
    return Result.UNSUPPORTED


def _run_prearm_checks(desk: Desk, command: Command) -> Result:
    del command
    if desk.copter.armed:
        return Result.TEMPORARILY_REJECTED
    for problem in desk.copter.arming_problems():
        desk.copter.say(f"PreArm: {problem}", Severity.CRITICAL)
    return Result.ACCEPTED


def _take_off(desk: Desk, command: Command) -> Result:
    if command.frame not in RELATIVE_FRAMES:
        return Result.DENIED
    return desk.copter.take_off(command.z)


def _reposition(desk: Desk, command: Command) -> Result:
    copter = desk.copter
    if not command.by_int:
        return Result.UNSUPPORTED
    above_sea = altitude(copter, command.frame, command.z)
    if above_sea is None:
        return Result.DENIED
    try:
        goal = copter.chart.vector(Place(command.lat, command.lon, above_sea))
    except ValueError:
        return Result.DENIED
    if copter.mode is not Mode.GUIDED:
        if not whole(command.params[1]) & 1:
            return Result.DENIED
        if copter.set_mode(Mode.GUIDED) is not Result.ACCEPTED:
            return Result.FAILED
    yaw = command.params[3]
    heading = yaw if math.isfinite(yaw) and yaw else None
    return Result.ACCEPTED if copter.guide(GoTo(goal, heading)) else Result.FAILED


def _do(desk: Desk, command: Command) -> Result:
    return do(desk.copter, command.number, command.params)


def _set_mission_item(desk: Desk, command: Command) -> Result:
    if not desk.copter.jump_to(whole(command.params[0])):
        return Result.FAILED
    desk.after.append(telemetry.mission_current(desk.copter))
    return Result.ACCEPTED


def _set_home(desk: Desk, command: Command) -> Result:
    copter = desk.copter
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


def _reboot(desk: Desk, command: Command) -> Result:
    if command.params[0] not in (1.0, 3.0):
        return Result.UNSUPPORTED
    if desk.copter.armed:
        return Result.FAILED
    desk.reboot_wanted = True
    return Result.ACCEPTED


def _start_mission(desk: Desk, command: Command) -> Result:
    del command
    return desk.copter.start_mission()


def _send(message: int) -> "Action":
    def action(desk: Desk, command: Command) -> Result:
        del command
        built = telemetry.BUILDERS[message](desk.copter)
        if built is None:
            return Result.FAILED
        desk.after.append(built)
        return Result.ACCEPTED

    return action


def _request_message(desk: Desk, command: Command) -> Result:
    wanted = whole(command.params[0])
    return _send(wanted)(desk, command) if wanted in telemetry.BUILDERS else Result.FAILED


def _set_interval(desk: Desk, command: Command) -> Result:
    wanted, interval_us = whole(command.params[0]), command.params[1]
    if not math.isfinite(interval_us):
        return Result.DENIED
    if desk.streams.set(wanted, interval_us, desk.copter.now):
        return Result.ACCEPTED
    desk.copter.say(f"No ap_message for mavlink id ({wanted})")
    return Result.DENIED


def _get_interval(desk: Desk, command: Command) -> Result:
    wanted = whole(command.params[0])
    if not 0 <= wanted <= 65535:
        return Result.FAILED
    desk.ahead.append(dialect.MAVLink_message_interval_message(wanted, desk.streams.interval_us(wanted)))
    return Result.ACCEPTED if desk.streams.knows(wanted) else Result.FAILED


Action = Callable[[Desk, Command], Result]

_ACTIONS: dict[int, Action] = {
    dialect.MAV_CMD_NAV_LOITER_UNLIM: _enter(Mode.LOITER),
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: _enter(Mode.RTL),
    dialect.MAV_CMD_NAV_LAND: _enter(Mode.LAND),
    dialect.MAV_CMD_NAV_TAKEOFF: _take_off,
    dialect.MAV_CMD_CONDITION_YAW: _do,
    dialect.MAV_CMD_DO_SET_MODE: _set_mode,
    dialect.MAV_CMD_DO_CHANGE_SPEED: _do,
    dialect.MAV_CMD_DO_SET_HOME: _set_home,
    dialect.MAV_CMD_DO_REPOSITION: _reposition,
    dialect.MAV_CMD_DO_SET_SERVO: _do,
    dialect.MAV_CMD_DO_REPEAT_SERVO: _do,
    dialect.MAV_CMD_DO_FENCE_ENABLE: _do,
    dialect.MAV_CMD_DO_GRIPPER: _do,
    dialect.MAV_CMD_DO_SET_MISSION_CURRENT: _set_mission_item,
    dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    dialect.MAV_CMD_MISSION_START: _start_mission,
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    dialect.MAV_CMD_RUN_PREARM_CHECKS: _run_prearm_checks,
    dialect.MAV_CMD_GET_HOME_POSITION: _send(242),
    dialect.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    dialect.MAV_CMD_REQUEST_MESSAGE: _request_message,
    dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _send(148),
}
