"""What watches over a flight: the fence, and the link to the ground station."""

import math
from dataclasses import dataclass
from enum import Enum

from bridged.simulation.copter.dynamics import Vector
from bridged.simulation.copter.protocol.parameters import Parameters

FENCE_ALTITUDE, FENCE_CIRCLE = 1, 2
"""Bits of FENCE_TYPE that are simulated; polygons are not."""


@dataclass(slots=True)
class Fence:
    """Circle around home and ceiling above it, as FENCE_ parameters say."""

    parameters: Parameters
    breached: str | None = None
    breaches: int = 0
    breached_at: float = 0.0  # vehicle seconds

    @property
    def enabled(self) -> bool:
        """FENCE_ENABLE"""
        return self.parameters["FENCE_ENABLE"] >= 1

    def breach(self, at: Vector, home: Vector) -> str | None:
        """Which part of the fence a place is outside of, in the vehicle's words."""
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
        """Takes in whether the copter is outside; True at the moment when it gets there."""
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
    """GCS failsafe: HEARTBEATs of system MAV_GCS_SYSID must not stop while FS_GCS_ENABLE is set and the motors turn."""

    parameters: Parameters
    heard_at: float | None = None
    lost: bool = False

    def heartbeat(self, sysid: int, now: float) -> None:
        """A HEARTBEAT came in."""
        if sysid == int(self.parameters["MAV_GCS_SYSID"]):
            self.heard_at = now

    def check(self, now: float, *, armed: bool) -> StationLink | None:
        """What changed since the last call."""
        if self.heard_at is None:
            return None
        silent = now - self.heard_at >= max(2.0, self.parameters["FS_GCS_TIMEOUT"])
        if not self.lost and silent and armed and self.parameters["FS_GCS_ENABLE"] > 0:
            self.lost = True
            return StationLink.LOST
        if self.lost and not silent:
            self.lost = False
            return StationLink.FOUND
        return None
