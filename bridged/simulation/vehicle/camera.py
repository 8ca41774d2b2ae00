"""A simulated camera under a copter: publishes the victims in view of the copter's true position.

A victim is seen within the camera's range over ground, unless a fault hides it, and from then on for `MEMORY` more: the
tracker behind a real camera keeps what it has found for a while too, and a router that restarts just then does not hide
anybody. A victim that was never in range is not reported.
"""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import Callable, Sequence

import msgspec

from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.world import Victim
from commd.bus.bus import open_bus
from schemas.geo import distance

LOOK_S = 0.1
"""Vehicle seconds between two looks."""
MEMORY = 30.0
"""Wall seconds for which a victim that is out of sight is still published."""
PERIOD = 0.2
"""Wall seconds between two publications."""
JSON = "application/json"


class Sighting(msgspec.Struct, frozen=True):
    """A victim as the camera publishes it."""

    id: int
    lat: float
    """degrees"""
    lon: float


class Camera:
    """The victims in view of one copter."""

    def __init__(self, victims: Sequence[Victim], reach: float, share: float = 1.0, seed: int = 0) -> None:
        """`reach`: metres over ground. `share`: chance that a victim is seen each time that it comes into range."""
        self._victims, self._reach, self._share = victims, reach, share
        self._dice = random.Random(f"{seed} camera")
        self._in_range: dict[Victim, bool] = {}
        """Whether each victim that is in range is seen."""
        self._seen: dict[Victim, float] = {}
        self._looked = float("-inf")

    def look(self, where: Callable[[], Place], age: float, wall: float) -> None:
        """Look down from a place at `age` vehicle seconds, if it is time; `wall`: monotonic wall seconds."""
        if age - self._looked < LOOK_S:
            return
        self._looked, at = age, where()
        for victim in self._victims:
            if distance((at.lat, at.lon), (victim.lat, victim.lon)) > self._reach:
                self._in_range.pop(victim, None)
            else:
                if victim not in self._in_range:
                    self._in_range[victim] = self._dice.random() < self._share
                if self._in_range[victim]:
                    self._seen[victim] = wall

    def sightings(self, wall: float) -> list[Sighting]:
        """Return the sightings to publish at `wall` monotonic wall seconds."""
        return [
            Sighting(victim.number, victim.lat, victim.lon)
            for victim, seen in self._seen.items()
            if wall - seen <= MEMORY
        ]


async def publish_sightings(camera: Camera, router: str, key: str, stop: asyncio.Event) -> None:
    """Put each sighting on `key` until `stop`. Raises BusClosed if the router does not come before the stop."""
    name = key.replace("/", ".")
    async with open_bus(router, fleet="simulation", name=name, daemon="camera", stop=stop) as bus:
        publisher = bus.raw.publisher(key)
        while not stop.is_set():
            for sighting in camera.sightings(time.monotonic()):
                publisher.put(msgspec.json.encode(sighting), JSON)
            await asyncio.sleep(PERIOD)
