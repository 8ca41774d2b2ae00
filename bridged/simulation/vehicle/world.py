"""The simulated world of a search: where its victims are, and the log of what copters dropped, both for a referee.

The same seed, number and area give the same victims everywhere: in the simulator of the copter whose camera may see
them, and in the referee who counts the buoys. No program and no robot gets them otherwise. The log tells the truth of
the simulation; a line is written before the vehicle acknowledges the command.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from schemas.geo import distance

if TYPE_CHECKING:
    from bridged.simulation.vehicle.autopilot import Autopilot

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
    """Return `count` (1 or more) victims, the same for each `seed` (any integer).

    Raises ValueError if the area has no room for them.
    """
    dice = random.Random(f"victims {seed}")
    found: list[Victim] = []
    for _ in range(_TRIES):
        if len(found) == count:
            return found
        lat, lon = dice.uniform(area.south, area.north), dice.uniform(area.west, area.east)
        if all(distance((lat, lon), (other.lat, other.lon)) >= APART for other in found):
            found.append(Victim(len(found) + 1, round(lat, 7), round(lon, 7)))
    raise ValueError(f"the area has no room for {count} victims, {APART:g} m apart")


class ServoMove(msgspec.Struct, frozen=True):
    """An output got another pulse."""

    at: float
    """Vehicle seconds since it was switched on."""
    copter: int
    """System id."""
    output: int
    pulse: int
    """Microseconds."""
    lat: float
    """degrees"""
    lon: float
    height: float
    """Metres above the ground."""
    home: float
    """Metres over ground from home."""
    armed: bool


class ServoLog:
    """Log of one copter's servo moves."""

    def __init__(self, path: Path) -> None:
        """Raises OSError."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb", buffering=0)

    def moved(self, vehicle: Autopilot, system: int, age: float, output: int, pulse: int) -> None:
        """Write that an `output` (from 1) of a vehicle (`system` id) got another `pulse` (µs). Raises OSError.

        `age`: vehicle seconds since it was switched on.
        """
        place, position, home = vehicle.true_place, vehicle.truth, vehicle.home_on_chart
        away = math.hypot(position.north - home.north, position.east - home.east)
        move = ServoMove(
            round(age, 2), system, output, pulse, round(place.lat, 7), round(place.lon, 7),
            round(position.up, 2), round(away, 2), vehicle.armed,
        )  # fmt: skip
        self._file.write(msgspec.json.encode(move) + b"\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_moves(path: Path) -> Iterator[ServoMove]:
    """Yield the moves of a log. Raises OSError, and ValueError for a line that is none."""
    for number, line in enumerate(path.read_bytes().splitlines(), 1):
        try:
            yield msgspec.json.decode(line, type=ServoMove)
        except msgspec.DecodeError as error:
            raise ValueError(f"{path}:{number}: {error}") from None
