"""Notices when a vehicle that agents fly leaves the mission's limits, whatever it was told.

Targets are checked before they are sent; a velocity, a mission of others or the wind can still carry a vehicle out.
"""

from __future__ import annotations

from bridged.drivers.mavlink.actions.context import ProcedureContext

MARGIN = 2.0
"""Metres beyond a limit that are no excursion: arriving at the limit itself overshoots a little."""


class LimitWatch:
    """Whether one vehicle is outside the limits of the mission file."""

    def __init__(self, flight: ProcedureContext) -> None:
        self._flight = flight
        self.outside = ""
        """Which limit is broken now, in words; empty = none."""

    def look(self) -> str:
        """Return which limit has just been left, in words; empty if none has, or if others or RTL fly the vehicle."""
        vehicle, modes = self._flight.vehicle, self._flight.vehicle.modes
        before, broken = self.outside, self._broken()
        if broken or not self._broken(0.0):
            self.outside = broken
        steered = vehicle.mode in (modes.guided, modes.auto)
        leaving = self._flight.expects(modes.rtl) or self._flight.expects(modes.land)
        if broken and not before and vehicle.aloft and steered and not leaving:
            return f"the vehicle left the mission's limits: {broken}"
        return ""

    def _broken(self, margin: float = MARGIN) -> str:
        limits, vehicle = self._flight.limits, self._flight.vehicle
        if vehicle.position is None:
            return ""
        if limits.altitude is not None and vehicle.position.altitude > limits.altitude + margin:
            return f"{vehicle.position.altitude:.1f} m above home, the limit is {limits.altitude:g} m"
        if limits.radius is not None and vehicle.home is not None:
            away = vehicle.home.distance(vehicle.position)
            if away > limits.radius + margin:
                return f"{away:.0f} m from home, the limit is {limits.radius:g} m"
        return ""
