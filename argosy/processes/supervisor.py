"""Start, restart and end the processes of a run, and leave none behind.

Each process leads its own process group, so that the terminal's ctrl-C reaches only `argosy run`, which ends the others
in order; the kernel ends them if `argosy run` is killed (`argosy.processes.launcher`).
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from argosy.cli.journal import Journal
from argosy.processes.process_table import Process
from commd.common.tasks import wait_at_most
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.wire import log_lines
from schemas.wire.log_lines import LogLine

KEPT_LINES = 50
"""Last lines of each process that are kept to explain its end."""
MAX_LINE = 65_536
"""Bytes of one line that are read: more than a `LogLine` can have; the rest is cut."""
HURRIED = 1.0
"""Wall seconds for processes to end after a second ctrl-C."""
_LAUNCHER = str(Path(__file__).with_name("launcher.py"))
_READ_BYTES = 65_536


class Child:
    """A started process."""

    def __init__(self, process: Process, handle: asyncio.subprocess.Process) -> None:
        self.process, self.handle = process, handle
        self.name = process.name
        self.pid = handle.pid
        self.lines: deque[LogLine] = deque(maxlen=KEPT_LINES)
        self.logged_error = self.stderr_line = ""
        """Its last logged error, and its last line on standard error that is not a log line."""
        self.started = time.monotonic()
        self.asked_to_leave = self.killed = False
        """Whether it was asked to end; whether it was killed because it did not."""
        self.died: float | None = None
        self.replaced = False
        """Whether it has died and is replaced by a restart."""
        self.in_vain = ""
        """Why it is not restarted; appended to how it ended."""
        self.readers: list[asyncio.Task[None]] = []
        self.waiter: asyncio.Task[None] | None = None

    @property
    def alive(self) -> bool:
        """Whether it is running."""
        return self.died is None

    @property
    def stopped(self) -> bool:
        """Whether it was stopped by a signal, or by a debugger."""
        try:
            return Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"
        except (OSError, IndexError):
            return False

    @property
    def dead(self) -> bool:
        """Whether it ended by itself or by a foreign signal, and is not restarted."""
        code = self.handle.returncode
        crashed = code is not None and code < 0 and code != -signal.SIGTERM and not self.killed
        return self.died is not None and not self.replaced and (crashed or not self.asked_to_leave)

    def how_it_ended(self) -> str:
        """Return how it ended as text, with its last error."""
        code = self.handle.returncode
        if code is None:
            return "still runs"
        if code < 0:
            return f"was killed by {signal.Signals(-code).name}{self.in_vain}"
        error = self.logged_error or self.stderr_line
        return f"ended by itself with exit code {code}{f': {error}' if error else ''}{self.in_vain}"

    def ask_to_leave(self) -> None:
        """Send SIGTERM."""
        self.asked_to_leave = True
        self.signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.asked_to_leave = self.killed = True
        self.signal(signal.SIGKILL)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the process, if it is running."""
        if self.alive:
            with suppress(ProcessLookupError):
                self.handle.send_signal(number)

    def kill_group(self) -> None:
        """Kill what is left of the process group."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)


class Supervisor:
    """The processes of a run."""

    def __init__(self, on_line: Callable[[Child, LogLine], None], on_end: Callable[[Child], None]) -> None:
        """`on_line` gets each line that a process writes, `on_end` each process that has ended."""
        self.children: list[Child] = []
        self._on_line, self._on_end = on_line, on_end

    async def start(self, process: Process, instead_of: Child | None = None) -> Child:
        """Start a process, or restart a dead one in its place. Raises OSError."""
        child = await self.launch(process)
        if instead_of in self.children:
            self.children[self.children.index(instead_of)] = child
        else:
            self.children.append(child)
        streams = child.handle.stdout, child.handle.stderr
        child.readers = [asyncio.create_task(self._read(child, stream)) for stream in streams if stream is not None]
        child.waiter = asyncio.create_task(self._wait(child))
        return child

    async def launch(self, process: Process) -> Child:
        """Start a process. Raises OSError."""
        launcher = (sys.executable, "-I", "-S", _LAUNCHER, str(int(process.orphaned)), str(os.getpid()))
        handle = await asyncio.create_subprocess_exec(
            *launcher,
            *process.argv,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, **log_lines.AS_JSON, "PYTHONUNBUFFERED": "1"},
            process_group=0,
        )
        return Child(process, handle)

    def dead(self) -> list[Child]:
        """Return the needed processes that are `dead`, in the order of their end."""
        dead = (child for child in self.children if child.dead and child.process.kind.needed)
        return sorted(dead, key=lambda child: child.died or 0.0)

    def of_kind(self, *names: str) -> list[Child]:
        """Return the processes of these kinds, in the order of the start."""
        return [child for child in self.children if child.process.kind.name in names]

    async def leave(self, children: Iterable[Child], patience: float, hurry: asyncio.Event) -> list[Child]:
        """Ask processes to end and wait for them, at most `patience` seconds, or `HURRIED` once `hurry` is set.

        Kills the late ones and returns them.
        """
        leaving = [child for child in children if child.alive]
        for child in leaving:
            child.ask_to_leave()
        until, hurried = time.monotonic() + patience, False
        while (late := [child for child in leaving if child.alive]) and time.monotonic() < until:
            if hurry.is_set() and not hurried:
                until, hurried = min(until, time.monotonic() + HURRIED), True
            await asyncio.sleep(0.02)
        for child in late:
            child.kill()
        await self._gone(late)
        return late

    async def close(self) -> None:
        """Kill all processes and their groups."""
        for child in self.children:
            if child.alive:
                child.kill()
            child.kill_group()
        await self._gone(self.children)
        for child in self.children:
            for reader in child.readers:
                reader.cancel()

    async def _gone(self, children: Iterable[Child]) -> None:
        waiters = [child.waiter for child in children if child.waiter is not None]
        if waiters:
            await asyncio.wait(waiters, timeout=2.0)

    async def _wait(self, child: Child) -> None:
        await child.handle.wait()
        child.kill_group()
        await asyncio.wait(child.readers, timeout=0.3)  # its last output
        child.died = time.monotonic()
        self._on_end(child)

    async def _read(self, child: Child, stream: asyncio.StreamReader) -> None:
        waiting = b""
        while data := await stream.read(_READ_BYTES):
            *lines, waiting = (waiting + data).split(b"\n")
            for line in lines:
                self._take(child, line, stream)
            if len(waiting) > MAX_LINE:
                self._take(child, waiting, stream)
                waiting = b""
        if waiting:
            self._take(child, waiting, stream)

    def _take(self, child: Child, data: bytes, stream: asyncio.StreamReader) -> None:
        line = log_lines.decode(data)
        if line is None:
            line = LogLine(text=log_lines.cut(data[:MAX_LINE].decode(errors="replace").rstrip()))
            if line.text and stream is child.handle.stderr:
                child.stderr_line = line.text
        elif line.level == "error":
            child.logged_error = line.text
        if line.text:
            child.lines.append(line)
            self._on_line(child, line)


MOST = 5
"""Restarts of one process within `WINDOW`; when it dies once more, the run ends."""
WINDOW = 60.0
"""Wall seconds."""
FIRST, LONGEST = 0.2, 5.0
"""Wall seconds until the first restart within the window; doubled for each further one, up to the longest."""


class Restarts:
    """Restarts dead daemons of a run: the same command on the same state, later each time, and only `MOST` times."""

    def __init__(self, supervisor: Supervisor, journal: Journal, counts: Counter[str], on: bool) -> None:
        """Adds to `counts` the restarts of each process, by name. `on`: whether the mission wants restarts."""
        self._counts = counts
        self._supervisor, self._journal, self._on = supervisor, journal, on
        self._times: dict[str, deque[float]] = {}
        self._over = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._coming: dict[str, Child] = {}
        """Restarted processes that do not serve yet."""

    def died(self, child: Child, *, anyway: bool = False) -> None:
        """Restart a process that has died, if that is wanted and can help. `anyway`: the mission need not want it."""
        if not (self._on or anyway) or self._over.is_set() or not child.process.kind.daemon:
            return
        if child.handle.returncode in (EXIT_DONE, EXIT_BAD_INPUT):  # it would end in the same way again
            return
        times, now = self._times.setdefault(child.name, deque(maxlen=MOST)), time.monotonic()
        recent = sum(now - one < WINDOW for one in times)
        if recent == MOST:
            child.in_vain = f"; it was restarted {MOST} times within {WINDOW:g} s and is given up"
            return
        times.append(now)
        child.replaced = True
        delay = min(FIRST * 2**recent, LONGEST)
        self._journal.add(child.name, f"{child.how_it_ended()}; it is started again in {delay:g} s", "warning")
        task = asyncio.create_task(self._again(child, delay))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _again(self, child: Child, delay: float) -> None:
        if await wait_at_most(self._over, delay):
            return
        try:
            new = await self._supervisor.start(child.process, instead_of=child)
        except OSError as error:
            child.replaced, child.in_vain = False, f"; it cannot be started again: {error.strerror}"
            return
        self._counts[child.name] += 1
        self._journal.add(child.name, f"restarted, pid {new.pid}, restart {self._counts[child.name]} in this run")
        self._coming[new.name] = new

    def report_restarted(self, serves: Callable[[Child], bool]) -> None:
        """Report each restarted process that serves again."""
        for name, child in list(self._coming.items()):
            if not child.alive:
                del self._coming[name]
            elif serves(child):
                del self._coming[name]
                self._journal.add(name, f"up again after {time.monotonic() - child.started:.1f} s", "good")

    async def close(self) -> None:
        """Stop restarting; return when no restart is in progress."""
        self._over.set()
        await asyncio.gather(*self._tasks)
