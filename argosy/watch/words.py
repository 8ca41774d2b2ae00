"""Small words of the view: spans of time, places of a program, where the fleet stands."""

from __future__ import annotations

import math
import re
import time

_FOLDERS = re.compile(r"[^\s(,]*/(?=[^\s/(,]+:\d)")
_LONG = re.compile(r"(\.\d{6})\d+")


def span(seconds: float) -> str:
    """Return how long, in as few letters as tell it: `0.4 s`, `12 s`, `3 min`, `2 h 5 min`."""
    if not math.isfinite(seconds):
        return "? s"
    if seconds < 9.95:
        return f"{max(0.0, seconds):.1f} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds // 3600:.0f} h {seconds % 3600 // 60:.0f} min"


def clock(at: float) -> str:
    """Return the time of day of this machine."""
    return time.strftime("%H:%M:%S", time.localtime(at))


def place(position: str) -> str:
    """Return `file:line` without the folders."""
    return position.rpartition("/")[2]


def count(number: int, what: str) -> str:
    """Return `1 message`, `2 messages`."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def rounded(text: str) -> str:
    """Return a text whose numbers have six digits behind the point at most: degrees to 0.1 m."""
    return _LONG.sub(r"\1", text)


def places(text: str) -> str:
    """Return a text whose `file:line` have no folders."""
    return _FOLDERS.sub("", text)
