"""The percept of the link: `up` while the vehicle is heard over a transport that carries, `down` otherwise."""

from __future__ import annotations

import math

from bridged.drivers.api import OnReading, Reading
from schemas.wire.terms import Atom

SOURCE = "LINK"
_ATOMS = {True: Atom("up"), False: Atom("down")}


class LinkState:
    """Tells each change once. Pure: the time, in mission seconds, goes in.

    A vehicle that was not heard yet is neither up nor down until it has been silent for the time of a link loss: a
    program need not tell the start of every flight from a loss.
    """

    def __init__(self, on_reading: OnReading) -> None:
        self._on_reading = on_reading
        self._told: bool | None = None
        self._begun = math.inf
        self._carries = True
        self._carries_since = -math.inf

    def carry(self, up: bool, now: float) -> None:
        """The transport (a socket, a device) came up or went down."""
        if up and not self._carries:
            self._carries_since = now
        self._carries = up

    def look(self, connected: bool, heard_at: float, now: float, patience: float) -> None:
        """Tell what has changed: whether the vehicle is heard, and when it was heard last.

        After the transport was down the link is up when the vehicle is heard again, not before.
        """
        self._begun = min(self._begun, now)
        up = self._carries and connected and heard_at >= self._carries_since
        if up is self._told or (not up and self._told is None and now - self._begun <= patience):
            return
        self._told = up
        self._on_reading(Reading(SOURCE, {"state": _ATOMS[up]}))
