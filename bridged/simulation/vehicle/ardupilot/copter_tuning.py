"""How ArduCopter flies a copter: constants fitted to recorded flights, and what its parameters set."""

import math

from bridged.simulation.vehicle.motion.copter_flight import Tuning
from bridged.simulation.vehicle.motion.dynamics import Limits
from bridged.simulation.vehicle.parameters import Parameters

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

_STOP = Limits(accel=2.5)
_HARD_STOP = Limits(accel=3.4, release=1.1)


def copter_tuning(values: Parameters, cruise_speed: float | None) -> Tuning:
    speed = cruise_speed or max(0.2, values["WPNAV_SPEED"] / 100)
    climb, descent = max(0.1, values["WPNAV_SPEED_UP"] / 100), max(0.1, values["WPNAV_SPEED_DN"] / 100)
    slow = max(0.3, values["LAND_SPEED"] / 100)
    fast = max(slow, values["LAND_SPEED_HIGH"] / 100 or values["WPNAV_SPEED_DN"] / 100)
    low = values["LAND_ALT_LOW"] / 100 + 0.25
    cone, highest = values["RTL_CONE_SLOPE"], values["RTL_ALT"] / 100

    def smooth(length: float) -> Limits:
        pace = min(speed, max(1.0, _SMOOTH_PACE * math.sqrt(length)))
        return Limits(pace, climb, descent, 2.2, 1.5, 1.0, 0.9, 1.0, 0.9, response=0.9)

    def takeoff(height: float, rising: float) -> Limits:
        # Near the ground the copter first creeps, then jumps off: recorded shape of the first metre.
        accel = 0.6 if rising < 0.4 and height < 0.2 else 2.9 if rising < 1.15 and height < 0.4 else 1.05
        if height > 1.0:
            accel = 1.1
        return Limits(climb=climb, climb_accel=accel, jerk=40.0)

    def landing(height: float) -> float:
        above = height - low
        return min(fast, math.sqrt(slow * slow + 2.4 * above)) if above > 0 else slow

    return Tuning(
        legs=Limits(speed, climb, descent),
        smooth=smooth,
        drift=_STOP,
        circle=_STOP,
        stop=_STOP,
        hard_stop=_HARD_STOP,
        landing=_STOP,
        spool_up=SPOOL_UP_S,
        lift_delay=LIFT_DELAY_S,
        takeoff=takeoff,
        takeoff_done=lambda off, rising: off < 0.03 or (off < 0.15 and rising < 0.15),
        radius=values["WPNAV_RADIUS"] / 100,
        return_height=lambda away: min(highest, cone * away if cone > 0 else math.inf),
        over_home=1.0,
        return_wait=RETURN_PAUSE_S + values["RTL_LOIT_TIME"] / 1000,
        descent=landing,
        touchdown_to_landed=TOUCHDOWN_TO_LANDED_S,
    )
