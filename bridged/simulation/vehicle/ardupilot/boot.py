"""The boot sequence of a vehicle: milestones, their times and status texts."""

from dataclasses import dataclass
from enum import Enum

from bridged.simulation.vehicle.autopilot import BootKind

FIRST_HEARTBEAT_S = 1.02
"""Seconds after power on; every time below counts from here."""


class Milestone(Enum):
    """Milestones of an autopilot's start: recorded time and time of a quick start, in seconds."""

    BAROMETER = (0.90, 0.1)
    READY = (1.436, 0.2)  # the arming checks run
    MODE_SWITCH = (1.63, 0.3)  # the pilot's mode switch is read: STABILIZE, whatever was set before
    AUX_SWITCH = (1.733, 0.3)
    EKF_STARTED = (3.436, 0.5)
    EKF_TILT = (4.784, 0.6)
    EKF_YAW = (4.883, 0.7)
    GPS_PROBE = (8.789, 0.8)
    GPS_FIX = (8.813, 0.9)
    ACCELS_AGREE = (14.0, 1.0)
    HOME = (19.006, 1.4)
    GYROS_AGREE = (22.9, 1.8)
    PREARM_GOOD = (23.0, 1.9)  # the pre-arm bit of SYS_STATUS
    POSITION = (40.602, 2.6)  # the EKF uses GPS: GUIDED can be armed


_TEXTS: dict[Milestone, tuple[str, ...]] = {
    Milestone.BAROMETER: ("Barometer 1 calibration complete", "Barometer 2 calibration complete"),
    Milestone.READY: ("ArduPilot Ready", "AHRS: DCM active"),
    Milestone.AUX_SWITCH: ("RC7: SaveWaypoint LOW",),
    Milestone.EKF_STARTED: ("EKF3 IMU0 initialised", "EKF3 IMU1 initialised", "AHRS: EKF3 active"),
    Milestone.EKF_TILT: ("EKF3 IMU0 tilt alignment complete", "EKF3 IMU1 tilt alignment complete"),
    Milestone.EKF_YAW: (
        "EKF3 IMU0 MAG0 initial yaw alignment complete",
        "EKF3 IMU1 MAG0 initial yaw alignment complete",
    ),
    Milestone.GPS_PROBE: ("GPS 1: probing for u-blox at 230400 baud",),
    Milestone.GPS_FIX: ("GPS 1: detected u-blox",),
    Milestone.HOME: ("EKF3 IMU0 origin set", "Field Elevation Set: {elevation:.0f}m", "EKF3 IMU1 origin set"),
    Milestone.POSITION: ("EKF3 IMU0 is using GPS", "EKF3 IMU1 is using GPS"),
}

_EKF_UNINITIALISED = 1024
_EKF_ALIGNED = 167  # attitude, velocities, vertical position, constant position mode
_EKF_GLITCHING = 32768
_EKF_POSITION = 831  # everything: attitude, velocities, positions relative and absolute, predictions


@dataclass(slots=True)
class Boot:
    """The start of one vehicle."""

    kind: BootKind
    elevation: float
    _next: int = 0

    def passed(self, milestone: Milestone, now: float) -> bool:
        """Return whether the milestone was passed `now` seconds after power on."""
        return now - FIRST_HEARTBEAT_S >= milestone.value[self.kind == "quick"]

    @property
    def complete(self) -> bool:
        """Whether the last milestone was reached."""
        return self._next == len(_ORDER)

    def advance(self, now: float) -> list[tuple[Milestone, tuple[str, ...]]]:
        """Return the milestones passed since the last call, each with the vehicle's status texts."""
        reached = []
        while not self.complete and self.passed(_ORDER[self._next], now):
            milestone = _ORDER[self._next]
            self._next += 1
            texts = tuple(text.format(elevation=self.elevation) for text in _TEXTS.get(milestone, ()))
            reached.append((milestone, texts))
        return reached

    def ekf_flags(self, now: float, *, lost: bool = False, glitching: bool = False) -> int:
        """Return EKF_STATUS_REPORT.flags `now` seconds after power on; `lost`: GPS is, and the position with it."""
        if self.passed(Milestone.POSITION, now) and not lost:
            return _EKF_POSITION | (_EKF_GLITCHING if glitching else 0)
        if self.passed(Milestone.EKF_YAW, now):
            return _EKF_ALIGNED
        return 0 if self.passed(Milestone.EKF_STARTED, now) else _EKF_UNINITIALISED


_ORDER = tuple(Milestone)
