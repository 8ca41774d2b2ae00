"""A simulated rover with PX4: it drives to places and along velocities, and takes no takeoff."""

from __future__ import annotations

import pytest

from bridged.simulation.vehicle.px4.modes import Mode
from tests.bridged.attended_vehicle import NAN, AttendedVehicle

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


def test_velocities_are_followed_in_offboard_and_without_them_it_returns(px4: AttendedVehicle) -> None:
    for round_ in range(60):
        px4.velocity(1.5, 0.0)
        if round_ == 10:
            assert px4.command(176, 1, 6) == 0
        px4.wait(0.1)
    assert px4.at.north > 4
    px4.wait(2.0)
    assert px4.autopilot.mode is Mode.RTL
