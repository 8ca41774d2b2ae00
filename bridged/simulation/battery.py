"""The battery of the simulated copter."""

from dataclasses import dataclass

from bridged.simulation.parameters import Parameters

VOLTAGE = 12.6
"""V; the recorded simulated battery kept its voltage."""

HOVER_CURRENT = 28.12
"""A, recorded."""


@dataclass(slots=True)
class Battery:
    """Counts the charge that was used."""

    parameters: Parameters
    used: float = 0.0  # mAh
    current: float = 0.0  # A

    def step(self, dt: float, *, flying: bool) -> None:
        """Draws the current of a hover for `dt` seconds, or none."""
        self.current = HOVER_CURRENT if flying else 0.0
        self.used += self.current * dt / 3.6

    @property
    def remaining(self) -> int:
        """Per cent."""
        capacity = max(1.0, self.parameters["BATT_CAPACITY"])
        return max(0, min(100, round(100 * (1 - self.used / capacity))))
