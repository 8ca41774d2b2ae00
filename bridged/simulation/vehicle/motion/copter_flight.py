"""Flight control: tasks of a copter, takeoff, landing and touchdown."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from bridged.simulation.vehicle.motion.dynamics import Limits, Motion, Vector
from bridged.simulation.vehicle.motion.locomotion import Locomotion
from bridged.simulation.vehicle.motion.tasks import (
    Circle,
    Drift,
    GoTo,
    Land,
    Landed,
    Return,
    Stage,
    Stop,
    TakeOff,
    Task,
)

_LOOK_AHEAD_SPEED = 0.8
"""m/s: slower than this the copter does not turn to where it goes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """How an autopilot flies a copter, by its parameters: metres, m/s, seconds."""

    legs: Limits
    smooth: Callable[[float], Limits]
    """Limits of a smooth leg of a length."""
    drift: Limits
    slip: float = 1.0
    """Share of a wanted velocity that is flown."""
    turn_ahead: float = 0.5
    """Seconds ahead to which the nose turns by a rate."""
    circle: Limits
    circle_slip: float = 1.0
    """The same of the speed on a circle."""
    stop: Limits
    hard_stop: Limits
    landing: Limits
    spool_up: float
    """From arming until the motors can lift."""
    lift_delay: float
    """From the order to take off until the copter moves."""
    takeoff: Callable[[float, float], Limits]
    """Limits of a takeoff at a height, at a speed of climb."""
    takeoff_done: Callable[[float, float], bool]
    """Whether a takeoff is over that is so far below its goal, at a speed of climb."""
    radius: float
    """Around a goal, within which a leg is done ..."""
    leg_done: float = 0.3
    """... if the target is as near to it."""
    return_height: Callable[[float], float]
    """Height above home of a return from a place so far away, if the copter is not higher."""
    over_home: float
    """Around home, within which a return ends."""
    lands_over_home: bool = False
    """Whether the descent at its end goes on to home."""
    return_wait: float
    """From the end of a return to the descent."""
    descent: Callable[[float], float]
    """Speed of a landing at a height above the ground."""
    touchdown_to_landed: float
    """From the touchdown until the autopilot reports that it is on the ground."""


