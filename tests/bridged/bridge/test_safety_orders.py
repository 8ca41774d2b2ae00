"""What the bridge orders without an agent, and that a pilot is above it: a simulated copter, virtual time."""

import asyncio
from collections.abc import Awaitable
from pathlib import Path
from typing import Literal
from unittest.mock import Mock

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.agent_monitor import Idleness
from bridged.bridge.bus_endpoints import Service, VehicleRequests
from bridged.bridge.safety_orders import UNATTENDED, Step
from bridged.drivers.api import Execution, Order, Outcome
from bridged.drivers.mavlink.driver import MavlinkDriver
from schemas.wire import keys
from schemas.wire.log_lines import RobotLeft
from schemas.wire.records import Action, ManifestChange
from tests.bridged.sky import Sky, is_command
from tests.support.notes import identities

pytestmark = pytest.mark.usefixtures("looks_at_each_step")

LOITER, GUIDED, LAND = 5, 4, 9
HOME_AT_LAST = (Step("hold", 5.0), Step("rtl"))


def take_over(sky: Sky, mode: int = LOITER) -> None:
    """A pilot, or another ground station, sets a mode."""
    sky.pilot_sets(mode)


async def passing(sky: Sky, seconds: float) -> None:
    """Let mission time pass while the orders run."""
    until = sky.clock.time + seconds
    while sky.clock.time < until:
        sky.step()
        await asyncio.sleep(0)


async def leaving(sky: Sky, left: Awaitable[RobotLeft]) -> RobotLeft:
    """Let mission time pass until the bridge has left."""
    task = asyncio.ensure_future(left)
    for _ in range(60):
        if task.done():
            break
        await passing(sky, 1)
    return await task


def mode_of(sky: Sky) -> str:
    return sky.vehicle.autopilot.mode.name


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return Sky(tmp_path).flying(20)


async def test_a_vehicle_that_the_pilot_has_is_left_to_the_pilot_when_the_agent_is_lost(sky: Sky) -> None:
    take_over(sky)
    await passing(sky, 3)
    sent = len(sky.commands(dialect.MAV_CMD_DO_SET_MODE))
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 20)
    assert mode_of(sky) == "LOITER"
    assert len(sky.commands(dialect.MAV_CMD_DO_SET_MODE)) == sent
    assert ("left_to_others", "LOITER") in identities(sky.bridge.health().notes)


async def test_a_pilot_who_takes_over_while_the_vehicle_holds_for_a_lost_agent_keeps_it(sky: Sky) -> None:
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 3)
    assert mode_of(sky) == "BRAKE"
    take_over(sky)
    await passing(sky, 20)
    assert mode_of(sky) == "LOITER"


async def test_a_pilot_who_takes_over_while_the_vehicle_cannot_be_heard_keeps_it(sky: Sky) -> None:
    sky.we_hear = lambda message: False
    await passing(sky, 8)
    sky.bridge.orders.agent_lost("uav", "no liveliness token", (Step("rtl"),))
    await passing(sky, 2)
    take_over(sky)
    sky.we_hear = lambda message: True
    await passing(sky, 20)
    assert mode_of(sky) == "LOITER"


def test_an_agents_own_way_home_is_no_takeover_when_it_shows_only_after_a_lost_link(sky: Sky) -> None:
    home = sky.begin("return_to_launch")
    sky.we_hear = lambda message: False
    sky.end(home)
    sky.wait(10)
    sky.we_hear = lambda message: True
    sky.forward(lambda: sky.belief("state") == ("RTL", True, True), "the vehicle is heard again", 5)
    assert sky.driver.overridden == ""
    assert sky.belief("override") is None


async def test_an_agent_that_is_back_and_commands_nothing_does_not_end_what_the_bridge_has_begun(sky: Sky) -> None:
    orders = sky.bridge.orders
    orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 3)
    orders.agent_back("uav")
    await passing(sky, 9)
    assert mode_of(sky) == "BRAKE", "it has 10 s to take control"
    while mode_of(sky) != "RTL":
        await passing(sky, 0.5)
    while sky.vehicle.autopilot.armed:
        await passing(sky, 1)


