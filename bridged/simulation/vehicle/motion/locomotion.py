"""What a copter's flight, a plane's flight and a rover's drive have in common: one task at a time, motors, landing."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Generic, Self, TypeVar

from bridged.simulation.vehicle.motion.dynamics import Axis, Motion, Vector
from bridged.simulation.vehicle.motion.tasks import Landed, Stop, Task
from bridged.simulation.vehicle.parameters import Parameters

T = TypeVar("T")
Tuning = Callable[[Parameters, float | None], T]
"""Derives how a vehicle moves from its parameters and the speed of legs that DO_CHANGE_SPEED has set, in m/s."""


class Locomotion(ABC, Generic[T]):
    """What moves a vehicle. `reached` is set when its task is done: a takeoff, a leg, a landing."""

    MOTION: ClassVar[type[Motion]]
    heading_wish: float | None = None
    """Heading in radians where a task has none, as CONDITION_YAW sets it; only a copter turns to it."""
    lift_at: float | None = None
    """When it will leave the ground, in vehicle seconds; None: it is not about to."""

    def __init__(self, motion: Motion, tuning: Callable[[float | None], T]) -> None:
        """`tuning` is called before each use, with the speed of legs that DO_CHANGE_SPEED has set (m/s)."""
        self.motion = motion
        self._tuning = tuning
        self.armed = False
        self.airborne = False
        self.landed = Landed.ON_GROUND
        self.task: Task = Stop()
        self.cruise_speed: float | None = None
        self.reached = False
        self.touchdown_at: float | None = None
        self.touchdown_speed = 0.0
        self.now = 0.0
        """Vehicle seconds, set by the autopilot before each step."""

    @classmethod
    def by_parameters(cls, heading: float, parameters: Parameters, derive: Tuning[T]) -> Self:
        """Make one with a heading in radians; the tuning is derived again only when a parameter has changed."""
        known: dict[tuple[float | None, int], T] = {}

        def tuning(speed: float | None) -> T:
            key = speed, parameters.changes
            if key not in known:
                known.clear()
                known[key] = derive(parameters, speed)
            return known[key]

        return cls(cls.MOTION(heading), tuning)

    @property
    def tuning(self) -> T:
        """The present tuning."""
        return self._tuning(self.cruise_speed)

    @property
    def height(self) -> float:
        """Metres above the ground."""
        return self.motion.up.position

    @property
    @abstractmethod
    def target(self) -> Vector | None:
        """Goal of the present task, if the autopilot reports one (POSITION_TARGET_GLOBAL_INT)."""

    @abstractmethod
    def arm(self) -> None:
        """Start the motors."""

    @abstractmethod
    def disarm(self) -> None:
        """Stop the motors, even in the air."""

    @abstractmethod
    def begin(self, task: Task) -> None:
        """Begin another task from the present motion."""

    @abstractmethod
    def step(self, dt: float) -> None:
        """One step of `dt` seconds that ends at `now`."""

    def fall_from(self, up: Axis) -> None:
        """Start in the air with the motors off, after a restart of the autopilot in flight."""
        self.motion.up, self.airborne, self.landed = up, True, Landed.IN_AIR

    def meet_ground(self) -> bool:
        """Note a touchdown if it sinks into the ground; returns whether it does."""
        up = self.motion.up
        if up.position > 0.0 or up.velocity > 0.0:
            return False
        self.touchdown_speed, self.touchdown_at = -up.velocity, self.now
        self.airborne, up.position = False, 0.0
        return True
