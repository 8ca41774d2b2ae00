"""What a PX4 carries, and the percepts of its equipment: the same actions and beliefs as with ArduPilot."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.autopilots.px4 import bits_of
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.components import CameraComponent, GimbalComponent
from tests.bridged.sky import HOME, Message, Sky

INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32


@pytest.fixture
def px4(tmp_path: Path) -> Sky:
    """A copter with PX4 that is heard, beside a camera and a gimbal."""
    sky = Sky(tmp_path, vehicle=Vehicle(HOME, KINDS["copter", "px4"]))
    sky.components += [CameraComponent(), GimbalComponent()]
    sky.forward(lambda: sky.belief("home_pos"), "home")
    sky.wait(3)
    return sky


def with_outputs(sky: Sky, values: dict[str, float]) -> None:
    """The vehicle has these integer parameters, too."""

    def hears(message: Message) -> bool:
        name = getattr(message, "param_id", "")
        if message.get_type() != "PARAM_REQUEST_READ" or name not in values:
            return True
        value = bits_of(values[name], INT32)
        sky.downlink.append(dialect.MAVLink_param_value_message(name.encode(), value, INT32, 900, 65535))
        return False

    sky.hears_us = hears


def test_pictures_video_and_gimbal_are_those_of_any_vehicle(px4: Sky) -> None:
    for action, *arguments in (
        ("take_picture",), ("start_video",), ("stop_video",), ("zoom", 30), ("point_gimbal", -30, 45),
    ):  # fmt: skip
        status = px4.do(action, *arguments)
        assert status.state == "succeeded", f"{action}: {status.reason}"


def test_without_a_camera_a_picture_is_refused(tmp_path: Path) -> None:
    sky = Sky(tmp_path, vehicle=Vehicle(HOME, KINDS["copter", "px4"]))
    sky.forward(lambda: sky.belief("home_pos"), "home")
    status = sky.do("take_picture")
    assert (status.state, "refused MAV_CMD_DO_DIGICAM_CONTROL" in status.reason) == ("refused", True)


def test_a_servo_is_the_actuator_for_which_its_output_is_set_up(px4: Sky) -> None:
    with_outputs(px4, {"PWM_AUX_FUNC1": 302, "PWM_AUX_MIN1": 1000, "PWM_AUX_MAX1": 2000})
    status = px4.do("drop_buoy")  # output 9 to 1900 us
    assert status.state == "succeeded", status.reason
    (command,) = px4.commands(dialect.MAV_CMD_DO_SET_ACTUATOR)
    assert command.param2 == pytest.approx(0.8)
    assert all(math.isnan(getattr(command, f"param{index}")) for index in (1, 3, 4, 5, 6))
    assert px4.commands(dialect.MAV_CMD_DO_SET_SERVO) == []


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({}, "output 9 is no actuator that commands set (301 to 306): there is no PWM_AUX_FUNC1"),
        ({"PWM_AUX_FUNC1": 101}, "output 9 is no actuator that commands set (301 to 306): PWM_AUX_FUNC1 is 101"),
        (
            {"PWM_AUX_FUNC1": 301, "PWM_AUX_MIN1": 1100, "PWM_AUX_MAX1": 1800},
            "output 9 takes 1100 to 1800 us (PWM_AUX_MIN1, PWM_AUX_MAX1), got 1900",
        ),
    ],
)
def test_an_output_that_is_not_set_up_for_it_is_not_moved(px4: Sky, values: dict[str, float], reason: str) -> None:
    with_outputs(px4, values)
    status = px4.do("drop_buoy")
    assert (status.state, status.reason) == ("refused", reason)
    assert px4.commands(dialect.MAV_CMD_DO_SET_ACTUATOR) == []


def test_the_wind_is_that_of_px4s_own_message(px4: Sky) -> None:
    asked = {one.param1 for one in px4.commands(dialect.MAV_CMD_SET_MESSAGE_INTERVAL) if one.param2 > 0}
    assert dialect.MAVLINK_MSG_ID_WIND_COV in asked
    assert dialect.MAVLINK_MSG_ID_WIND not in asked
    px4.downlink.append(dialect.MAVLink_wind_cov_message(0, 0.0, -4.0, 0, 0, 0, 0, 0, 0))
    px4.step()
    assert px4.belief("wind") == (90.0, 4.0)


def test_equipment_that_a_px4_does_not_have_is_no_warning(px4: Sky) -> None:
    px4.flying(10)
    px4.wait(30)
    assert [note for note in px4.driver.notes() if note.code in ("message_unknown", "message_late")] == []


def test_an_output_whose_range_is_not_reported_is_not_moved(px4: Sky) -> None:
    with_outputs(px4, {"PWM_AUX_FUNC1": 301, "PWM_AUX_MAX1": 2000})
    status = px4.do("drop_buoy")
    assert (status.state, status.reason) == (
        "failed", "the vehicle does not report PWM_AUX_MIN1, the range of output 9"
    )  # fmt: skip
    assert px4.commands(dialect.MAV_CMD_DO_SET_ACTUATOR) == []