@pytest.mark.usefixtures("looks_at_each_step")
async def test_an_action_that_is_refused_does_not_end_the_way_home(sky: Sky) -> None:
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 3)
    sky.bridge.orders.agent_back("uav")
    for _ in range(12):  # as a plan that tries again each second
        refused = sky.begin("goto", -27.6036, -48.5180, 20)
        assert refused[-1].state == "refused", "in BRAKE it takes no targets"
        await passing(sky, 1)
    await passing(sky, 3)
    assert mode_of(sky) == "RTL"


async def test_an_action_that_is_refused_after_a_pause_does_not_begin_the_way_home_again(
    sky: Sky, monkeypatch: pytest.MonkeyPatch
) -> None:
    orders = sky.bridge.orders
    orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 3)
    orders.agent_back("uav")
    down = sky.begin("land")
    await passing(sky, 3)
    monkeypatch.setattr(sky.bridge.driver, "refuses", lambda _: Outcome("refused", "its driver restarts"))
    for order in (orders.pause, orders.resume):
        done = asyncio.ensure_future(order())
        await passing(sky, 5)
        assert (await done).state == "succeeded"
    assert (down[-1].state, orders._lost, sky.bridge.lease.closed) == ("refused", None, "")


async def test_an_agent_that_crashes_again_and_again_does_not_keep_its_vehicle_from_coming_home(sky: Sky) -> None:
    for _ in range(4):
        sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
        await passing(sky, 2)
        sky.bridge.orders.agent_back("uav")
        await passing(sky, 2)
    assert mode_of(sky) == "RTL"


async def test_an_agent_that_is_back_has_the_robot_from_its_first_action_on(sky: Sky) -> None:
    orders = sky.bridge.orders
    orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 3)
    orders.agent_back("uav")
    await passing(sky, 3)
    refused = sky.begin("goto", -27.6036, -48.5180, 20, agent="other")
    assert refused[-1].reason == "agent uav is lost: the bridge brings the robot to safety first"
    mode = sky.begin("set_mode", "GUIDED")
    await passing(sky, 3)
    assert mode[-1].state == "succeeded"
    flight = sky.begin("goto", -27.6036, -48.5180, 20)
    while not flight[-1].final:
        await passing(sky, 1)
    assert flight[-1].state == "succeeded"
    await passing(sky, 20)
    assert mode_of(sky) == "GUIDED"


async def test_an_order_ends_before_the_action_that_takes_control_begins(sky: Sky) -> None:
    deaf = is_command(dialect.MAV_CMD_DO_SET_MODE)
    sky.hears_us = lambda message: not deaf(message)
    sky.bridge.orders.agent_lost("uav", "no liveliness token", (Step("rtl"),))
    await passing(sky, 0.5)
    sky.hears_us = lambda message: True
    assert sky.begin("goto", -27.6036, -48.5180, 20)[-1].state == "accepted"
    sky.wait(5)
    assert mode_of(sky) == "GUIDED"


def alarms(sky: Sky) -> list[str]:
    return [note.code for note in sky.bridge.health().notes if note.code == UNATTENDED]


async def idling(sky: Sky, seconds: float, steps: tuple[Step, ...] = (Step("rtl"),), *, lost: bool = False) -> None:
    """Let mission time pass with an agent that is there and says that it intends nothing, or is lost."""
    idleness, until = Idleness(10.0), sky.clock.time + seconds
    idleness.told("uav", True)
    while sky.clock.time < until:
        there, unattended = set() if lost else {"uav"}, sky.bridge.orders.unattended
        idle = idleness.look(there, unattended, sky.clock.now(), sky.clock.wall(), lost=lost)
        sky.bridge.orders.agents_idle(idle, steps, lost=lost)
        await passing(sky, 0.5)


async def test_a_robot_in_the_air_whose_agent_intends_nothing_is_an_alarm_and_is_brought_home(sky: Sky) -> None:
    await idling(sky, 9)
    assert (mode_of(sky), alarms(sky)) == ("GUIDED", [])
    await idling(sky, 15)
    assert (mode_of(sky), alarms(sky)) == ("RTL", [UNATTENDED])
    alarm = next(note for note in sky.bridge.health().notes if note.code == UNATTENDED)
    assert alarm.value is not None
    assert 10 <= alarm.value <= 16
    await idling(sky, 60)
    assert (sky.vehicle.autopilot.armed, alarms(sky)) == (False, [])


