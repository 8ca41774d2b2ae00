"""Items of missions, and how numbers in messages are read."""

import math
from dataclasses import dataclass

GLOBAL_FRAMES = (0, 5)
"""Coordinate frames whose altitude is above mean sea level."""

RELATIVE_FRAMES = (3, 6, 10, 11)
"""Coordinate frames whose altitude is above home; terrain counts as flat at home's height."""


@dataclass(frozen=True, slots=True)
class Item:
    """One mission item with the fields of MISSION_ITEM_INT."""

    seq: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1


def whole(value: float) -> int:
    """A whole number from a field that any sender can fill with anything; -1 for what is none."""
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else -1
