"""Whom a simulated PX4 hears, and for how long it has not: ground stations, and a companion."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

HEARTBEAT_TIMEOUT_S = 2.25
"""Seconds after the last HEARTBEAT of a kind at which its sender counts as silent (recorded: 2.1 to 2.6)."""
COMPANION_S = 4.8
"""Seconds of that after which the companion is lost."""


@dataclass(slots=True)
class Links:
    """HEARTBEATs of ground stations and of a companion, on any link; times in vehicle seconds."""

    station_at: float | None = None
    companion_at: float | None = None
    station_lost: bool = False
    companion_lost: bool = False

    def heard(self, message: dialect.MAVLink_message, system: int, now: float) -> None:
        """Take note of a HEARTBEAT; `system` is the vehicle's own id."""
        if message.type == dialect.MAV_TYPE_GCS:
            self.station_at = now
        elif message.type == dialect.MAV_TYPE_ONBOARD_CONTROLLER and message.get_srcSystem() == system:
            self.companion_at = now

    def station_present(self, now: float) -> bool:
        """Return whether a ground station is heard."""
        return self.station_at is not None and now - self.station_at <= HEARTBEAT_TIMEOUT_S

    def station_silent(self, now: float, limit: float) -> bool:
        """Return whether a ground station that was heard has been silent for longer than `limit` seconds."""
        return self.station_at is not None and now - self.station_at > HEARTBEAT_TIMEOUT_S + limit

    def companion_silent(self, now: float) -> bool:
        """Return whether a companion that was heard has been silent for too long."""
        return self.companion_at is not None and now - self.companion_at > HEARTBEAT_TIMEOUT_S + COMPANION_S