async def test_with_on_idle_none_the_alarm_is_all(sky: Sky) -> None:
    await idling(sky, 20, ())
    assert (mode_of(sky), alarms(sky)) == ("GUIDED", [UNATTENDED])
    sky.begin("goto", -27.6036, -48.5180, 20)
    await idling(sky, 1, ())
    assert alarms(sky) == []


async def ordered(sky: Sky, order: Order | Literal["pause"]) -> None:
    """The operator orders something, and it is confirmed."""
    orders = sky.bridge.orders
    asked = asyncio.ensure_future(orders.pause() if order == "pause" else orders.operator(order))
    while not asked.done():
        await passing(sky, 0.5)
    assert (await asked).state == "succeeded"


async def until_mode(sky: Sky, mode: str) -> None:
    while mode_of(sky) != mode:
        await passing(sky, 0.5)


@pytest.mark.parametrize("when", ["under the hold", "before the hold", "long before the hold"])
async def test_a_lost_agent_is_answered_for_when_the_operator_releases_the_robot(sky: Sky, when: str) -> None:
    if when != "under the hold":
        sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
        await passing(sky, 3 if when == "before the hold" else 15)
    await ordered(sky, "hold")
    if when == "under the hold":
        sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 20)
    assert mode_of(sky) == "BRAKE"
    assert {("safety_deferred", ""), ("operator_order", "hold")} <= set(identities(sky.bridge.health().notes))
    said = "actions are accepted again; agent uav is lost: the bridge brings the robot to safety first"
    assert sky.bridge.orders.release().reason == said
    await until_mode(sky, "RTL")


def restarted(sky: Sky, tmp_path: Path) -> Sky:
    """Another life of a bridge that was killed, at the same vehicle."""
    again = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    again.bridge.orders.restore()
    return again


async def test_the_operators_order_outlives_a_bridge_that_is_killed_until_release(sky: Sky, tmp_path: Path) -> None:
    await ordered(sky, "hold")
    again = restarted(sky, tmp_path)
    assert again.begin("set_mode", "GUIDED", id="uav:t:90")[-1].cause == "operator", "from the start on"
    await passing(again, 3)
    assert again.begin("set_mode", "GUIDED", id="uav:t:91")[-1].cause == "operator"
    assert again.bridge.health().ordered == "hold"
    assert ("operator_order", "hold") in identities(again.bridge.health().notes)
    assert again.bridge.orders.release().state == "succeeded"
    last = restarted(again, tmp_path)
    await passing(last, 2)
    assert last.begin("set_mode", "GUIDED", id="uav:t:92")[-1].state == "accepted"


async def test_an_order_that_was_not_done_when_the_bridge_was_killed_is_given_again(sky: Sky, tmp_path: Path) -> None:
    sky.hears_us = lambda message: False
    asked = asyncio.ensure_future(sky.bridge.orders.operator("land"))
    await passing(sky, 1)
    asked.cancel()
    assert mode_of(sky) == "GUIDED"
    again = restarted(sky, tmp_path)
    while mode_of(sky) != "LAND":
        await passing(again, 0.5)


