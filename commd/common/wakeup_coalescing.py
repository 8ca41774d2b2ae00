"""An event loop that can leave input waiting for some milliseconds, to take several inputs in one wake-up (coalescing).

A wake-up of a process, with the system calls and switches around it, costs more than most inputs that it is for. So
the loop also measures by itself how late it is, without a timer.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from typing import Final

LAG_KEPT: Final = 1.0
"""Wall seconds for which a delay of the loop counts at least; at most twice as long."""


class _Selector(selectors.DefaultSelector):
    """Waits for input, for a while without looking whether there is any."""

    def __init__(self) -> None:
        super().__init__()
        self.blind_until = 0.0
        """When input is looked for again, as `time.monotonic`."""
        self._began = self._kept_since = time.monotonic()
        """When the present pass of the loop began, and when the delays began of which `_late` is the worst."""
        self._late = self._late_before = 0.0

    @property
    def lag(self) -> float:
        """The worst delay lately: by a pass of the loop, or by the machine that did not run it; wall seconds."""
        return max(self._late, self._late_before, time.monotonic() - self._began)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return the input that is there, or wait for some, at most `timeout` wall seconds (None: without end)."""
        ended = time.monotonic()
        if ended - self._kept_since >= LAG_KEPT:
            self._late, self._late_before, self._kept_since = 0.0, self._late, ended
        late = ended - self._began
        found = self._wait(timeout, self.blind_until - ended) if self.blind_until > ended else super().select(timeout)
        self._began = time.monotonic()
        if timeout is not None:
            late = max(late, self._began - ended - timeout)
        if late > self._late:
            self._late = late
        return found

    def _wait(self, timeout: float | None, pause: float) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for `pause` wall seconds without looking, then for input."""
        if timeout is not None and timeout <= pause:
            if timeout > 0:
                time.sleep(timeout)
            return []
        time.sleep(pause)
        return super().select(None if timeout is None else timeout - pause)


class CoalescingLoop(asyncio.SelectorEventLoop):
    """The event loop of a daemon."""

    def __init__(self) -> None:
        self._waits = _Selector()
        super().__init__(self._waits)

    @property
    def lag(self) -> float:
        """The worst delay of the loop in the last `LAG_KEPT` wall seconds or a little more, in wall seconds."""
        return self._waits.lag

    def postpone_input(self, seconds: float) -> None:
        """Look for no input in the next wall seconds, neither of sockets nor of threads; timers are not affected."""
        self._waits.blind_until = max(self._waits.blind_until, time.monotonic() + seconds)


def postpone_input(seconds: float) -> None:
    """Call `CoalescingLoop.postpone_input` of the running loop; one that is not a daemon's takes input as it comes."""
    loop = asyncio.get_running_loop()
    if isinstance(loop, CoalescingLoop):
        loop.postpone_input(seconds)


def loop_lag() -> float:
    """Return `CoalescingLoop.lag` of the running loop, 0 for one that is not a daemon's."""
    loop = asyncio.get_running_loop()
    return loop.lag if isinstance(loop, CoalescingLoop) else 0.0
