"""The boot sequence of a vehicle: milestones, their times and status texts."""

from dataclasses import dataclass, field
from enum import Enum, auto

from bridged.simulation.vehicle.autopilot import BootKind
from bridged.simulation.vehicle.notifications import Severity

FIRST_HEARTBEAT_S = 1.02
"""Seconds after power on; every time below counts from here."""


class Milestone(Enum):
    """Milestones of an autopilot's start."""

    BAROMETER = auto()
    READY = auto()  # the arming checks run
    MODE_SWITCH = auto()  # the pilot's mode switch is read: STABILIZE, whatever was set before
    AUX_SWITCH = auto()
    EKF_STARTED = auto()
    EKF_TILT = auto()
    EKF_YAW = auto()
    GPS_PROBE = auto()
    GPS_FIX = auto()
    ACCELS_AGREE = auto()
    HOME = auto()
    GYROS_AGREE = auto()
    PREARM_GOOD = auto()  # the pre-arm bit of SYS_STATUS
    POSITION = auto()  # the EKF uses GPS: GUIDED can be armed


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a boot sequence: what it is, when it comes (seconds), and its status texts."""

    milestone: Milestone | None
    """None: only texts."""
    real: float
    quick: float
    texts: tuple[str, ...] = ()
    severity: Severity = Severity.INFO


Script = tuple[Step, ...]
"""A boot sequence, in the order of time."""

_BAROMETERS = ("Barometer 1 calibration complete", "Barometer 2 calibration complete")
_GPS = ("GPS 1: probing for u-blox at 230400 baud", "GPS 1: detected u-blox")


def _both(text: str) -> tuple[str, str]:
    """Return a text for both of the estimators of a kind; `#` is its number."""
    return text.replace("#", "0"), text.replace("#", "1")


COPTER: Script = (
    Step(Milestone.BAROMETER, 0.90, 0.1, _BAROMETERS),
    Step(Milestone.READY, 1.436, 0.2, ("ArduPilot Ready", "AHRS: DCM active")),
    Step(Milestone.MODE_SWITCH, 1.63, 0.3),
    Step(Milestone.AUX_SWITCH, 1.733, 0.3, ("RC7: SaveWaypoint LOW",)),
    Step(Milestone.EKF_STARTED, 3.436, 0.5, (*_both("EKF3 IMU# initialised"), "AHRS: EKF3 active")),
    Step(Milestone.EKF_TILT, 4.784, 0.6, _both("EKF3 IMU# tilt alignment complete")),
    Step(Milestone.EKF_YAW, 4.883, 0.7, _both("EKF3 IMU# MAG0 initial yaw alignment complete")),
    Step(Milestone.GPS_PROBE, 8.789, 0.8, _GPS[:1]),
    Step(Milestone.GPS_FIX, 8.813, 0.9, _GPS[1:]),
    Step(Milestone.ACCELS_AGREE, 14.0, 1.0),
    Step(
        Milestone.HOME,
        19.006,
        1.4,
        ("EKF3 IMU0 origin set", "Field Elevation Set: {elevation:.0f}m", "EKF3 IMU1 origin set"),
    ),
    Step(Milestone.GYROS_AGREE, 22.9, 1.8),
    Step(Milestone.PREARM_GOOD, 23.0, 1.9),
    Step(Milestone.POSITION, 40.602, 2.6, _both("EKF3 IMU# is using GPS")),
)
"""An ArduCopter, recorded."""

PLANE: Script = (
    Step(Milestone.BAROMETER, 0.68, 0.1),
    Step(Milestone.READY, 0.686, 0.2, (*_BAROMETERS, "Airspeed 1 calibration started", "ArduPilot Ready")),
    Step(Milestone.MODE_SWITCH, 0.69, 0.21, ("AHRS: DCM active",)),
    Step(Milestone.AUX_SWITCH, 0.71, 0.22, ("Throttle failsafe off",), Severity.WARNING),
    Step(None, 2.38, 0.3, ("Airspeed 1 calibrated",)),
    Step(Milestone.GPS_PROBE, 8.03, 0.4, _GPS),
    Step(None, 8.48, 0.5, _both("EKF2 IMU# MAG0 initial yaw alignment complete")),
    Step(Milestone.GPS_FIX, 8.7, 0.6),
    Step(Milestone.HOME, 9.07, 0.7),
    Step(Milestone.EKF_STARTED, 9.23, 0.8, _both("EKF3 IMU# initialised")),
    Step(Milestone.EKF_TILT, 11.11, 0.9, _both("EKF3 IMU# tilt alignment complete")),
    Step(Milestone.EKF_YAW, 11.2, 1.0, _both("EKF3 IMU# MAG0 initial yaw alignment complete")),
    Step(None, 13.7, 1.1, _both("EKF2 IMU# tilt alignment complete")),
    Step(None, 18.45, 1.2, (*_both("EKF2 IMU# origin set"), *_both("EKF3 IMU# origin set"))),
    Step(Milestone.ACCELS_AGREE, 18.48, 1.3, ("Field Elevation Set: {elevation:.0f}m",)),
    Step(Milestone.GYROS_AGREE, 19.4, 1.4),
    Step(Milestone.POSITION, 19.45, 1.5, (*_both("EKF3 IMU# is using GPS"), "AHRS: EKF3 active")),
    Step(Milestone.PREARM_GOOD, 21.6, 1.9),
    Step(None, 42.4, 20.0, _both("EKF2 IMU# is using GPS")),
)
"""An ArduPlane, recorded."""

ROVER: Script = (
    Step(Milestone.BAROMETER, 0.9, 0.1, (*_BAROMETERS, "Beginning INS calibration. Do not move vehicle")),
    Step(None, 1.439, 0.18, ("INS: alloc 6144 bytes for ISB (free=524288)",), Severity.DEBUG),
    Step(Milestone.READY, 1.44, 0.2, ("ArduPilot Ready",)),
    Step(None, 1.44, 0.21, ("RCInput: decoding UDP (Pulses)",), Severity.DEBUG),
    Step(Milestone.MODE_SWITCH, 1.44, 0.22, ("AHRS: DCM active",)),
    Step(Milestone.AUX_SWITCH, 1.5, 0.3),
    Step(Milestone.EKF_STARTED, 3.46, 0.5, _both("EKF3 IMU# initialised")),
    Step(Milestone.EKF_TILT, 5.07, 0.6, _both("EKF3 IMU# tilt alignment complete")),
    Step(Milestone.EKF_YAW, 5.14, 0.7, _both("EKF3 IMU# MAG0 initial yaw alignment complete")),
    Step(Milestone.GPS_PROBE, 8.75, 0.8, _GPS),
    Step(Milestone.GPS_FIX, 8.77, 0.9),
    Step(Milestone.HOME, 9.44, 1.0),
    Step(None, 18.95, 1.2, _both("EKF3 IMU# origin set")),
    Step(Milestone.ACCELS_AGREE, 19.03, 1.3, ("Field Elevation Set: {elevation:.0f}m",)),
    Step(Milestone.GYROS_AGREE, 23.0, 1.8),
    Step(Milestone.PREARM_GOOD, 23.1, 1.9),
    Step(Milestone.POSITION, 41.17, 2.6, (*_both("EKF3 IMU# is using GPS"), "AHRS: EKF3 active")),
)
"""A Rover, recorded."""

_EKF_UNINITIALISED = 1024
_EKF_ALIGNED = 167  # attitude, velocities, vertical position, constant position mode
_EKF_GLITCHING = 32768
_EKF_POSITION = 831  # everything: attitude, velocities, positions relative and absolute, predictions


@dataclass(slots=True)
class Boot:
    """The start of one vehicle."""

    kind: BootKind
    elevation: float
    script: Script = COPTER
    _next: int = 0
    _times: dict[Milestone, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._times = {step.milestone: self._time(step) for step in self.script if step.milestone is not None}

    def _time(self, step: Step) -> float:
        return step.quick if self.kind == "quick" else step.real

    def passed(self, milestone: Milestone, now: float) -> bool:
        """Return whether the milestone was passed `now` seconds after power on."""
        return now - FIRST_HEARTBEAT_S >= self._times[milestone]

    @property
    def complete(self) -> bool:
        """Whether the last step was reached."""
        return self._next == len(self.script)

    def advance(self, now: float) -> list[tuple[Milestone | None, list[tuple[str, Severity]]]]:
        """Return the steps passed since the last call: their milestones and status texts."""
        reached: list[tuple[Milestone | None, list[tuple[str, Severity]]]] = []
        while not self.complete and now - FIRST_HEARTBEAT_S >= self._time(self.script[self._next]):
            step = self.script[self._next]
            self._next += 1
            texts = [(text.format(elevation=self.elevation), step.severity) for text in step.texts]
            reached.append((step.milestone, texts))
        return reached

    def ekf_flags(self, now: float, *, lost: bool = False, glitching: bool = False) -> int:
        """Return EKF_STATUS_REPORT.flags `now` seconds after power on; `lost`: GPS is, and the position with it."""
        if self.passed(Milestone.POSITION, now) and not lost:
            return _EKF_POSITION | (_EKF_GLITCHING if glitching else 0)
        if self.passed(Milestone.EKF_YAW, now):
            return _EKF_ALIGNED
        return 0 if self.passed(Milestone.EKF_STARTED, now) else _EKF_UNINITIALISED
