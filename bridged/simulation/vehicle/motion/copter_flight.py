"""Flight control: tasks of a copter, takeoff, landing and touchdown."""

import math
from dataclasses import dataclass
from enum import Enum, IntEnum, auto

from bridged.simulation.vehicle.ardupilot.parameters import Parameters
from bridged.simulation.vehicle.motion.dynamics import Limits, Motion, Vector


class Landed(IntEnum):
    """landed_state of EXTENDED_SYS_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


@dataclass(slots=True)
class TakeOff:
    """Straight up to `up` metres on the map."""

    up: float


@dataclass(slots=True)
class GoTo:
    """To a place and hold it; `heading` in radians, or None to look ahead. `smooth` legs are those of RTL and AUTO."""

    goal: Vector
    heading: float | None = None
    smooth: bool = False
    length: float | None = None  # m, horizontally, from where it began


@dataclass(slots=True)
class Drift:
    """A velocity in m/s, until `expires` (vehicle seconds): then the copter stops."""

    velocity: Vector
    expires: float
    heading: float | None = None
    turn_rate: float | None = None  # rad/s


@dataclass(slots=True)
class Stop:
    """Slow down and hover where that ends; `hard` is what BRAKE does."""

    hard: bool = False


class Stage(Enum):
    """Stage of a return."""

    CLIMB = auto()
    CRUISE = auto()
    WAIT = auto()
    DESCEND = auto()


@dataclass(slots=True)
class Return:
    """Climb, fly over home, wait, land."""

    home: Vector
    stage: Stage = Stage.CLIMB
    over: Vector | None = None  # the point over home
    since: float = 0.0  # when the stage began
    length: float = 0.0  # m, horizontally, from where it began


@dataclass(slots=True)
class Land:
    """Straight down."""


Task = TakeOff | GoTo | Drift | Stop | Return | Land


SPOOL_UP_S = 3.3
"""From arming until the motors can lift (recorded: 5 cm high 3.7 s after arming)."""

LIFT_DELAY_S = 0.98
"""From the takeoff command until the copter moves (recorded: 5 cm high 1.4 s after it)."""

RETURN_PAUSE_S = 1.5
"""Time between the arrival over home and the loiter time of RTL (recorded)."""

TOUCHDOWN_TO_LANDED_S = 1.7
TOUCHDOWN_TO_DISARM_S = 2.09

_SMOOTH_PACE = 1.12
"""A smooth leg of L metres peaks at this times the root of L in m/s (recorded: 6.8 on 40 m, 7.8 on 50 m)."""

_LEG_DONE = 0.3
"""m that the target may be short of the end of a leg that is done."""

_LOOK_AHEAD_SPEED = 0.8
"""m/s: slower than this the copter does not turn to where it goes."""


class Flight:
    """A copter with motors. It has one task at a time; `reached` is set when a takeoff or a leg is done."""

    def __init__(self, motion: Motion, parameters: Parameters) -> None:
        self.motion = motion
        self.parameters = parameters
        self.armed = False
        self.airborne = False
        self.landed = Landed.ON_GROUND
        self.task: Task = Stop()
        self.heading_wish: float | None = None
        self.cruise_speed: float | None = None  # m/s, set by DO_CHANGE_SPEED until the next task source
        self.reached = False
        self.touchdown_at: float | None = None
        self.touchdown_speed = 0.0
        self._armed_at = 0.0
        self._lift_at: float | None = None
        self._ahead: float | None = None  # direction in which the copter goes
        self.now = 0.0  # vehicle seconds, set by the copter before each step
        self._asked: tuple[float | None, float | None, int] | None = None
        """For what `_answer` are the limits: the leg, the speed, the state of the parameters."""
        self._answer = Limits()

    @property
    def height(self) -> float:
        """Metres above the ground."""
        return self.motion.up.position

    @property
    def target(self) -> Vector | None:
        """Goal of the present task, if the autopilot reports one (POSITION_TARGET_GLOBAL_INT)."""
        match self.task:
            case GoTo(goal):
                return goal
            case Return(stage=stage, over=over) if stage is not Stage.DESCEND:
                return over
        return None

    def arm(self) -> None:
        """Start the motors."""
        self.armed, self._armed_at, self._lift_at = True, self.now, None
        self.touchdown_at = None

    def disarm(self) -> None:
        """Stop the motors, even in the air."""
        self.armed, self._lift_at, self.touchdown_at = False, None, None
        if not self.airborne:
            self.landed = Landed.ON_GROUND

    @property
    def idle_since(self) -> float | None:
        """Time since which the motors idle on the ground without a pending takeoff; None if they do not."""
        if not self.armed or self.airborne or self._lift_at is not None:
            return None
        return max(self._armed_at, self.touchdown_at or 0.0)

    def begin(self, task: Task) -> None:
        """Begin another task from the present motion."""
        if self.airborne and type(task) is not type(self.task):
            self.motion.retarget()
        if not isinstance(task, TakeOff | GoTo | Drift):
            self._lift_at = None  # a goal on the ground keeps a takeoff going, another mode ends it
        self.task, self.reached = task, False
        self.heading_wish = self._ahead = None
        if isinstance(task, TakeOff) and self.armed and not self.airborne:
            self._lift_at = max(self._armed_at + SPOOL_UP_S, self.now + LIFT_DELAY_S)
            self.touchdown_at = None

    def step(self, dt: float) -> None:
        """One step of `dt` seconds that ends at `now`."""
        if not self.armed:
            if self.airborne:
                self.motion.fall(dt)
                self._meet_ground()
            elif self.touchdown_at is not None:
                self._settle()
            return
        if not self.airborne:
            self._on_ground()
            return
        self._fly(dt)
        self._meet_ground()

    def _on_ground(self) -> None:
        if self._lift_at is not None and self.now >= self._lift_at:
            self._lift_at = None
            self.airborne, self.landed = True, Landed.TAKEOFF
            self.motion.rest()
        else:
            self._settle()

    def _settle(self) -> None:
        if self.touchdown_at is not None and self.now - self.touchdown_at >= TOUCHDOWN_TO_LANDED_S:
            self.landed = Landed.ON_GROUND
            if not self.armed:
                self.touchdown_at = None

    def _meet_ground(self) -> None:
        up = self.motion.up
        if up.position <= 0.0 and up.velocity <= 0.0:
            self.touchdown_speed, self.touchdown_at = -up.velocity, self.now
            self.airborne, up.position = False, 0.0
            self.motion.rest()

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
                self.motion.fly(Vector(), _HARD_STOP if hard else _STOP, dt)
                self._turn(self.heading_wish, dt)
            case Return() as back:
                self._return(back, dt)
            case Land():
                self._descend(dt)

    def _limits(self, leg: float | None = None) -> Limits:
        """Return the limits set by parameters; `leg` is the length of a smooth leg in metres."""
        asked = leg, self.cruise_speed, self.parameters.changes
        if asked != self._asked:
            self._asked, self._answer = asked, self._limits_now(leg)
        return self._answer

    def _limits_now(self, leg: float | None) -> Limits:
        values = self.parameters
        speed = self.cruise_speed or max(0.2, values["WPNAV_SPEED"] / 100)
        climb, descent = max(0.1, values["WPNAV_SPEED_UP"] / 100), max(0.1, values["WPNAV_SPEED_DN"] / 100)
        if leg is not None:
            speed = min(speed, max(1.0, _SMOOTH_PACE * math.sqrt(leg)))
            return Limits(speed, climb, descent, 2.2, 1.5, 1.0, 0.9, 1.0, 0.9, response=0.9)
        return Limits(speed, climb, descent)

    def _take_off(self, goal: float, dt: float) -> None:
        motion, height, speed = self.motion, self.height, self.motion.up.target_velocity
        # Near the ground the copter first creeps, then jumps off: recorded shape of the first metre.
        accel = 0.6 if speed < 0.4 and height < 0.2 else 2.9 if speed < 1.15 and height < 0.4 else 1.05
        if height > 1.0:
            accel = 1.1
        limits = Limits(climb=self._limits().climb, climb_accel=accel, jerk=40.0)
        motion.go(Vector(motion.north.target, motion.east.target, goal), limits, dt)
        self._turn(self.heading_wish, dt)
        off = goal - motion.up.position
        if not self.reached and (off < 0.03 or (off < 0.15 and motion.up.velocity < 0.15)):
            self.reached = True
            self.landed = Landed.IN_AIR

    def _go(self, leg: GoTo, dt: float) -> None:
        here = self.motion.position
        if leg.length is None:
            leg.length = math.hypot(leg.goal.north - here.north, leg.goal.east - here.east)
        self.motion.go(leg.goal, self._limits(leg.length if leg.smooth else None), dt)
        off, left = _apart(leg.goal, here), _apart(leg.goal, self.motion.target)
        if off < self.parameters["WPNAV_RADIUS"] / 100 and left < _LEG_DONE:
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
        self.motion.fly(drift.velocity, Limits(accel=2.5), dt)
        if drift.turn_rate is not None:
            drift.heading = (self.motion.heading + drift.turn_rate * max(dt, 0.5)) % (2 * math.pi)
        self._turn(drift.heading if drift.heading is not None else self.heading_wish, dt)

    def _return(self, back: Return, dt: float) -> None:
        here, home = self.motion.position, back.home
        away = math.hypot(here.north - home.north, here.east - home.east)
        if back.over is None:
            cone = self.parameters["RTL_CONE_SLOPE"] * away if self.parameters["RTL_CONE_SLOPE"] > 0 else math.inf
            height = max(here.up, home.up + min(self.parameters["RTL_ALT"] / 100, cone))
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
                if away < 1.0 and back.over.up - here.up < 0.5:
                    self._enter(back, Stage.WAIT)
            case Stage.WAIT:
                self.motion.go(back.over, limits, dt)
                if self.now - back.since >= RETURN_PAUSE_S + self.parameters["RTL_LOIT_TIME"] / 1000:
                    self._enter(back, Stage.DESCEND)
            case Stage.DESCEND:
                self._descend(dt)

    def _enter(self, back: Return, stage: Stage) -> None:
        back.stage, back.since = stage, self.now

    def _descend(self, dt: float) -> None:
        self.landed = Landed.LANDING
        slow = max(0.3, self.parameters["LAND_SPEED"] / 100)
        fast = max(slow, self.parameters["LAND_SPEED_HIGH"] / 100 or self.parameters["WPNAV_SPEED_DN"] / 100)
        above = self.height - (self.parameters["LAND_ALT_LOW"] / 100 + 0.25)
        speed = min(fast, math.sqrt(slow * slow + 2.4 * above)) if above > 0 else slow
        self.motion.fly(Vector(up=-speed), _STOP, dt)

    def _turn(self, heading: float | None, dt: float) -> None:
        if heading is not None:
            self.motion.turn(heading, dt)


def _apart(one: Vector, other: Vector) -> float:
    return math.dist((one.north, one.east, one.up), (other.north, other.east, other.up))


_STOP = Limits(accel=2.5)
_HARD_STOP = Limits(accel=3.4, release=1.1)
