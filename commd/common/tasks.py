"""Tasks in the background, whose failure is reported and which end together; waits and timers of the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

WARN_AGAIN = 5.0
"""Wall seconds after which a cancelled task that still runs is cancelled again: `wait_for` of Python 3.11 loses a
cancel that coincides with what it waits for."""


class Tasks(set[asyncio.Task[None]]):
    """The running tasks of one owner."""

    def __init__(self, what: str) -> None:
        """`what` they do, for the report of a failure."""
        super().__init__()
        self._what = what

    def spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a task."""
        task = asyncio.get_running_loop().create_task(work)
        self.add(task)
        task.add_done_callback(self._ended)
        return task

    def cancel(self) -> None:
        """Cancel all of them."""
        for task in list(self):
            task.cancel()

    async def end(self) -> None:
        """Cancel all of them, again if needed, and wait until they have ended."""
        while self:
            self.cancel()
            await asyncio.wait(list(self), timeout=WARN_AGAIN)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            context = {"message": self._what, "exception": error, "task": task}
            asyncio.get_running_loop().call_exception_handler(context)


def in_step(now: float, period: float, least: float = 0.0) -> float:
    """Return the seconds from `now` to a multiple of `period`, `least` at least.

    Tasks that wait so for one period wake together: a wake-up of the process costs more than their work.
    """
    left = period - now % period
    return left if left >= least else left + period


async def wait_at_most(event: asyncio.Event, seconds: float | None) -> bool:
    """Wait for an event, at most `seconds` (wall; None = for ever). Returns whether it is set."""
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):  # wait_for of Python 3.11 loses a cancel that coincides with the event
            await event.wait()
    return event.is_set()


class Alarm:
    """Calls `ring()` on the event loop at the due time at the latest, often before: `ring` looks what is due.

    A timer for what is mostly over before it is due: it is not started and cancelled each time, but left running.
    """

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._timer: asyncio.TimerHandle | None = None

    def by(self, due: float) -> None:
        """Call it at `due` (the loop's time) at the latest; of several times the earliest counts."""
        if self._timer is not None:
            if self._timer.when() <= due:
                return
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_at(due, self._rings)

    def cancel(self) -> None:
        """Do not call it any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _rings(self) -> None:
        self._timer = None
        self._ring()
