"""Write a daemon's lines to a terminal, pipe or journal, on a thread of its own.

A paused pager, Ctrl-S or a parent that stops reading would otherwise block the event loop in a write, and with it the
heartbeats of a vehicle. Lines to the journal begin with their priority, `<4>` (sd-daemon(3)); a supervisor may ask for
`LogLine`s.
"""

from __future__ import annotations

import os
import select
import stat
import sys
import threading
import time
from collections import deque
from functools import cache

from msgspec.structs import replace

from schemas.humanize import escape_lines
from schemas.wire import log_lines
from schemas.wire.log_lines import AnyEvent, Level, LogLine

LINES = 10_000
"""Lines that may wait for their reader; further ones are dropped, and counted in the next line."""
DEBUG, INFORMATIONAL, NOTICE, WARNING, ERROR, CRITICAL = 7, 6, 5, 4, 3, 2
"""Priorities as syslog(3) counts them."""
_LEVELS: dict[int, Level] = {NOTICE: "notice", WARNING: "warning", ERROR: "error", CRITICAL: "error"}
GATHERING, WRITES_IN_A_ROW = 0.005, 10.0
"""After more than `WRITES_IN_A_ROW` writes with less than `GATHERING` wall seconds between them on average, further
lines wait that long for the next write: to wake the thread for each costs the event loop more than the lines do."""
FLUSH = 0.5
"""Wall seconds for the reader to take the last lines when the daemon ends."""


class Output:
    """One stream of lines, written in order to a file descriptor."""

    def __init__(
        self, descriptor: int, lines: int = LINES, encoding: str = "utf-8", *, structured: bool = False
    ) -> None:
        """`structured`: each line is a `LogLine`."""
        self.structured = structured
        self.dropped = 0
        """Lines dropped so far: not read, or not writable."""
        self._descriptor, self._encoding = descriptor, encoding
        self._lines = lines
        self._waiting: deque[bytes] = deque()
        self._there = threading.Event()
        """Set when the first line waits."""
        self._writing = False
        self._reported = 0
        self._to_journal = _is_journal(descriptor)
        threading.Thread(target=self._run, name=f"output-{descriptor}", daemon=True).start()

    @property
    def dates_its_lines(self) -> bool:
        """Whether the reader adds the time to lines: the journal and `argosy run` do, which read a pipe or a socket;
        a terminal and a file do not."""
        try:
            return not (os.isatty(self._descriptor) or stat.S_ISREG(os.fstat(self._descriptor).st_mode))
        except OSError:  # closed: there is no reader
            return True

    def keep(self) -> None:
        """Keep writing to the present file if its descriptor is replaced."""
        self._descriptor = os.dup(self._descriptor)

    def write(
        self, text: str, priority: int = INFORMATIONAL, *, agent: str = "", event: AnyEvent | None = None
    ) -> None:
        """Queue one line, or several that belong together; never waits.

        `priority`: as syslog(3) counts them, 0 to 7. `agent`: whose program printed it. `event`: for the supervisor.
        """
        lines = escape_lines(text).split("\n")
        if self.structured:
            level = _LEVELS.get(priority, "info")
            records = [LogLine(text=log_lines.cut(line), level=level, agent=agent) for line in lines]
            records[0] = replace(records[0], event=event)
            data = b"\n".join(map(log_lines.encode, records))
        else:
            # a text must not fake a priority or an agent
            prefix = (f"<{priority}>" if self._to_journal else "") + (f"[{agent}] " if agent else "")
            data = "\n".join(f"{prefix}{line}" for line in lines).encode(self._encoding, "backslashreplace")
        if len(self._waiting) >= self._lines:
            self.dropped += 1
            return
        self._waiting.append(data + b"\n")
        if not self._there.is_set():
            self._there.set()

    def flush(self, patience: float = FLUSH) -> None:
        """Wait until everything has been written, at most `patience` wall seconds."""
        until = time.monotonic() + patience
        while (self._waiting or self._writing) and time.monotonic() < until:
            time.sleep(0.005)

    def _run(self) -> None:
        left, written = WRITES_IN_A_ROW, time.monotonic()
        while True:
            self._there.wait()
            self._there.clear()
            while self._waiting:
                self._writing = True
                while self._waiting:
                    self._write_some()
                self._writing = False
                now = time.monotonic()
                left, written = min(WRITES_IN_A_ROW, left + (now - written) / GATHERING) - 1, now
                if left < 0:
                    time.sleep(GATHERING)

    def _write_some(self) -> None:
        """Write lines that wait: no more than arrive whole beside those of other processes, but one at least."""
        lines = [self._waiting.popleft()]
        size = len(lines[0])
        while self._waiting and (size := size + len(self._waiting[0])) <= select.PIPE_BUF:
            lines.append(self._waiting.popleft())
        data = b"".join(lines)
        if self.dropped > self._reported:
            prefix = "<4>" if self._to_journal else ""
            report = f"{prefix}({self.dropped - self._reported} lines were dropped: they were not read)\n"
            data = report.encode() + data
            self._reported = self.dropped
        try:
            while data:
                data = data[os.write(self._descriptor, data) :]
        except OSError:  # closed by its reader
            self.dropped += len(lines)
            self._reported = self.dropped


def _is_journal(descriptor: int) -> bool:
    """Return whether systemd has connected a descriptor to the journal."""
    try:
        found = os.fstat(descriptor)
    except OSError:
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


@cache
def stdout() -> Output:
    """Return the process' standard output."""
    return Output(1, encoding=sys.stdout.encoding, structured=log_lines.wanted())


@cache
def stderr() -> Output:
    """Return the process' standard error."""
    return Output(2, encoding=sys.stderr.encoding, structured=log_lines.wanted())


def flush() -> None:
    """Flush both, for `FLUSH` seconds each at most."""
    stdout().flush()
    stderr().flush()
