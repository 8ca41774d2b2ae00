"""What operators read and set of a vehicle: nothing of it becomes a percept, and nothing unsafe is set unnamed."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Execution, Outcome
from bridged.drivers.mavlink.autopilots.px4 import bits_of, number_of
from bridged.simulation.vehicle.fault_injection import Faults
from schemas.wire.vehicle_records import PlanItem
from tests.bridged.drivers.mavlink.actions.test_mission_actions import TOUR
from tests.bridged.sky import MISSION, Message, Sky

LIMITED = MISSION + "    limits: {altitude: 30}\n    failsafe: {gcs: human}\n"


def ended(sky: Sky, execution: Execution) -> Outcome:
    """Let time pass until an execution ends."""
    sky.forward(lambda: execution.over, f"the end of {execution.name}")
    assert execution.outcome is not None
    return execution.outcome


def setting(sky: Sky, name: str, value: float, *, allow_safety: bool = False) -> tuple[str, str]:
    """Set a parameter; return state and cause."""
    outcome = ended(sky, sky.driver.set_parameter(name, value, allow_safety=allow_safety))
    return outcome.state, outcome.cause


def test_all_parameters_are_read_over_a_bad_link_and_no_agent_perceives_them(sky: Sky) -> None:
    sky.wait(3)
    lost = iter(range(10**6))
    sky.we_hear = lambda message: message.get_type() != "PARAM_VALUE" or next(lost) % 3 != 0
    values: dict[str, float] = {}
    assert ended(sky, sky.driver.read_parameters(values)).state == "succeeded"
    assert values == pytest.approx({one.name: one.value for one in sky.vehicle.autopilot.parameters})
    assert sky.belief("parameter") is None


def test_the_stored_mission_is_read_with_home_first_and_becomes_no_percept(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("home_pos"), "home")
    sky.done("upload_mission", TOUR)
    sky.vehicle.autopilot.mission.items.pop()
    items: list[PlanItem] = []
    assert ended(sky, sky.driver.read_plan(items)).state == "succeeded"
    assert [item.command for item in items] == [16, 22, 16]
    assert (items[0].x, items[2].z) == (-276040330, 20.0)
    assert sky.belief("waypoint") is not None, "of the upload"
    assert len([one for one in sky.bridge.percepts.sets["uav"].present() if one.name == "waypoint"]) == 3


def test_a_parameter_is_set_disarmed_and_one_of_safety_when_it_is_allowed(sky: Sky) -> None:
    assert setting(sky, "WPNAV_SPEED", 700) == ("succeeded", "driver")
    assert setting(sky, "FENCE_RADIUS", 120) == ("refused", "request")
    assert setting(sky, "fence_radius", 120) == ("refused", "request")
    assert setting(sky, "FENCE_RADIUS", 120, allow_safety=True)[0] == "succeeded"
    assert setting(sky, "MIS_TOTAL", 1, allow_safety=True) == ("refused", "request"), "it would cut the mission"
    sky.armed()
    assert setting(sky, "WPNAV_SPEED", 900) == ("refused", "busy")
    assert sky.vehicle.autopilot.parameters["WPNAV_SPEED"] == 700


def test_what_the_mission_relies_on_is_not_set_even_when_it_is_named(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=LIMITED)
    for name, value in (("FENCE_ENABLE", 0), ("FS_GCS_ENABLE", 0), ("MAV_GCS_SYSID", 254)):
        assert setting(sky, name, value, allow_safety=True) == ("refused", "limits"), name
    assert setting(sky, "FENCE_ENABLE", 1, allow_safety=True)[0] == "succeeded"


@pytest.mark.parametrize("name", ["", "A NAME", "RTL_ALT\0X", "ARMING_CHECK_THAT_IS_LONG"])
def test_a_name_that_mavlink_would_cut_reaches_no_parameter(sky: Sky, name: str) -> None:
    sky.wait(3)
    sky.sent.clear()
    assert setting(sky, name, 1) == ("refused", "request")
    sky.wait(1)
    assert not [one for one in sky.sent if one.get_type().startswith("PARAM_")]


def test_whole_numbers_of_px4_are_set_by_all_their_bits(tmp_path: Path) -> None:
    sky = Sky(tmp_path, faults=Faults(autopilot=dialect.MAV_AUTOPILOT_PX4))
    held, kind = {"SDLOG_PROFILE": 1.0}, dialect.MAV_PARAM_TYPE_INT32

    def hears(message: Message) -> bool:
        match message.get_type():
            case "PARAM_SET" if message.param_id in held and message.param_type == kind:
                held[message.param_id] = number_of(message.param_value, kind)
            case "PARAM_REQUEST_READ" if message.param_id in held:
                pass
            case _:
                return True
        value = bits_of(held[message.param_id], kind)
        sky.downlink.append(dialect.MAVLink_param_value_message(message.param_id.encode(), value, kind, 1, 0))
        return False

    sky.hears_us = hears
    assert setting(sky, "SDLOG_PROFILE", 2.0**24 + 1)[0] == "succeeded"
    assert held == {"SDLOG_PROFILE": 2.0**24 + 1}
    assert setting(sky, "SDLOG_PROFILE", 0.5)[0] == "refused"
