"""Tasks of a vehicle that moves by itself, and what it reports of where it is: on the ground, in the air."""

from dataclasses import dataclass
from enum import Enum, IntEnum, auto

from bridged.simulation.vehicle.motion.dynamics import Limits, Vector


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
    limits: Limits | None = None  # None: those of legs
    radius: float | None = None  # m, of a plane's circle around it; anticlockwise if < 0, None: the autopilot's own


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


@dataclass(slots=True)
class Circle:
    """Around a place at its height, by a radius in metres and a speed in m/s; anticlockwise if the radius is < 0."""

    centre: Vector
    radius: float
    speed: float


@dataclass(slots=True)
class Approach:
    """A plane's landing: down to a place on the ground, along a straight line from where it begins."""

    goal: Vector
    length: float | None = None  # m, horizontally, from where it began ...
    up: float = 0.0  # ... at this altitude


Task = TakeOff | GoTo | Drift | Stop | Return | Land | Circle | Approach
