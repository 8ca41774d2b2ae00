"""A simulated Rover with ArduPilot: it drives to goals and along velocities, as tests/data/autopilots have it."""

from __future__ import annotations

import math

import pytest

from bridged.simulation.vehicle.ardupilot.flight_modes import RoverMode
from bridged.simulation.vehicle.motion.dynamics import Vector
from tests.bridged.attended_vehicle import AttendedVehicle

SET_MODE, ARM, REPOSITION = 176, 400, 192


def mode(rover: AttendedVehicle, wanted: RoverMode) -> int:
    return rover.command(SET_MODE, 1, wanted)


@pytest.fixture
def rover() -> AttendedVehicle:
    """Armed in GUIDED."""
    rover = AttendedVehicle("rover", "ardupilot")
    assert mode(rover, RoverMode.GUIDED) == 0
    assert rover.command(ARM, 1) == 0
    rover.heard.clear()
    return rover


def test_it_drives_to_setpoints_and_repositions(rover: AttendedVehicle) -> None:
    goal = Vector(15, 10, 0)
    rover.setpoint(goal)
    rover.until(lambda: rover.distance(goal) < 1.5, "goal", 60)
    rover.wait(4.0)
    assert rover.distance(goal) < 2.5
    goal = Vector(0, 20, 0)
    assert rover.place(REPOSITION, goal, -1, 0, 0, 0, alt=0.0, frame=6) == 0
    rover.until(lambda: rover.distance(goal) < 1.5, "goal", 60)
    assert rover.at.up == 0


def test_it_follows_velocities_and_stops_3_s_after_the_last_one(rover: AttendedVehicle) -> None:
    for _ in range(40):
        rover.velocity(1.0, 0.0)
        rover.wait(0.1)
    assert rover.autopilot.motion.velocity.north == pytest.approx(1.0, abs=0.4)
    rover.wait(3.5)
    assert "target not received last 3secs, stopping" in rover.said
    rover.wait(6.0)
    assert rover.speed < 0.1


def test_hold_stops_it_and_setpoints_are_ignored_there(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(40, 0, 0))
    rover.wait(5.0)
    assert rover.speed > 0.5
    assert mode(rover, RoverMode.HOLD) == 0
    rover.setpoint(Vector(40, 0, 0))
    rover.wait(15.0)
    assert rover.speed < 0.1
    assert rover.at.north < 30


def test_a_takeoff_and_modes_without_their_conditions_are_refused(rover: AttendedVehicle) -> None:
    assert rover.command(22, 0, 0, 0, 0, 0, 0, 10) != 0
    assert mode(rover, RoverMode.AUTO) == 4
    rover.wait(0.3)
    assert rover.said[-2:] == ["No Mission. Can't set AUTO.", "Flight mode change failed"]
    assert mode(rover, RoverMode.DOCK) == 4
    assert rover.autopilot.mode is RoverMode.GUIDED


@pytest.mark.parametrize("wanted", [RoverMode.RTL, RoverMode.SMART_RTL])
def test_a_return_drives_home_and_stays_armed(rover: AttendedVehicle, wanted: RoverMode) -> None:
    rover.setpoint(Vector(20, 0, 0))
    rover.wait(14.0)
    assert mode(rover, wanted) == 0
    rover.until(lambda: "Reached destination" in rover.said, "home", 90)
    assert rover.at.flat() < 3
    assert rover.autopilot.armed


def test_it_is_disarmed_while_it_drives_and_rolls_out(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(40, 0, 0))
    rover.wait(6.0)
    assert rover.command(ARM, 0) == 0
    before = rover.at.north
    rover.wait(10.0)
    assert rover.at.north > before + 0.5
    assert rover.speed < 0.1


def test_a_lost_ground_station_brings_it_home_if_its_parameters_say_so(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(30, 0, 0))
    rover.autopilot.parameters.set("FS_GCS_ENABLE", 1)
    rover.autopilot.parameters.set("FS_ACTION", 1)
    rover.silent = True
    rover.wait(12.0)
    assert rover.autopilot.mode is RoverMode.RTL
    assert "Radio Failsafe" in rover.said


def test_home_follows_it_while_it_is_disarmed(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(20, 0, 0))
    rover.wait(14.0)
    assert math.isclose(rover.autopilot.home_on_chart.flat(), 0.0, abs_tol=0.5)
    rover.command(ARM, 0)
    rover.wait(8.0)
    assert rover.autopilot.home_on_chart.distance(rover.at) < 1.0
