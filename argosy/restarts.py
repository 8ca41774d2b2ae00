"""Starts dead daemons again: the same command on the same state, later each time, and not for ever."""

from __future__ import annotations

import asyncio
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from contextlib import suppress

from argosy.journal import Journal
from argosy.supervise import Child, Supervisor
from commd.process import EXIT_BAD_INPUT, EXIT_DONE

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

    def died(self, child: Child) -> None:
        """A process has ended although nobody told it to: see that it comes again, if that is wanted and may help."""
        if not self._on or self._over.is_set() or not child.process.kind.daemon:
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


PATIENCE = 15.0
"""Wall seconds that a daemon may be silent although its board is heard, or be stopped, until it counts as hung."""


class Watchdog:
    """Kills daemons that run and do nothing, so that they are started again."""

    def __init__(self, supervisor: Supervisor, journal: Journal, silent: Callable[[Child], bool]) -> None:
        """`silent` tells whether nothing is heard of a process although the way to it is open."""
        self._supervisor, self._journal, self._silent = supervisor, journal, silent
        self._since: dict[int, float] = {}

    def look(self, children: Iterable[Child]) -> None:
        """Look at each process, a few times a second."""
        now = time.monotonic()
        for child in children:
            if not (child.alive and child.process.kind.daemon and (is_stopped(child.pid) or self._silent(child))):
                self._since.pop(child.pid, None)
            elif now - self._since.setdefault(child.pid, now) >= PATIENCE:
                how = "is stopped" if is_stopped(child.pid) else "says nothing"
                self._journal.add(child.name, f"hangs: it {how} for {PATIENCE:g} s, and is killed", "warning")
                child.signal(signal.SIGKILL)
                self._since.pop(child.pid)


def is_stopped(pid: int) -> bool:
    """Whether a process was stopped by a signal, or by a debugger."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] in "Tt"
    except (OSError, IndexError):
        return False
