"""Calls of a plug-in's functions in threads: one thread for each function, so that one that hangs holds up no other.

Threads are daemons: one that never returns does not keep the process from ending."""

from __future__ import annotations

import asyncio
import inspect
import math
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, cast

from bridged.drivers.api import Execution, Outcome, Value
from bridged.drivers.python.plugins import Function

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
    """Its text, or its kind if it has none."""


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
        """Wall seconds since the begin of the call under way; 0 if there is none."""
        return 0.0 if self._since is None else max(self._now() - self._since, 1e-9)

    @property
    def hangs(self) -> bool:
        """Whether the call under way takes longer than it may."""
        return self.busy > self.bound

    def begin(self, work: Work, done: Callable[[Result], None], bound: float = math.inf) -> None:
        """Do `work` in the thread; `done` is called in the event loop. After `bound` wall seconds it counts as hanging.

        Raises RuntimeError while one is under way.
        """
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
        """Do `work` in the thread and wait for it, as long as it takes, and for the call before.

        After `bound` wall seconds it counts as hanging.
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


MAX_RATE = 500.0
"""Most steps of a generator in a wall second: it need not pause by itself."""


class FunctionRun(Execution):
    """One call of a function for an action; of a generator, until its end or until the action is over."""

    def __init__(self, name: str, function: str) -> None:
        super().__init__(name, waits_for=f"`{function}` to return")
        self.function = function
        self._feedback: dict[str, float] = {}
        self._over = threading.Event()

    def work(self, function: Function, arguments: Mapping[str, Value]) -> Any:
        """Call the function, in a thread. Returns what it returned, at last."""
        returned = function(**arguments)
        return self._drive(cast(Generator[Any, None, Any], returned)) if inspect.isgenerator(returned) else returned

    def abandon(self) -> None:
        """Close the generator at its next `yield`; a function runs on."""
        self._over.set()

    def look(self) -> None:
        """Take over the latest feedback, in the event loop."""
        if not self.over:
            self.feedback = self._feedback

    def _drive(self, generator: Generator[Any, None, Any]) -> Any:
        while not self._over.is_set():
            try:
                self._feedback = _figures(next(generator))
            except StopIteration as end:
                return end.value
            self._over.wait(1 / MAX_RATE)
        generator.close()
        return None


def _figures(yielded: object) -> dict[str, float]:
    """Return the numbers of what a generator yields, without anything else."""
    if not isinstance(yielded, Mapping):
        return {}
    items = ((str(name), value) for name, value in yielded.items())
    return {name: float(value) for name, value in items if isinstance(value, int | float)}


def outcome_of(function: str, result: Result) -> Outcome:
    """Return the outcome of a result: None or True is success; False, a text or an exception is failure."""
    match result:
        case Raised(_, text):
            return Outcome("failed", text)
    match result.value:
        case None | True:
            return Outcome("succeeded")
        case False:
            return Outcome("failed", f"`{function}` returned False")
        case str(text):
            return Outcome("failed", text or f"`{function}` returned an empty text")
        case other:
            reason = f"`{function}` returned a {type(other).__name__}: expected None, True, False or a text why not"
            return Outcome("failed", reason)