class Flight(Locomotion[Tuning]):
    """A copter with motors."""

    MOTION = Motion

    def __init__(self, motion: Motion, tuning: Callable[[float | None], Tuning]) -> None:
        super().__init__(motion, tuning)
        self._armed_at = 0.0
        self._ahead: float | None = None  # direction in which the copter goes

    @property
    def target(self) -> Vector | None:
        """Goal of a leg, or over home."""
        match self.task:
            case GoTo(goal):
                return goal
            case Return(stage=stage, over=over) if stage is not Stage.DESCEND:
                return over
        return None

    def arm(self) -> None:
        """Start the motors."""
        self.armed, self._armed_at, self.lift_at = True, self.now, None
        self.touchdown_at = None

    def disarm(self) -> None:
        """Stop the motors, even in the air."""
        self.armed, self.lift_at, self.touchdown_at = False, None, None
        if not self.airborne:
            self.landed = Landed.ON_GROUND

    @property
    def idle_since(self) -> float | None:
        """Time since which the motors idle on the ground without a pending takeoff; None if they do not."""
        if not self.armed or self.airborne or self.lift_at is not None:
            return None
        return max(self._armed_at, self.touchdown_at or 0.0)

    def begin(self, task: Task) -> None:
        """Begin another task from the present motion."""
        if self.airborne and type(task) is not type(self.task):
            self.motion.retarget()
        if not isinstance(task, TakeOff | GoTo | Drift):
            self.lift_at = None  # a goal on the ground keeps a takeoff going, another mode ends it
        self.task, self.reached = task, False
        self.heading_wish = self._ahead = None
        if isinstance(task, TakeOff) and self.armed and not self.airborne:
            tuning = self.tuning
            self.lift_at = max(self._armed_at + tuning.spool_up, self.now + tuning.lift_delay)
            self.touchdown_at = None

    def step(self, dt: float) -> None:
        """One step of `dt` seconds that ends at `now`."""
        if not self.armed:
            if self.airborne:
                self.motion.fall(dt)
                self._touch_ground()
            elif self.touchdown_at is not None:
                self._settle()
            return
        if not self.airborne:
            self._on_ground()
            return
        self._fly(dt)
        self._touch_ground()

    def _touch_ground(self) -> None:
        if self.meet_ground():
            self.motion.rest()

    def _on_ground(self) -> None:
        if self.lift_at is not None and self.now >= self.lift_at:
            self.lift_at = None
            self.airborne, self.landed = True, Landed.TAKEOFF
            self.motion.rest()
        else:
            self._settle()

    def _settle(self) -> None:
        if self.touchdown_at is not None and self.now - self.touchdown_at >= self.tuning.touchdown_to_landed:
            self.landed = Landed.ON_GROUND
            if not self.armed:
                self.touchdown_at = None

    def _fly(self, dt: float) -> None:
        if not (isinstance(self.task, TakeOff) and self.landed is Landed.TAKEOFF):
            self.landed = Landed.IN_AIR
        match self.task:
            case TakeOff(up):
                self._take_off(up, dt)
            case GoTo() as leg:
                self._go(leg, dt)
            case Drift() as drift:
                self._drift(drift, dt)
            case Stop(hard):
                self.motion.fly(Vector(), self.tuning.hard_stop if hard else self.tuning.stop, dt)
                self._turn(self.heading_wish, dt)
            case Return() as back:
                self._return(back, dt)
            case Land():
                self._descend(dt)
            case Circle() as circle:
                self._circle(circle, dt)

    def _limits(self, leg: float | None = None) -> Limits:
        """Return the limits set by parameters; `leg` is the length of a smooth leg in metres."""
        tuning = self.tuning
        return tuning.legs if leg is None else tuning.smooth(leg)

    def _take_off(self, goal: float, dt: float) -> None:
        motion = self.motion
        limits = self.tuning.takeoff(self.height, motion.up.target_velocity)
        motion.go(Vector(motion.north.target, motion.east.target, goal), limits, dt)
        self._turn(self.heading_wish, dt)
        off = goal - motion.up.position
        if not self.reached and self.tuning.takeoff_done(off, motion.up.velocity):
            self.reached = True
            self.landed = Landed.IN_AIR

    def _go(self, leg: GoTo, dt: float) -> None:
        here = self.motion.position
        if leg.length is None:
            leg.length = math.hypot(leg.goal.north - here.north, leg.goal.east - here.east)
        self.motion.go(leg.goal, leg.limits or self._limits(leg.length if leg.smooth else None), dt)
        off, left = _apart(leg.goal, here), _apart(leg.goal, self.motion.target)
        if off < self.tuning.radius and left < self.tuning.leg_done:
            self.reached = True
        speed, course = self.motion.course
        if speed > _LOOK_AHEAD_SPEED:
            self._ahead = course
        wishes = (leg.heading, self.heading_wish, self._ahead)
        self._turn(next((wish for wish in wishes if wish is not None), None), dt)

    def _drift(self, drift: Drift, dt: float) -> None:
        if self.now >= drift.expires:
            self.begin(Stop())
            return
        tuning, wanted = self.tuning, drift.velocity
        flown = Vector(wanted.north * tuning.slip, wanted.east * tuning.slip, wanted.up)
        self.motion.fly(flown, tuning.drift, dt)
        if drift.turn_rate is not None:
            drift.heading = (self.motion.heading + drift.turn_rate * max(dt, tuning.turn_ahead)) % (2 * math.pi)
        self._turn(drift.heading if drift.heading is not None else self.heading_wish, dt)

    def _return(self, back: Return, dt: float) -> None:
        here, home = self.motion.position, back.home
        away = math.hypot(here.north - home.north, here.east - home.east)
        if back.over is None:
            height = max(here.up, home.up + self.tuning.return_height(away))
            back.over, back.since = Vector(home.north, home.east, height), self.now
            back.length = away
        limits = self._limits(back.length)
        match back.stage:
            case Stage.CLIMB:
                self.motion.go(Vector(self.motion.north.target, self.motion.east.target, back.over.up), limits, dt)
                if back.over.up - here.up < 0.7 and self.now - back.since >= 0.7:
                    self._enter(back, Stage.CRUISE)
            case Stage.CRUISE:
                self.motion.go(back.over, limits, dt)
                if away < self.tuning.over_home and back.over.up - here.up < 0.5:
                    self._enter(back, Stage.WAIT)
            case Stage.WAIT:
                self.motion.go(back.over, limits, dt)
                if self.now - back.since >= self.tuning.return_wait:
                    self._enter(back, Stage.DESCEND)
            case Stage.DESCEND:
                self._descend(dt, home if self.tuning.lands_over_home else None)

    def _enter(self, back: Return, stage: Stage) -> None:
        back.stage, back.since = stage, self.now

    def _descend(self, dt: float, over: Vector | None = None) -> None:
        self.landed = Landed.LANDING
        towards = Vector() if over is None else self.motion.course_to(over, self.tuning.legs)
        towards.up = -self.tuning.descent(self.height)
        self.motion.fly(towards, self.tuning.landing, dt)

    def _circle(self, circle: Circle, dt: float) -> None:
        """Fly along the tangent, and to the circle; the nose points to its centre."""
        here, centre = self.motion.position, circle.centre
        north, east = here.north - centre.north, here.east - centre.east
        if math.hypot(north, east) < 0.1:  # outward from the centre, ahead
            north, east = 0.1 * math.cos(self.motion.heading), 0.1 * math.sin(self.motion.heading)
        away = math.hypot(north, east)
        inward = max(-1.0, min(1.0, (away - abs(circle.radius)) / 4))
        speed = circle.speed * self.tuning.circle_slip
        along = math.copysign(math.sqrt(1 - inward * inward), circle.radius) * speed / away
        inward *= speed / away
        climb = max(-1.0, min(1.0, centre.up - here.up))
        velocity = Vector(-east * along - north * inward, north * along - east * inward, climb)
        self.motion.fly(velocity, self.tuning.circle, dt)
        self._turn(math.atan2(-east, -north) % (2 * math.pi), dt)

    def _turn(self, heading: float | None, dt: float) -> None:
        if heading is not None:
            self.motion.turn(heading, dt)


def _apart(one: Vector, other: Vector) -> float:
    return math.dist((one.north, one.east, one.up), (other.north, other.east, other.up))
