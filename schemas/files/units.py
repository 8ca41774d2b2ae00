"""Distances as people write them in missions: `300m`, `1.5km`, or a number of metres."""

from __future__ import annotations

import re
import sys
from typing import Final

_LARGEST: Final = sys.float_info.max
"""A TOML or YAML integer may be larger than any float."""
_UNITS = {"m": 1.0, "km": 1000.0}
_SHAPE = re.compile(r"(\d+(?:\.\d+)?)\s*(m|km)?")


class Distance(float):
    """A length in metres."""

    @classmethod
    def read(cls, value: object) -> Distance:
        """Read a distance. Raises ValueError that says what was expected."""
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= _LARGEST:
            return cls(value)
        if isinstance(value, str) and (found := _SHAPE.fullmatch(value.strip())):
            metres = float(found[1]) * _UNITS[found[2] or "m"]
            if metres < float("inf"):
                return cls(metres)
        raise ValueError(f"Expected a distance such as `300m` or `1.5km`, got `{value}`")

    def __str__(self) -> str:
        return f"{self / 1000:g}km" if self >= 1000 else f"{float(self):g}m"
