"""How a simulated rover drives: it steers to where it goes, speeds up, brakes in time, and rolls out."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from bridged.simulation.vehicle.motion.dynamics import Motion, Vector
from bridged.simulation.vehicle.motion.locomotion import Locomotion
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo, Return, Stop, Task

_STANDS = 0.03
"""m/s below which it stands."""
_TURNING = 0.9
"""m/s while it turns on the spot."""
_STEER_GAIN = 1.4  # 1/s: heading off to rate of turn


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverTuning:
    """How an autopilot drives a rover, by its parameters: metres, m/s, seconds."""

    speed: float
    accel: float
    brake: float
    """Deceleration that a stop at the goal is planned with, m/s²."""
    turn_rate: float
    """rad/s at most."""
    radius: float
    """Around a goal, within which a leg is done."""
    roll_out: float
    """Time constant of its speed when nothing drives it."""
    delay: float
    """From an order until it moves."""
    overshoot: float = 1.0
    """How much faster than a wanted velocity it drives."""


class RoverMotion(Motion):
    """Place, heading and speed of a rover."""

    @property
    def steady(self) -> bool:
        """It is stepped finely: there is little to compute."""
        return False

    @property
    def tilt(self) -> tuple[float, float]:
        """It stands level."""
        return 0.0, 0.0


class RoverDrive(Locomotion[RoverTuning]):
    """A rover with motors."""

    MOTION = RoverMotion

    def __init__(self, motion: Motion, tuning: Callable[[float | None], RoverTuning]) -> None:
        super().__init__(motion, tuning)
        self.speed = 0.0
        """m/s along its heading; backwards if < 0."""
        self._begun = 0.0

    @property
    def airborne(self) -> bool:
        """Whether it drives, or would: a rover is under way while its motors are on."""
        return self.armed

    @airborne.setter
    def airborne(self, value: bool) -> None:
        del value  # a rover does not fall

    @property
    def target(self) -> Vector | None:
        """Goal of the present task."""
        return self.task.goal if isinstance(self.task, GoTo) else None

    def arm(self) -> None:
        """Switch the motors on."""
        self.armed, self.touchdown_at = True, None

    def disarm(self) -> None:
        """Switch the motors off; it rolls out."""
        self.armed, self.touchdown_at = False, self.now

    def begin(self, task: Task) -> None:
        """Begin another task from the present motion."""
        if isinstance(task, Return):
            task = GoTo(task.home)
        if type(task) is not type(self.task) or (isinstance(task, GoTo) and abs(self.speed) < _STANDS):
            self._begun = self.now
        self.task, self.reached = task, False

    def step(self, dt: float) -> None:
        """One step of `dt` seconds that ends at `now`."""
        if not self.armed:
            self._roll(dt)
            if abs(self.speed) < _STANDS:
                self.speed, self.touchdown_at = 0.0, None
                self.motion.rest()
            return
        match self.task:
            case GoTo(goal) as leg:
                self._go(goal, leg, dt)
            case Drift() as drift:
                self._drift(drift, dt)
            case Stop(hard=True):
                self._move(0.0, 0.0, dt)
            case _:
                self._roll(dt)

    def _go(self, goal: Vector, leg: GoTo, dt: float) -> None:
        tuning, here = self.tuning, self.motion.position
        north, east = goal.north - here.north, goal.east - here.east
        away = math.hypot(north, east)
        if leg.length is None:
            leg.length = away
        if leg.smooth and away <= tuning.radius:
            self.reached = True
        course = math.atan2(east, north)
        ahead = north * math.cos(self.motion.heading) + east * math.sin(self.motion.heading)
        if away < 1.0 and ahead < 0.0:  # it has come there
            self._move(0.0, 0.0, dt)
            self.reached = self.reached or self.speed < 0.45
            return
        wish = min(tuning.speed, math.sqrt(2 * tuning.brake * away)) if not leg.smooth else tuning.speed
        self._drive(course, wish, dt)

    def _drift(self, drift: Drift, dt: float) -> None:
        if self.now >= drift.expires:
            self.begin(Stop(hard=True))
            return
        velocity = drift.velocity
        wish = velocity.flat() * self.tuning.overshoot
        if drift.turn_rate is not None:
            self._move(drift.turn_rate, wish, dt)
        elif wish > 0.05:
            self._drive(math.atan2(velocity.east, velocity.north), wish, dt)
        else:
            self._roll(dt)

    def _drive(self, course: float, wish: float, dt: float) -> None:
        tuning = self.tuning
        off = math.remainder(course - self.motion.heading, 2 * math.pi)
        wish = min(wish, max(_TURNING, wish * math.cos(min(abs(off), math.pi / 2))))
        self._move(max(-tuning.turn_rate, min(tuning.turn_rate, _STEER_GAIN * off)), wish, dt)

    def _move(self, rate: float, wish: float, dt: float) -> None:
        tuning = self.tuning
        delay = tuning.delay if isinstance(self.task, GoTo) else 0.6 * tuning.delay
        if self.now - self._begun < delay and self.speed < 0.3:
            wish = 0.0
        change = max(-2 * tuning.brake * dt, min(tuning.accel * dt, wish - self.speed))
        self.speed += change
        self.motion.turn_rate = rate * min(1.0, 0.6 * abs(self.speed) + 0.1)
        self._advance(dt)

    def _roll(self, dt: float) -> None:
        self.speed -= self.speed * min(1.0, dt / self.tuning.roll_out)
        self.motion.turn_rate = 0.0
        self._advance(dt)

    def _advance(self, dt: float) -> None:
        motion = self.motion
        motion.heading = (motion.heading + motion.turn_rate * dt) % (2 * math.pi)
        motion.north.velocity = self.speed * math.cos(motion.heading)
        motion.east.velocity = self.speed * math.sin(motion.heading)
        for axis in (motion.north, motion.east):
            axis.position += axis.velocity * dt
            axis.retarget()
