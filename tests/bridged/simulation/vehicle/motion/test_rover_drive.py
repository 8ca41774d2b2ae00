"""The motion of a simulated rover without an autopilot."""

import math

import pytest

from bridged.simulation.vehicle.motion.dynamics import Motion, Vector
from bridged.simulation.vehicle.motion.rover_drive import RoverDrive, RoverTuning
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo, Stop

TUNING = RoverTuning(
    speed=2.0, accel=1.0, brake=0.7, turn_rate=math.radians(60), radius=2.0, roll_out=1.5, delay=0.3
)  # fmt: skip


def drive(rover: RoverDrive, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        rover.now += 0.02
        rover.step(0.02)


@pytest.fixture
def rover() -> RoverDrive:
    rover = RoverDrive(Motion(0.0), lambda speed: TUNING)
    rover.arm()
    return rover


@pytest.mark.parametrize("goal", [Vector(10, 0, 0), Vector(-10, 0, 0), Vector(3, -12, 0)])
def test_it_drives_to_a_place_ahead_or_behind_and_stops_there(rover: RoverDrive, goal: Vector) -> None:
    rover.begin(GoTo(goal))
    drive(rover, 25.0)
    assert rover.reached
    assert rover.motion.position.distance(goal) < 1.5
    assert abs(rover.speed) < 0.1


def test_it_drives_no_faster_than_it_may_and_turns_no_faster(rover: RoverDrive) -> None:
    rover.begin(GoTo(Vector(0, 50, 0)))
    heading = rover.motion.heading
    for _ in range(500):
        drive(rover, 0.02)
        turned = abs(math.remainder(rover.motion.heading - heading, 2 * math.pi))
        assert turned <= TUNING.turn_rate * 0.02 + 1e-6
        assert abs(rover.speed) <= TUNING.speed + 1e-6
        heading = rover.motion.heading


def test_a_velocity_ends_when_it_expires(rover: RoverDrive) -> None:
    rover.begin(Drift(Vector(1.0, 0.0, 0.0), 3.0))
    drive(rover, 2.5)
    assert rover.speed == pytest.approx(1.0, abs=0.2)
    drive(rover, 10.0)
    assert isinstance(rover.task, Stop)
    assert abs(rover.speed) < 0.05


def test_without_motors_it_rolls_out_and_obeys_nothing(rover: RoverDrive) -> None:
    rover.begin(GoTo(Vector(40, 0, 0)))
    drive(rover, 6.0)
    rover.disarm()
    drive(rover, 10.0)
    stands = rover.motion.position
    rover.begin(GoTo(Vector(40, 0, 0)))
    drive(rover, 5.0)
    assert rover.motion.position.distance(stands) < 1e-6
