"""Small texts of the view: times of day, places of a program, rounded numbers."""

from __future__ import annotations

import re
import time

_FOLDERS = re.compile(r"[^\s(,]*/(?=[^\s/(,]+:\d)")
_LONG = re.compile(r"(\.\d{6})\d+")


def clock(at: float) -> str:
    """Return the time of day of this machine."""
    return time.strftime("%H:%M:%S", time.localtime(at))


def place(position: str) -> str:
    """Return `file:line` without the folders."""
    return position.rpartition("/")[2]


def rounded(text: str) -> str:
    """Return a text whose numbers have six digits behind the point at most: degrees to 0.1 m."""
    return _LONG.sub(r"\1", text)


def places(text: str) -> str:
    """Return a text whose `file:line` have no folders."""
    return _FOLDERS.sub("", text)