async def silent(sky: Sky, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the vehicle be out of reach, and orders be given up soon."""
    monkeypatch.setattr("bridged.bridge.safety_orders.ORDER_PATIENCE", 0.01)
    sky.we_hear = sky.hears_us = lambda message: False
    await passing(sky, 8)


async def heard_again(sky: Sky, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridged.bridge.safety_orders.ORDER_PATIENCE", 10.0)
    sky.we_hear = sky.hears_us = lambda message: True
    for _ in range(20):
        await passing(sky, 0.5)


@pytest.mark.parametrize(("said", "mode"), [("rtl", "RTL"), ("land", "LAND"), ("pause", "BRAKE")])
async def test_what_the_operator_orders_while_the_vehicle_cannot_be_heard_is_given_again_when_it_is(
    sky: Sky, monkeypatch: pytest.MonkeyPatch, said: Literal["rtl", "land", "pause"], mode: str
) -> None:
    orders = sky.bridge.orders
    await silent(sky, monkeypatch)
    outcome = await (orders.pause() if said == "pause" else orders.operator(said))
    assert outcome.state == "timed_out"
    assert outcome.reason.endswith("is given again when the robot is heard")
    assert mode_of(sky) == "GUIDED"
    await heard_again(sky, monkeypatch)
    assert mode_of(sky) == mode


async def test_a_robot_not_heard_to_continue_is_paused_when_it_is(sky: Sky, monkeypatch: pytest.MonkeyPatch) -> None:
    await silent(sky, monkeypatch)
    await sky.bridge.orders.pause()
    outcome = await sky.bridge.orders.resume()
    assert outcome.reason.endswith("the pause is given again when the robot is heard")
    await heard_again(sky, monkeypatch)
    assert (mode_of(sky), sky.bridge.action_server.paused) == ("BRAKE", True)


async def test_an_order_that_is_not_confirmed_in_time_is_given_again(sky: Sky, monkeypatch: pytest.MonkeyPatch) -> None:
    await silent(sky, monkeypatch)
    monkeypatch.setattr("bridged.bridge.safety_orders.ORDER_PATIENCE", 0.3)
    asked = asyncio.ensure_future(sky.bridge.orders.operator("rtl"))
    sky.we_hear = lambda message: True
    await passing(sky, 1)
    assert sky.bridge.driver.own.heard
    assert (await asked).state == "timed_out"
    await heard_again(sky, monkeypatch)
    assert mode_of(sky) == "RTL"


async def test_an_order_waits_for_a_failsafe_that_has_acted_meanwhile_and_for_who_hands_the_robot_over(
    sky: Sky, monkeypatch: pytest.MonkeyPatch
) -> None:
    await silent(sky, monkeypatch)
    await sky.bridge.orders.operator("land")
    take_over(sky, LOITER)
    await heard_again(sky, monkeypatch)
    assert mode_of(sky) == "LOITER"
    take_over(sky, GUIDED)
    await passing(sky, 5)
    assert mode_of(sky) == "LAND"


async def test_a_pause_that_is_continued_before_it_is_given_up_is_not_given_again(
    sky: Sky, monkeypatch: pytest.MonkeyPatch
) -> None:
    await silent(sky, monkeypatch)
    monkeypatch.setattr("bridged.bridge.safety_orders.ORDER_PATIENCE", 10.0)
    pause = asyncio.ensure_future(sky.bridge.orders.pause())
    await passing(sky, 0.5)
    resume = asyncio.ensure_future(sky.bridge.orders.resume())
    await passing(sky, 0.5)
    assert "given again" not in (await pause).reason
    await heard_again(sky, monkeypatch)
    assert (await resume).state == "succeeded"
    assert (mode_of(sky), sky.bridge.action_server.paused) == ("GUIDED", False)


async def test_an_order_that_could_not_be_heard_is_not_given_to_a_vehicle_that_is_released_meanwhile(
    sky: Sky, monkeypatch: pytest.MonkeyPatch
) -> None:
    await silent(sky, monkeypatch)
    assert (await sky.bridge.orders.operator("rtl")).state == "timed_out"
    sky.bridge.orders.release()
    await heard_again(sky, monkeypatch)
    assert mode_of(sky) == "GUIDED"


@pytest.mark.parametrize("mode", [LAND, LOITER], ids=["a safer motion", "LOITER"])
async def test_a_restarted_bridge_leaves_a_pilot_what_began_under_a_hold(sky: Sky, tmp_path: Path, mode: int) -> None:
    await ordered(sky, "hold")
    take_over(sky, mode)
    await passing(sky, 2)
    taken, again = mode_of(sky), restarted(sky, tmp_path)
    await passing(again, 10)
    assert mode_of(again) == taken != "BRAKE"
    assert again.begin("set_mode", "GUIDED", id="uav:t:91")[-1].cause == "operator"


@pytest.mark.parametrize("said", ["hold", "pause"])
async def test_what_the_operator_said_ends_with_an_orderly_end(tmp_path: Path, said: Literal["hold", "pause"]) -> None:
    sky = Sky(tmp_path)
    sky.wait(2)
    orders = sky.bridge.orders
    await ordered(sky, said)
    await leaving(sky, orders.shut_down("land"))
    last = restarted(sky, tmp_path).bridge
    assert (last.action_log.paused, last.action_log.ordered, last.action_server.blocked) == (False, None, None)


@pytest.mark.parametrize("armed", [False, True])
async def test_an_order_from_before_the_machine_was_started_stands_until_release(
    sky: Sky, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, armed: bool
) -> None:
    await ordered(sky, order := "hold" if armed else "land")
    while sky.vehicle.autopilot.armed != armed:
        await passing(sky, 1)
    monkeypatch.setenv("ARGOSY_BOOT", "after a power failure")
    again = restarted(sky, tmp_path)
    assert again.bridge.action_server.blocked
    await passing(again, 10)
    assert again.bridge.action_log.ordered == order
    assert again.bridge.action_server.blocked


async def test_a_pause_from_before_the_machine_started_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sky = Sky(tmp_path)
    sky.wait(2)
    await ordered(sky, "pause")
    monkeypatch.setenv("ARGOSY_BOOT", "the battery was changed")
    again = restarted(sky, tmp_path)
    await passing(again, 10)
    assert again.bridge.action_server.paused


async def test_an_agent_that_is_back_during_the_operators_hold_has_time_to_take_control_after_it(sky: Sky) -> None:
    await ordered(sky, "hold")
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 2)
    sky.bridge.orders.agent_back("uav")
    await passing(sky, 30)
    sky.bridge.orders.release()
    await passing(sky, 5)
    assert sky.begin("set_mode", "GUIDED")[-1].state == "accepted"
    await passing(sky, 2)
    await ordered(sky, "hold")
    sky.bridge.orders.release()
    await passing(sky, 20)
    assert mode_of(sky) == "BRAKE", "an agent took control: it is lost no longer"


async def test_a_robot_that_was_landed_under_the_operators_order_is_anybodys(sky: Sky) -> None:
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 2)
    await ordered(sky, "land")
    while sky.vehicle.autopilot.armed:
        await passing(sky, 1)
    await passing(sky, 3)
    assert "safety_deferred" not in {note.code for note in sky.bridge.health().notes}
    assert sky.bridge.orders.release().reason == "actions are accepted again"
    assert sky.begin("set_mode", "GUIDED", agent="other")[-1].state == "accepted"


async def test_a_robot_in_the_air_whose_agent_is_lost_is_an_alarm_when_no_sequence_has_it(sky: Sky) -> None:
    sky.bridge.orders.agent_lost("uav", "no liveliness token", (Step("hold"),))
    await idling(sky, 9, lost=True)
    assert (mode_of(sky), alarms(sky)) == ("BRAKE", [])
    await idling(sky, 15, lost=True)
    assert (mode_of(sky), alarms(sky)) == ("RTL", [UNATTENDED])
    alarm = next(note for note in sky.bridge.health().notes if note.code == UNATTENDED)
    said = "in the air with nobody in charge: agent uav is lost; it is brought to safety (rtl)"
    assert alarm.text == said


@pytest.mark.parametrize("who", ["an action", "operator", "pilot", "its way home", "by hand", "nobody yet"])
async def test_a_robot_that_somebody_has_is_not_unattended(sky: Sky, who: str) -> None:
    match who:
        case "an action":
            sky.begin("goto", -27.60, -48.51, 20)
        case "operator":
            await ordered(sky, "hold")
        case "pilot":
            take_over(sky)
        case "its way home":
            sky.begin("set_mode", "RTL")
        case "by hand":
            sky.begin("goto", -27.6036, -48.5180, 20, id="")
            await passing(sky, 20)
        case "nobody yet":
            sky.bridge.lease.restore("uav", True)
            sky.bridge.lease.answers = ""
    await passing(sky, 1)
    before = mode_of(sky)
    await idling(sky, 20)
    assert alarms(sky) == []
    assert mode_of(sky) == before


@pytest.mark.parametrize(("action", "mode"), [("return_to_launch", "RTL"), ("land", "LAND")])
async def test_a_lost_agents_way_home_or_down_is_not_replaced_by_a_hold(sky: Sky, action: str, mode: str) -> None:
    """Neither is LAND by RTL: the sequence counts what is safer as done, and the agent's action has failed."""
    sky.done("goto", -27.6036, -48.5180, 20)
    home = sky.begin(action)
    sky.wait(3)
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    assert home[-1].state == "failed"
    modes = set()
    for _ in range(30):
        await passing(sky, 0.5)
        modes.add(mode_of(sky))
    assert modes == {mode}


async def test_a_vehicle_that_turned_home_while_it_could_not_be_heard_is_not_held(sky: Sky) -> None:
    sky.begin("return_to_launch")
    await passing(sky, 0.5)
    sky.we_hear = lambda message: False
    await passing(sky, 8)
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 2)
    sky.we_hear = lambda message: True
    modes = set()
    for _ in range(10):
        await passing(sky, 0.5)
        modes.add(mode_of(sky))
    assert modes == {"RTL"}


