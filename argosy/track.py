"""The flown track of one robot: where it was when, and what changed on the way."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

MAX_POINTS = 20_000
"""Points that are kept; when there are more, every second one goes."""
EARTH_RADIUS = 6_378_137.0
"""Metres; the flight areas are small enough for a plane that touches the sphere at home."""


@dataclass(frozen=True)
class Point:
    """A place at a time: mission seconds, degrees, metres above home (None = not known)."""

    at: float
    latitude: float
    longitude: float
    altitude: float | None


@dataclass
class Track:
    """What the observer saw of a flight."""

    points: list[Point] = field(default_factory=list)
    modes: list[tuple[float, str]] = field(default_factory=list)
    armed_at: list[tuple[float, bool]] = field(default_factory=list)
    home: tuple[float, float] | None = None
    every: int = 1
    """One of so many positions is kept now."""
    _seen: int = 0

    def moved(self, at: float, latitude: float, longitude: float, altitude: float | None) -> None:
        """Add a position."""
        self._seen += 1
        if self._seen % self.every == 0:
            self.points.append(Point(at, latitude, longitude, altitude))
        if len(self.points) > MAX_POINTS:
            del self.points[1::2]
            self.every *= 2

    def changed_mode(self, at: float, mode: str) -> None:
        """Add a change of mode."""
        if len(self.modes) < MAX_POINTS:
            self.modes.append((at, mode))

    def length(self) -> float:
        """Return the metres flown over ground while armed."""
        points = [point for point in self.points if self.armed(point.at)]
        return sum(
            math.dist(metres((b.latitude, b.longitude), (a.latitude, a.longitude)), (0.0, 0.0))
            for a, b in pairwise(points)
        )

    def highest(self) -> float | None:
        """Return the greatest altitude in metres above home."""
        return max((point.altitude for point in self.points if point.altitude is not None), default=None)

    def armed(self, at: float) -> bool:
        """Whether the vehicle was armed at a time."""
        state = False
        for when, armed in self.armed_at:
            if when > at:
                break
            state = armed
        return state


def metres(position: tuple[float, float], origin: tuple[float, float]) -> tuple[float, float]:
    """Return how far east and north of an origin a position is."""
    north = math.radians(position[0] - origin[0]) * EARTH_RADIUS
    turn = (position[1] - origin[1] + 180) % 360 - 180
    return math.radians(turn) * EARTH_RADIUS * math.cos(math.radians(origin[0])), north


def distance(position: tuple[float, float], origin: tuple[float, float]) -> float:
    """Return metres over ground between two positions."""
    return math.hypot(*metres(position, origin))
