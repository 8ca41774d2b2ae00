"""Starts dead daemons again: the same command on the same state, later each time, and not for ever."""

from __future__ import annotations

import asyncio
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress

from argosy.cli.journal import Journal
from argosy.processes.supervisor import Child, Supervisor
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE

MOST = 5
"""Restarts of one process within `WINDOW`; when it dies once more, the run ends."""
WINDOW = 60.0
"""Wall seconds."""
FIRST, LONGEST = 0.2, 5.0
"""Wall seconds until the first restart within the window; doubled for each further one, up to the longest."""


class Restarts:
    """What is started again in a run, and how often it was."""

    def __init__(self, supervisor: Supervisor, journal: Journal, counts: Counter[str], on: bool) -> None:
        """`counts` is filled: how often each process was started again, by its name."""
        self._counts = counts
        self._supervisor, self._journal, self._on = supervisor, journal, on
        self._times: dict[str, deque[float]] = {}
        self._over = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._coming: dict[str, Child] = {}
        """What was started again and has not shown itself yet."""

    def died(self, child: Child, *, anyway: bool = False) -> None:
        """A process has ended although nobody told it to: see that it comes again, if that is wanted and may help.

        `anyway`: it is wanted whatever the mission says.
        """
        if not (self._on or anyway) or self._over.is_set() or not child.process.kind.daemon:
            return
        if child.handle.returncode in (EXIT_DONE, EXIT_BAD_INPUT):  # it would end in the same way again
            return
        times, now = self._times.setdefault(child.name, deque(maxlen=MOST)), time.monotonic()
        recent = sum(now - one < WINDOW for one in times)
        if recent == MOST:
            child.in_vain = f"; it was restarted {MOST} times within {WINDOW:g} s, and is not any more"
            return
        times.append(now)
        child.replaced = True
        delay = min(FIRST * 2**recent, LONGEST)
        self._journal.add(child.name, f"{child.how_it_ended()}; it is started again in {delay:g} s", "warning")
        task = asyncio.create_task(self._again(child, delay))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _again(self, child: Child, delay: float) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self._over.wait(), delay)
            return
        try:
            new = await self._supervisor.start(child.process, instead_of=child)
        except OSError as error:
            child.replaced, child.in_vain = False, f"; it cannot be started again: {error.strerror}"
            return
        self._counts[child.name] += 1
        self._journal.add(child.name, f"restarted, pid {new.pid}, restart {self._counts[child.name]} in this run")
        self._coming[new.name] = new

    def tell(self, serves: Callable[[Child], bool]) -> None:
        """Tell of each process that was started again and does its work now."""
        for name, child in list(self._coming.items()):
            if not child.alive:
                del self._coming[name]
            elif serves(child):
                del self._coming[name]
                self._journal.add(name, f"up again after {time.monotonic() - child.started:.1f} s", "good")

    async def close(self) -> None:
        """Start nothing any more; returns when nothing is being started."""
        self._over.set()
        await asyncio.gather(*self._tasks)
