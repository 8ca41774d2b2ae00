"""Distances on the earth. Positions are latitude and longitude in degrees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

EARTH_RADIUS: Final = 6_378_137.0
"""Metres; the equator's of WGS 84, with which autopilots reckon."""
Position = tuple[float, float]


def distance(here: Position, there: Position) -> float:
    """Return the great-circle distance in metres (haversine), good to 0.5 % anywhere."""
    north, east = math.radians(there[0] - here[0]), math.radians(there[1] - here[1])
    across = math.cos(math.radians(here[0])) * math.cos(math.radians(there[0])) * math.sin(east / 2) ** 2
    return 2 * EARTH_RADIUS * math.asin(math.sqrt(min(1.0, math.sin(north / 2) ** 2 + across)))


def offset(origin: Position, position: Position) -> tuple[float, float]:
    """Return how many metres east and north of `origin` a position is, on the plane that touches the earth there."""
    north = math.radians(position[0] - origin[0]) * EARTH_RADIUS
    turn = (position[1] - origin[1] + 180) % 360 - 180
    return math.radians(turn) * EARTH_RADIUS * math.cos(math.radians(origin[0])), north


def is_inside(point: Position, corners: Sequence[Position]) -> bool:
    """Return whether a point lies within a polygon; coordinates count as those of a plane."""
    (x, y), inside = point, False
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], *corners[:1]], strict=True):
        if (x1 > x) != (x2 > x) and y < y1 + (x - x1) / (x2 - x1) * (y2 - y1):
            inside = not inside
    return inside
