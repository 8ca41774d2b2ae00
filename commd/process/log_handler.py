"""Log one line per record, for people, the journal and `argosy run`, with flood control.

Of each kind of message (its template and subject) `BURST` lines pass in each `WINDOW`. The rest is counted, and the
count is logged at the end of the window.
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
"""Wall seconds of a window from its first line."""
KINDS = 500
"""Kinds of messages in one window; all further ones count as one kind."""
SUBJECTS = 500
"""Agents, robots and boards whose last error is remembered."""
PRIORITIES = {
    "DEBUG": output.DEBUG,
    "INFO": output.INFORMATIONAL,
    "WARNING": output.WARNING,
    "ERROR": output.ERROR,
    "CRITICAL": output.CRITICAL,
}
"""Levels by their numbers in syslog and the journal."""
_SUBJECT = re.compile(r"(?:agent|robot|board)=%s")


@dataclass(frozen=True)
class LastError:
    """A logged error."""

    text: str
    at: float
    """`time.monotonic()`."""


class LogHandler(logging.Handler):
    """Writes records to an output with flood control, and remembers the last errors."""

    def __init__(self, output: Output, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._output, self._now = output, now
        self._counts: Counter[object] = Counter()
        """The records of each kind in this window."""
        self._suppressed: dict[object, logging.LogRecord] = {}
        """The newest suppressed record of each kind."""
        self._window_end = 0.0
        self._timer: threading.Timer | None = None
        self._errors: OrderedDict[str, LastError] = OrderedDict()
        self.errors = 0
        """Errors logged so far, also the suppressed ones."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record unless it is suppressed. A record that cannot be formatted raises nothing to its caller."""
        try:
            self._take(record)
        except Exception as error:
            self._take(_plain(record, f"a line that cannot be formatted ({type(error).__name__}): {record.msg!r:.200}"))

    def _take(self, record: logging.LogRecord) -> None:
        if not isinstance(record.msg, str):  # everything that is not text is one kind
            record = _plain(record, str(record.msg))
        subject = subject_of(record)
        if record.levelno >= logging.ERROR:
            self._remember(subject, record)
        if self._now() >= self._window_end:
            self.end_window()
            self._window_end = self._now() + WINDOW
        reports = getattr(record, "event", None) is not None  # the supervisor acts on it
        if reports or self._passes((record.name, record.levelno, record.msg, subject), record):
            self._write(record)
        elif self._timer is None:
            self._timer = threading.Timer(self._window_end - self._now(), self.end_window)
            self._timer.daemon = True
            self._timer.start()

    def _passes(self, kind: object, record: logging.LogRecord) -> bool:
        """Return whether a record of a kind may be written: the first `BURST` of a window."""
        if kind not in self._counts and len(self._counts) >= KINDS:
            kind = None
        self._counts[kind] += 1
        if self._counts[kind] <= BURST:
            return True
        self._suppressed[kind] = record
        return False

    def end_window(self) -> None:
        """Log the number of suppressed records of each kind, and end the window."""
        self.acquire()
        try:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            counts, suppressed = self._counts, self._suppressed
            self._counts, self._suppressed, self._window_end = Counter(), {}, 0.0
            for kind, last in suppressed.items():
                text = f"suppressed={counts[kind] - BURST} the last: {_plain_text(last)}"
                self._write(logging.LogRecord(last.name, last.levelno, "", 0, text, None, None))
        finally:
            self.release()

    def _write(self, record: logging.LogRecord) -> None:
        priority = PRIORITIES.get(record.levelname, output.INFORMATIONAL)
        self._output.write(self.format(record), priority, event=getattr(record, "event", None))

    def last_error(self, subject: str) -> LastError | None:
        """Return the newest error about an agent, robot or board, or about none."""
        found = [one for name in (subject, "") if (one := self._errors.get(name)) is not None]
        return max(found, key=lambda one: one.at, default=None)

    def error_about(self, subject: str) -> LastError | None:
        """Return the newest error about an agent, robot or board alone."""
        return self._errors.get(subject)

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
        """Return the record as one line, with the type, text and position of a caught error."""
        text, _, trace = super().format(record).partition("\n" if record.exc_info else "\0")
        if record.exc_info and os.environ.get("ARGOSY_DEBUG"):
            return f"{one_line(text)}\n{trace}"
        return one_line(f"{text} {trace}".rstrip())

    def formatException(self, ei: Any) -> str:
        """Return what was raised and where; the whole traceback with ARGOSY_DEBUG=1."""
        kind, error, trace = ei
        if os.environ.get("ARGOSY_DEBUG"):
            return "".join(traceback.format_exception(kind, error, trace)).rstrip()
        frames = traceback.extract_tb(trace)
        at = f" at={os.path.relpath(frames[-1].filename)}:{frames[-1].lineno}" if frames else ""
        return f"error={type(error).__name__}: {error}{at}"


def _plain(record: logging.LogRecord, text: str) -> logging.LogRecord:
    """Return a copy of a record with another text."""
    return logging.LogRecord(record.name, record.levelno, record.pathname, record.lineno, "%s", (text,), None)


def _plain_text(record: logging.LogRecord) -> str:
    try:
        return record.getMessage()
    except Exception:
        return str(record.msg)


def begin_logging(daemon: str) -> LogHandler:
    """Log to standard error from now on, as a daemon of this name, from level INFO on.

    A line is `LEVEL daemon logger text`, after the time if the reader does not add it. A `LogLine` has only the text.
    """
    handler = LogHandler(stderr())
    when = "" if stderr().dates_its_lines else "%(asctime)s.%(msecs)03d "
    handler.setFormatter(LineFormatter("" if stderr().structured else f"{when}%(levelname)s {daemon} %(name)s "))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    # no line tells where it was logged; to find that out would take longer than the rest of it (logging HOWTO)
    logging._srcfile = None
    logging.logThreads = logging.logMultiprocessing = logging.logProcesses = False
    return handler


def handler_of_this_process() -> LogHandler | None:
    """Return this process's log handler; None if it is no daemon."""
    return next((one for one in logging.getLogger().handlers if isinstance(one, LogHandler)), None)


def subject_of(record: logging.LogRecord) -> str:
    """Return the agent, robot or board that a record begins with; empty if there is none."""
    if not (record.args and isinstance(record.args, tuple) and _SUBJECT.match(str(record.msg))):
        return ""
    return str(record.args[0])


def one_line(text: str) -> str:
    """Return a text as one line of valid Unicode, without terminal commands, of bounded length."""
    return cut(escape_line(text.rstrip("\n")))
