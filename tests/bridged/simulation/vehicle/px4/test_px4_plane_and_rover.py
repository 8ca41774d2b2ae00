"""A simulated plane with PX4: takeoff, circles, a landing by the mission; and a rover, which takes no takeoff."""

import pytest

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.px4.modes import Mode
from tests.bridged.attended_vehicle import NAN, AttendedVehicle, Item
from tests.bridged.sky import HOME

NO = (0.0, 0.0, 0.0, NAN)
TAKE_OFF: Item = (22, 6, NO, Vector(250, 0, 0), 40.0)
AHEAD: Item = (16, 6, NO, Vector(500, 300, 0), 40.0)
FINAL: Item = (16, 6, NO, Vector(500, 0, 0), 25.0)
START: Item = (189, 6, NO, None, 0.0)
LAND: Item = (21, 6, NO, Vector(0, 0, 0), 0.0)


@pytest.fixture
def px4() -> AttendedVehicle:
    return AttendedVehicle("plane", "px4")


@pytest.fixture
def flying(px4: AttendedVehicle) -> AttendedVehicle:
    """In AUTO.LOITER after a takeoff to 50 m."""
    assert px4.command(400, 1) == 0
    assert px4.command(22, 0, 0, 0, NAN, NAN, NAN, HOME.alt + 50) == 0
    px4.until(lambda: px4.autopilot.mode is Mode.LOITER, "end of the takeoff", 200)
    px4.heard.clear()
    return px4


def test_it_takes_off_and_circles_where_that_ends(flying: AttendedVehicle) -> None:
    assert flying.at.up == pytest.approx(50, abs=12)
    end = flying.at
    flying.wait(60.0)
    assert flying.speed > 8
    assert (flying.last("HEARTBEAT").type, flying.last("HEARTBEAT").autopilot) == (1, 12)
    assert end.distance(flying.at) < 250
    assert flying.last("ORBIT_EXECUTION_STATUS").radius == pytest.approx(80)
    assert flying.last("VFR_HUD").airspeed > 8


def test_a_reposition_circles_another_place_and_altitude(flying: AttendedVehicle) -> None:
    goal = Vector(-300, 100, 70)
    assert flying.place(192, goal, -1, 1, 0, NAN) == 0
    flying.wait(90.0)
    assert 55 < flying.distance(goal) < 110
    assert flying.at.up == pytest.approx(70, abs=5)


def test_a_return_without_a_landing_circles_over_home(flying: AttendedVehicle) -> None:
    flying.command(20)
    flying.until(lambda: "RTL: completed, loitering" in flying.said, "return", 200)
    flying.wait(40.0)
    assert flying.at.flat() < 120
    assert flying.at.up == pytest.approx(100, abs=8)
    assert flying.autopilot.armed


def test_a_mission_lands_and_disarms(px4: AttendedVehicle) -> None:
    assert px4.upload([TAKE_OFF, AHEAD, START, FINAL, LAND]) == 0
    px4.command(176, 1, 4, 4)
    assert px4.command(400, 1) == 0
    px4.until(lambda: not px4.autopilot.armed, "landing", 400)
    assert px4.at.flat() < 150
    assert "Mission finished, landed" in px4.said


def test_a_landing_that_is_too_steep_cannot_be_flown(px4: AttendedVehicle) -> None:
    near: Item = (16, 6, NO, Vector(60, 0, 0), 60.0)
    assert px4.upload([TAKE_OFF, AHEAD, START, near, LAND]) == 0
    px4.command(400, 1)
    assert px4.command(300) == 2


def test_its_airspeed_can_be_changed(flying: AttendedVehicle) -> None:
    before = flying.autopilot.motion.airspeed
    assert flying.command(178, 0, 18, -1) == 0
    flying.wait(20.0)
    assert flying.autopilot.motion.airspeed > before + 1


@pytest.fixture
def rover() -> AttendedVehicle:
    """Armed."""
    rover = AttendedVehicle("rover", "px4")
    assert rover.command(400, 1) == 0
    return rover


def test_it_is_a_rover_and_takes_no_takeoff(rover: AttendedVehicle) -> None:
    rover.wait(1.2)
    assert rover.last("HEARTBEAT").type == 10
    assert rover.command(22, 0, 0, 0, NAN, NAN, NAN, NAN) == 2


def test_velocities_are_followed_in_offboard_and_without_them_it_returns(rover: AttendedVehicle) -> None:
    for round_ in range(60):
        rover.velocity(1.5, 0.0)
        if round_ == 10:
            assert rover.command(176, 1, 6) == 0
        rover.wait(0.1)
    assert rover.at.north > 4
    rover.wait(2.0)
    assert rover.autopilot.mode is Mode.RTL