async def test_a_bridge_that_stops_lets_a_landing_go_on(sky: Sky) -> None:
    sky.begin("land")
    sky.wait(3)
    left = await leaving(sky, sky.bridge.orders.shut_down("rtl"))
    assert (left.state, left.order) == ("ordered", "rtl")
    assert left.text == "rtl: land is under way: the vehicle is in LAND"
    assert mode_of(sky) == "LAND"


@pytest.mark.parametrize(("action", "mode"), [("return_to_launch", "RTL"), ("land", "LAND")])
def test_a_way_home_or_down_that_takes_longer_than_its_deadline_goes_on(sky: Sky, action: str, mode: str) -> None:
    late = sky.do(action, deadline=3.0)
    assert late.state == "timed_out"
    sky.wait(5)
    assert mode_of(sky) == mode


@pytest.mark.parametrize(("before", "order", "mode"), [("rtl", "hold", "BRAKE"), ("pilot", "land", "LAND")])
async def test_the_operators_order_goes_through_in_any_mode(sky: Sky, before: str, order: Order, mode: str) -> None:
    if before == "pilot":
        take_over(sky)
    else:
        sky.begin("return_to_launch")
    await passing(sky, 3)
    await ordered(sky, order)
    assert mode_of(sky) == mode


@pytest.mark.parametrize("restarted", [False, True], ids=["", "somebody flew it before the bridge started"])
async def test_a_bridge_that_stops_leaves_a_pilots_vehicle_to_the_pilot_and_says_so(
    sky: Sky, tmp_path: Path, restarted: bool
) -> None:
    take_over(sky)
    sky.wait(3)
    sky = Sky(tmp_path / "later", vehicle=sky.vehicle) if restarted else sky
    await passing(sky, 3)
    left = await leaving(sky, sky.bridge.orders.shut_down("rtl"))
    assert (left.state, left.text) == ("piloted", "left to the pilot in LOITER, armed")
    await passing(sky, 5)
    assert mode_of(sky) == "LOITER"


