"""How the simulated copter moves: a point mass that follows a shaped target.

Two layers, as in a real autopilot. The *target* runs to the goal within limits of speed, acceleration and jerk. The
*copter* follows the target by position and velocity feedback through the lag of tilting and against air drag; the
integral that holds it against the drag is what makes it overshoot a goal by some decimetres after a fast leg.
The constants are fitted to recorded flights (tests/data/dynamics.json,
tests/bridged/simulation/vehicle/motion/test_copter_dynamics.py).

Positions are metres north, east and up of the place where the vehicle was switched on.
"""

import math
from dataclasses import dataclass

GRAVITY = 9.81
"""m/s²"""

_POSITION_GAIN = 0.57  # 1/s: metres off the target to m/s
_VELOCITY_GAIN = 1.1  # 1/s: m/s off to m/s²
_INTEGRAL_GAIN = 0.84  # 1/s²
_DRAG = 0.24  # 1/s: m/s² of drag per m/s
_TILT_LAG_S = 0.05
_LEAN = GRAVITY * math.tan(math.radians(30.0))  # m/s²: the most that a tilt gives (ANGLE_MAX)

_CLIMB_RESPONSE_S = 0.15
"""Time in which a wrong vertical speed is corrected, within the limits of acceleration."""

_BRAKE_JERK = 10.0
"""m/s³ while slowing down, whatever the mode allows for speeding up: a plan to stop must hold."""

_TURN_RATE = math.radians(62.0)
"""rad/s"""

_TURN_ACCEL = math.radians(120.0)
"""rad/s²"""

_STEADY = 0.01  # m/s² and rad/s


@dataclass(slots=True)
class Vector:
    """Metres, m/s or m/s² in the directions north, east and up."""

    north: float = 0.0
    east: float = 0.0
    up: float = 0.0

    def flat(self) -> float:
        """Return the length of the horizontal part."""
        return math.hypot(self.north, self.east)

    def distance(self, other: "Vector") -> float:
        """Return the horizontal distance to another place."""
        return math.hypot(self.north - other.north, self.east - other.east)


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a flight mode; m/s, m/s², m/s³."""

    speed: float = 10.0
    climb: float = 2.5
    descent: float = 1.5
    accel: float = 2.5
    brake: float = 1.456  # deceleration that a stop at the goal is planned with
    jerk: float = 3.1
    settle: float = 2.0  # 1/s: speed per metre in the last decimetres
    climb_accel: float = 1.1
    climb_brake: float = 0.58
    climb_settle: float = 1.5  # 1/s: vertical speed per metre in the last decimetres
    response: float = 0.15  # s in which a higher speed is reached, within accel and jerk
    release: float = 0.15  # s in which a lower speed is reached


@dataclass(slots=True)
class Axis:
    """One direction: motion of the copter and of its target, in steps of `dt` seconds."""

    position: float = 0.0
    velocity: float = 0.0
    accel: float = 0.0
    target: float = 0.0
    target_velocity: float = 0.0
    target_accel: float = 0.0
    integral: float = 0.0
    aimed: float = 0.0  # acceleration that the tilt gives now

    @property
    def steady(self) -> bool:
        """Whether neither the copter nor its target accelerates."""
        return -_STEADY < self.accel < _STEADY and -_STEADY < self.target_accel < _STEADY

    def rest(self) -> None:
        """Stop, with the target here."""
        self.velocity = self.accel = self.integral = self.aimed = 0.0
        self.target, self.target_velocity, self.target_accel = self.position, 0.0, 0.0

    def retarget(self) -> None:
        """Start the target from the copter's position and velocity."""
        self.target, self.target_velocity, self.target_accel = self.position, self.velocity, 0.0

    def plan(self, accel: float, dt: float) -> None:
        """Move the target, accelerated by `accel` m/s², for `dt` seconds."""
        self.target_accel = accel
        self.target_velocity += accel * dt
        self.target += self.target_velocity * dt

    def follow(self, dt: float, air: float = 0.0) -> None:
        """Move the copter after the target for `dt` seconds: feedback, tilt lag, drag in air of `air` m/s."""
        position, velocity = self.position, self.velocity
        off = self.target_velocity + _POSITION_GAIN * (self.target - position) - velocity
        demand = self.target_accel + _VELOCITY_GAIN * off + self.integral
        if -_LEAN < demand < _LEAN:
            self.integral += _INTEGRAL_GAIN * off * dt
        else:
            if demand * off < 0:  # one that leans as far as it can does not wind up
                self.integral += _INTEGRAL_GAIN * off * dt
            demand = math.copysign(_LEAN, demand)
        self.aimed = aimed = self.aimed + (demand - self.aimed) * (dt / _TILT_LAG_S if dt < _TILT_LAG_S else 1.0)
        self.accel = accel = aimed - _DRAG * (velocity - air)
        self.velocity = velocity = velocity + accel * dt
        self.position = position + velocity * dt

    def track(self) -> None:
        """Put the copter at the target: thrust answers faster than tilt."""
        self.position, self.velocity, self.accel = self.target, self.target_velocity, self.target_accel


