"""Whether a simulated vehicle keeps up with the time: a machine with too much to do shows here first."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

LATE_S = 0.1
"""Wall seconds by which a round of the simulation may come too late: five of its steps at speed 1."""

TELL_EVERY_S = 5.0
"""Wall seconds between two reports."""


@dataclass
class RealtimeMonitor:
    """Counts the rounds that came late, and the time that never happened. It says so now and then, if it has grown."""

    tell: Callable[[str], None]
    rounds: int = 0
    late: int = 0
    worst: float = 0.0
    """Wall seconds by which a round was late at most."""
    lost: float = 0.0
    """Wall seconds that never happened: the vehicle stood still for too long to make up for them."""
    _told: tuple[int, float] = (0, 0.0)
    _told_at: float = -math.inf

    def round(self, late: float, now: float) -> None:
        """A round begins `late` wall seconds after it was due."""
        self.rounds += 1
        if late > LATE_S:
            self.late += 1
            self.worst = max(self.worst, late)
        if now >= self._told_at + TELL_EVERY_S:
            self._told_at = now
            self.report()

    def report(self) -> None:
        """Say what has not been said yet."""
        if (self.late, self.lost) != self._told:
            self._told = self.late, self.lost
            self.tell(
                f"late: {self.late} of {self.rounds} rounds by more than {LATE_S:g} s, at worst by {self.worst:.1f} s; "
                f"{self.lost:.1f} s never happened"
            )