async def test_an_agent_that_takes_control_again_is_answered_for_again(sky: Sky) -> None:
    take_over(sky)
    sky.wait(3)
    sky.done("set_mode", "GUIDED")
    left = await leaving(sky, sky.bridge.orders.shut_down("rtl"))
    assert (left.state, left.order) == ("ordered", "rtl")


def test_who_flew_last_is_not_answered_for_in_a_later_flight(sky: Sky) -> None:
    assert sky.bridge.lease.answers == "uav"
    sky.done("land")
    sky.wait(2)
    assert sky.bridge.lease.answers == ""
    sky.begin("set_mode", "GUIDED")
    assert sky.bridge.lease.answers == "uav", "the next one that acts holds it again"


def test_a_restarted_bridge_answers_for_nobody_if_its_vehicle_is_not_armed(sky: Sky, tmp_path: Path) -> None:
    flying = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    flying.wait(2)
    assert flying.bridge.lease.answers == "uav"
    sky.done("land")
    parked = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    parked.wait(2)
    assert parked.bridge.lease.answers == ""


def test_a_bridge_that_cannot_read_who_had_the_robot_lets_its_first_agent_answer_for_it_until_another_takes_it(
    sky: Sky, tmp_path: Path
) -> None:
    (tmp_path / "uav1.actions").write_bytes(b"noise")
    flying = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    flying.wait(2)
    assert (flying.bridge.lease.answers, flying.bridge.lease.holder) == ("uav", "")
    assert flying.begin("set_mode", "GUIDED", agent="other")[0].state == "accepted"
    assert flying.bridge.lease.answers == "other"