class Motion:
    """The body of the copter, moved in steps of `dt` seconds. Deterministic: no noise."""

    def __init__(self, heading: float = 0.0) -> None:
        self.north, self.east, self.up = Axis(), Axis(), Axis()
        self.heading = heading  # radians clockwise from north
        self.turn_rate = 0.0  # rad/s
        self.air = Vector()  # m/s: the wind

    @property
    def steady(self) -> bool:
        """Whether it neither turns nor accelerates: a long step moves it as several short ones do."""
        return -_STEADY < self.turn_rate < _STEADY and self.up.steady and self.north.steady and self.east.steady

    @property
    def effort(self) -> float:
        """Power for flight as a multiple of that of a hover in still air: thrust that leans, to the power of 1.5."""
        if not (self.air.north or self.air.east):
            return 1.0
        return float((1 + (_DRAG * self.air.flat() / GRAVITY) ** 2) ** 0.75)

    @property
    def position(self) -> Vector:
        """m"""
        return Vector(self.north.position, self.east.position, self.up.position)

    @property
    def velocity(self) -> Vector:
        """m/s"""
        return Vector(self.north.velocity, self.east.velocity, self.up.velocity)

    @property
    def target(self) -> Vector:
        """m"""
        return Vector(self.north.target, self.east.target, self.up.target)

    @property
    def course(self) -> tuple[float, float]:
        """Horizontal speed of the target in m/s and its direction in radians."""
        north, east = self.north.target_velocity, self.east.target_velocity
        return math.hypot(north, east), math.atan2(east, north)

    @property
    def bearing(self) -> float:
        """Heading in degrees from 0 to 360."""
        return math.degrees(self.heading) % 360.0

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll and pitch in radians that give the present horizontal acceleration."""
        north, east = self.north.aimed, self.east.aimed
        forward = north * math.cos(self.heading) + east * math.sin(self.heading)
        right = -north * math.sin(self.heading) + east * math.cos(self.heading)
        return math.atan2(right, GRAVITY), math.atan2(-forward, GRAVITY)

    def turned(self, forward: float, right: float) -> tuple[float, float]:
        """Return a direction from the vehicle as north and east."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return forward * cos - right * sin, forward * sin + right * cos

    def rest(self) -> None:
        """Stop all motion on the ground."""
        for axis in (self.north, self.east, self.up):
            axis.rest()
        self.turn_rate = 0.0

    def retarget(self) -> None:
        """Continue the present motion with another flight mode."""
        for axis in (self.north, self.east, self.up):
            axis.retarget()

    def go(self, goal: Vector, limits: Limits, dt: float) -> None:
        """Move for `dt` seconds on the straight line to `goal`, braking in time to stop there."""
        north, east = goal.north - self.north.target, goal.east - self.east.target
        up = goal.up - self.up.target
        flat = math.hypot(north, east)
        speed = min(limits.speed, _braking_speed(flat, limits.brake, limits.settle))
        climb = limits.climb if up > 0 else limits.descent
        if flat > 0.5 and abs(up) > 0.5:
            # The line is kept: the slower of the two directions sets the pace.
            pace = min(limits.speed / flat, climb / abs(up))
            speed, climb = min(speed, pace * flat), min(climb, pace * abs(up))
        climb = math.copysign(min(climb, _braking_speed(abs(up), limits.climb_brake, limits.climb_settle)), up)
        scale = speed / flat if flat > 1e-6 else 0.0
        self.fly(Vector(north * scale, east * scale, climb), limits, dt)

    def course_to(self, goal: Vector, limits: Limits) -> Vector:
        """Return the horizontal velocity to a goal from which the target stops there."""
        north, east = goal.north - self.north.target, goal.east - self.east.target
        flat = math.hypot(north, east)
        scale = min(limits.speed, _braking_speed(flat, limits.brake, limits.settle)) / flat if flat > 1e-6 else 0.0
        return Vector(north * scale, east * scale)

    def fly(self, velocity: Vector, limits: Limits, dt: float) -> None:
        """Move for `dt` seconds with this velocity as the wish."""
        northward, eastward, upward = self.north, self.east, self.up
        north, east = velocity.north - northward.target_velocity, velocity.east - eastward.target_velocity
        speeding_up = north * northward.target_velocity + east * eastward.target_velocity >= 0
        response, jerk = (limits.response, limits.jerk) if speeding_up else (limits.release, _BRAKE_JERK)
        north, east = _clip(north / response, east / response, limits.accel)
        north, east = _clip(north - northward.target_accel, east - eastward.target_accel, jerk * dt)
        up = (velocity.up - upward.target_velocity) / _CLIMB_RESPONSE_S
        up = max(-limits.climb_accel, min(limits.climb_accel, up))
        most = (limits.jerk if up * upward.target_velocity >= 0 else _BRAKE_JERK) * dt
        northward.plan(northward.target_accel + north, dt)
        eastward.plan(eastward.target_accel + east, dt)
        upward.plan(upward.target_accel + max(-most, min(most, up - upward.target_accel)), dt)
        northward.follow(dt, self.air.north)
        eastward.follow(dt, self.air.east)
        upward.track()

    def fall(self, dt: float) -> None:
        """Fall for `dt` seconds, with the motors off in the air."""
        self.up.accel = -GRAVITY
        self.up.velocity -= GRAVITY * dt
        for axis in (self.north, self.east, self.up):
            axis.position += axis.velocity * dt
            axis.retarget()

    def shift(self, by: Vector) -> None:
        """Continue as if from a place that is `by` metres away: the estimate of the position has jumped."""
        for axis, metres in ((self.north, by.north), (self.east, by.east)):
            axis.position += metres
            axis.target += metres

    def turn(self, heading: float, dt: float) -> None:
        """Turn for `dt` seconds to `heading` (radians) the short way."""
        off = math.remainder(heading - self.heading, 2 * math.pi)
        wish = math.copysign(min(_TURN_RATE, math.sqrt(1.5 * _TURN_ACCEL * abs(off)), 4.0 * abs(off)), off)
        most = _TURN_ACCEL * dt
        self.turn_rate += max(-most, min(most, wish - self.turn_rate))
        self.heading = (self.heading + self.turn_rate * dt) % (2 * math.pi)


def _clip(north: float, east: float, longest: float) -> tuple[float, float]:
    length = math.hypot(north, east)
    if length <= longest:
        return north, east
    return north * longest / length, east * longest / length


def _braking_speed(distance: float, brake: float, settle: float) -> float:
    """The speed from which a copter that is `distance` away stops there: a root, and a line in the last metres."""
    near = brake / (settle * settle)
    if distance < near:
        return settle * distance
    return math.sqrt(2 * brake * (distance - near / 2))
