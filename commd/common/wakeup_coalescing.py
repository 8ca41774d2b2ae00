"""An event loop that can leave input waiting for some milliseconds, to take several inputs in one wake-up (coalescing).

A wake-up of a process, with the system calls and switches around it, costs more than most inputs that it is for.
"""

from __future__ import annotations

import asyncio
import selectors
import time


class _Selector(selectors.DefaultSelector):
    """Waits for input, for a while without looking whether there is any."""

    def __init__(self) -> None:
        super().__init__()
        self.blind_until = 0.0
        """When input is looked for again, as `time.monotonic`."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return the input that is there, or wait for some, at most `timeout` wall seconds (None: without end)."""
        pause = self.blind_until - time.monotonic()
        if pause > 0:
            if timeout is not None and timeout <= pause:
                if timeout > 0:
                    time.sleep(timeout)
                return []
            time.sleep(pause)
            timeout = None if timeout is None else timeout - pause
        return super().select(timeout)


class CoalescingLoop(asyncio.SelectorEventLoop):
    """The event loop of a daemon."""

    def __init__(self) -> None:
        self._waits = _Selector()
        super().__init__(self._waits)

    def postpone_input(self, seconds: float) -> None:
        """Look for no input in the next wall seconds, neither of sockets nor of threads; timers are not affected."""
        self._waits.blind_until = max(self._waits.blind_until, time.monotonic() + seconds)


def postpone_input(seconds: float) -> None:
    """Call `CoalescingLoop.postpone_input` of the running loop; one that is not a daemon's takes input as it comes."""
    loop = asyncio.get_running_loop()
    if isinstance(loop, CoalescingLoop):
        loop.postpone_input(seconds)
