"""A copter with PX4."""

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.copter_flight import Flight, Tuning
from bridged.simulation.vehicle.motion.dynamics import Limits, Vector
from bridged.simulation.vehicle.motion.tasks import GoTo, Land, TakeOff, Task
from bridged.simulation.vehicle.parameters import Parameters
from bridged.simulation.vehicle.px4 import parameters
from bridged.simulation.vehicle.px4.px4 import Px4

_LIFT_S = 3.0
"""From the order to take off, or from `_SPOOL_UP_S` after arming, until it moves: the thrust rises slowly."""
_SPOOL_UP_S = 1.0
_DETECTED_S = 2.15
"""Before that, PX4 detects a takeoff."""
_TOP = 0.75
"""Metres below its goal at which a takeoff ends (recorded: 0.1 to 0.8)."""
_TOUCHDOWN_TO_LANDED_S = 2.6
_NEAR_HOME = 26.0
"""Metres; a return from nearer than this is flown lower (recorded: 20 m above home from 25 m, 30 m from 28 m)."""

_SLIP = 0.83
"""Share of a wanted speed that is flown: the recorded simulator has drag, and its PX4 no integral for seconds."""
_HOLD = Limits(accel=1.8, climb_accel=0.45)
_CRAWL, _CRAWL_HEIGHT = 0.32, 0.7


def _tuning(values: Parameters, cruise_speed: float | None) -> Tuning:
    speed = min(cruise_speed or values["MPC_XY_CRUISE"], values["MPC_XY_VEL_MAX"])
    up, down = max(0.1, values["MPC_Z_V_AUTO_UP"]), max(0.1, values["MPC_Z_V_AUTO_DN"])
    slow, high, low = max(0.3, values["MPC_LAND_SPEED"]), values["MPC_LAND_ALT1"], values["MPC_LAND_ALT2"]
    takeoff = Limits(climb=0.92 * max(0.1, values["MPC_TKO_SPEED"]), climb_accel=0.9, climb_brake=0.45, jerk=6.0)
    acceptance, highest = values["NAV_ACC_RAD"], values["RTL_RETURN_ALT"]
    legs = Limits(
        _SLIP * max(0.2, speed), 0.88 * up, down, accel=2.4, brake=0.75, jerk=4.0, settle=4.0,
        climb_accel=1.9, climb_brake=0.6, climb_settle=0.55, response=0.3, release=0.3,
    )  # fmt: skip

    def landing(height: float) -> float:
        if height < _CRAWL_HEIGHT:
            return _CRAWL
        share = min(1.0, max(0.0, (height - low) / max(0.1, high - low)))
        return slow + (down - slow) * share

    def return_height(away: float) -> float:
        return -math.inf if away < acceptance else highest if away > _NEAR_HOME else min(highest, 2 * acceptance)

    return Tuning(
        legs=legs,
        smooth=lambda length: legs,
        drift=Limits(accel=2.6, jerk=5.0),
        slip=_SLIP,
        turn_ahead=0.25,
        circle=Limits(accel=1.2, jerk=1.6),
        circle_slip=0.76,
        stop=_HOLD,
        hard_stop=_HOLD,
        landing=Limits(accel=2.5),
        spool_up=_SPOOL_UP_S + _LIFT_S,
        lift_delay=_LIFT_S,
        takeoff=lambda height, rising: takeoff,
        takeoff_done=lambda off, rising: off < _TOP,
        radius=0.8,
        return_height=return_height,
        over_home=acceptance,
        lands_over_home=True,
        return_wait=0.0,
        descent=landing,
        touchdown_to_landed=_TOUCHDOWN_TO_LANDED_S,
    )


class Px4Copter(Px4):
    """A quadrotor."""

    NAME: ClassVar = "copter"
    TYPE: ClassVar = dialect.MAV_TYPE_QUADROTOR
    ROWS: ClassVar = parameters.rows(parameters.COPTER)
    LOCOMOTION: ClassVar = Flight
    TUNING: ClassVar = staticmethod(_tuning)
    DETECTED_S: ClassVar = _DETECTED_S
    flight: Flight

    @property
    def stream_limits(self) -> Limits:
        """Limits of the way to a place that is streamed in OFFBOARD."""
        up, down = 0.88 * self.parameters["MPC_Z_V_AUTO_UP"], self.parameters["MPC_Z_V_AUTO_DN"]
        return Limits(
            _SLIP * self.parameters["MPC_XY_VEL_MAX"], up, down, accel=4.0, brake=3.3, jerk=8.0, settle=0.95,
            climb_accel=2.0, climb_brake=1.0, climb_settle=1.0,
        )  # fmt: skip

    def begin_takeoff(self, up: float) -> None:
        """Take off to an altitude on the map."""
        self.flight.begin(TakeOff(up))

    def landing(self) -> Task:
        """Return what it does in AUTO.LAND."""
        return Land()

    def going(self, goal: Vector, heading: float | None = None, radius: float = math.nan) -> Task:
        """Return how it goes to a goal and stays there."""
        return GoTo(goal, heading)

    def return_height(self) -> float:
        """Return the height above home of a return from here, in metres."""
        return self.flight.tuning.return_height(self.motion.position.distance(self.home_on_chart))
