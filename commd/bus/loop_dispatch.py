"""What comes on Zenoh's threads, handed over to the event loop in the order in which it came.

The loop is woken once for all that waits. Whoever is told of something may ask for a turn behind the rest
(`afterwards`): an agent then reasons about all of it at once, without another pass of the loop.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable
from itertools import count
from time import monotonic
from typing import Any, Final

AT_ONCE: Final = 64
"""So much is handed over, however long it takes, before others on the loop have their turn."""
TURN: Final = 0.02
"""Wall seconds for which more is handed over: a pass of the loop may be long, and what waits must not pile up."""


class LoopDispatch:
    """Hands over to one event loop, while that runs; what comes later is counted as dropped."""

    def __init__(self, loop: asyncio.AbstractEventLoop, counters: Counter[str]) -> None:
        self._loop, self._counters = loop, counters
        self._waiting: deque[tuple[Callable[[Any], None], Any]] = deque()
        self._called = False
        """Whether the loop is going to hand over what waits."""
        self._at_work = False
        self._later: list[Callable[[], None]] = []

    def put(self, function: Callable[[Any], None], item: Any) -> None:
        """Have `function(item)` called on the loop; from any thread."""
        self._waiting.append((function, item))
        if self._called and not self._loop.is_closed():
            return
        self._called = True
        try:
            self._loop.call_soon_threadsafe(self._hand_over)
        except RuntimeError:  # the loop has ended
            self._called = False
            self._counters["dropped"] += len(self._waiting)
            self._waiting.clear()

    def afterwards(self, handler: Callable[[], None]) -> bool:
        """Have `handler()` called behind what is handed over now, in the same pass; False if nothing is."""
        if self._at_work:
            self._later.append(handler)
        return self._at_work

    def _hand_over(self) -> None:
        self._called = False  # before the last look: who puts something now calls again
        self._at_work = True
        until = monotonic() + TURN
        try:
            for number in count():
                if not self._waiting or (number >= AT_ONCE and monotonic() >= until):
                    break
                function, item = self._waiting.popleft()
                self._guarded(function, item)
        finally:
            self._at_work = False
            if self._waiting and not self._called:
                self._called = True
                self._loop.call_soon(self._hand_over)
            later, self._later = self._later, []
            for handler in later:
                self._guarded(handler)

    def _guarded(self, function: Callable[..., None], *args: Any) -> None:
        """Call a function; what it raises keeps nobody else from theirs."""
        try:
            function(*args)
        except Exception as error:
            self._loop.call_exception_handler({"message": "handing over what has come", "exception": error})
