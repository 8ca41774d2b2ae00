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


def check_failsafes(copter: "ArduPilot", dt: float) -> None:
    """Check all failsafes; the last check was `dt` vehicle seconds ago."""
    _pilot(copter)
    _station(copter)
    _position(copter)
    _fence(copter)
    _battery(copter, dt)
    if copter.hindrance and not copter.armed and copter.now % PREARM_REPORTED_EVERY < dt:
        copter.send_text(f"PreArm: {copter.hindrance}", Severity.CRITICAL)
    text = copter.outputs.step(copter.now)
    if text is not None:
        copter.send_text(text)


def _pilot(copter: "ArduPilot") -> None:
    pilot = copter.transmitter
    if not pilot.touched:
        return
    wanted = pilot.switched_mode(copter.now)
    if wanted is not None and copter.passed(Milestone.MODE_SWITCH):
        copter.set_mode(wanted)
    if copter.mode.piloted and copter.flight.airborne:
        drift = pilot.drift(copter.motion, copter.now)
        if drift is not None:
            copter.flight.begin(drift)


def _station(copter: "ArduPilot") -> None:
    change = copter.station.check(copter.now, armed=copter.armed)
    if change is not None:
        copter.on_station(change)


def _position(copter: "ArduPilot") -> None:
    estimate = copter.estimate
    (glitched, failed), now = estimate.reported, (estimate.glitching, estimate.failed and copter.armed)
    estimate.reported = now
    if glitched != now[0]:
        copter.send_text("GPS Glitch or Compass error" if now[0] else "Glitch cleared", Severity.CRITICAL)
    if failed and not now[1]:
        copter.send_text("EKF Failsafe Cleared", Severity.CRITICAL)
    elif now[1] and not failed:
        copter.send_text("EKF variance: over thresholds", Severity.CRITICAL)
        copter.on_position_lost()


def _fence(copter: "ArduPilot") -> None:
    fence = copter.fence
    breach = fence.breach(copter.motion.position, copter.home_on_chart) if copter.flight.airborne else None
    if not fence.notice(breach, copter.now):
        return
    copter.send_text(f"{breach} fence breached", Severity.WARNING)
    copter.on_fence(int(copter.parameters["FENCE_ACTION"]))


def _battery(copter: "ArduPilot", dt: float) -> None:
    battery, flight = copter.battery, copter.flight
    if not copter.armed and not flight.airborne and copter.home is not None:
        away = copter.motion.position.distance(copter.home_on_chart)
        battery.rest(dt, at_home=away <= HOME_RADIUS)
    shortage = battery.check(copter.now)
    if shortage is None:
        return
    name = shortage.name.lower()
    copter.send_text(f"Battery 1 is {name} {battery.voltage:.2f}V used {battery.used:.0f} mAh", Severity.WARNING)
    action = int(copter.parameters["BATT_FS_LOW_ACT" if shortage is Shortage.LOW else "BATT_FS_CRT_ACT"])
    if not copter.armed or action == 0:
        return
    copter.send_text("Battery Failsafe", Severity.WARNING)
    if not flight.airborne or action == _TERMINATE:
        copter.disarm(force=True)
    else:
        copter.on_shortage(action)
