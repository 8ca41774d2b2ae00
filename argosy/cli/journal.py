"""The journal of a run: entries with mission time, for the screen and the report's log."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TextIO

from schemas.humanize import printable

KEPT = 500
"""Entries kept for the view; the log file has all."""
MAX_LOGGED = 200_000
"""Limit of lines in the log file, so that a process that prints too much cannot fill the disk."""

Level = Literal["info", "print", "action", "good", "warning", "error", "output", "detail"]
"""Kind of an entry: `output` = a process wrote it, `detail` = for the log file only."""


@dataclass(frozen=True)
class Entry:
    """One event."""

    at: float
    """Mission seconds since the start of the run."""
    who: str
    text: str
    level: Level = "info"

    def __str__(self) -> str:
        return f"{self.at:8.1f} s  {self.who}: {self.text}"


class Journal:
    """Keeps the last entries, and passes each to the screen and the log file."""

    def __init__(self, now: Callable[[], float], log: TextIO | None = None) -> None:
        self.entries: deque[Entry] = deque(maxlen=KEPT)
        self.shown: Callable[[Entry], None] | None = None
        self._now, self._log = now, log
        self._logged = 0

    def add(self, who: str, text: str, level: Level = "info") -> None:
        """Add an entry at the present time."""
        entry = Entry(self._now(), who, printable(text), level)
        if level != "detail":
            self.entries.append(entry)
            if self.shown is not None:
                self.shown(entry)
        if self._log is not None and self._logged <= MAX_LOGGED:
            self._logged += 1
            last = f"the log ends here: {MAX_LOGGED} lines\n"
            try:
                self._log.write(f"{entry}\n" if self._logged <= MAX_LOGGED else last)
                self._log.flush()
            except OSError as error:  # a full disk must not end a flight
                self._log = None
                self.add("argosy", f"writing the log has failed and stops: {error.strerror}", "warning")
