"""How far a mind is behind what came for it, judged from time to time by its cycles: each takes one event, one message.

What waits now has been taken when so many cycles have gone by. That costs the cycles themselves nothing.
"""

from __future__ import annotations


class LagEstimator:
    """Follows what waited at one look until it has been taken, then what waits at that moment."""

    def __init__(self) -> None:
        self._until: int | None = None
        """The cycle by which what waited at the last look has been taken; None: nothing waited."""
        self._since = 0.0

    def lag(self, cycle: int, waiting: int, now: float) -> float:
        """Return for how many seconds what was there has waited by now; 0 if it is taken.

        `cycle` is the last one, `waiting` how many events and messages are there.
        """
        if self._until is not None and cycle < self._until and waiting:
            return now - self._since
        self._until = cycle + waiting if waiting else None
        self._since = now
        return 0.0
