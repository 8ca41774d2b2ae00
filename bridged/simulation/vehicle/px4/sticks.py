"""The pilot's sticks: MANUAL_CONTROL, or a radio while a pilot at the field has the vehicle."""

import math
from dataclasses import dataclass

from bridged.simulation.vehicle.motion.dynamics import Motion, Vector
from bridged.simulation.vehicle.motion.tasks import Drift

LOST_S = 0.5
"""Seconds without MANUAL_CONTROL after which the sticks are lost (COM_RC_LOSS_T)."""
_MOVED = 0.1
"""Share of a stick's way that it must be moved for an override."""
_CLIMB, _TURN = 3.0, math.radians(90)


@dataclass(slots=True)
class Sticks:
    """Sticks from -1 to 1: forward, right, up, turn to the right."""

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    turn: float = 0.0
    at: float = -math.inf
    """When they were read last, in vehicle seconds."""
    speed: float = 0.0
    """How fast the fastest stick moved, in ways (half a stick's) per second."""
    radio: bool = False
    """Whether a radio is on: its sticks are centred."""

    def move(self, x: int, y: int, z: int, r: int, now: float) -> None:
        """MANUAL_CONTROL: -1000..1000, `z` 0..1000."""
        before = (self.forward, self.right, self.up, self.turn)
        self.forward, self.right, self.up, self.turn = x / 1000, y / 1000, (z - 500) / 500, r / 1000
        moved = max(
            abs(one - other) for one, other in zip((self.forward, self.right, self.up, self.turn), before, strict=True)
        )
        self.speed = max(self.speed, moved / max(0.01, now - self.at)) if self.alive(now) else 0.0
        self.at = now

    def alive(self, now: float) -> bool:
        """Return whether the sticks are read."""
        return self.radio or now - self.at <= LOST_S

    def override(self, threshold: float) -> bool:
        """Return whether the sticks were moved far and fast since the last call: ways per second."""
        fast, self.speed = self.speed, 0.0
        return threshold > 0 and fast >= threshold and max(map(abs, (self.forward, self.right, self.turn))) >= _MOVED

    def drift(self, motion: Motion, now: float, fastest: float) -> Drift:
        """Return the velocity that the sticks want of a vehicle; `fastest` in m/s."""
        forward, right = self.forward * abs(self.forward) * fastest, self.right * abs(self.right) * fastest
        velocity = Vector(*motion.turned(forward, right), self.up * _CLIMB)
        return Drift(velocity, now + 1.0, turn_rate=self.turn * _TURN)
