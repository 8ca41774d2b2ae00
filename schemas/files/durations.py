"""Durations as people write them in missions and manifests: `5s`, `500ms`, `15min`, `1h`, or a number of seconds."""

from __future__ import annotations

import re
import sys
from typing import Final

from schemas.files.units import Distance

_LARGEST: Final = sys.float_info.max
"""A TOML or YAML integer may be larger than any float."""
_UNITS = {"ms": 0.001, "s": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0}
_SHAPE = re.compile(r"(\d+(?:\.\d+)?)\s*(ms|s|min|m|h)?")


class Duration(float):
    """A length of time in seconds."""

    @classmethod
    def read(cls, value: object) -> Duration:
        """Read a duration. Raises ValueError that says what was expected."""
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= _LARGEST:
            return cls(value)
        if isinstance(value, str) and (found := _SHAPE.fullmatch(value.strip())):
            seconds = float(found[1]) * _UNITS[found[2] or "s"]
            if seconds < float("inf"):
                return cls(seconds)
        raise ValueError(f"Expected a duration such as `5s`, `500ms` or `15min`, got `{value}`")

    def __str__(self) -> str:
        if self >= 60 and self % 60 == 0:
            return f"{self / 60:g}min"
        return f"{self * 1000:g}ms" if 0 < self < 1 else f"{float(self):g}s"


def decode_hook(expected: type, value: object) -> object:
    """msgspec's `dec_hook` for the files that people write. Raises ValueError that says what was expected."""
    if expected is Duration:
        return Duration.read(value)
    if expected is Distance:
        return Distance.read(value)
    raise NotImplementedError(f"no decoding for {expected!r}")
