"""A velocity that is sent again and again, for an autopilot that flies it only while it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

EVERY = 0.2
"""Mission seconds between two setpoints: PX4 needs two a second, and takes 1 s without any for a loss."""


@dataclass(eq=False)
class VelocityStream:
    """One velocity, from its first setpoint until the vehicle has left the mode that needs them."""

    send: Callable[[], None]
    mode: int
    """The mode (custom_mode) that flies setpoints."""
    until: float = math.inf
    """Mission seconds at which the motion ends."""
    leaving: bool = False
    """Another action or order ends it: the stream lasts until the mode has changed."""
    sent: int = 0
    _next_at: float = -math.inf

    def keep(self, now: float) -> None:
        """Send a setpoint if one is due now (mission seconds)."""
        if now >= self._next_at:
            self._next_at = now + EVERY
            self.sent += 1
            self.send()
