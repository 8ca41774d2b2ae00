"""ArduPilot: ArduCopter, ArduPlane and Rover 4.6 and later."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.context import BoundAction, LocalTarget, ProcedureContext, ProcedureRun
from bridged.drivers.mavlink.actions.flight import mode_action
from bridged.drivers.mavlink.autopilots.autopilot import Autopilot
from bridged.drivers.mavlink.vehicle.commands import MavlinkCommand
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable

OWN_SPEED = -1.0
"""param1 of DO_REPOSITION."""


class ArduPilot(Autopilot):
    """The conventions that procedures are written in are ArduPilot's, so little is left to say."""

    name: ClassVar = "ArduPilot"
    needs: ClassVar = {
        "GLOBAL_POSITION_INT": 5.0,
        "SYS_STATUS": 1.0,
        "GPS_RAW_INT": 2.0,
        "EKF_STATUS_REPORT": 2.0,
        "EXTENDED_SYS_STATE": 2.0,
        "POSITION_TARGET_GLOBAL_INT": 2.0,
    }
    stream_denials: ClassVar = frozenset({dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_UNSUPPORTED})
    pre_arm: ClassVar = "PreArm: "
    """AP_Arming::check_failed."""
    texts_for_stations_only: ClassVar = False
    typed_parameters: ClassVar = False
    outputs_show: ClassVar = True
    local_places: ClassVar = True

    def station_failsafe(self, modes: ModeTable) -> str:
        """A plane's parameter is a letter shorter."""
        return "FS_GCS_ENABL" if modes.vehicle == "plane" else "FS_GCS_ENABLE"

    def hold(self, modes: ModeTable) -> BoundAction:
        """A mode of its own: BRAKE, LOITER or HOLD."""
        return mode_action(modes, modes.hold)

    def takeoff(self, flight: ProcedureContext, action: BoundAction) -> BoundAction:
        """As the manifest has it: the altitude counts from home."""
        return action

    def reposition(self, flight: ProcedureContext, action: BoundAction) -> BoundAction:
        """As the manifest has it: the frame of the altitude is honoured."""
        return action

    def offer_target(self, flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> MavlinkCommand | None:
        """SET_POSITION_TARGET_GLOBAL_INT, which a plane ignores in silence: that one takes DO_REPOSITION."""
        if flight.vehicle.modes.can_stop and action.target is not None:
            flight.send_target(action.target, action.frame, action.yaw)
            return None
        return flight.submit(run, reposition_action(action), in_frame=True)

    def begin_velocity(
        self, flight: ProcedureContext, run: ProcedureRun, target: LocalTarget
    ) -> Generator[None, None, Callable[[], None]]:
        """GUIDED takes velocities; the vehicle stops by itself after the last."""
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
