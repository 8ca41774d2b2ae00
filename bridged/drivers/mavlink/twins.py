"""Two vehicles with one system id on one link: told by the addresses that the HEARTBEATs come from.

Which of them an answer reaches is chance, so the driver neither arms nor moves them. What brings a vehicle down that
flies already goes to both. A vehicle that reboots may come back from another port, and does not go back to the old one.
"""

from __future__ import annotations

import logging
import math

from bridged.drivers.mavlink.flight import Call
from bridged.drivers.mavlink.modes import ModeTable
from schemas.manifest import ActionEntry

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


WAYS_DOWN = frozenset({"landed", "home", "at_home", "mode", "armed"})
"""Confirmations of actions that can bring a vehicle down, or end its flight."""


def may_lead_down(entry: ActionEntry) -> bool:
    """Whether an action can bring a vehicle down that flies: landing, returning, or a mode or disarming that may."""
    return entry.confirm in WAYS_DOWN


def leads_down(entry: ActionEntry, call: Call, modes: ModeTable) -> bool:
    """Whether it does so with its arguments filled in: it starts no motors and sets no mode but the safe ones."""
    match entry.confirm:
        case "mode":
            return call.parameters[1] in (modes.hold, modes.land, modes.rtl)
        case "armed":
            return call.parameters[0] == 0.0
    return may_lead_down(entry)