def test_a_vehicle_a_bridge_without_state_finds_in_use_has_an_agent_to_answer_for_it(sky: Sky, tmp_path: Path) -> None:
    found = Sky(tmp_path / "wiped", vehicle=sky.vehicle, clock=sky.clock)
    found.bridge.lease.present = {"other"}
    found.wait(2)
    assert (found.bridge.lease.answers, found.bridge.lease.holder) == ("other", "")
    assert found.begin("land")[0].state == "accepted"
    assert found.bridge.lease.answers == "uav"


def test_a_vehicle_that_a_bridge_without_state_finds_with_a_pilot_is_the_pilots_until_it_is_handed_over(
    sky: Sky, tmp_path: Path
) -> None:
    take_over(sky)
    found = Sky(tmp_path / "wiped", vehicle=sky.vehicle, clock=sky.clock)
    found.wait(2)
    assert found.bridge.lease.answers == ""
    take_over(found, GUIDED)
    found.wait(2)
    assert found.bridge.lease.answers == "uav"


async def test_a_lost_agents_vehicle_that_will_not_return_lands(sky: Sky, caplog: pytest.LogCaptureFixture) -> None:
    sky.pretend(
        lambda message: is_command(dialect.MAV_CMD_DO_SET_MODE)(message) and message.param2 == 6,
        dialect.MAV_RESULT_FAILED,
    )
    sky.bridge.orders.agent_lost("uav", "no liveliness token", (Step("hold", 1.0), Step("rtl")))
    await passing(sky, 10)
    assert mode_of(sky) == "LAND"
    assert "the vehicle did not do the last that was ordered, so land is ordered instead" in caplog.text


async def test_a_vehicle_that_this_life_of_the_bridge_has_not_heard_when_its_agent_is_lost_returns_once_it_is(
    sky: Sky, tmp_path: Path
) -> None:
    again = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    again.we_hear = lambda message: False
    again.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(again, 3)
    assert "never_heard" in {note.code for note in again.bridge.health().notes}
    again.we_hear = lambda message: True
    while mode_of(again) != "RTL":
        await passing(again, 1)
    assert "never_heard" not in {note.code for note in again.bridge.health().notes}


