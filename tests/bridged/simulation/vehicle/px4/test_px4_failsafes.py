"""Failsafes of a simulated PX4: of the ground station, the sticks, the battery and the fence; a pilot who takes it."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.px4.modes import Mode
from tests.bridged.attended_vehicle import NAN, AttendedVehicle
from tests.bridged.sky import HOME

SET_MODE = 176


def flown(**parameters: float) -> AttendedVehicle:
    """At 10 m in AUTO.LOITER."""
    px4 = AttendedVehicle("copter", "px4")
    for name, value in parameters.items():
        px4.autopilot.parameters.set(name, value)
    px4.command(400, 1)
    px4.command(22, -1, 0, 0, NAN, NAN, NAN, HOME.alt + 10)
    px4.until(lambda: px4.autopilot.mode is Mode.LOITER, "end of the takeoff")
    px4.heard.clear()
    return px4


def sticks(px4: AttendedVehicle, seconds: float, pitch: int = 0, throttle: int = 500) -> None:
    for _ in range(round(seconds * 10)):
        px4.say(dialect.MAVLink_manual_control_message(1, pitch, 0, throttle, 0, 0))
        px4.wait(0.1)


def test_a_lost_ground_station_does_nothing_by_default() -> None:
    px4 = flown()
    px4.silent = True
    px4.wait(30.0)
    assert px4.autopilot.mode is Mode.LOITER


def test_lost_sticks_bring_it_home_from_the_mode_of_a_pilot_alone() -> None:
    px4 = flown()
    sticks(px4, 1.0)
    px4.wait(8.0)
    assert px4.autopilot.mode is Mode.LOITER
    sticks(px4, 1.0)
    assert px4.command(SET_MODE, 1, 3) == 0
    px4.until(lambda: px4.autopilot.mode is Mode.RTL, "return", 20)


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.LOITER), (2, Mode.LAND), (3, Mode.RTL)])
def test_a_low_battery_does_what_its_parameter_says(action: int, mode: Mode) -> None:
    px4 = flown(COM_LOW_BAT_ACT=action, SIM_BAT_DRAIN=60, SIM_BAT_MIN_PCT=6)
    px4.wait(80.0)
    modes = {one.custom_mode for one in px4.heard if one.get_type() == "HEARTBEAT"}
    assert mode in modes
    assert (Mode.RTL in modes or Mode.LAND in modes) == bool(action)


def test_a_breach_of_the_fence_is_told_and_brings_it_home() -> None:
    px4 = flown(GF_ACTION=3)
    px4.place(192, Vector(60, 0, 10), -1, 1, 0, NAN)
    px4.wait(2.0)
    px4.autopilot.parameters.set("GF_MAX_HOR_DIST", 20)
    px4.until(lambda: px4.autopilot.mode is Mode.RTL, "return", 60)
    assert any("eofence" in text for text in px4.said)
    px4.until(lambda: not px4.autopilot.armed, "landing", 200)
    assert px4.at.flat() < 1.0
