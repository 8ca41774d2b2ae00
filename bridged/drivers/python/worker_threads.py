"""Threads for calls that may block: one for each function of a plug-in, so that one that hangs holds up no other.

Threads are daemons: one that never returns does not keep the process from ending.
"""

from __future__ import annotations

import asyncio
import math
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

Work = Callable[[], Any]


@dataclass(frozen=True, slots=True)
class Returned:
    """A call came back with a value."""

    value: Any


@dataclass(frozen=True, slots=True)
class Raised:
    """A call came back with an exception."""

    kind: str
    text: str
    """What it says; its kind if it says nothing."""


Result = Returned | Raised


class Worker:
    """The thread of one function. It does one call at a time; the thread starts with the first one."""

    def __init__(self, name: str, now: Callable[[], float]) -> None:
        """`now` gives wall seconds."""
        self.name = name
        self.calls = 0
        self.bound = math.inf
        """Wall seconds that the call under way may take."""
        self._now = now
        self._since: float | None = None
        self._queue: SimpleQueue[tuple[Work, asyncio.AbstractEventLoop, Callable[[Result], None]] | None] = (
            SimpleQueue()
        )
        self._thread: threading.Thread | None = None
        self._free = asyncio.Event()

    @property
    def busy(self) -> float:
        """Wall seconds for which the call that is under way has not returned; 0 if there is none."""
        return 0.0 if self._since is None else max(self._now() - self._since, 1e-9)

    @property
    def hangs(self) -> bool:
        """Whether the call under way takes longer than it may."""
        return self.busy > self.bound

    def begin(self, work: Work, done: Callable[[Result], None], bound: float = math.inf) -> None:
        """Do `work` in the thread; `done` is called in the event loop. Raises RuntimeError while one is under way."""
        if self._since is not None:
            raise RuntimeError(f"{self.name} is called already")
        self._since, self.bound = self._now(), bound
        self._free.clear()
        self.calls += 1
        if self._thread is None:
            self._thread = threading.Thread(target=self._serve, name=self.name, daemon=True)
            self._thread.start()
        self._queue.put((work, asyncio.get_running_loop(), done))

    async def call(self, work: Work, bound: float = math.inf) -> Result:
        """Do `work` in the thread and wait for it, for as long as it takes: past the bound it only counts as hanging.

        Waits for the call before, too.
        """
        loop = asyncio.get_running_loop()
        await self.idle()
        future: asyncio.Future[Result] = loop.create_future()
        self.begin(work, lambda result: None if future.done() else future.set_result(result), bound)
        return await future

    async def idle(self) -> None:
        """Wait until no call is under way."""
        while self._since is not None:
            await self._free.wait()

    def close(self) -> None:
        """Let the thread end after its call."""
        self._queue.put(None)

    def _serve(self) -> None:
        while (job := self._queue.get()) is not None:
            work, loop, done = job
            result: Result
            try:
                result = Returned(work())
            except BaseException as error:  # also SystemExit: a plug-in does not end the bridge
                result = _raised(error)
            with suppress(RuntimeError):  # the loop is closed: nobody waits any more
                loop.call_soon_threadsafe(self._over, done, result)

    def _over(self, done: Callable[[Result], None], result: Result) -> None:
        self._since = None
        self._free.set()
        done(result)


def _raised(error: BaseException) -> Raised:
    kind = type(error).__name__
    try:
        return Raised(kind, str(error) or kind)
    except Exception:  # its text is the plug-in's own work
        return Raised(kind, kind)