async def test_a_vehicle_whose_driver_cannot_be_told_one_order_is_told_the_next(
    sky: Sky, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = MavlinkDriver.order

    def broken(driver: MavlinkDriver, which: Order, reason: str, *, insist: bool) -> Execution:
        if which == "rtl":
            raise KeyError("rtl")
        return order(driver, which, reason, insist=insist)

    monkeypatch.setattr(MavlinkDriver, "order", broken)
    sky.bridge.orders.agent_lost("uav", "no liveliness token", (Step("rtl"),))
    while mode_of(sky) != "LAND":
        await passing(sky, 1)
    while sky.bridge.lease.closed:
        await passing(sky, 1)
    assert sky.bridge.lease.holder == ""


async def test_a_defect_while_a_lost_agent_is_answered_for_does_not_keep_the_robot_from_the_others(
    sky: Sky, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(seconds: float) -> None:
        raise KeyError("pause")

    monkeypatch.setattr(sky.clock, "sleep", broken)
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    assert sky.bridge.lease.closed
    while sky.bridge.lease.closed:
        await passing(sky, 1)
    assert sky.bridge.lease.holder == ""
    assert "defect while the robot is brought to safety (agent uav is lost)" in caplog.text


async def test_while_the_bridge_leaves_its_robot_the_operator_cannot_let_the_agents_act_again(sky: Sky) -> None:
    left = asyncio.ensure_future(sky.bridge.orders.shut_down("rtl"))
    await passing(sky, 0.1)
    released = sky.bridge.orders.release()
    assert (released.state, released.reason) == ("refused", "the bridge stops: it accepts no more actions")
    refused = sky.begin("goto", 0.0, 0.0, 20)[-1]
    assert (refused.state, refused.cause, refused.order) == ("refused", "shutdown", "rtl")
    assert (await leaving(sky, left)).order == "rtl"


async def test_an_operators_reading_of_parameters_that_an_order_ends_says_what_has_ended_it(sky: Sky) -> None:
    bus, query = Mock(), Mock(error="", record=None, concrete=True)
    VehicleRequests(bus, "uav1", sky.driver, inject=True).open()
    asked = asyncio.create_task(bus.serve.call_args_list[0].args[2](query))
    await asyncio.sleep(0)
    sky.bridge.action_server.order(
        "rtl", Outcome("failed", "agent uav is lost: rtl", "agent_lost", "rtl"), block=False, insist=False
    )
    await asked
    (answer,) = query.reply.call_args.args
    assert answer.problem == "it ended, as the robot was ordered (agent uav is lost: rtl); ask again"


async def test_an_action_for_another_robot_of_its_agent_is_left_to_that_ones_bridge(sky: Sky) -> None:
    bus = Mock(fleet="test")
    service = Service(bus, "uav1", ["uav"])
    service.open(sky.bridge)
    served = {call.args[0]: call.args[2] for call in bus.serve.call_args_list}
    key = keys.action("test", "uav", "set_mode")
    for robot, state in (("uav2", None), ("uav1", "refused")):
        query = Mock(key=key, concrete=True, record=Action(id=f"uav:1:{robot}", agent="uav", robot=robot))
        served[keys.action("test", "uav", "*")](query)
        assert [call.args[0].state for call in query.reply.call_args_list] == [state] * (state is not None)


def test_a_manifest_that_a_driver_fails_to_take_is_nowhere_in_effect(sky: Sky, monkeypatch: pytest.MonkeyPatch) -> None:
    driver, live = sky.bridge.driver, sky.bridge.live
    orders = driver.orders
    monkeypatch.setattr(sky.driver, "adopt", Mock(side_effect=[KeyError("rate"), None]))
    (problem,) = live.change(ManifestChange(set={"percepts.altitude.rate": 3}))
    assert problem.startswith("driver `mavlink`: adopt raised KeyError")
    assert (live.version, driver.orders) == (1, orders)


def test_a_vehicle_that_boots_in_flight_and_goes_on_armed_is_still_its_agents(sky: Sky) -> None:
    sky.we_hear = lambda message: message.get_type() != "HEARTBEAT" or message.system_status == dialect.MAV_STATE_BOOT
    sky.downlink.append(dialect.MAVLink_heartbeat_message(2, 3, 81, 4, dialect.MAV_STATE_BOOT, 3))  # not armed
    sky.wait(1)
    sky.we_hear = lambda message: True
    sky.wait(2)
    assert sky.vehicle.autopilot.flight.airborne
    assert sky.bridge.lease.answers == "uav", "if it is lost, somebody has to act"


async def test_a_vehicle_that_does_not_hear_us_for_minutes_is_brought_home_when_it_does(sky: Sky) -> None:
    sky.hears_us = lambda message: False
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 120)
    assert mode_of(sky) == "GUIDED"
    sky.hears_us = lambda message: True
    await passing(sky, 30)
    assert mode_of(sky) in ("RTL", "LAND")


async def test_an_order_of_the_operator_that_a_vehicle_does_not_hear_is_given_again_until_it_does(sky: Sky) -> None:
    sky.hears_us = lambda message: False
    asked = asyncio.ensure_future(sky.bridge.orders.operator("rtl"))
    await passing(sky, 20)
    assert (await asked).reason.endswith("; it is given again when the robot is heard")
    await passing(sky, 20)
    sky.hears_us = lambda message: True
    await passing(sky, 15)
    assert mode_of(sky) == "RTL"


async def test_a_robot_that_knows_no_way_home_is_held_once(sky: Sky) -> None:
    sky.bridge.driver.orders = frozenset({"hold"})
    sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 20)
    assert mode_of(sky) == "BRAKE"
    assert not sky.bridge.lease.closed, "the sequence is over"
