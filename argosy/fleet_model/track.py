"""The flown track of one robot: where it was when, and what changed on the way."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

from schemas.geo import distance

MAX_POINTS = 20_000
"""Points that are kept; when there are more, every second one goes."""


@dataclass(frozen=True)
class Point:
    """A place at a time: mission seconds, degrees."""

    at: float
    latitude: float
    longitude: float


@dataclass
class Track:
    """What the observer saw of a flight."""

    points: list[Point] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)
    """Mission seconds and metres above home. Not part of the points: a vehicle may climb and stay in its place."""
    modes: list[tuple[float, str]] = field(default_factory=list)
    armed_at: list[tuple[float, bool]] = field(default_factory=list)
    home: tuple[float, float] | None = None
    most: int = MAX_POINTS
    """Points that are kept of this track."""

    def moved(self, at: float, latitude: float, longitude: float) -> None:
        """Add a position."""
        self.points.append(Point(at, latitude, longitude))
        if len(self.points) > self.most:
            del self.points[1::2]

    def climbed(self, at: float, altitude: float) -> None:
        """Add an altitude."""
        self.heights.append((at, altitude))
        if len(self.heights) > self.most:
            del self.heights[1::2]

    def changed_mode(self, at: float, mode: str) -> None:
        """Add a change of mode."""
        if len(self.modes) < self.most:
            self.modes.append((at, mode))

    def length(self) -> float:
        """Return the metres flown over ground while armed."""
        points = [point for point in self.points if self.armed(point.at)]
        return sum(distance((a.latitude, a.longitude), (b.latitude, b.longitude)) for a, b in pairwise(points))

    def highest(self) -> float | None:
        """Return the greatest altitude in metres above home."""
        return max((altitude for _, altitude in self.heights), default=None)

    def armed(self, at: float) -> bool:
        """Whether the vehicle was armed at a time."""
        state = False
        for when, armed in self.armed_at:
            if when > at:
                break
            state = armed
        return state
