"""A simulated rover with PX4: it drives to places and along velocities, and takes no takeoff."""

from __future__ import annotations

import pytest

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.px4.modes import Mode
from tests.bridged.attended_vehicle import NAN, AttendedVehicle, Item

NO = (0.0, 0.0, 0.0, NAN)


@pytest.fixture
def px4() -> AttendedVehicle:
    """Armed."""
    px4 = AttendedVehicle("rover", "px4")
    assert px4.command(400, 1) == 0
    return px4


def test_it_is_a_rover_and_takes_no_takeoff(px4: AttendedVehicle) -> None:
    px4.wait(1.2)
    assert px4.last("HEARTBEAT").type == 10
    assert px4.command(22, 0, 0, 0, NAN, NAN, NAN, NAN) == 2


def test_a_reposition_drives_there_on_the_ground(px4: AttendedVehicle) -> None:
    goal = Vector(15, 15, 0)
    assert px4.place(192, goal, -1, 1, 0, NAN) == 0
    px4.until(lambda: px4.distance(goal) < 1.5, "goal", 60)
    px4.wait(4.0)
    assert px4.distance(goal) < 2.0
    assert px4.speed < 0.2
    assert px4.at.up == 0


def test_velocities_are_followed_in_offboard_and_without_them_it_returns(px4: AttendedVehicle) -> None:
    for round_ in range(60):
        px4.velocity(1.5, 0.0)
        if round_ == 10:
            assert px4.command(176, 1, 6) == 0
        px4.wait(0.1)
    assert px4.at.north > 4
    px4.wait(2.0)
    assert px4.autopilot.mode is Mode.RTL


def test_a_mission_is_driven_to_its_end(px4: AttendedVehicle) -> None:
    items: list[Item] = [(16, 6, NO, Vector(10, 0, 0), 0.0), (16, 6, NO, Vector(10, 10, 0), 0.0)]
    assert px4.upload(items) == 0
    assert px4.command(300) == 0
    px4.until(lambda: "Mission finished, loitering" in px4.said, "end of the mission", 90)
    px4.wait(5.0)
    assert px4.distance(Vector(10, 10, 0)) < 3
    assert {one.seq for one in px4.heard if one.get_type() == "MISSION_ITEM_REACHED"} >= {0, 1}


def test_a_return_drives_home_and_disarms(px4: AttendedVehicle) -> None:
    px4.place(192, Vector(20, 0, 0), -1, 1, 0, NAN)
    px4.wait(12.0)
    assert px4.at.north > 10
    assert px4.command(20) == 0
    px4.until(lambda: not px4.autopilot.armed, "landing", 60)
    assert px4.at.flat() < 3
