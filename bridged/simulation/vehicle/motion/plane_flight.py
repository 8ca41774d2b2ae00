"""How a simulated plane flies: a point that turns with a limited rate at its airspeed, climbs and sinks, and circles.

It cannot stop: a goal is circled, a waypoint of a mission is passed. Takeoffs and landings roll along a runway.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from bridged.simulation.vehicle.motion.dynamics import GRAVITY, Motion, Vector
from bridged.simulation.vehicle.motion.locomotion import Locomotion
from bridged.simulation.vehicle.motion.tasks import (
    Approach,
    Circle,
    Drift,
    GoTo,
    Land,
    Landed,
    Return,
    Stop,
    TakeOff,
    Task,
)

_TURN_GAIN = 1.2  # 1/s: heading off to rate of turn
_ROLL_LAG_S = 0.7
_CLIMB_GAIN = 0.35  # 1/s: metres off the altitude to m/s
_CLIMB_ACCEL = 2.5  # m/s²
_ACCEL = 2.5  # m/s² in the air
_PASSED = 120.0
"""Metres from the place of a landing within which a plane does not turn back to it."""
_SLOW = 2.0
"""m/s below which a plane that rolls out is taken for landed."""
_STANDS = 0.15
"""m/s below which a plane that rolls out has stopped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneTuning:
    """How an autopilot flies a plane, by its parameters: metres, m/s, seconds."""

    airspeed: float
    radius: float
    """Of the circles around a goal."""
    near: float
    """Around a waypoint of a mission, within which it is passed."""
    turn_rate: float
    """rad/s at most."""
    climb: float
    sink: float
    takeoff_climb: float
    rotation: float
    """Airspeed at which it leaves the ground."""
    thrust: float
    """m/s² on the runway."""
    run_delay: float
    """From the order to take off until it rolls."""
    takeoff_done: float
    """Below its goal, at which a takeoff ends."""
    flare_height: float
    flare_sink: float
    roll_out: float
    """Time constant of its speed after the touchdown."""
    touchdown_to_landed: float
    """From the touchdown until the autopilot reports that it is on the ground, at least; it must be slow, too."""


