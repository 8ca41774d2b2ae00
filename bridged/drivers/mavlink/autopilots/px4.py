"""PX4 1.15 and later: what it does otherwise than ArduPilot, as measured on its main branch of 2026-08.

Altitudes of NAV_TAKEOFF and DO_REPOSITION are above the sea whatever the frame, a takeoff is acknowledged disarmed too,
velocities are flown only in OFFBOARD and only as a stream, integers are sent as the bytes of a float, and the items of
a mission are numbered from 0, without home.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.confirmation import ABOVE_HOME, enter
from bridged.drivers.mavlink.actions.context import (
    GUIDED_TIMEOUT,
    BoundAction,
    Ended,
    LocalTarget,
    ProcedureContext,
    ProcedureRun,
    mode_action,
)
from bridged.drivers.mavlink.actions.parameters import read_parameters
from bridged.drivers.mavlink.autopilots.autopilot import Autopilot, VelocityStream, reposition_action
from bridged.drivers.mavlink.transport import further_messages as _  # noqa: F401  - PX4's messages become known
from bridged.drivers.mavlink.vehicle.commands import MavlinkCommand
from bridged.drivers.mavlink.vehicle.flight_modes import PX4_OFFBOARD, ModeTable
from bridged.drivers.mavlink.vehicle.px4_events import CHECK
from bridged.drivers.mavlink.vehicle.readings import NO_OUTPUT, OUTPUTS, WIND_ESTIMATE

NO_MISSION = 65535
"""MISSION_CURRENT.total of a vehicle that stores no mission."""
SETPOINTS_BEFORE = 3
"""Setpoints that are sent before OFFBOARD is requested: without any it is refused."""
MAIN_OUTPUTS = 8
"""Outputs before the first of the AUX ones of a flight controller that has both, as ArduPilot counts them."""
PREARM, WITH_SAFETY_OFF, ALWAYS = "COM_PREARM_MODE", 1, 2
"""The parameter that says when a disarmed vehicle moves its outputs, and two of its values; otherwise never."""
FIRST_ACTUATOR, ACTUATORS = 301, 6
"""Functions of outputs (PWM_MAIN_FUNC1, ...) that DO_SET_ACTUATOR sets: `Peripheral via Actuator Set`."""
_SIGNED = {dialect.MAV_PARAM_TYPE_INT8, dialect.MAV_PARAM_TYPE_INT16, dialect.MAV_PARAM_TYPE_INT32}
_UNSIGNED = {dialect.MAV_PARAM_TYPE_UINT8, dialect.MAV_PARAM_TYPE_UINT16, dialect.MAV_PARAM_TYPE_UINT32}
_ITEMS = frozenset({"MISSION_ITEM_INT", "MISSION_ITEM"})
_OF_MISSIONS = _ITEMS | {
    "MISSION_COUNT", "MISSION_CURRENT", "MISSION_ITEM_REACHED", "MISSION_REQUEST", "MISSION_REQUEST_INT",
    "MISSION_SET_CURRENT",
}  # fmt: skip
"""Messages that number or count items."""


def _number_outputs(message: dialect.MAVLink_message) -> None:
    """Number the outputs of AUX (port 1) after those of MAIN; a pulse of 0 says that a port has no such output."""
    pulses = [getattr(message, f"servo{output}_raw") or NO_OUTPUT for output in range(1, OUTPUTS + 1)]
    if message.port == 1:
        message.port, pulses = 0, [NO_OUTPUT] * MAIN_OUTPUTS + pulses[: OUTPUTS - MAIN_OUTPUTS]
    for output, pulse in enumerate(pulses, 1):
        setattr(message, f"servo{output}_raw", pulse)


def _renumber(by: int, message: dialect.MAVLink_message) -> None:
    """Add to the numbers of items, and to their count, in a message of the mission's list.

    A yaw of 0 is none, as for ArduPilot.
    """
    kind = message.get_type()
    if getattr(message, "mission_type", 0) != dialect.MAV_MISSION_TYPE_MISSION:
        return
    if kind == "MISSION_COUNT":
        message.count += by
    else:
        message.seq += by
    if kind == "MISSION_CURRENT" and message.total == NO_MISSION:
        message.total = 0
    elif kind in _ITEMS:
        if message.command == dialect.MAV_CMD_DO_JUMP:
            message.param1 += by
        if by > 0 and math.isnan(message.param4):
            message.param4 = 0.0
        elif by < 0 and message.param4 == 0.0 and message.command <= dialect.MAV_CMD_NAV_LAST:
            message.param4 = math.nan


def number_of(value: float, kind: int) -> float:
    """Return the number of a PARAM_VALUE: PX4 sends an integer as the bytes of a float. `kind`: MAV_PARAM_TYPE."""
    if kind in _SIGNED:
        return float(struct.unpack("<i", struct.pack("<f", value))[0])
    return float(struct.unpack("<I", struct.pack("<f", value))[0]) if kind in _UNSIGNED else value


def bits_of(value: float, kind: int) -> float:
    """Return the float whose bytes are the number: the inverse of `number_of`."""
    if kind in _SIGNED:
        return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])
    return float(struct.unpack("<f", struct.pack("<I", int(value)))[0]) if kind in _UNSIGNED else value


def _convert(to: Callable[[float, int], float], message: dialect.MAVLink_message) -> None:
    message.param_value = to(message.param_value, message.param_type)


class Px4(Autopilot):
    """PX4 in the conventions of procedures."""

    name: ClassVar = "PX4"
    needs: ClassVar = {
        "GLOBAL_POSITION_INT": 5.0,
        "SYS_STATUS": 1.0,
        "GPS_RAW_INT": 2.0,
        "ESTIMATOR_STATUS": 1.0,
        "EXTENDED_SYS_STATE": 2.0,
        "POSITION_TARGET_GLOBAL_INT": 2.0,
        "CURRENT_MODE": 0.5,
    }
    unrequestable: ClassVar = frozenset({"MISSION_CURRENT", "RC_CHANNELS"})
    unasked: ClassVar = (
        "ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET", "HIGHRES_IMU", "LOCAL_POSITION_NED", "ODOMETRY",
        "ALTITUDE", "TIMESYNC", "SERVO_OUTPUT_RAW", "VFR_HUD", "SCALED_PRESSURE", "PING",
    )  # fmt: skip
    sources: ClassVar = {**Autopilot.sources, WIND_ESTIMATE: "WIND_COV"}
    stream_denials: ClassVar = frozenset({
        dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_UNSUPPORTED, dialect.MAV_RESULT_FAILED,
    })  # fmt: skip
    pre_arm: ClassVar = CHECK
    texts_for_stations_only: ClassVar = True
    typed_parameters: ClassVar = True
    outputs_show: ClassVar = False
    local_places: ClassVar = False
    fence_switch: ClassVar = ("GF_ACTION", 2.0)
    """2 = it holds, PX4's default; what it does otherwise is the value that somebody has set."""
    lands_by_mission: ClassVar = ("RTL_TYPE", 1.0)
    settles: ClassVar = 1.0
    """Seen: up to 0.8 m low."""
    home_is_an_item: ClassVar = False
    repeats_reached: ClassVar = True
    judges_missions_later: ClassVar = True
    incoming: ClassVar = {
        "PARAM_VALUE": partial(_convert, number_of),
        "SERVO_OUTPUT_RAW": _number_outputs,
        **dict.fromkeys(_OF_MISSIONS, partial(_renumber, 1)),
    }
    """Integers by value, outputs of AUX after those of MAIN, and items counted from 1 with home before them."""
    outgoing: ClassVar = {
        "PARAM_SET": partial(_convert, bits_of),
        **dict.fromkeys(_OF_MISSIONS, partial(_renumber, -1)),
    }
    """Integers by their bytes, and items counted from 0 without home."""

    def station_failsafe(self, modes: ModeTable) -> str:
        """One name for all kinds; what it does is the value."""
        return "NAV_DLL_ACT"

    def hold(self, modes: ModeTable) -> BoundAction:
        """DO_REPOSITION to nowhere: in the mode that takes targets, setting that mode would not end a target."""
        nowhere = (-1.0, float(dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE), 0.0, *(math.nan,) * 4)
        frame = dialect.MAV_FRAME_GLOBAL_INT
        return BoundAction(dialect.MAV_CMD_DO_REPOSITION, nowhere, mode=modes.hold, frame=frame, by_int=True)

    def takeoff(self, flight: ProcedureContext, action: BoundAction) -> BoundAction:
        """NAV_TAKEOFF above the sea. Disarmed it would be acknowledged, and begin whenever somebody arms."""
        if not flight.vehicle.armed:
            raise Ended("refused", f"a takeoff begins armed; {flight.state_text()}")
        if flight.vehicle.modes.takeoff is not None:
            flight.expect_mode(flight.vehicle.modes.takeoff)
        altitude = action.parameters[6] + _home(flight)
        return replace(action, parameters=(*action.parameters[:3], *(math.nan,) * 3, altitude))

    def reposition(self, flight: ProcedureContext, action: BoundAction) -> BoundAction:
        """The altitude is one above the sea whatever the frame."""
        if action.target is None or action.frame not in ABOVE_HOME:
            return action
        altitude = action.target.altitude + _home(flight)
        yaw = action.parameters[3] or math.nan
        parameters = (*action.parameters[:3], yaw, *action.parameters[4:6], altitude)
        return replace(action, parameters=parameters, frame=dialect.MAV_FRAME_GLOBAL_INT)

    def offer_target(self, flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> MavlinkCommand | None:
        """DO_REPOSITION, which enters the mode that takes targets."""
        flight.expect_mode(flight.vehicle.modes.guided)
        return flight.submit(run, self.reposition(flight, reposition_action(action)), in_frame=True)

    def servo(
        self, flight: ProcedureContext, run: ProcedureRun, action: BoundAction
    ) -> Generator[None, None, BoundAction]:
        """DO_SET_ACTUATOR of the actuator for which the output is set up.

        An output is the MAIN one of its number, or AUX from 9 on where there is no such MAIN.
        """
        output, pulse = int(action.parameters[0]), action.parameters[1]
        group, pin = "MAIN", output
        if output > MAIN_OUTPUTS and not (yield from read_parameters(flight, run, (f"PWM_MAIN_FUNC{output}",))):
            group, pin = "AUX", output - MAIN_OUTPUTS
        function, least, most = (f"PWM_{group}_{what}{pin}" for what in ("FUNC", "MIN", "MAX"))
        reversals = f"PWM_{group}_REV"
        wanted = (function, least, most, reversals, *(() if flight.vehicle.armed else (PREARM,)))
        found = yield from read_parameters(flight, run, wanted)
        index = int(found.get(function, 0)) - FIRST_ACTUATOR
        if not 0 <= index < ACTUATORS:
            what = f"{function} is {found[function]:g}" if function in found else f"there is no {function}"
            last = FIRST_ACTUATOR + ACTUATORS - 1
            reason = f"output {output} is no actuator that commands set ({FIRST_ACTUATOR} to {last}): {what}"
            raise Ended("refused", reason)
        if silent := [name for name in (least, most) if name not in found]:
            raise Ended("failed", f"the vehicle does not report {' and '.join(silent)}, the range of output {output}")
        low, high = found[least], found[most]
        if not low <= pulse <= high or low == high:
            raise Ended("refused", f"output {output} takes {low:g} to {high:g} us ({least}, {most}), got {pulse:g}")
        if found.get(PREARM, ALWAYS) not in (WITH_SAFETY_OFF, ALWAYS):
            raise Ended("refused", f"disarmed, PX4 moves outputs only with {PREARM} {ALWAYS}; it is {found[PREARM]:g}")
        value = 2 * (pulse - low) / (high - low) - 1
        values = [math.nan] * ACTUATORS
        values[index] = -value if int(found.get(reversals, 0)) >> (pin - 1) & 1 else value
        one, two, three, four, five, six = values
        return BoundAction(dialect.MAV_CMD_DO_SET_ACTUATOR, (one, two, three, four, five, six, 0.0), retry=action.retry)

    def begin_velocity(
        self, flight: ProcedureContext, run: ProcedureRun, target: LocalTarget
    ) -> Generator[None, None, Callable[[], None]]:
        """Stream it, and enter OFFBOARD once setpoints have been sent; the session ends the stream on purpose."""
        if target.frame == dialect.MAV_FRAME_BODY_OFFSET_NED:
            target = replace(target, frame=dialect.MAV_FRAME_BODY_NED)
        if target.yaw is None and target.yaw_rate is None:
            target = replace(target, yaw_rate=0.0)
        modes = flight.vehicle.modes
        flight.velocity = stream = VelocityStream(target, flight.send_local, PX4_OFFBOARD)
        if flight.vehicle.mode != PX4_OFFBOARD:
            flight.expect_mode(PX4_OFFBOARD)
            while stream.sent < SETPOINTS_BEFORE:
                run.waits_for = "the first setpoints to be sent"
                yield
            try:
                yield from enter(flight, run, mode_action(modes, PX4_OFFBOARD), PX4_OFFBOARD)
            except Ended:
                flight.velocity = None
                raise
        stream.until = flight.now + GUIDED_TIMEOUT
        return lambda: None


def _home(flight: ProcedureContext) -> float:
    """Return the altitude of home above the sea in metres. Raises Ended while it is not known."""
    altitude = flight.altitude_of_home()
    if altitude is None:
        raise Ended("refused", "the vehicle's altitude above home is not known yet")
    return altitude
