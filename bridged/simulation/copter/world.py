"""The simulated world of a search: where its victims are, which no program and no robot is told.

The same seed, number and area give the same victims everywhere: in the simulator of the copter whose camera may see
them, and in the referee who counts the buoys.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

from schemas.geo import distance

APART = 15.0
"""Metres between two victims at least: a buoy falls to one of them."""
_TRIES = 10_000


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle by its borders in degrees."""

    south: float
    west: float
    north: float
    east: float

    def __post_init__(self) -> None:
        if not (-90 <= self.south < self.north <= 90 and -180 <= self.west < self.east <= 180):
            raise ValueError(
                "expected an area SOUTH,WEST,NORTH,EAST in degrees with south below north and west below east, "
                f"got {self.south},{self.west},{self.north},{self.east}"
            )


@dataclass(frozen=True, slots=True)
class Victim:
    """Somebody in the water."""

    number: int
    """From 1."""
    lat: float
    lon: float


def victims_of(seed: int, count: int, area: Area) -> list[Victim]:
    """Return the victims of a world. Raises ValueError if the area has no room for so many."""
    dice = random.Random(f"victims {seed}")
    found: list[Victim] = []
    for _ in range(_TRIES):
        if len(found) == count:
            return found
        lat, lon = dice.uniform(area.south, area.north), dice.uniform(area.west, area.east)
        if all(distance((lat, lon), (other.lat, other.lon)) >= APART for other in found):
            found.append(Victim(len(found) + 1, round(lat, 7), round(lon, 7)))
    raise ValueError(f"the area has no room for {count} victims, {APART:g} m apart")
