"""Hand over what arrives on Zenoh's threads to the event loop, in order.

The loop is woken once for everything that waits. A handler may ask for a call behind the rest (`afterwards`), so that
an agent reasons about all of it together, in the same pass of the loop.
"""

from __future__ import annotations

import asyncio
import ctypes
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from threading import get_ident
from time import monotonic
from typing import Any, Final

import zenoh

BACKLOG: Final = 10_000
"""Items of one callback that may wait for the event loop; further ones are refused and counted."""
AT_ONCE: Final = 64
"""Items of one pass at least, however long they take, before other work on the loop has its turn."""
TURN: Final = 0.02
"""Wall seconds of one pass: other work may take long, and the backlog must not grow meanwhile."""
LAST_WORD: Final = 1.0
"""Wall seconds after the timeout of a query that Zenoh has to report its end."""


KEPT: Final = 32
"""Threads whose state in the interpreter is kept at most; Zenoh has seven."""
_kept: Final[set[int]] = set()


def _keep_thread_state() -> None:
    """Keep the interpreter's state of this thread: it is not freed, whatever becomes of the thread.

    Python makes one whenever a thread of Zenoh's calls it, and frees it at the end of the call, with two system calls:
    a fifth of what the thread does for a sample. `PyGILState_Ensure` without its `PyGILState_Release` keeps it.
    """
    if len(_kept) < KEPT:
        _kept.add(get_ident())
        ctypes.pythonapi.PyGILState_Ensure()


class LoopDispatch:
    """Calls functions on one event loop from any thread; what arrives after the loop has ended counts as dropped."""

    def __init__(self, loop: asyncio.AbstractEventLoop, counters: Counter[str]) -> None:
        self.loop, self.counters = loop, counters
        self._waiting: deque[tuple[Callable[[Any], None], deque[Any]]] = deque()
        """Functions, each with a queue whose next item it is called with."""
        self._called = False
        """Whether the loop is going to run `_run`."""
        self._running = False
        self._later: list[Callable[[], None]] = []

    def put(self, function: Callable[[Any], None], item: Any) -> None:
        """Call `function(item)` on the loop; from any thread."""
        self._put_next(function, deque((item,)))

    def _put_next(self, function: Callable[[Any], None], items: deque[Any]) -> None:
        if get_ident() not in _kept:
            _keep_thread_state()
        self._waiting.append((function, items))
        if self._called and not self.loop.is_closed():
            return
        self._called = True
        try:
            self.loop.call_soon_threadsafe(self._run)
        except RuntimeError:  # the loop has ended
            self._called = False
            self.counters["dropped"] += len(self._waiting)
            self._waiting.clear()

    def callback(
        self, deliver: Callable[[Any], None], refuse: Callable[[Any], None] | None = None
    ) -> zenoh.handlers.Callback[Any]:
        """Return a callback for Zenoh that calls `deliver(item)` on the loop.

        At most `BACKLOG` items wait. Further ones are counted as dropped, and given to `refuse` on Zenoh's thread.
        """
        waiting: deque[Any] = deque()

        def arrived(item: Any) -> None:
            if len(waiting) >= BACKLOG:
                self.counters["dropped"] += 1
                if refuse is not None:
                    refuse(item)
                return
            waiting.append(item)
            self._put_next(deliver, waiting)

        return zenoh.handlers.Callback(arrived, indirect=False)

    def replies(self, arrived: Callable[[zenoh.Reply | None], None]) -> zenoh.handlers.Callback[Any]:
        """Return a callback for a query of Zenoh's that calls `arrived(reply)` on the loop, at its end with None."""
        return zenoh.handlers.Callback(partial(self.put, arrived), partial(self.put, arrived, None), indirect=False)

    async def collect(
        self, ask: Callable[[zenoh.handlers.Callback[Any]], object], timeout: float
    ) -> tuple[list[zenoh.Reply], bool]:
        """Return the replies to the query that `ask(callback)` begins, and whether it ended.

        `timeout` is that of the query, in wall seconds: Zenoh itself ends it then, or a broken query never ends.
        """
        waiting: asyncio.Queue[zenoh.Reply | None] = asyncio.Queue()
        ask(self.replies(waiting.put_nowait))
        found: list[zenoh.Reply] = []
        try:
            async with asyncio.timeout(timeout + LAST_WORD):
                while (reply := await waiting.get()) is not None:
                    found.append(reply)
        except TimeoutError:
            return found, False
        return found, True

    def afterwards(self, handler: Callable[[], None]) -> None:
        """Call `handler()` behind all that is handed over in this pass of the loop, or in the next if nothing is.

        A pass takes `TURN` of a flood, and at least `AT_ONCE` items. For handlers that act on several items together.
        """
        if self._running:
            self._later.append(handler)
        else:
            self.loop.call_soon(handler)

    def _run(self) -> None:
        number, until = 0, monotonic() + TURN
        while True:
            self._running = True
            while self._waiting and (number < AT_ONCE or monotonic() < until):
                number += 1
                function, items = self._waiting.popleft()
                self.call(function, items.popleft())
            self._running = False
            later, self._later = self._later, []
            for handler in later:
                self.call(handler)
            if not self._waiting:
                self._called = False  # before the last look: whoever puts something now calls again
                if not self._waiting:
                    return
                self._called = True
            if monotonic() >= until:  # what came meanwhile has its turn behind the rest of the loop
                self.loop.call_soon(self._run)
                return

    def call(self, function: Callable[..., None], *args: Any) -> None:
        """Call a function; an error in it does not keep the others from being called."""
        try:
            function(*args)
        except (Exception, asyncio.CancelledError) as error:  # such as the result of a task that was cancelled
            self.loop.call_exception_handler({"message": "handling what has arrived", "exception": error})
        except BaseException:  # the program ends: what waits may be needed for that
            self._running = False
            self.loop.call_soon(self._run)
            raise
