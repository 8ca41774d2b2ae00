"""Run background tasks: a failure is reported, and all end together."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any

WARN_AGAIN = 5.0
"""Wall seconds after which a cancelled task that still runs is cancelled again: `wait_for` of Python 3.11 loses a
cancel that coincides with what it waits for."""


class Tasks:
    """The tasks of one owner; `len` is the number of running ones."""

    def __init__(self, what: str) -> None:
        """`what` they do, for the report of a failure."""
        self._what = what
        self._running: set[asyncio.Task[None]] = set()

    def __len__(self) -> int:
        return len(self._running)

    def spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a task."""
        task = asyncio.get_running_loop().create_task(work)
        self._running.add(task)
        task.add_done_callback(self._ended)
        return task

    def cancel(self) -> None:
        """Cancel all of them."""
        for task in list(self._running):
            task.cancel()

    async def end(self) -> None:
        """Cancel all of them, again if needed, and wait until they have ended."""
        while self._running:
            self.cancel()
            await asyncio.wait(list(self._running), timeout=WARN_AGAIN)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._running.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            context = {"message": self._what, "exception": error, "task": task}
            asyncio.get_running_loop().call_exception_handler(context)


def in_step(now: float, period: float, least: float = 0.0) -> float:
    """Return the seconds from `now` to a multiple of `period`, `least` at least.

    Tasks that wait so for one period wake together: a wake-up of the process costs more than their work.
    """
    left = period - now % period
    return left if left >= least else left + period


async def wait_at_most(event: asyncio.Event, seconds: float | None) -> None:
    """Wait for an event, at most `seconds` (wall; None = for ever)."""
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):  # wait_for of Python 3.11 loses a cancel that coincides with the event
            await event.wait()
