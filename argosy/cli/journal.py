"""What happened in a run, line by line with mission time: for the screen, and for the report's log."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TextIO

from schemas.humanize import printable

KEPT = 500
"""Entries kept for the view; the log file has them all."""
MAX_LOGGED = 200_000
"""Lines written to the log file at most, so that a chattering process cannot fill the disk."""

Level = Literal["info", "print", "action", "good", "warning", "error", "output", "detail"]
"""What kind of entry it is; `output` is what a process wrote, `detail` what only the log file needs."""


@dataclass(frozen=True)
class Entry:
    """One thing that happened."""

    at: float
    """Mission seconds since the start of the run."""
    who: str
    text: str
    level: Level = "info"

    def __str__(self) -> str:
        return f"{self.at:8.1f} s  {self.who}: {self.text}"


class Journal:
    """Takes entries, keeps the last ones and hands every one to whoever shows or writes them."""

    def __init__(self, now: Callable[[], float], log: TextIO | None = None) -> None:
        self.entries: deque[Entry] = deque(maxlen=KEPT)
        self.shown: Callable[[Entry], None] | None = None
        self._now, self._log = now, log
        self._logged = 0

    def add(self, who: str, text: str, level: Level = "info") -> None:
        """Note that something happened just now."""
        entry = Entry(self._now(), who, printable(text), level)
        if level != "detail":
            self.entries.append(entry)
            if self.shown is not None:
                self.shown(entry)
        if self._log is not None and self._logged <= MAX_LOGGED:
            self._logged += 1
            last = f"the log ends here: {MAX_LOGGED} lines\n"
            self._write(self._log, f"{entry}\n" if self._logged <= MAX_LOGGED else last)

    def _write(self, log: TextIO, text: str) -> None:
        try:
            log.write(text)
            log.flush()
        except OSError as error:  # a full disk must not end a flight
            self._log = None
            self.add("argosy", f"the log cannot be written any more: {error.strerror}", "warning")
