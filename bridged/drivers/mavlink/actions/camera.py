"""Cameras: pictures, video, mode and zoom, confirmed by what the camera reports.

A camera is a component of the vehicle's system (MAVLink's camera protocol, version 2), or is attached to the autopilot,
which then answers for it, and may only report that it has triggered.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.confirmation import Poll, acknowledged, asked_message, comes_true
from bridged.drivers.mavlink.actions.context import SUCCEEDED, BoundAction, Ended, ProcedureContext, ProcedureRun, Steps
from bridged.drivers.mavlink.actions.outputs import shown
from bridged.drivers.mavlink.vehicle.commands import Parameters
from bridged.drivers.mavlink.vehicle.state import ATTACHED, CAMERAS

APPEARS_WITHIN = (2.5, 1.5)
"""Mission and wall seconds after the vehicle in which a camera or gimbal is heard, if there is one."""
COUNTS_WITHIN = (1.5, 1.0)
"""Mission and wall seconds in which a camera that counts its pictures answers a request for the count."""
TAKES_WITHIN = (10.0, 5.0)
"""Mission and wall seconds in which a picture must be reported: exposure and storage take seconds."""
_SHOOT: Parameters = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
"""Parameters of DO_DIGICAM_CONTROL that trigger: for autopilots that refuse or ignore IMAGE_START_CAPTURE."""
_ZOOM_RANGE, _ZOOM_NEAR = 2.0, 1.0
"""SET_CAMERA_ZOOM in percent of the range, and percent within which it is there."""


@dataclass(frozen=True)
class _Proof:
    """What shows the effect of a command to a camera."""

    camera: int
    """The parameter, from 1, that names the camera."""
    message: str
    shows: str
    """For people, with the parameters of the command from 0 as `{0}`."""
    fits: Callable[[dialect.MAVLink_message, Parameters], bool]


PROOFS: Mapping[int, _Proof] = {
    dialect.MAV_CMD_VIDEO_START_CAPTURE: _Proof(
        3, "CAMERA_CAPTURE_STATUS", "a video that is recorded", lambda m, _: m.video_status != 0
    ),
    dialect.MAV_CMD_VIDEO_STOP_CAPTURE: _Proof(
        2, "CAMERA_CAPTURE_STATUS", "that no video is recorded", lambda m, _: m.video_status == 0
    ),
    dialect.MAV_CMD_SET_CAMERA_MODE: _Proof(
        1, "CAMERA_SETTINGS", "the mode {1:g}", lambda m, parameters: m.mode_id == parameters[1]
    ),
    dialect.MAV_CMD_SET_CAMERA_ZOOM: _Proof(
        3, "CAMERA_SETTINGS", "{1:g} % of zoom", lambda m, parameters: abs(m.zoomLevel - parameters[1]) <= _ZOOM_NEAR
    ),
}
"""By command."""


def set_camera(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """Video, mode or zoom: the camera's own message shows it."""
    proof, parameters = PROOFS[action.number], action.parameters
    if action.number == dialect.MAV_CMD_SET_CAMERA_ZOOM and parameters[0] != _ZOOM_RANGE:
        return Outcome("refused", "a zoom in percent of the range (param1 = 2) is confirmed by the camera, no other")
    camera = yield from find_camera(flight, run, int(parameters[proof.camera - 1]))
    what = proof.shows.format(*parameters)
    action = replace(action, component=camera)
    return (yield from shown(flight, run, action, proof.message, what, lambda m: proof.fits(m, parameters)))


