"""What a vehicle does by itself in mid-action: failsafes, crashes, terminations; no action succeeds, none fights it."""

from functools import partial
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.wire.records import ActionStatus
from tests.bridged.drivers.mavlink.test_six_kinds import FAR, sky_of, under_way
from tests.bridged.sky import HOME, Message, Sky

LANDING = [
    ["takeoff", 0, 0, 50], [*FAR, 50], [-27.59, -48.53, 50], ["MAV_CMD_DO_LAND_START", 0, 0, 0],
    [-27.598, -48.5184, 40], ["land", -27.6030, -48.5184, 0],
]  # fmt: skip
RTL_ACTION = 2
"""BATT_FS_LOW_ACT: return."""


def goes_down(state: int, message: Message) -> bool:
    """Whether the bridge hears a message: it does; HEARTBEATs have the `state` (MAV_STATE)."""
    if message.get_type() == "HEARTBEAT":
        message.system_status = state
    return True


@pytest.mark.parametrize("action", ["land", "return_to_launch"])
def test_motors_that_the_vehicle_stops_because_it_has_crashed_are_no_landing(sky: Sky, action: str) -> None:
    sky.flying(5)
    heard = sky.begin(action)
    sky.forward(lambda: sky.driver.vehicle.on_ground, "the ground")
    sky.downlink.append(dialect.MAVLink_statustext_message(0, b"Crash: Disarming: AngErr=64>30, Accel=0.6<3.0"))
    sky.vehicle.autopilot.disarm(force=True)
    status = sky.end(heard, 10)
    assert status.state == "failed"
    assert "Crash: Disarming" in status.reason


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("state", [dialect.MAV_STATE_EMERGENCY, dialect.MAV_STATE_FLIGHT_TERMINATION])
def test_a_motion_of_a_vehicle_that_goes_down_or_whose_motors_are_cut_has_failed_and_is_not_followed_by_another(
    tmp_path: Path, autopilot: str, state: int
) -> None:
    sky = sky_of(tmp_path, "copter", autopilot)
    under_way(sky, "copter")
    landing = sky.begin("land")
    sky.wait(3)

    sky.we_hear = partial(goes_down, state)
    sent = len(sky.sent)
    status = sky.end(landing, 5)
    assert (status.state, status.cause) == ("failed", "pilot")
    name = dialect.enums["MAV_STATE"][state].name.removeprefix("MAV_STATE_")
    assert f"(the vehicle's failsafe; its state is {name})" in status.reason
    assert sky.belief("override") == ("LAND",)
    assert sky.do("goto", *FAR, 40).cause == "pilot"
    asked = {one.command for one in sky.sent[sent:] if one.get_type().startswith("COMMAND_")}
    assert asked <= {dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_REQUEST_MESSAGE}


def test_a_mission_whose_flight_is_terminated_at_its_last_item_has_failed(sky: Sky) -> None:
    sky.flying(20)
    sky.done("upload_mission", [["takeoff", 0, 0, 20], ["land"]])
    heard = sky.begin("start_mission")
    sky.forward(
        lambda: sky.belief("mission_item") is not None and sky.belief("mission_item")[0] == 2, "the landing", 30
    )
    sky.we_hear = partial(goes_down, dialect.MAV_STATE_FLIGHT_TERMINATION)
    status = sky.end(heard, 60)
    assert status.state == "failed"
    assert "the vehicle's failsafe" in status.reason


def test_a_mission_that_a_failsafe_breaks_off_names_it_as_the_cause(sky: Sky) -> None:
    sky.flying(20)
    sky.done("upload_mission", [["takeoff", 0, 0, 20], [*FAR, 20], ["rtl"]])
    heard = sky.begin("start_mission")
    sky.wait(5)
    sky.vehicle.autopilot.on_shortage(RTL_ACTION)
    assert (sky.end(heard, 10).state, heard[-1].cause) == ("failed", "pilot")


def test_a_failsafe_that_enters_the_mode_of_a_way_home_that_was_just_cancelled_is_no_mode_of_ours(sky: Sky) -> None:
    sky.flying(20)
    sky.begin("return_to_launch")
    sky.forward(lambda: sky.belief("state") == ("RTL", True, True), "the way home", 3)
    sky.bridge.action_server.cancel("uav", sky.statuses[-1].id, "uav")
    sky.forward(lambda: sky.belief("state") == ("GUIDED", True, True), "the hold", 3)
    going = sky.begin("goto", *FAR, 20)
    sky.wait(1)
    sky.vehicle.autopilot.on_shortage(RTL_ACTION)
    status = sky.end(going, 5)
    assert (status.state, status.cause) == ("failed", "pilot")
    assert sky.belief("override") == ("RTL",)


def test_a_mode_that_a_failsafe_sets_again_after_an_agent_left_it_is_not_left_a_second_time(sky: Sky) -> None:
    sky.flying(20)
    sky.vehicle.autopilot.on_shortage(RTL_ACTION)
    sky.forward(lambda: sky.belief("override"), "the override", 3)
    heard = sky.begin("set_mode", "GUIDED")
    sky.forward(lambda: sky.belief("state") == ("GUIDED", True, True), "the mode", 3)
    sky.vehicle.autopilot.on_shortage(RTL_ACTION)
    assert (sky.end(heard, 20).state, heard[-1].cause) == ("failed", "pilot")
    assert sky.vehicle.autopilot.mode is Mode.RTL
    assert sky.belief("override") == ("RTL",)


def test_where_a_vehicle_is_that_has_no_position_yet_is_not_known(tmp_path: Path) -> None:
    sky = Sky(tmp_path, vehicle=Vehicle(HOME, boot="real"))
    sky.forward(lambda: sky.driver.vehicle.positions, "its reports", 60)
    sky.wait(1)
    assert sky.told("global_pos") == []
    sky.forward(lambda: sky.belief("global_pos"), "its position", 120)
    assert sky.told("global_pos")[0] == pytest.approx((HOME.lat, HOME.lon), abs=1e-5)


def on_the_leg(tmp_path: Path, leg: int) -> tuple[Sky, list[ActionStatus]]:
    """An ArduPlane on the way to an item of its mission."""
    sky = sky_of(tmp_path, "plane", "ardupilot")
    sky.vehicle.autopilot.parameters.set("RTL_AUTOLAND", 2)
    sky.done("upload_mission", LANDING)
    heard = sky.armed().begin("start_mission")
    sky.forward(lambda: sky.belief("mission_item") == (leg, len(LANDING)), "the leg", 120)
    return sky, heard


@pytest.mark.parametrize("leg", [2, 3])
def test_a_mission_that_a_planes_failsafe_cuts_short_by_its_landing_has_failed_and_the_landing_goes_on(
    tmp_path: Path, leg: int
) -> None:
    sky, heard = on_the_leg(tmp_path, leg)
    sky.wait(3)
    sky.vehicle.autopilot.start_landing()
    status = sky.end(heard, 5)
    assert (status.state, status.cause) == ("failed", "pilot")
    assert status.reason.startswith(f"the vehicle goes on to item 5 and was not at item {leg}, which nobody here asked")
    sky.forward(lambda: sky.belief("override") == ("AUTO",), "the override", 3)
    assert sky.do("return_to_launch").cause == "pilot"
    sky.forward(lambda: not sky.vehicle.autopilot.armed, "the landing", 300)


def test_a_mission_in_which_an_agent_goes_to_a_later_item_succeeds(tmp_path: Path) -> None:
    sky, heard = on_the_leg(tmp_path, 2)
    sky.done("set_mission_item", 5)
    assert sky.end(heard, 400).state == "succeeded"
