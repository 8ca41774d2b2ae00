"""What people type as arguments: names, counts and durations. Each reader raises ArgumentTypeError for what is none."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Callable

from schemas.files.units import Duration
from schemas.wire.keys import check_name

_COUNT = re.compile(r"0*[1-9][0-9]{0,8}")


def name(text: str) -> str:
    """Return the name of a fleet or of somebody in it: one chunk of a key, and no expression for several."""
    try:
        return check_name(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None


def count(text: str) -> int:
    """Return a number of things, at least one."""
    if not _COUNT.fullmatch(text):
        raise ArgumentTypeError(f"expected a number, 1 or more, got `{text}`")
    return int(text)


def duration(accepted: Callable[[float], bool], expected: str) -> Callable[[str], Duration]:
    """Return what reads seconds, and refuses those that are not accepted; `expected` says which are."""

    def read(text: str) -> Duration:
        try:
            seconds = Duration.read(text)
        except ValueError as error:
            raise ArgumentTypeError(str(error)) from None
        if not accepted(seconds):
            raise ArgumentTypeError(f"expected {expected}, got {text}")
        return seconds

    return read
