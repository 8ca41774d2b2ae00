"""What a pilot would want of a bridge when things go wrong: nobody is overruled, nothing flies on unattended."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.safety_orders import by_operator
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from tests.bridged.simulation.vehicle.ardupilot.test_setpoints_and_outputs import manifest as manifest_with_raw_commands
from tests.bridged.sky import GOAL, MISSION, Message, Sky
from tests.support.notes import identities


def without(*kinds: str):  # type: ignore[no-untyped-def]
    """What passes when messages of some kinds do not."""
    return lambda message: message.get_type() not in kinds


def is_command(message: Message) -> bool:
    return message.get_type() in ("COMMAND_LONG", "COMMAND_INT", "SET_POSITION_TARGET_GLOBAL_INT")


def test_a_takeoff_that_is_cancelled_before_it_leaves_the_ground_does_not_take_off(sky: Sky) -> None:
    sky.armed()
    heard = sky.begin("takeoff", 10)
    sky.forward(lambda: sky.commands(dialect.MAV_CMD_NAV_TAKEOFF), "the command is on its way")
    sky.wait(0.3)
    assert sky.bridge.action_server.cancel("uav", heard[0].id).state == "cancelled"
    sky.wait(40)
    copter = sky.vehicle.autopilot
    assert not copter.flight.airborne or abs(copter.motion.up.velocity) < 0.2, "it stands, or it hovers"
    assert copter.motion.up.position - copter.home_on_chart.up < 5
    assert sky.bridge.action_server.running == []


def test_a_pilot_who_takes_a_vehicle_that_agents_only_moved_keeps_it(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("state") is not None, "the vehicle is heard")
    sky.wait(10)
    sky.vehicle.autopilot.set_mode(Mode.GUIDED)
    sky.wait(3)
    sky.done("arm_motors", True)
    sky.done("takeoff", 10)
    heard = sky.begin("goto", *GOAL)
    sky.wait(3)
    sky.vehicle.autopilot.set_mode(Mode.LOITER)
    assert sky.end(heard).state == "failed"
    assert sky.belief("override") == ("LOITER",)
    for name in ("return_to_launch", "land"):
        refused = sky.do(name)
        assert (refused.state, "override" in refused.reason) == ("refused", True)
    assert sky.vehicle.autopilot.mode is Mode.LOITER


def test_a_pilots_change_while_an_agent_sets_a_mode_is_told_and_kept(sky: Sky) -> None:
    sky.flying(10)
    sky.we_hear = lambda message: message.get_type() != "COMMAND_ACK"
    sky.hears_us = lambda message: not is_command(message)
    heard = sky.begin("set_mode", "LOITER")
    sky.wait(0.1)
    sky.vehicle.autopilot.set_mode(Mode.STABILIZE)
    sky.end(heard)
    sky.hears_us = sky.we_hear = lambda message: True
    assert heard[-1].state != "succeeded"
    sky.forward(lambda: sky.belief("override") == ("STABILIZE",), "the override is told", 10)
    assert "override" in sky.do("return_to_launch").reason


def test_a_hold_after_a_cancel_is_tried_until_the_vehicle_does_it(sky: Sky) -> None:
    sky.flying(20)
    heard = sky.begin("goto", GOAL[0] + 0.01, GOAL[1], 20)
    sky.wait(8)
    sky.hears_us = lambda message: not is_command(message)
    assert sky.bridge.action_server.cancel("uav", heard[0].id).state == "cancelled"
    sky.wait(20)
    assert ("hold_failed", "") in identities(sky.bridge.health().notes)
    sky.hears_us = lambda message: True
    sky.wait(15)
    speed = sky.vehicle.autopilot.motion
    assert max(abs(speed.north.velocity), abs(speed.east.velocity)) < 0.3, "it stays"
    assert ("hold_failed", "") not in identities(sky.bridge.health().notes)


def test_a_hold_does_not_fly_back_to_where_the_vehicle_was_long_ago(sky: Sky) -> None:
    sky.flying(20)
    heard = sky.begin("goto", GOAL[0] + 0.01, GOAL[1], 20)
    sky.wait(3)
    sky.we_hear = without("GLOBAL_POSITION_INT")
    sky.wait(25)
    sky.bridge.action_server.cancel("uav", heard[0].id)
    cancelled_at = sky.vehicle.autopilot.motion.position.north
    sky.wait(20)
    assert sky.vehicle.autopilot.motion.position.north > cancelled_at - 5, "it does not fly back"
    assert sky.vehicle.autopilot.mode is Mode.BRAKE


def test_an_order_does_not_believe_that_a_vehicle_stands_because_it_stood_long_ago(sky: Sky) -> None:
    sky.armed()
    sky.we_hear = without("EXTENDED_SYS_STATE")
    sky.done("takeoff", 10)
    sky.wait(5)
    sky.done("goto", *GOAL[:2], 20)
    order = sky.bridge.action_server.order("rtl", by_operator("rtl"), block=False, insist=True)
    sky.forward(lambda: order.outcome is not None, "the order is confirmed", 30)
    assert order.outcome.state == "succeeded"
    assert sky.vehicle.autopilot.mode is Mode.RTL
    assert sky.vehicle.autopilot.armed


@pytest.mark.parametrize("name", ["land", "return_to_launch"])
def test_motors_that_stop_in_the_air_have_not_landed(sky: Sky, name: str) -> None:
    sky.flying(20)
    heard = sky.begin(name)
    sky.wait(4)
    sky.vehicle.autopilot.disarm(force=True)
    assert sky.end(heard, 30).state == "failed"
    assert heard[-1].reason.startswith("the motors stopped in the air")


def test_limits_are_not_kept_by_a_place_of_long_ago(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=MISSION.replace("    simulate:", "    limits: {radius: 60}\n    simulate:")).flying(10)
    sky.we_hear = without("GLOBAL_POSITION_INT")
    sky.wait(10)
    refused = [sky.do("fly", 8, 0, 0), sky.do("goto", *GOAL[:2], 20)]
    assert [one.state for one in refused] == ["refused"] * 2
    assert all("has not reported its position lately" in one.reason for one in refused)


def test_a_way_home_by_a_raw_command_is_the_agents_own(tmp_path: Path) -> None:
    sky = Sky(tmp_path, manifest=manifest_with_raw_commands()).flying(10)
    sky.done("raw", "MAV_CMD_NAV_RETURN_TO_LAUNCH", 0, 0, 0)
    assert sky.belief("override") is None
    assert not sky.vehicle.autopilot.armed
