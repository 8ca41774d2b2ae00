"""What a daemon logs: one line for each record, with its level, for people, the journal and `argosy run`; no flood.

Of each kind of message (its text before the values are filled in, and whose it is) `BURST` lines pass in each `WINDOW`.
The rest is counted, and the count is logged at the end of the window.
"""

from __future__ import annotations

import logging
import os
import re
import threading
import time
import traceback
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from commd.process import output
from commd.process.output import Output, stderr
from schemas.humanize import escape_line
from schemas.wire.log_lines import cut

BURST = 50
"""Lines of one kind that pass in one window."""
WINDOW = 10.0
"""Wall seconds of a window, which begins with its first line."""
KINDS = 500
"""Kinds of messages of one window that are told apart; all further ones together are one more kind."""
SUBJECTS = 500
"""Agents, robots and boards whose last error is kept."""
PRIORITIES = {
    "DEBUG": output.DEBUG,
    "INFO": output.INFORMATIONAL,
    "WARNING": output.WARNING,
    "ERROR": output.ERROR,
    "CRITICAL": output.CRITICAL,
}
"""The levels as syslog and the journal number them."""
_SUBJECT = re.compile(r"(?:agent|robot|board)=%s")


class Flood:
    """Counts the records of each kind in one window: `BURST` of each pass, the rest is suppressed."""

    def __init__(self) -> None:
        self._counts: Counter[object] = Counter()
        self._last: dict[object, logging.LogRecord] = {}
        """The newest record of each kind that did not pass."""

    def passes(self, kind: object, record: logging.LogRecord) -> bool:
        """Return whether a record may be written."""
        if kind not in self._counts and len(self._counts) >= KINDS:
            kind = None
        self._counts[kind] += 1
        if self._counts[kind] <= BURST:
            return True
        self._last[kind] = record
        return False

    def suppressed(self) -> list[tuple[int, logging.LogRecord]]:
        """Return how many records of each kind did not pass, and the newest of each."""
        return [(self._counts[kind] - BURST, record) for kind, record in self._last.items()]


@dataclass(frozen=True)
class LastError:
    """An error that was logged."""

    text: str
    at: float
    """`time.monotonic()`."""


class LogHandler(logging.Handler):
    """Writes records to an output, keeps a flood out and the last error in mind."""

    def __init__(self, output: Output, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._output, self._now = output, now
        self._flood = Flood()
        self._window_end = 0.0
        self._timer: threading.Timer | None = None
        self._errors: OrderedDict[str, LastError] = OrderedDict()
        self.errors = 0
        """Errors logged so far, passed or not."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record if it may pass. What is wrong with it is told here, not to whoever logs: it ends no loop."""
        try:
            self._take(record)
        except Exception as error:
            self._take(_plain(record, f"a line that cannot be told ({type(error).__name__}): {record.msg!r:.200}"))

    def _take(self, record: logging.LogRecord) -> None:
        if not isinstance(record.msg, str):  # all that is no text is one kind
            record = _plain(record, str(record.msg))
        subject = subject_of(record)
        if record.levelno >= logging.ERROR:
            self._remember(subject, record)
        if self._now() >= self._window_end:
            self.end_window()
            self._window_end = self._now() + WINDOW
        reports = getattr(record, "event", None) is not None  # whoever started this process acts on it
        if reports or self._flood.passes((record.name, record.levelno, record.msg, subject), record):
            self._write(record)
        elif self._timer is None:
            self._timer = threading.Timer(self._window_end - self._now(), self.end_window)
            self._timer.daemon = True
            self._timer.start()

    def end_window(self) -> None:
        """Write how many records of each kind did not pass in this window; the next record begins another one."""
        self.acquire()
        try:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            flood, self._flood, self._window_end = self._flood, Flood(), 0.0
            for count, last in flood.suppressed():
                text = f"suppressed={count} the last: {_said(last)}"
                self._write(logging.LogRecord(last.name, last.levelno, "", 0, text, None, None))
        finally:
            self.release()

    def _write(self, record: logging.LogRecord) -> None:
        priority = PRIORITIES.get(record.levelname, output.INFORMATIONAL)
        self._output.write(self.format(record), priority, event=getattr(record, "event", None))

    def last_error(self, subject: str) -> LastError | None:
        """Return the newest error that is about an agent, robot or board, or about nobody in particular."""
        found = [one for name in (subject, "") if (one := self._errors.get(name)) is not None]
        return max(found, key=lambda one: one.at, default=None)

    def _remember(self, subject: str, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if record.exc_info and (error := record.exc_info[1]) is not None:
            text += f" error={type(error).__name__}: {error}"
        self.errors += 1
        self._errors[subject] = LastError(one_line(text), self._now())
        self._errors.move_to_end(subject)
        if len(self._errors) > SUBJECTS:
            self._errors.popitem(last=False)


class LineFormatter(logging.Formatter):
    """A prefix, such as `%(levelname)s `, and the message of the record as one line."""

    def __init__(self, prefix: str) -> None:
        super().__init__(f"{prefix}%(message)s", "%H:%M:%S")

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line; of an error that was caught, what it is and where it was raised."""
        said, _, trace = super().format(record).partition("\n" if record.exc_info else "\0")
        if record.exc_info and os.environ.get("ARGOSY_DEBUG"):
            return f"{one_line(said)}\n{trace}"
        return one_line(f"{said} {trace}".rstrip())

    def formatException(self, ei: Any) -> str:
        """Return what was raised and where; all of it with ARGOSY_DEBUG=1."""
        kind, error, trace = ei
        if os.environ.get("ARGOSY_DEBUG"):
            return "".join(traceback.format_exception(kind, error, trace)).rstrip()
        frames = traceback.extract_tb(trace)
        at = f" at={os.path.relpath(frames[-1].filename)}:{frames[-1].lineno}" if frames else ""
        return f"error={type(error).__name__}: {error}{at}"


def _plain(record: logging.LogRecord, text: str) -> logging.LogRecord:
    """Return a record that says a text in place of what it said."""
    return logging.LogRecord(record.name, record.levelno, record.pathname, record.lineno, "%s", (text,), None)


def _said(record: logging.LogRecord) -> str:
    try:
        return record.getMessage()
    except Exception:
        return str(record.msg)


def begin_logging(daemon: str) -> LogHandler:
    """Log to standard error from now on, as a daemon of this name, from level INFO on.

    A line is `LEVEL daemon logger text`, with the time before it where the reader does not note that himself. A
    `LogLine` has the text alone.
    """
    handler = LogHandler(stderr())
    when = "" if stderr().dates_its_lines else "%(asctime)s.%(msecs)03d "
    handler.setFormatter(LineFormatter("" if stderr().structured else f"{when}%(levelname)s {daemon} %(name)s "))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    return handler


def handler_of_this_process() -> LogHandler | None:
    """Return what this process logs by; None if it is no daemon."""
    return next((one for one in logging.getLogger().handlers if isinstance(one, LogHandler)), None)


def subject_of(record: logging.LogRecord) -> str:
    """Return the agent, robot or board that a record is about; empty for one that does not begin with that."""
    if not (record.args and isinstance(record.args, tuple) and _SUBJECT.match(str(record.msg))):
        return ""
    return str(record.args[0])


def one_line(text: str) -> str:
    """Return a text without line breaks and what a terminal takes for a command, that is Unicode, of bounded length."""
    return cut(escape_line(text.rstrip("\n")))