class PlaneMotion(Motion):
    """Place, course and speed of a plane."""

    def __init__(self, heading: float) -> None:
        super().__init__(heading)
        self.airspeed = 0.0
        """m/s"""

    @property
    def steady(self) -> bool:
        """It always turns or climbs a little."""
        return False

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll and pitch in radians."""
        pitch = math.atan2(self.up.velocity, max(1.0, self.airspeed))
        return math.atan2(self.airspeed * self.turn_rate, GRAVITY), pitch

    def move(self, turn: float, climb: float, dt: float) -> None:
        """Fly for `dt` seconds with a rate of turn (rad/s) and of climb (m/s) as wishes."""
        self.turn_rate += (turn - self.turn_rate) * min(1.0, dt / _ROLL_LAG_S)
        self.heading = (self.heading + self.turn_rate * dt) % (2 * math.pi)
        most = _CLIMB_ACCEL * dt
        self.up.velocity += max(-most, min(most, climb - self.up.velocity))
        self.north.velocity = self.airspeed * math.cos(self.heading) + self.air.north
        self.east.velocity = self.airspeed * math.sin(self.heading) + self.air.east
        for axis in (self.north, self.east, self.up):
            axis.position += axis.velocity * dt
            axis.retarget()

    def roll(self, acceleration: float, dt: float) -> None:
        """Roll straight on for `dt` seconds."""
        self.airspeed = max(0.0, self.airspeed + acceleration * dt)
        self.turn_rate = 0.0
        self.up.rest()
        self.north.velocity = self.airspeed * math.cos(self.heading)
        self.east.velocity = self.airspeed * math.sin(self.heading)
        for axis in (self.north, self.east):
            axis.position += axis.velocity * dt
            axis.retarget()


class PlaneFlight(Locomotion[PlaneTuning]):
    """A plane with a motor."""

    MOTION = PlaneMotion
    motion: PlaneMotion

    def __init__(self, motion: PlaneMotion, tuning: Callable[[float | None], PlaneTuning]) -> None:
        super().__init__(motion, tuning)
        self.flaring = False
        self._roll_at: float | None = None

    @property
    def target(self) -> Vector | None:
        """Goal of the present task."""
        match self.task:
            case GoTo(goal) | Approach(goal):
                return goal
            case Circle(centre):
                return centre
        return None

    @property
    def lift_at(self) -> float | None:  # type: ignore[override]
        """When it will leave the ground, in vehicle seconds; None: it is not about to."""
        if self._roll_at is None:
            return None
        left = max(0.0, self.tuning.rotation - self.motion.airspeed) / self.tuning.thrust
        return max(self.now, self._roll_at) + left

    @property
    def rolls(self) -> bool:
        """Whether it moves on the ground."""
        return not self.airborne and self.motion.airspeed > _STANDS

    def arm(self) -> None:
        """Start the motor."""
        self.armed, self._roll_at, self.touchdown_at = True, None, None

    def disarm(self) -> None:
        """Stop the motor, even in the air."""
        self.armed, self._roll_at = False, None
        if not self.airborne and not self.rolls:
            self.landed, self.touchdown_at = Landed.ON_GROUND, None

    def begin(self, task: Task) -> None:
        """Begin another task from the present motion. Without a place, the present one is circled."""
        here = self.motion.position
        if isinstance(task, Stop | Drift | Return):
            task = GoTo(here) if self.airborne else Stop()
        self.task, self.reached, self.flaring = task, False, False
        self._roll_at = None
        if isinstance(task, TakeOff) and self.armed and not self.airborne:
            self._roll_at = self.now + self.tuning.run_delay
            self.touchdown_at = None

    def step(self, dt: float) -> None:
        """One step of `dt` seconds that ends at `now`."""
        if not self.airborne:
            self._on_ground(dt)
            return
        if not self.armed:
            self.motion.fall(dt)
        else:
            self._fly(dt)
        if self.meet_ground():
            self.motion.up.rest()

    def _on_ground(self, dt: float) -> None:
        motion, tuning = self.motion, self.tuning
        if self._roll_at is not None:
            if self.now >= self._roll_at:
                motion.roll(tuning.thrust, dt)
            if motion.airspeed >= tuning.rotation:
                self.airborne, self.landed, self._roll_at = True, Landed.TAKEOFF, None
            return
        if motion.airspeed > 0:
            motion.roll(-motion.airspeed / tuning.roll_out - 0.02, dt)
        elif not motion.north.velocity == motion.east.velocity == 0:
            motion.rest()
        if self.touchdown_at is None:
            return
        if motion.airspeed < _SLOW and self.now - self.touchdown_at >= tuning.touchdown_to_landed:
            self.landed, self.reached = Landed.ON_GROUND, True
            if not self.armed and not self.rolls:
                self.touchdown_at = None

    def _fly(self, dt: float) -> None:
        motion, tuning = self.motion, self.tuning
        most = _ACCEL * dt
        motion.airspeed += max(-most, min(most, tuning.airspeed - motion.airspeed))
        if not (isinstance(self.task, TakeOff) and self.landed is Landed.TAKEOFF):
            self.landed = Landed.IN_AIR
        match self.task:
            case TakeOff(up):
                self._take_off(up, dt)
            case GoTo() as leg:
                self._go(leg, dt)
            case Circle(centre, radius):
                self._circle(centre, radius, dt)
            case Approach() as approach:
                self._approach(approach, dt)
            case Land():
                self.landed = Landed.LANDING
                sink = tuning.flare_sink if self.height < tuning.flare_height else 0.6 * tuning.sink
                self.motion.move(tuning.airspeed / tuning.radius, -sink, dt)
            case _:
                motion.move(0.0, 0.0, dt)

    def _take_off(self, up: float, dt: float) -> None:
        motion, tuning = self.motion, self.tuning
        off = up - motion.up.position
        motion.move(0.0, max(0.0, min(tuning.takeoff_climb, off)), dt)
        if not self.reached and off < tuning.takeoff_done:
            self.reached, self.landed = True, Landed.IN_AIR

    def _go(self, leg: GoTo, dt: float) -> None:
        radius = leg.radius if leg.radius else self.tuning.radius
        away = self.motion.position.distance(leg.goal)
        if leg.smooth:
            north, east = leg.goal.north - self.motion.north.position, leg.goal.east - self.motion.east.position
            self._steer(math.atan2(east, north), leg.goal.up, dt)
            self.reached = self.reached or away <= self.tuning.near
            return
        self._circle(leg.goal, radius, dt)
        if away <= abs(radius) + 15.0:
            self.reached = True

    def _circle(self, centre: Vector, radius: float, dt: float) -> None:
        """Fly along the tangent of a circle, and to it from outside or inside."""
        here, size = self.motion.position, max(1.0, abs(radius))
        north, east = here.north - centre.north, here.east - centre.east
        off = (math.hypot(north, east) - size) / size
        direction = math.copysign(1.0, radius)
        course = math.atan2(east, north) + direction * (math.pi / 2 + math.atan(2 * off))
        inside = abs(off) < 0.5
        self._steer(course, centre.up, dt, direction * self.motion.airspeed / size if inside else 0.0)

    def _steer(self, course: float, up: float, dt: float, turn: float = 0.0) -> None:
        """Turn to a course, besides a rate of turn that it needs there, and climb or sink to an altitude."""
        tuning = self.tuning
        off = math.remainder(course - self.motion.heading, 2 * math.pi)
        rate = max(-tuning.turn_rate, min(tuning.turn_rate, turn + _TURN_GAIN * off))
        climb = max(-tuning.sink, min(tuning.climb, _CLIMB_GAIN * (up - self.motion.up.position)))
        self.motion.move(rate, climb, dt)

    def _approach(self, approach: Approach, dt: float) -> None:
        """Fly down to a place on the ground; the last metres are flared, and it rolls out."""
        motion, goal, tuning = self.motion, approach.goal, self.tuning
        self.landed = Landed.LANDING
        here = motion.position
        away = here.distance(goal)
        if approach.length is None:
            approach.length, approach.up = max(1.0, away), here.up
        if self.flaring or self.height < tuning.flare_height:
            self.flaring = True
            motion.airspeed = max(0.75 * tuning.airspeed, motion.airspeed - 2 * dt)
            motion.move(0.0, -tuning.flare_sink, dt)
            return
        north, east = goal.north - here.north, goal.east - here.east
        course = math.atan2(east, north)
        wanted = goal.up + (approach.up - goal.up) * away / approach.length
        slope = (approach.up - goal.up) / approach.length * tuning.airspeed
        off = math.remainder(course - motion.heading, 2 * math.pi)
        if abs(off) > math.pi / 2:
            if away < _PASSED:
                off, wanted = 0.0, goal.up  # it has passed it
            else:
                wanted, slope = approach.up, 0.0  # it turns to it first
                approach.length = away
        rate = max(-tuning.turn_rate, min(tuning.turn_rate, _TURN_GAIN * off))
        motion.move(rate, max(-tuning.sink, min(1.0, 0.8 * (wanted - here.up) - slope)), dt)
