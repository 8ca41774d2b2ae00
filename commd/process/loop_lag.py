"""How late an event loop comes to what is due: what a process with too much to do shows first."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from weakref import WeakKeyDictionary

LOOK = 0.25
"""Wall seconds between two looks; a stall that is longer is seen for certain."""
KEPT = 5
"""Looks that count: those of the last second and a little more."""


class LoopLag:
    """Looks at an event loop for as long as it runs."""

    def __init__(self, now: Callable[[], float], call_at: Callable[[float, Callable[[], None]], object]) -> None:
        self._now, self._call_at = now, call_at
        self._late: deque[float] = deque(maxlen=KEPT)
        self._due = now() + LOOK
        call_at(self._due, self._look)

    @property
    def worst(self) -> float:
        """Wall seconds by which the loop came too late at worst, a short time ago or now."""
        return max(0.0, self._now() - self._due, *self._late)

    def _look(self) -> None:
        now = self._now()
        self._late.append(now - self._due)
        self._due = now + LOOK
        self._call_at(self._due, self._look)


_of_loops: WeakKeyDictionary[asyncio.AbstractEventLoop, LoopLag] = WeakKeyDictionary()


def loop_lag() -> LoopLag:
    """Return what looks at the running loop: one for all that ask."""
    loop = asyncio.get_running_loop()
    found = _of_loops.get(loop)
    if found is None:
        found = _of_loops[loop] = LoopLag(loop.time, loop.call_at)
    return found
