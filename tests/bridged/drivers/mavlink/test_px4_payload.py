"""What a PX4 carries, and the percepts of its equipment: the same actions and beliefs as with ArduPilot."""

import math
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.autopilots.px4 import bits_of
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.manifest.loader import load_manifest
from tests.bridged.components import CameraComponent, GimbalComponent
from tests.bridged.sky import HOME, Message, Sky, end_of
from tests.docs.pages import ROOT

INT32, REAL32 = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32


ACTUATOR, MOVES_DISARMED = ("PWM_MAIN_FUNC9", 302.0), ("COM_PREARM_MODE", 2.0)


def heard(state: Path, *parameters: tuple[str, float]) -> Sky:
    """Return a copter with PX4 and these parameters that is heard."""
    sky = Sky(state, vehicle=Vehicle(HOME, KINDS["copter", "px4"], parameters=parameters))
    sky.forward(lambda: sky.belief("home_pos"), "home")
    return sky


@pytest.fixture
def px4(tmp_path: Path) -> Sky:
    """A copter with PX4 that is heard, beside a camera and a gimbal."""
    sky = Sky(tmp_path, vehicle=Vehicle(HOME, KINDS["copter", "px4"]))
    sky.components += [CameraComponent(), GimbalComponent()]
    sky.forward(lambda: sky.belief("home_pos"), "home")
    sky.wait(3)
    return sky


def with_outputs(sky: Sky, values: dict[str, float]) -> None:
    """The vehicle has eight MAIN outputs, and these integer parameters."""

    def hears(message: Message) -> bool:
        name = getattr(message, "param_id", "")
        if name == "PWM_MAIN_FUNC9":
            sky.downlink.append(dialect.MAVLink_param_error_message(0, 0, name.encode(), 10080, 1))
            return False
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


def test_a_servo_is_the_actuator_for_which_its_output_is_set_up(tmp_path: Path) -> None:
    px4 = heard(tmp_path, ACTUATOR, MOVES_DISARMED)
    status = px4.do("drop_buoy")  # output 9 to 1900 us
    assert status.state == "succeeded", status.reason
    command = px4.commands(dialect.MAV_CMD_DO_SET_ACTUATOR)[0]
    assert command.param2 == pytest.approx(0.8)
    assert all(math.isnan(getattr(command, f"param{index}")) for index in (1, 3, 4, 5, 6))
    assert px4.commands(dialect.MAV_CMD_DO_SET_SERVO) == []
    assert pulses(px4)[8] == 1900


def test_a_reversed_output_gets_the_pulse_that_was_asked_for(tmp_path: Path) -> None:
    px4 = heard(tmp_path, ACTUATOR, MOVES_DISARMED, ("PWM_MAIN_REV", 1 << 8))
    px4.done("drop_buoy")
    assert pulses(px4)[8] == 1900


def test_disarmed_an_output_that_would_not_move_is_refused(tmp_path: Path) -> None:
    px4 = heard(tmp_path, ACTUATOR)
    status = px4.do("drop_buoy")
    reason = "disarmed, PX4 moves outputs only with COM_PREARM_MODE 2; it is 0"
    assert (status.state, status.reason) == ("refused", reason)
    px4.flying()
    px4.done("drop_buoy")


def test_an_output_that_was_acknowledged_and_does_not_move_is_no_success(tmp_path: Path) -> None:
    px4 = heard(tmp_path, ACTUATOR, MOVES_DISARMED)
    px4.pretend(lambda message: getattr(message, "command", 0) == dialect.MAV_CMD_DO_SET_ACTUATOR)
    status = px4.do("drop_buoy")
    reason = "MAV_CMD_DO_SET_ACTUATOR was acknowledged, but SERVO_OUTPUT_RAW does not show servo 9 at 1900"
    assert (status.state, status.reason.startswith(reason)) == ("failed", True)


def test_an_output_of_aux_that_is_not_reported_is_confirmed_by_its_acknowledgement(tmp_path: Path) -> None:
    px4 = heard(tmp_path, ("PWM_MAIN_DIS9", 0.0))  # a pulse of 0, as of an output that it does not have
    with_outputs(px4, AUX)
    px4.done("drop_buoy")
    assert px4.commands(dialect.MAV_CMD_DO_SET_ACTUATOR)[0].param2 == pytest.approx(0.8)


def test_outputs_of_aux_are_numbered_after_those_of_main(tmp_path: Path) -> None:
    manifest = load_manifest(ROOT / "missions/search_and_rescue/rescuer.toml")
    px4 = Sky(tmp_path, vehicle=Vehicle(HOME, KINDS["copter", "px4"]), manifest=manifest)
    px4.forward(lambda: px4.belief("home_pos"), "home")
    for _ in range(3):  # MAIN has no output 9
        px4.downlink.append(dialect.MAVLink_servo_output_raw_message(0, 0, *([1500] * 8), *([0] * 8)))
        px4.downlink.append(dialect.MAVLink_servo_output_raw_message(0, 1, 1100, *([900] * 7), *([0] * 8)))
        px4.step()
        assert px4.belief("latch") == (1100,)


def pulses(sky: Sky) -> list[int]:
    """The pulses of its outputs in us."""
    autopilot = sky.vehicle.autopilot
    return autopilot.outputs.pulses(armed=autopilot.armed, airborne=autopilot.flight.airborne)


AUX = {
    "PWM_AUX_FUNC1": 302, "PWM_AUX_MIN1": 1000, "PWM_AUX_MAX1": 2000, "PWM_AUX_REV": 0, "COM_PREARM_MODE": 2,
}  # fmt: skip


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
    assert end_of(px4.do("drop_buoy")) == ("refused", reason)
    assert px4.commands(dialect.MAV_CMD_DO_SET_ACTUATOR) == []


def test_the_wind_is_that_of_px4s_own_message(px4: Sky) -> None:
    asked = {one.param1 for one in px4.commands(dialect.MAV_CMD_SET_MESSAGE_INTERVAL) if one.param2 > 0}
    assert dialect.MAVLINK_MSG_ID_WIND_COV in asked
    assert dialect.MAVLINK_MSG_ID_WIND not in asked
    px4.downlink.append(dialect.MAVLink_wind_cov_message(0, 0.0, -4.0, 0, 0, 0, 0, 0, 0))
    px4.step()
    assert px4.belief("wind") == (90.0, 4.0)


def test_an_output_whose_range_is_not_reported_is_not_moved(px4: Sky) -> None:
    with_outputs(px4, {"PWM_AUX_FUNC1": 301, "PWM_AUX_MAX1": 2000})
    status = px4.do("drop_buoy")
    assert (status.state, status.reason) == (
        "failed", "the vehicle does not report PWM_AUX_MIN1, the range of output 9"
    )  # fmt: skip
    assert px4.commands(dialect.MAV_CMD_DO_SET_ACTUATOR) == []
