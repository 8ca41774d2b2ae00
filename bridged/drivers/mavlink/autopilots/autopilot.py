"""What procedures need to know of an autopilot: how it is commanded, what it streams, how it numbers and encodes.

Actions, percepts and their meaning are the same for agents whichever autopilot flies: altitudes of targets count from
home, items of a mission from 1, and parameters are numbers. The conventions that procedures are written in are those of
ArduPilot 4.6 and later (ArduCopter, ArduPlane, Rover); another autopilot overrides what it does otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.context import (
    BoundAction,
    LocalTarget,
    ProcedureContext,
    ProcedureRun,
    mode_action,
)
from bridged.drivers.mavlink.vehicle.commands import MavlinkCommand
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable
from bridged.drivers.mavlink.vehicle.readings import BATTERY, RC_INPUT, SERVO_OUTPUTS, WIND_ESTIMATE

OWN_SPEED = -1.0
"""param1 of DO_REPOSITION."""
SETPOINT_EVERY = 0.2
"""Mission seconds between two setpoints: PX4 needs two a second, and takes 1 s without any for a loss."""


@dataclass(eq=False)
class VelocityStream:
    """One velocity, from its first setpoint until the vehicle has left the mode that needs them."""

    target: LocalTarget
    send: Callable[[LocalTarget], None]
    mode: int
    """The mode (custom_mode) that flies setpoints."""
    until: float = math.inf
    """Mission seconds at which the motion ends: from then on the velocity is zero."""
    leaving: bool = False
    """Another action or order ends it: the stream lasts until the mode has changed."""
    sent: int = 0
    _next_at: float = -math.inf

    def keep(self, now: float) -> None:
        """Send a setpoint if one is due now (mission seconds)."""
        if now >= self._next_at:
            self._next_at = now + SETPOINT_EVERY
            self.sent += 1
            still = LocalTarget(self.target.frame, velocity=(0.0, 0.0, 0.0), yaw_rate=0.0)
            self.send(self.target if now < self.until else still)


class Autopilot:
    """One kind of autopilot, ArduPilot, without state: that is the vehicle's. All times are mission seconds."""

    name: ClassVar[str] = "ArduPilot"
    needs: ClassVar[Mapping[str, float]] = {
        "GLOBAL_POSITION_INT": 5.0,
        "SYS_STATUS": 1.0,
        "GPS_RAW_INT": 2.0,
        "EKF_STATUS_REPORT": 2.0,
        "EXTENDED_SYS_STATE": 2.0,
        "POSITION_TARGET_GLOBAL_INT": 2.0,
    }
    """Hz at least of the messages that readiness and the confirmations look at."""
    unrequestable: ClassVar[frozenset[str]] = frozenset()
    """Messages that it sends by itself and that cannot be requested."""
    unasked: ClassVar[tuple[str, ...]] = ()
    """Messages that it streams fast without being asked: stopped where no percept needs them."""
    sources: ClassVar[Mapping[str, str]] = {
        BATTERY: "BATTERY_STATUS",
        RC_INPUT: "RC_CHANNELS",
        SERVO_OUTPUTS: "SERVO_OUTPUT_RAW",
        WIND_ESTIMATE: "WIND",
    }
    """Messages of which readings of the driver's own sources are made."""
    stream_denials: ClassVar[frozenset[int]] = frozenset({dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_UNSUPPORTED})
    """Results (MAV_RESULT) of SET_MESSAGE_INTERVAL that say that it does not have the message."""
    pre_arm: ClassVar[str] = "PreArm: "
    """Prefix of its texts of failed arming checks (AP_Arming::check_failed)."""
    texts_for_stations_only: ClassVar[bool] = False
    """Whether it sends STATUSTEXT only on a link on which it hears the HEARTBEAT of a ground station."""
    typed_parameters: ClassVar[bool] = False
    """Whether a parameter is set only by its own type, and errors are reported (PARAM_ERROR)."""
    outputs_show: ClassVar[bool] = True
    """Whether outputs and parameters show what a gripper and every servo do; otherwise its acknowledgement suffices."""
    local_places: ClassVar[bool] = True
    """Whether it takes SET_POSITION_TARGET_LOCAL_NED with a place in the mode that takes targets."""
    fence_switch: ClassVar[tuple[str, float] | None] = None
    """The parameter that switches the fence, and its value for on; None = DO_FENCE_ENABLE does."""
    lands_by_mission: ClassVar[tuple[str, float] | None] = None
    """The parameter, and its value, by which a plane's way home ends with the landing of its mission."""
    settles: ClassVar[float] = 0.0
    """Metres beside the altitude of a takeoff at which it ends one by itself."""
    home_is_an_item: ClassVar[bool] = True
    """Whether the first item of a stored mission is home, and an item at 0/0 is flown where the vehicle is."""
    repeats_reached: ClassVar[bool] = False
    """Whether it reports an item as reached again and again."""
    judges_missions_later: ClassVar[bool] = False
    """Whether it stores a mission before it judges whether the mission can be flown."""

    incoming: ClassVar[Mapping[str, Callable[[dialect.MAVLink_message], None]]] = {}
    """By message: what brings one of the vehicle into the numbering and encoding that procedures use."""
    outgoing: ClassVar[Mapping[str, Callable[[dialect.MAVLink_message], None]]] = {}
    """By message: what brings one of procedures into the vehicle's numbering and encoding."""

    def station_failsafe(self, modes: ModeTable) -> str:
        """Return the name of the parameter that switches the ground-station failsafe; at 0 it is off."""
        return "FS_GCS_ENABL" if modes.vehicle == "plane" else "FS_GCS_ENABLE"

    def hold(self, modes: ModeTable) -> BoundAction:
        """Return the command of the order `hold`: the vehicle stays where it is, whatever it did.

        A mode of its own: BRAKE, LOITER or HOLD.
        """
        return mode_action(modes, modes.hold)

    def takeoff(self, flight: ProcedureContext, action: BoundAction) -> BoundAction:
        """Return the command of a takeoff to param7 metres above home. Raises Ended where it must not be sent."""
        return action

    def reposition(self, flight: ProcedureContext, action: BoundAction) -> BoundAction:
        """Return the DO_REPOSITION of an action that has a target; the frame of its altitude is honoured."""
        return action

    def offer_target(self, flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> MavlinkCommand | None:
        """Send the target of an action once. Returns the command that carries it; None = a message does.

        SET_POSITION_TARGET_GLOBAL_INT, which a plane ignores in silence: that one takes DO_REPOSITION.
        """
        if flight.vehicle.modes.can_stop and action.target is not None:
            flight.send_target(action.target, action.frame, action.yaw)
            return None
        return flight.submit(run, reposition_action(action), in_frame=True)

    def servo(
        self, flight: ProcedureContext, run: ProcedureRun, action: BoundAction
    ) -> Generator[None, None, BoundAction]:
        """Return the command of a DO_SET_SERVO (param1: output, param2: us). Raises Ended where it has none."""
        return action
        yield

    def begin_velocity(
        self, flight: ProcedureContext, run: ProcedureRun, target: LocalTarget
    ) -> Generator[None, None, Callable[[], None]]:
        """Prepare the vehicle for a velocity that ends `GUIDED_TIMEOUT` s after the last. Raises Ended.

        Returns what sends the velocity once more. GUIDED takes velocities without preparation.
        """
        return lambda: flight.send_local(target)
        yield


def reposition_action(action: BoundAction) -> BoundAction:
    """Return DO_REPOSITION to the target of an action, in its frame and at the vehicle's own speed."""
    if action.target is None:
        raise ValueError("an action without a target")
    yaw = float("nan") if action.yaw is None else action.yaw
    flags = float(dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
    place = (action.target.latitude, action.target.longitude, action.target.altitude)
    return BoundAction(
        dialect.MAV_CMD_DO_REPOSITION,
        (OWN_SPEED, flags, 0.0, yaw, *place),
        retry=action.retry,
        target=action.target,
        frame=action.frame,
        by_int=True,
    )
