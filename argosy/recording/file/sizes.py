"""Sizes of files as people write them: `2GB`, `500MB`, `64kB`, or a number of bytes."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError

from schemas.files.durations import Duration

_UNITS = {"": 1, "b": 1, "kb": 1_000, "mb": 1_000_000, "gb": 1_000_000_000, "tb": 1_000_000_000_000}
_SHAPE = re.compile(r"(\d+(?:\.\d+)?)\s*([A-Za-z]*)")
SMALLEST = 1_000_000


def size(text: str) -> int:
    """Read the size of a recording from the command line. Raises ArgumentTypeError that says what was expected."""
    found = _SHAPE.fullmatch(text.strip())
    if found is None or found[2].lower() not in _UNITS:
        raise ArgumentTypeError(f"expected a size such as `2GB` or `500MB`, got `{text}`")
    read = int(float(found[1]) * _UNITS[found[2].lower()])
    if read < SMALLEST:
        raise ArgumentTypeError(f"expected 1MB at least, got `{text}`")
    return read


def duration(text: str) -> Duration:
    """Read a duration of more than nothing. Raises ArgumentTypeError that says what was expected."""
    try:
        read = Duration.read(text)
    except ValueError as error:
        said = str(error)
        raise ArgumentTypeError(said[0].lower() + said[1:]) from None
    if not read:
        raise ArgumentTypeError("expected more than 0 s")
    return read
