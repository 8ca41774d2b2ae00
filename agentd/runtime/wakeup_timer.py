"""Wakes one task that has nothing to do until something comes, or until a time.

An agent with a robot is woken for each percept. A timer for each of these waits would cost more than the percept: there
is one, and it is left as it is while it is due early enough.
"""

from __future__ import annotations

import asyncio
from typing import Final

EARLY: Final = 0.0001
"""Wall seconds by which a timer may come too early."""


class WakeupTimer:
    """What one task sleeps on."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._set = False
        self._sleeper: asyncio.Future[None] | None = None
        self._alarm: asyncio.TimerHandle | None = None
        self._due: float | None = None
        """When it is to be woken at the latest."""

    @property
    def asleep(self) -> bool:
        """Whether the task sleeps, and nothing has woken it yet."""
        return self._sleeper is not None and not self._sleeper.done()

    def set(self) -> None:
        """Wake the task, or keep it from falling asleep."""
        self._set = True
        if self._sleeper is not None and not self._sleeper.done():
            self._sleeper.set_result(None)

    def clear(self) -> None:
        """What has come so far is known."""
        self._set = False

    def within(self, seconds: float | None) -> None:
        """Have the task woken within so many wall seconds (None: only when something comes)."""
        if seconds is None:
            self._due = None
            return
        self._due = due = self._loop.time() + seconds
        if self._alarm is not None:
            if self._alarm.when() <= due:
                return  # when it comes too early, it is set anew
            self._alarm.cancel()
        self._alarm = self._loop.call_at(due, self._ring)

    async def wait(self, seconds: float | None) -> None:
        """Sleep until something comes, at most so many wall seconds; not at all if something has come already."""
        if self._set:
            return
        self.within(seconds)
        self._sleeper = self._loop.create_future()
        try:
            await self._sleeper
        finally:
            self._sleeper = None

    def close(self) -> None:
        """Wake nobody any more."""
        self._due = None
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None

    def _ring(self) -> None:
        self._alarm = None
        if self._due is None:
            return
        if self._due > self._loop.time() + EARLY:
            self._alarm = self._loop.call_at(self._due, self._ring)
            return
        self._due = None
        self.set()
