"""Two vehicles with one system id on one link: told by the addresses that the HEARTBEATs come from.

Each is answered where it was heard last, so with two of them orders reach now one and now the other: the driver arms
neither. A vehicle that reboots may come back from another port, and does not go back to the old one.
"""

from __future__ import annotations

import logging
import math

BACK_WITHIN = 5.0
"""Wall seconds within which an address that was left speaks again if there are two vehicles, of 1 Hz each."""
MAX_ADDRESSES = 8
"""Addresses that are remembered; the one silent longest goes first."""
log = logging.getLogger("mavlink")


class Twins:
    """Where one system's HEARTBEATs come from."""

    def __init__(self, system: int) -> None:
        self._system = system
        self._heard_at: dict[str, float] = {}
        self._last = ""
        self._said = ""
        self._until = -math.inf

    def heard(self, address: str, wall: float) -> None:
        """Take in that a HEARTBEAT came from an address."""
        came_back = address != self._last and wall - self._heard_at.get(address, -math.inf) < BACK_WITHIN
        if came_back:
            if not self.notes(wall):
                both = " and ".join(sorted((address, self._last)))
                self._said = f"two vehicles are system {self._system}, at {both}: give each its own MAV_SYSID"
                log.warning("%s", self._said)
            self._until = wall + BACK_WITHIN
        self._last = address
        self._heard_at.pop(address, None)
        self._heard_at[address] = wall
        if len(self._heard_at) > MAX_ADDRESSES:
            del self._heard_at[next(iter(self._heard_at))]

    def notes(self, wall: float) -> list[str]:
        """The warning, while both speak."""
        return [self._said] if wall < self._until else []