def take_picture(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """IMAGE_START_CAPTURE of one picture: the camera reports a new one, or the autopilot that it has triggered."""
    if action.parameters[2] != 1.0:
        return Outcome("refused", f"one picture (param3 = 1) is confirmed, got {action.parameters[2]:g}")
    asked, camera = flight.now, (yield from find_camera(flight, run, int(action.parameters[0])))
    pictures = _Pictures(flight, run, camera)
    yield from pictures.count()
    which, interval, one, _, *spare = action.parameters
    parameters = (which, interval, one, pictures.next_number(), spare[0], spare[1], spare[2])
    action = replace(action, component=camera, parameters=parameters)
    command = flight.submit(run, action, lambda: not pictures.taken)
    try:
        yield from acknowledged(flight, run, command, pictures)
    except Ended:
        if camera or not (command.silent or command.result == dialect.MAV_RESULT_UNSUPPORTED):
            raise
        trigger = replace(action, number=dialect.MAV_CMD_DO_DIGICAM_CONTROL, parameters=_SHOOT)
        command = flight.submit(run, trigger, lambda: False)
        yield from acknowledged(flight, run, command, pictures)
    run.waits_for = "the camera to report the picture"
    if (yield from comes_true(flight, TAKES_WITHIN, pictures)):
        return SUCCEEDED
    reason = f"{command.name} was acknowledged, but no picture is reported ({', '.join(pictures.reported_by)})"
    return Outcome("failed", flight.with_texts(reason, asked))


def find_camera(flight: ProcedureContext, run: ProcedureRun, wanted: int) -> Generator[None, None, int]:
    """Return the component of a camera; 0 = the autopilot, for those that are attached to it. Raises Ended.

    `wanted`: a component, one of 1 to 6 that are attached, or 0: the first that is heard, or else an attached one.
    """
    run.waits_for = "the HEARTBEAT of a camera"
    while not (there := flight.present(CAMERAS)):
        if flight.now > flight.connected_since + flight.wait(*APPEARS_WITHIN):
            break
        yield
    if wanted in ATTACHED or (wanted == 0 and not there):
        return 0
    if wanted == 0:
        return there[0]
    if wanted not in there:
        heard = ", ".join(map(str, there)) or "none"
        raise Ended("refused", f"no camera is heard as component {wanted} of the vehicle; heard: {heard}")
    return wanted


class _Pictures:
    """Whether a camera has reported a picture that is newer than its count before."""

    def __init__(self, flight: ProcedureContext, run: ProcedureRun, camera: int) -> None:
        self.taken = False
        self._flight, self._run, self._camera = flight, run, camera
        self._poll = Poll(flight, run, "CAMERA_CAPTURE_STATUS", component=camera)
        self._before: int | None = None

    @property
    def reported_by(self) -> tuple[str, ...]:
        """The messages that may report it."""
        own = ("CAMERA_IMAGE_CAPTURED", "CAMERA_CAPTURE_STATUS")
        return own if self._camera else (*own, "CAMERA_FEEDBACK", "CAMERA_TRIGGER")

    def next_number(self) -> float:
        """Return the number by which the camera knows a repetition of the command: no two commands share one."""
        self._flight.pictures = max(self._flight.pictures, self._before or 0) + 1
        return float(self._flight.pictures)

    def count(self) -> Generator[None, None, None]:
        """Ask how many pictures there are; some cameras do not count."""
        self._run.waits_for = "the camera's count of its pictures"
        status = yield from asked_message(
            self._flight, self._run, "CAMERA_CAPTURE_STATUS", COUNTS_WITHIN, self._is_of_it, self._camera
        )
        self._before = None if status is None else status.image_count

    def __call__(self) -> bool:
        """Look at the present message. Raises Ended if the camera reports a failure."""
        if self._before is not None:
            self._poll()
        message = self._flight.message
        if message is not None and message.get_type() in self.reported_by and self._is_of_it(message):
            self.taken = self.taken or self._reports_one(message)
        return self.taken

    def _is_of_it(self, message: dialect.MAVLink_message) -> bool:
        return bool(message.get_srcComponent() == (self._camera or self._flight.autopilot_component))

    def _reports_one(self, message: dialect.MAVLink_message) -> bool:
        match message.get_type():
            case "CAMERA_CAPTURE_STATUS":
                return self._before is not None and bool(message.image_count > self._before)
            case "CAMERA_IMAGE_CAPTURED" if self._before is None or message.image_index >= self._before:
                if message.capture_result == 0:
                    raise Ended("failed", "the camera reports that it could not take the picture")
                return True
            case "CAMERA_FEEDBACK" | "CAMERA_TRIGGER":
                return True
        return False
