"""Log a lasting condition again at growing intervals, and equal events ever more seldom."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

AGAIN = (10.0, 60.0, 600.0)
"""Wall seconds after `begin`; the last one is then the interval."""


class RepeatedLog:
    """Calls `log(seconds)` at the times of `AGAIN` from `begin` to `end`, with how long it has lasted."""

    def __init__(self, log: Callable[[float], None]) -> None:
        self._log, self._loop = log, asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._since: float | None = None

    @property
    def active(self) -> bool:
        """Whether it has begun and not ended."""
        return self._since is not None

    def begin(self) -> None:
        """Begin; the first line is the caller's."""
        self.end()
        self._since = self._loop.time()
        self._timer = self._loop.call_later(AGAIN[0], self._remind, 1)

    def end(self) -> float | None:
        """End. Returns how many wall seconds it lasted; None if it had not begun."""
        if self._timer is not None:
            self._timer.cancel()
        since, self._since, self._timer = self._since, None, None
        return None if since is None else self._loop.time() - since

    def _remind(self, count: int) -> None:
        """Log for the `count`th time, and plan the next."""
        if self._since is not None:
            self._log(self._loop.time() - self._since)
            due = AGAIN[count] if count < len(AGAIN) else AGAIN[-1] * (count - len(AGAIN) + 2)
            self._timer = self._loop.call_at(self._since + due, self._remind, count + 1)


def is_logged(count: int) -> bool:
    """Return whether the `count`th of like events is logged: the first ten, then each thousandth."""
    return count <= 10 or count % 1000 == 0
