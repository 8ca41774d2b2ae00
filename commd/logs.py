"""What a daemon logs: one line for each record, with its level, for people, the journal and `argosy run`; no flood.

Of each kind of message (its text before the values are filled in, and whose it is) `BURST` lines pass at once and
`PER_SECOND` from then on. What does not pass is counted, and the count is told every `TOLD_EVERY` seconds.
"""

from __future__ import annotations

import logging
import os
import re
import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from commd.output import Output, stderr
from schemas.terminal import escape_line

BURST = 50
"""Lines of one kind that pass at once."""
PER_SECOND = 1.0
"""Lines of one kind that pass each wall second from then on."""
TOLD_EVERY = 10.0
"""Wall seconds between two counts of what did not pass."""
KINDS = 500
"""Kinds of messages that are told apart; all further ones together are one more kind."""
SUBJECTS = 500
"""Agents, robots and boards whose last error is kept."""
LONGEST = 4_000
"""Characters of a line; the rest is counted."""
PRIORITIES = {"DEBUG": 7, "INFO": 6, "WARNING": 4, "ERROR": 3, "CRITICAL": 2}
"""The levels as syslog and the journal number them."""
_SUBJECT = re.compile(r"(?:agent|robot|board)=%s")


@dataclass
class _Kind:
    left: float = BURST
    since: float = 0.0
    suppressed: int = 0
    last: logging.LogRecord | None = None
    """The newest that did not pass."""


class Flood:
    """Lets so many lines of each kind pass, and counts the rest. Pure: wall seconds go in."""

    def __init__(self) -> None:
        self._kinds: dict[object, _Kind] = {}

    def passes(self, kind: object, record: logging.LogRecord, now: float) -> bool:
        """Whether a record may be written; if not, it is counted."""
        found = self._kinds.get(kind) or self._begin(kind, now)
        found.left = min(BURST, found.left + (now - found.since) * PER_SECOND)
        found.since = now
        if found.left < 1:
            found.suppressed += 1
            found.last = record
            return False
        found.left -= 1
        return True

    def untold(self) -> list[tuple[int, logging.LogRecord]]:
        """Return how many of each kind did not pass since this was asked last, and the newest of each."""
        told = [(kind.suppressed, kind.last) for kind in self._kinds.values() if kind.last is not None]
        for kind in self._kinds.values():
            kind.suppressed, kind.last = 0, None
        return told

    def _begin(self, kind: object, now: float) -> _Kind:
        if len(self._kinds) >= KINDS:
            for key, one in list(self._kinds.items()):
                if one.last is None and now - one.since > BURST / PER_SECOND:
                    del self._kinds[key]
            if len(self._kinds) >= KINDS:
                kind = None
        return self._kinds.setdefault(kind, _Kind(since=now))


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
        if self._flood.passes((record.name, record.levelno, record.msg, subject), record, self._now()):
            self._write(record)
        elif self._timer is None:
            self._timer = threading.Timer(TOLD_EVERY, self.tell_suppressed)
            self._timer.daemon = True
            self._timer.start()

    def tell_suppressed(self) -> None:
        """Tell how many of each kind did not pass since this was told last."""
        self.acquire()
        try:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            for count, last in self._flood.untold():
                text = f"suppressed={count} the last: {_said(last)}"
                self._write(logging.LogRecord(last.name, last.levelno, "", 0, text, None, None))
        finally:
            self.release()

    def _write(self, record: logging.LogRecord) -> None:
        self._output.write(self.format(record), PRIORITIES.get(record.levelname, 6))

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
    """`LEVEL daemon logger text`, with the time before it where the reader does not note that himself."""

    def __init__(self, daemon: str, *, dated: bool) -> None:
        when = "%(asctime)s.%(msecs)03d " if dated else ""
        super().__init__(f"{when}%(levelname)s {daemon} %(name)s %(message)s", "%H:%M:%S")

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
    """Log to standard error from now on, as a daemon of this name, from level INFO on."""
    handler = LogHandler(stderr())
    handler.setFormatter(LineFormatter(daemon, dated=not stderr().dates_its_lines))
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
    text = escape_line(text.rstrip("\n"))
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}… ({len(text) - LONGEST} characters more)"
