"""A vehicle whose autopilot is not known is listened to, and nothing is asked of it that it could misunderstand."""

import asyncio
import logging
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.safety_orders import Step, by_operator
from bridged.drivers.api import Order, Outcome
from bridged.simulation.vehicle.fault_injection import Faults
from schemas.wire.log_lines import RobotLeft
from tests.bridged.bridge.test_safety_orders import leaving, passing
from tests.bridged.drivers.mavlink.test_recorded_flights import Replay
from tests.bridged.recorded import PX4, packets
from tests.bridged.sky import GOAL, Sky, end_of

SAID = "the autopilot of the vehicle is PPZ, and only ArduPilot and PX4 are commanded: it is listened to only"
ACTIONS = {
    "set_mode": ("GUIDED",),
    "arm_motors": (True,),
    "takeoff": (5.0,),
    "goto": GOAL,
    "land": (),
    "return_to_launch": (),
    "upload_mission": ([["takeoff", 0, 0, 10], ["rtl"]],),
    "set_param": ("RTL_ALT", 15.0),
    "get_param": ("RTL_ALT",),
    "drop_buoy": (),
}


@pytest.fixture
def stranger(tmp_path: Path) -> Sky:
    """A vehicle that flies, and says that it is a Paparazzi."""
    sky = Sky(tmp_path, faults=Faults(autopilot=dialect.MAV_AUTOPILOT_PPZ))
    sky.vehicle.advance(4)
    sky.vehicle.autopilot.set_mode(4)
    sky.vehicle.autopilot.arm()
    sky.vehicle.autopilot.take_off(20)
    sky.vehicle.advance(15)
    sky.wait(2)
    return sky


def heard_by(sky: Sky) -> set[str]:
    return {message.get_type() for message in sky.sent}


def test_every_action_is_refused_and_the_reason_names_the_autopilot(stranger: Sky) -> None:
    ends = {name: end_of(stranger.do(name, *arguments)) for name, arguments in ACTIONS.items()}
    assert ends == dict.fromkeys(ACTIONS, ("refused", SAID))
    stranger.wait(5)
    assert heard_by(stranger) == {"HEARTBEAT"}


@pytest.mark.parametrize("order", ["hold", "land", "rtl"])
def test_an_operators_order_is_refused_with_that_reason(stranger: Sky, order: Order) -> None:
    execution = stranger.bridge.action_server.order(order, by_operator(order), block=True, insist=True)
    stranger.wait(1)
    assert execution.outcome == Outcome("refused", SAID)
    assert heard_by(stranger) == {"HEARTBEAT"}


def test_neither_a_lost_agent_nor_the_end_of_the_bridge_orders_anything(stranger: Sky) -> None:
    async def lost() -> RobotLeft:
        async with asyncio.timeout(60):
            stranger.bridge.orders.agent_lost("uav", "a test", (Step("hold", 1.0), Step("rtl")))
            await passing(stranger, 20)
            return await leaving(stranger, stranger.bridge.orders.shut_down("rtl"))

    assert asyncio.run(lost()).state == "piloted"
    assert heard_by(stranger) == {"HEARTBEAT"}


def test_it_is_perceived_and_its_modes_have_no_names_of_another_autopilot(stranger: Sky) -> None:
    assert stranger.belief("state") == ("CMODE(4)", True, True)


def test_it_is_told_in_the_log_once_and_in_health_with_a_code(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    sky = Sky(tmp_path, faults=Faults(autopilot=dialect.MAV_AUTOPILOT_PPZ))
    with caplog.at_level(logging.ERROR):
        sky.wait(10)
    assert [record.getMessage() for record in caplog.records] == [f"system 1: {SAID}"]
    assert [note.code for note in sky.bridge.health().notes] == ["autopilot_unknown"]


def test_a_running_action_ends_when_the_vehicle_turns_out_to_be_another_autopilot(tmp_path: Path) -> None:
    sky = Sky(tmp_path).flying(10)
    heard = sky.begin("goto", *GOAL)
    sky.wait(2)
    sky.sent.clear()
    strange = dialect.MAVLink_heartbeat_message(2, dialect.MAV_AUTOPILOT_PPZ, 157, 50593792, 4, 3)
    sky.we_hear = lambda message: message.get_type() != "HEARTBEAT" or message.autopilot == strange.autopilot
    sky.downlink.append(strange)
    sky.end(heard, 5)
    assert (heard[-1].state, heard[-1].reason) == ("failed", SAID)
    sky.sent.clear()
    sky.wait(3)
    assert heard_by(sky) <= {"HEARTBEAT"}
    sky.we_hear = lambda message: True
    sky.wait(3)
    assert sky.do("set_mode", "GUIDED").state == "succeeded", "it is one that is known again"
    sky.done("goto", *GOAL)


def test_a_recorded_px4_is_asked_in_its_own_terms() -> None:
    replay = Replay(PX4)
    for packet in packets(PX4):
        replay.now = packet.at
        replay.clock.time = packet.at
        replay.talk.receive(packet.message)
        replay.tick(packet.at)
    asked = [one.param_id for one in replay.messages if one.get_type() == "PARAM_REQUEST_READ"]
    streams = {int(one.param1) for one in replay.messages if one.get_type() == "COMMAND_LONG" and one.command == 511}
    assert asked[:1] == ["NAV_DLL_ACT"]
    assert dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS in streams
    assert dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT not in streams
    assert "autopilot_unknown" not in [note.code for note in replay.talk.notes()]
    modes = [one.parameters[0] for _, one in replay.told if one.name == "state"]
    assert {"GUIDED", "TAKEOFF", "RTL"} <= set(modes)
