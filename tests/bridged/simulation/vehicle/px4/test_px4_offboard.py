"""OFFBOARD of a simulated PX4: it follows streams of setpoints, and does something else when they end."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.px4.modes import Mode
from tests.bridged.attended_vehicle import NAN, AttendedVehicle
from tests.bridged.sky import HOME

SET_MODE = 176


@pytest.fixture
def px4() -> AttendedVehicle:
    """At 10 m in AUTO.LOITER."""
    px4 = AttendedVehicle("copter", "px4")
    px4.command(400, 1)
    px4.command(22, -1, 0, 0, NAN, NAN, NAN, HOME.alt + 10)
    px4.until(lambda: px4.autopilot.mode is Mode.LOITER, "end of the takeoff")
    px4.wait(3.0)
    px4.heard.clear()
    return px4


def stream(px4: AttendedVehicle, seconds: float, north: float, east: float) -> None:
    for _ in range(round(seconds * 10)):
        px4.velocity(north, east)
        px4.wait(0.1)


def enter(px4: AttendedVehicle, north: float = 2.0, east: float = 0.0) -> None:
    stream(px4, 1.0, north, east)
    assert px4.command(SET_MODE, 1, 6) == 0


def test_it_follows_velocities_once_the_mode_is_set(px4: AttendedVehicle) -> None:
    stream(px4, 2.0, 2.0, 0.0)
    assert px4.at.flat() < 0.5
    assert px4.command(SET_MODE, 1, 6) == 0
    stream(px4, 5.0, 2.0, 0.0)
    assert px4.at.north == pytest.approx(8.5, abs=2)
    assert px4.autopilot.motion.velocity.north == pytest.approx(2.0, abs=0.3)


def test_it_follows_places_above_the_home_position(px4: AttendedVehicle) -> None:
    goal = Vector(10, 5, 12)
    enter(px4, 0, 0)
    for _ in range(150):
        px4.setpoint(goal)
        px4.wait(0.1)
    assert px4.distance(goal) < 0.5
    assert px4.at.up == pytest.approx(12, abs=0.5)
    assert px4.autopilot.mode is Mode.OFFBOARD


def test_without_setpoints_it_returns_after_a_second_and_goes_on_when_they_come_again(px4: AttendedVehicle) -> None:
    enter(px4)
    px4.wait(0.9)
    assert px4.autopilot.mode is Mode.OFFBOARD
    px4.wait(0.6)
    assert (px4.autopilot.mode, px4.autopilot.intended) == (Mode.RTL, Mode.OFFBOARD)
    assert "Failsafe activated" in px4.said
    px4.wait(2.0)
    stream(px4, 0.5, 0.0, 1.0)
    assert px4.autopilot.mode is Mode.OFFBOARD


def test_a_mode_set_during_the_return_ends_it_and_setpoints_do_not_bring_it_back(px4: AttendedVehicle) -> None:
    enter(px4)
    px4.wait(3.0)
    assert px4.command(SET_MODE, 1, 4, 3) == 0
    stream(px4, 3.0, 2.0, 0.0)
    assert px4.autopilot.mode is Mode.LOITER
    assert px4.speed < 1.0


def test_setpoints_with_an_unknown_frame_are_not_taken(px4: AttendedVehicle) -> None:
    for _ in range(20):
        px4.say(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 20, 0b010111000111, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0
            )
        )
        px4.wait(0.1)
    assert px4.command(SET_MODE, 1, 6) == 1
