"""The clocks that a team in one process runs by: the wall's, or one that jumps when nobody has anything to do."""

from __future__ import annotations

import time
from collections.abc import Callable

LONGEST = 1.0
"""Seconds that are slept at once; what is due later is waited for again. A signal that comes in the moment before
Python falls asleep does not wake it: so late it is noticed then."""


class WallClock:
    """Real seconds since it was made."""

    def __init__(self) -> None:
        self._begun = time.monotonic()

    def now(self) -> float:
        return time.monotonic() - self._begun

    def pass_time(self, seconds: float, sleep: Callable[[float], None] = time.sleep) -> None:
        """Wait so long; ``sleep`` may end sooner."""
        sleep(min(max(0.0, seconds), LONGEST))


class VirtualClock(WallClock):
    """Seconds that pass only when somebody lets them: a wait of an hour takes no time."""

    def __init__(self) -> None:
        super().__init__()
        self._now = 0.0

    def now(self) -> float:
        return self._now

    def pass_time(self, seconds: float, sleep: Callable[[float], None] = time.sleep) -> None:
        self._now += max(0.0, seconds)
