"""The motion of a simulated plane without an autopilot."""

import math

import pytest

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.plane_flight import PlaneFlight, PlaneMotion, PlaneTuning
from bridged.simulation.vehicle.motion.tasks import Approach, Circle, GoTo, Landed, Stop, TakeOff

TUNING = PlaneTuning(
    airspeed=20.0, radius=80.0, near=30.0, turn_rate=0.4, climb=4.0, sink=3.0, takeoff_climb=6.0, rotation=15.0,
    thrust=5.0, run_delay=0.5, takeoff_done=1.0, flare_height=3.0, flare_sink=0.6, roll_out=3.0,
    touchdown_to_landed=5.0,
)  # fmt: skip


def fly(flight: PlaneFlight, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        flight.now += 0.02
        flight.step(0.02)


@pytest.fixture
def flight() -> PlaneFlight:
    """At 50 m after a takeoff to the north."""
    flight = PlaneFlight(PlaneMotion(0.0), lambda speed: TUNING)
    flight.arm()
    flight.begin(TakeOff(50.0))
    fly(flight, 25.0)
    assert flight.reached
    return flight


def test_it_rolls_before_it_climbs(flight: PlaneFlight) -> None:
    other = PlaneFlight(PlaneMotion(math.pi / 2), lambda speed: TUNING)
    other.arm()
    other.begin(TakeOff(50.0))
    fly(other, 3.0)
    assert other.rolls
    assert (other.motion.up.position, other.motion.north.position) == (0.0, pytest.approx(0.0, abs=1e-6))
    assert other.motion.east.position > 5
    assert flight.motion.north.position > 100
    assert flight.landed is Landed.IN_AIR


@pytest.mark.parametrize("radius", [80.0, -80.0])
def test_it_circles_in_the_direction_of_the_sign(flight: PlaneFlight, radius: float) -> None:
    centre = Vector(0, 0, 60)
    flight.begin(Circle(centre, radius, 20.0))
    fly(flight, 90.0)
    assert flight.motion.position.distance(centre) == pytest.approx(80, abs=10)
    assert flight.motion.up.position == pytest.approx(60, abs=1)
    assert math.copysign(1, flight.motion.turn_rate) == math.copysign(1, radius)


def test_it_cannot_stop_and_circles_where_it_is_told_to(flight: PlaneFlight) -> None:
    here = flight.motion.position
    flight.begin(Stop())
    fly(flight, 60.0)
    assert flight.motion.airspeed == pytest.approx(20)
    assert flight.motion.position.distance(here) < 120


def test_a_smooth_leg_is_done_near_its_end_and_climbs_no_faster_than_it_can(flight: PlaneFlight) -> None:
    flight.begin(GoTo(Vector(900, 0, 150), smooth=True))
    fly(flight, 10.0)
    assert flight.motion.up.velocity <= 4.0 + 1e-6
    fly(flight, 40.0)
    assert flight.reached


def test_wind_carries_it(flight: PlaneFlight) -> None:
    flight.motion.air = Vector(5.0, 0.0, 0.0)
    flight.begin(GoTo(Vector(2000, 0, 50), smooth=True))
    fly(flight, 5.0)
    assert flight.motion.velocity.north == pytest.approx(25, abs=0.5)


def test_it_lands_at_a_place_rolls_out_and_is_then_on_the_ground(flight: PlaneFlight) -> None:
    flight.begin(Approach(Vector(900, 0, 0)))
    fly(flight, 80.0)
    assert not flight.airborne
    assert flight.landed is Landed.ON_GROUND
    assert flight.touchdown_speed < 2.0
    assert flight.motion.position.distance(Vector(900, 0, 0)) < 150
    assert flight.motion.airspeed == 0


def test_without_a_motor_it_falls(flight: PlaneFlight) -> None:
    flight.disarm()
    fly(flight, 15.0)
    assert not flight.airborne
    assert flight.touchdown_speed > 3
