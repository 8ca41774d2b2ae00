"""Wind at the place of a simulated copter: a mean, and gusts that come and go (Ornstein-Uhlenbeck, seeded)."""

import math
import random

from bridged.simulation.vehicle.fault_injection import Faults, WindFault
from bridged.simulation.vehicle.motion.dynamics import Vector

GUST_LASTS_S = 3.0
"""Seconds after which a gust is down to 1/e."""


class Wind:
    """The motion of the air, in steps; `air` is the velocity of the present step in m/s."""

    def __init__(self, wind: WindFault, seed: int) -> None:
        towards = math.radians(wind.bearing + 180)
        self._mean = (wind.speed * math.cos(towards), wind.speed * math.sin(towards))
        self._gust, self._dice, self._gusts = wind.gust, random.Random(f"{seed} wind"), [0.0, 0.0]
        self.air = Vector(*self._mean)

    @classmethod
    def of(cls, faults: Faults) -> "Wind | None":
        """Return the wind among the faults of a vehicle; None: the air is still."""
        return cls(faults.wind, faults.seed) if faults.wind is not None else None

    def step(self, dt: float) -> Vector:
        """Advance by `dt` seconds and return the velocity of the air in m/s."""
        if self._gust:
            lasts = math.exp(-dt / GUST_LASTS_S)
            spread = self._gust * math.sqrt(1 - lasts * lasts)
            self._gusts = [one * lasts + self._dice.gauss(0.0, spread) for one in self._gusts]
            self.air = Vector(*(mean + gust for mean, gust in zip(self._mean, self._gusts, strict=True)))
        return self.air
