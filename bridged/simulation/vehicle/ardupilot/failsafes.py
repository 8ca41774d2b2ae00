"""Failsafes, checked several times a second: pilot input, ground station, position, fence, battery."""

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from bridged.simulation.vehicle.ardupilot.battery import HOME_RADIUS, Shortage
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.notifications import Severity
from bridged.simulation.vehicle.parameters import Parameters

if TYPE_CHECKING:
    from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot


FENCE_ALTITUDE, FENCE_CIRCLE = 1, 2
"""Bits of FENCE_TYPE that are simulated; polygons are not."""


@dataclass(slots=True)
class Fence:
    """Circle around home and ceiling above it, as FENCE_ parameters say; times are vehicle seconds."""

    parameters: Parameters
    breached: str | None = None
    breaches: int = 0
    breached_at: float = 0.0  # vehicle seconds

    @property
    def enabled(self) -> bool:
        """FENCE_ENABLE"""
        return self.parameters["FENCE_ENABLE"] >= 1

    def breach(self, at: Vector, home: Vector) -> str | None:
        """Return the breached parts of the fence, in the vehicle's words; None inside."""
        if not self.enabled:
            return None
        parts = []
        kinds = int(self.parameters["FENCE_TYPE"])
        if kinds & FENCE_ALTITUDE and at.up - home.up > self.parameters["FENCE_ALT_MAX"]:
            parts.append("Max Alt")
        away = math.hypot(at.north - home.north, at.east - home.east)
        if kinds & FENCE_CIRCLE and away > self.parameters["FENCE_RADIUS"]:
            parts.append("Circle")
        return ", ".join(parts) or None

    def notice(self, breach: str | None, now: float) -> bool:
        """Note the present breach, at vehicle seconds; returns True when it is new."""
        new = breach is not None and self.breached is None
        if new:
            self.breaches, self.breached_at = self.breaches + 1, now
        self.breached = breach
        return new


class StationLink(Enum):
    """A change of the link to the ground station."""

    LOST = "GCS Failsafe"
    FOUND = "GCS Failsafe Cleared"


@dataclass(slots=True)
class StationWatch:
    """GCS failsafe: HEARTBEATs of system MAV_GCS_SYSID must not stop while it is enabled and armed."""

    parameters: Parameters
    switch: str
    """The parameter that enables it ..."""
    timeout: str
    """... and the one of the seconds of silence, ..."""
    extra: float
    """... to which these seconds are added."""
    heard_at: float | None = None
    lost: bool = False

    def heartbeat(self, sysid: int, now: float) -> None:
        """Note a HEARTBEAT of `sysid` (1..255) at `now`, in vehicle seconds."""
        if sysid == int(self.parameters["MAV_GCS_SYSID"]):
            self.heard_at = now

    def missing(self, now: float) -> bool:
        """Return whether the failsafe acts and nothing is heard yet."""
        return self.lost and self._silent(now)

    def _silent(self, now: float) -> bool:
        limit = max(2.0, self.parameters[self.timeout]) + self.extra
        return self.heard_at is not None and now - self.heard_at >= limit

    def check(self, now: float, *, armed: bool) -> StationLink | None:
        """Return the change of the link since the last call; `now`: vehicle seconds."""
        if self.heard_at is None:
            return None
        silent = self._silent(now)
        if not self.lost and silent and armed and self.parameters[self.switch] > 0:
            self.lost = True
            return StationLink.LOST
        if self.lost and not silent:
            self.lost = False
            return StationLink.FOUND
        return None


PREARM_REPORTED_EVERY = 30.0
"""Vehicle seconds (ArduPilot: PREARM_DISPLAY_PERIOD)."""
_TERMINATE = 5
"""Value of BATT_FS_LOW_ACT and BATT_FS_CRT_ACT: motors off."""


def check_failsafes(ardupilot: "ArduPilot", dt: float) -> None:
    """Check all failsafes; the last check was `dt` vehicle seconds ago."""
    _pilot(ardupilot)
    change = ardupilot.station.check(ardupilot.now, armed=ardupilot.armed)
    if change is not None:
        ardupilot.on_station(change)
    _position(ardupilot)
    _fence(ardupilot)
    _battery(ardupilot, dt)
    if ardupilot.hindrance and not ardupilot.armed and ardupilot.now % PREARM_REPORTED_EVERY < dt:
        ardupilot.send_text(f"PreArm: {ardupilot.hindrance}", Severity.CRITICAL)
    text = ardupilot.outputs.step(ardupilot.now)
    if text is not None:
        ardupilot.send_text(text)


def _pilot(ardupilot: "ArduPilot") -> None:
    pilot = ardupilot.transmitter
    if not pilot.touched:
        return
    wanted = pilot.switched_mode(ardupilot.now)
    if wanted is not None and ardupilot.passed(Milestone.MODE_SWITCH):
        ardupilot.set_mode(wanted)
    if ardupilot.mode.piloted and ardupilot.flight.airborne:
        drift = pilot.drift(ardupilot.motion, ardupilot.now)
        if drift is not None:
            ardupilot.flight.begin(drift)


def _position(ardupilot: "ArduPilot") -> None:
    estimate = ardupilot.estimate
    (glitched, failed), now = estimate.reported, (estimate.glitching, estimate.failed and ardupilot.armed)
    estimate.reported = now
    if glitched != now[0]:
        ardupilot.send_text("GPS Glitch or Compass error" if now[0] else "Glitch cleared", Severity.CRITICAL)
    if failed and not now[1]:
        ardupilot.send_text("EKF Failsafe Cleared", Severity.CRITICAL)
    elif now[1] and not failed:
        ardupilot.send_text("EKF variance: over thresholds", Severity.CRITICAL)
        ardupilot.on_position_lost()


def _fence(ardupilot: "ArduPilot") -> None:
    fence = ardupilot.fence
    breach = fence.breach(ardupilot.motion.position, ardupilot.home_on_chart) if ardupilot.flight.airborne else None
    if not fence.notice(breach, ardupilot.now):
        return
    ardupilot.send_text(f"{breach} fence breached", Severity.WARNING)
    ardupilot.on_fence(int(ardupilot.parameters["FENCE_ACTION"]))


def _battery(ardupilot: "ArduPilot", dt: float) -> None:
    battery, flight = ardupilot.battery, ardupilot.flight
    if not ardupilot.armed and not flight.airborne and ardupilot.home is not None:
        away = ardupilot.motion.position.distance(ardupilot.home_on_chart)
        battery.rest(dt, at_home=away <= HOME_RADIUS)
    shortage = battery.check(ardupilot.now)
    if shortage is None:
        return
    name = shortage.name.lower()
    ardupilot.send_text(f"Battery 1 is {name} {battery.voltage:.2f}V used {battery.used:.0f} mAh", Severity.WARNING)
    action = int(ardupilot.parameters["BATT_FS_LOW_ACT" if shortage is Shortage.LOW else "BATT_FS_CRT_ACT"])
    if not ardupilot.armed or action == 0:
        return
    ardupilot.send_text("Battery Failsafe", Severity.WARNING)
    if not flight.airborne or action == _TERMINATE:
        ardupilot.disarm(force=True)
    else:
        ardupilot.on_shortage(action)
