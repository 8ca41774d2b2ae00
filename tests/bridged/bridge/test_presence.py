"""How often a bridge steps and beats, whose failsafe watches whom, and what it does about a dead agent."""

import asyncio
from contextlib import suppress
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.safety_orders import SafetyOrders, Step
from tests.bridged.sky import MISSION, Sky, is_command
from tests.support.buses import virtual_test
from tests.support.notes import identities


def test_our_heartbeats_go_with_the_vehicles_own_so_that_an_idle_bridge_wakes_once_for_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sky = Sky(tmp_path)
    sky.wait(3)
    before = beats(sky)
    monkeypatch.setattr(sky.driver, "tick", lambda: None)
    sky.wait(10)
    assert beats(sky) - before in (9, 10, 11)


def beats(sky: Sky) -> int:
    """How many heartbeats the bridge has sent so far."""
    return sum(one.get_type() == "HEARTBEAT" for one in sky.sent)


@pytest.mark.parametrize(("armed", "expected"), [(False, 10), (True, 40)])
@virtual_test
async def test_a_robot_without_actions_and_held_back_percepts_is_stepped_seldom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, armed: bool, expected: int
) -> None:
    sky = Sky(tmp_path)
    sky.driver.vehicle.armed = armed
    step, seen = sky.bridge.step, list[float]()

    def counted() -> float:
        seen.append(step())
        return seen[-1]

    monkeypatch.setattr(sky.bridge, "step", counted)
    with suppress(TimeoutError):
        async with asyncio.timeout(9.99):
            await sky.bridge._pass_time()
    assert len(seen) == expected


@pytest.mark.parametrize("failsafe", ["", "    failsafe: {gcs: none}\n"])
def test_by_default_we_speak_as_the_vehicles_companion_and_what_was_switched_off_on_purpose_is_told(
    tmp_path: Path, failsafe: str
) -> None:
    sky = Sky(tmp_path, mission=MISSION.replace("    link:", f"{failsafe}    link:"))
    sky.wait(2)
    beats = [one for one in sky.sent if one.get_type() == "HEARTBEAT"]
    assert {(one.get_srcSystem(), one.get_srcComponent(), one.type, one.autopilot) for one in beats} == {
        (1, 191, 18, 8)
    }
    assert identities(sky.driver.notes()) == ([("failsafe_none", "")] if failsafe else [])


def watched(tmp_path: Path) -> Sky:
    return Sky(tmp_path, mission=MISSION.replace("    link:", "    failsafe: {gcs: bridge}\n    link:"))


def test_with_failsafe_bridge_we_are_the_ground_station_and_read_its_parameter_back(tmp_path: Path) -> None:
    sky = watched(tmp_path)
    sky.wait(3)
    beats = [one for one in sky.sent if one.get_type() == "HEARTBEAT"]
    assert {(one.get_srcSystem(), one.get_srcComponent()) for one in beats} == {(255, 190)}
    assert identities(sky.driver.notes()) == [("failsafe_off", "")]
    sky.vehicle.autopilot.parameters.set("FS_GCS_ENABLE", 1)
    again = Sky(
        tmp_path / "2",
        mission=MISSION.replace("    link:", "    failsafe: {gcs: bridge}\n    link:"),
        vehicle=sky.vehicle,
    )
    again.wait(3)
    assert again.driver.notes() == []


def test_a_dead_agents_vehicle_is_not_kept_from_its_own_failsafe(tmp_path: Path) -> None:
    sky = watched(tmp_path)
    sky.vehicle.autopilot.parameters.set("FS_GCS_ENABLE", 1)
    sky.flying(10)
    sky.driver.speak_for_agent(False)
    sky.forward(lambda: sky.vehicle.autopilot.mode.name == "RTL", "the vehicle's own failsafe", 10)
    sky.forward(lambda: sky.belief("override") == ("RTL",), "the percept of it", 3)


@virtual_test
async def test_an_order_that_is_called_off_does_not_go_on_against_the_agent_that_is_back(tmp_path: Path) -> None:
    sky = Sky(tmp_path).flying()
    orders = SafetyOrders(sky.bridge.action_server, sky.bridge.driver, sky.bridge.action_log, sky.clock)
    deaf = is_command(dialect.MAV_CMD_DO_SET_MODE)
    sky.hears_us = lambda message: not deaf(message)
    orders.agent_lost("uav", "no liveliness token", [Step("rtl")])
    await asyncio.sleep(0)
    sky.wait(0.5)
    assert sky.commands(dialect.MAV_CMD_DO_SET_MODE)
    orders.call_off()
    await asyncio.sleep(10)
    sky.hears_us = lambda message: True
    sky.wait(10)
    assert sky.vehicle.autopilot.mode.name == "GUIDED"


def test_a_vehicle_that_does_not_tell_its_failsafe_is_a_warning(tmp_path: Path) -> None:
    sky = watched(tmp_path)
    sky.we_hear = lambda message: message.get_type() != "PARAM_VALUE"
    sky.wait(8)
    assert identities(sky.driver.notes()) == [("failsafe_unknown", "")]
