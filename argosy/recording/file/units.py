"""Units of a recording."""

from typing import Final

SECOND: Final = 1_000_000_000
"""Nanoseconds."""
