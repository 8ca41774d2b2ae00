"""Measure how late an event loop runs due calls: the first sign of overload."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from weakref import WeakKeyDictionary

LOOK = 0.25
"""Wall seconds between two measurements; a longer stall is always noticed."""
KEPT = 5
"""Measurements that count: those of about the last second."""


class LoopLag:
    """Measures one event loop while it runs."""

    def __init__(self, now: Callable[[], float], call_at: Callable[[float, Callable[[], None]], object]) -> None:
        self._now, self._call_at = now, call_at
        self._late: deque[float] = deque(maxlen=KEPT)
        self._due = now() + LOOK
        call_at(self._due, self._look)

    @property
    def worst(self) -> float:
        """The worst delay in about the last second, in wall seconds."""
        return max(0.0, self._now() - self._due, *self._late)

    def _look(self) -> None:
        now = self._now()
        self._late.append(now - self._due)
        self._due = now + LOOK
        self._call_at(self._due, self._look)


_of_loops: WeakKeyDictionary[asyncio.AbstractEventLoop, LoopLag] = WeakKeyDictionary()


def loop_lag() -> LoopLag:
    """Return the measurement of the running loop, one for all callers."""
    loop = asyncio.get_running_loop()
    found = _of_loops.get(loop)
    if found is None:
        found = _of_loops[loop] = LoopLag(loop.time, loop.call_at)
    return found
