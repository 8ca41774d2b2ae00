"""What a simulated copter's servo outputs did, where and when: JSON lines that a referee reads.

The log tells the truth of the simulation, not what anybody was told. A line is on its way to the disk before the
vehicle answers the command.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import msgspec

from bridged.simulation.copter.copter import Copter


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
    """Writes the moves of one copter."""

    def __init__(self, path: Path) -> None:
        """Raises OSError."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb", buffering=0)

    def moved(self, copter: Copter, system: int, age: float, output: int, pulse: int) -> None:
        """Write that an output got another pulse. Raises OSError."""
        place, position, home = copter.place, copter.motion.position, copter.home_on_chart
        away = math.hypot(position.north - home.north, position.east - home.east)
        move = ServoMove(
            round(age, 2), system, output, pulse, round(place.lat, 7), round(place.lon, 7),
            round(position.up, 2), round(away, 2), copter.armed,
        )  # fmt: skip
        self._file.write(msgspec.json.encode(move) + b"\n")

    def close(self) -> None:
        """Write no more."""
        self._file.close()


def read_moves(path: Path) -> Iterator[ServoMove]:
    """Yield the moves of a log. Raises OSError, and ValueError for a line that is none."""
    for number, line in enumerate(path.read_bytes().splitlines(), 1):
        try:
            yield msgspec.json.decode(line, type=ServoMove)
        except msgspec.DecodeError as error:
            raise ValueError(f"{path}:{number}: {error}") from None
