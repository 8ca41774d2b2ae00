"""The operator pauses a robot and lets it go on: its actions are kept; a simulated copter in virtual time."""

import asyncio
from collections.abc import Awaitable
from pathlib import Path

import pytest
from msgspec.structs import replace

from bridged.drivers.api import Order, Outcome
from schemas.manifest.loader import Manifest, load_manifest
from schemas.wire.terms import Atom
from tests.bridged.bridge.test_safety_orders import HOME_AT_LAST, mode_of, passing, take_over, until_mode
from tests.bridged.drivers.mavlink.actions.test_mission_actions import TOUR
from tests.bridged.drivers.mavlink.test_six_kinds import sky_of
from tests.bridged.sky import GOAL, MISSION, Sky
from tests.support.notes import identities

pytestmark = pytest.mark.usefixtures("looks_at_each_step")

FAR = (-27.600683, -48.518052, 40)
"""370 m away: half a minute of flight."""


async def answered(sky: Sky, order: Awaitable[Outcome], within: int = 30) -> Outcome:
    """Let mission time pass until an order is confirmed or not."""
    task = asyncio.ensure_future(order)
    for _ in range(within * 4):
        if task.done():
            break
        await passing(sky, 0.25)
    assert task.done(), f"no answer within {within} s"
    return await task


async def pause(sky: Sky) -> Outcome:
    return await answered(sky, sky.bridge.orders.pause())


async def resume(sky: Sky) -> Outcome:
    return await answered(sky, sky.bridge.orders.resume())


def place(sky: Sky) -> tuple[float, float, float]:
    here = sky.driver.vehicle.position
    return here.latitude, here.longitude, here.altitude


def is_at(sky: Sky, before: tuple[float, float, float]) -> bool:
    """Whether it is where it was, as well as a copter holds: a metre."""
    latitude, longitude, altitude = (abs(now - then) for now, then in zip(place(sky), before, strict=True))
    return latitude < 1e-5 and longitude < 1e-5 and altitude < 0.5


def quick(deadline: float) -> Manifest:
    """The copter's manifest with a `goto` that has so many seconds."""
    manifest = load_manifest("copter")  # shared by all tests of a process
    goto = manifest.actions["goto"]
    return replace(manifest, actions=manifest.actions | {"goto": replace(goto, deadline=type(goto.deadline)(deadline))})


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return Sky(tmp_path).flying(20)


async def test_a_goto_is_kept_while_the_copter_holds_and_goes_on_to_its_place(sky: Sky) -> None:
    going = sky.begin("goto", *FAR)
    await passing(sky, 5)
    assert await pause(sky) == Outcome("succeeded", "the vehicle is in BRAKE")
    await passing(sky, 5)
    before = place(sky)
    await passing(sky, 100)
    assert is_at(sky, before)
    assert (going[-1].state, going[-1].paused, going[-1].reason) == ("running", True, "paused by the operator")
    assert await resume(sky) == Outcome("succeeded", "the vehicle is in GUIDED")
    assert sky.end(going).state == "succeeded"
    assert [one.paused for one in going[-2:]] == [False, False]


async def test_deadlines_do_not_run_while_it_is_paused(tmp_path: Path) -> None:
    sky = Sky(tmp_path, manifest=quick(60)).flying(20)
    going = sky.begin("goto", *FAR)
    await passing(sky, 5)
    await pause(sky)
    left = going[-1].deadline
    await passing(sky, 120)
    assert going[-1].deadline == pytest.approx(left, abs=0.1)
    await resume(sky)
    assert sky.end(going).state == "succeeded"


async def test_what_is_asked_while_it_is_paused_begins_when_it_continues(sky: Sky) -> None:
    await pause(sky)
    going = sky.begin("goto", *GOAL)
    before = place(sky)
    await passing(sky, 30)
    assert is_at(sky, before)
    assert [(one.state, one.paused) for one in going[:2]] == [("accepted", True), ("running", True)]
    assert sky.begin("goto", *FAR)[-1].reason == "busy: goto is running"
    assert sky.begin("goto", "nowhere")[-1].state == "refused"
    await resume(sky)
    assert sky.end(going).state == "succeeded"


async def test_what_does_not_move_it_goes_on(sky: Sky) -> None:
    sky.hears_us = lambda message: message.get_type() != "PARAM_REQUEST_READ"
    asking = sky.begin("get_param", "RTL_ALT")
    await pause(sky)
    sky.hears_us = lambda message: True
    assert sky.end(asking).state == "succeeded"


async def test_a_takeoff_that_was_held_above_its_altitude_goes_down_to_it(tmp_path: Path) -> None:
    sky = Sky(tmp_path).armed()
    climbing = sky.begin("takeoff", 10)
    sky.forward(lambda: place(sky)[2] > 8, "8 m")
    await pause(sky)
    up = sky.vehicle.autopilot.motion.up
    up.position = up.target = 15.0  # the wind, or a pilot between
    sky.wait(2)
    assert (await resume(sky)).state == "succeeded"
    assert sky.end(climbing).state == "succeeded"
    assert place(sky)[2] == pytest.approx(10, abs=0.4)


async def test_a_takeoff_that_was_interrupted_in_the_air_goes_on_climbing(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.armed()
    climbing = sky.begin("takeoff", 30)
    await passing(sky, 6)
    await pause(sky)
    await passing(sky, 5)
    before = place(sky)
    assert 1 < before[2] < 25
    await passing(sky, 30)
    assert is_at(sky, before)
    await resume(sky)
    assert sky.end(climbing).state == "succeeded"
    assert place(sky)[2] == pytest.approx(30, abs=0.5)


@pytest.mark.parametrize("way_down", ["land", "return_to_launch"])
async def test_a_way_down_is_held_too_and_goes_on(sky: Sky, way_down: str) -> None:
    going = sky.begin(way_down)
    await passing(sky, 8)
    await pause(sky)
    assert mode_of(sky) == "BRAKE"
    await passing(sky, 20)
    assert place(sky)[2] > 3
    await resume(sky)
    assert sky.end(going).state == "succeeded"
    assert not sky.vehicle.autopilot.armed


async def test_the_order_to_return_goes_on_too(sky: Sky) -> None:
    await answered(sky, sky.bridge.orders.operator("rtl"))
    await pause(sky)
    assert mode_of(sky) == "BRAKE"
    await resume(sky)
    assert mode_of(sky) == "RTL"


async def test_everybody_is_told_that_it_is_paused(sky: Sky) -> None:
    assert (sky.bridge.health().paused, sky.belief("paused")) == (False, None)
    await pause(sky)
    assert (sky.bridge.health().paused, sky.belief("paused", "other")) == (True, (Atom("operator"),))
    await resume(sky)
    assert (sky.bridge.health().paused, sky.belief("paused", "other")) == (False, None)


async def test_pausing_twice_is_as_pausing_once_and_continuing_twice_is_told(sky: Sky) -> None:
    going = sky.begin("goto", *GOAL)
    await passing(sky, 2)
    assert (await pause(sky)).state == (await pause(sky)).state == "succeeded"
    assert (await resume(sky)).state == "succeeded"
    assert await resume(sky) == Outcome("succeeded", "it was not paused")
    assert sky.end(going).state == "succeeded"


async def test_the_same_from_several_operators_at_a_time_is_confirmed_to_all_of_them(sky: Sky) -> None:
    orders = sky.bridge.orders
    sky.begin("goto", *GOAL)
    await passing(sky, 2)
    pauses = [asyncio.ensure_future(orders.pause()) for _ in range(3)]
    assert [(await answered(sky, one)).state for one in pauses] == ["succeeded"] * 3
    holds = [asyncio.ensure_future(orders.operator("rtl")) for _ in range(2)]
    assert [(await answered(sky, one)).state for one in holds] == ["succeeded"] * 2


@pytest.mark.parametrize("cancelled", [False, True])
async def test_an_order_that_another_operator_replaced_names_that_order(sky: Sky, cancelled: bool) -> None:
    orders = sky.bridge.orders
    sky.begin("goto", *GOAL)
    await passing(sky, 2)
    first, second = (asyncio.ensure_future(orders.operator(order)) for order in ("rtl", "hold"))
    said = await answered(sky, first)
    assert (said.state, said.reason) == ("failed", "a later `hold` of the operator replaced it")
    third = asyncio.ensure_future(orders.operator("hold"))
    if cancelled:
        await asyncio.sleep(0)
        third.cancel()
        assert (await answered(sky, second)).state == "failed", "nobody waits for ever"
    else:
        assert (await answered(sky, second)).state == (await answered(sky, third)).state == "succeeded"


async def test_what_is_held_by_the_operator_is_not_continued_but_released(sky: Sky) -> None:
    await answered(sky, sky.bridge.orders.operator("hold"))
    said = "it is not paused: operator: hold; `release` gives it back to its agents"
    assert await resume(sky) == Outcome("refused", said)


@pytest.mark.parametrize(("order", "mode"), [("hold", "BRAKE"), ("rtl", "RTL")])
async def test_continue_leaves_a_robot_to_the_operators_order(sky: Sky, order: Order, mode: str) -> None:
    await pause(sky)
    await resume(sky)
    await answered(sky, sky.bridge.orders.operator(order))
    await pause(sky)
    assert mode_of(sky) == "BRAKE"
    assert await resume(sky) == Outcome("succeeded", f"the vehicle is in {mode}")
    await passing(sky, 5)
    assert (mode_of(sky), sky.bridge.action_server.paused) == (mode, False)
    refused = sky.begin("goto", *GOAL)[-1]
    assert (refused.cause, refused.order) == ("operator", order)


async def test_continue_goes_back_to_the_mode_before_this_pause_and_not_before_an_earlier_one(sky: Sky) -> None:
    await pause(sky)
    await pause(sky)
    assert await resume(sky) == Outcome("succeeded", "the vehicle is in GUIDED")
    sky.done("set_mode", "BRAKE")
    await pause(sky)
    assert await resume(sky) == Outcome("succeeded", "the vehicle is in BRAKE")


@pytest.mark.parametrize("order", ["hold", "rtl", "land"])
async def test_another_order_ends_the_pause_and_the_actions(sky: Sky, order: str) -> None:
    going = sky.begin("goto", *FAR)
    await passing(sky, 2)
    await pause(sky)
    assert (await answered(sky, sky.bridge.orders.operator(order))).state == "succeeded"  # type: ignore[arg-type]
    assert (going[-1].state, going[-1].cause, going[-1].order) == ("failed", "operator", order)
    assert not sky.bridge.action_server.paused


async def test_a_pilot_who_takes_over_ends_the_pause_and_what_waits_has_failed(sky: Sky) -> None:
    going = sky.begin("goto", *FAR)
    await passing(sky, 2)
    await pause(sky)
    await passing(sky, 10)
    take_over(sky)
    await passing(sky, 5)
    assert (going[-1].state, mode_of(sky)) == ("failed", "LOITER")
    assert going[-1].reason.startswith("the mode became LOITER while the operator had paused the robot")
    assert not sky.bridge.action_server.paused
    assert sky.belief("override") == ("LOITER",)


async def test_a_dropped_action_is_cancelled_and_not_begun_again(sky: Sky) -> None:
    going = sky.begin("goto", *FAR)
    await passing(sky, 2)
    await pause(sky)
    assert sky.bridge.action_server.cancel("uav", going[-1].id).state == "cancelled"
    await passing(sky, 5)
    before = place(sky)
    await resume(sky)
    await passing(sky, 20)
    assert is_at(sky, before)


@pytest.mark.parametrize("lost", ["before the pause", "under it"])
async def test_a_lost_agent_is_answered_for_when_the_pause_is_over(sky: Sky, lost: str) -> None:
    if lost == "before the pause":
        sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
        await passing(sky, 3)
    await pause(sky)
    if lost == "under it":
        sky.bridge.orders.agent_lost("uav", "no liveliness token", HOME_AT_LAST)
    await passing(sky, 20)
    assert mode_of(sky) == "BRAKE"
    assert ("safety_deferred", "") in identities(sky.bridge.health().notes)
    await resume(sky)
    await until_mode(sky, "RTL")


async def test_a_restarted_bridge_keeps_the_pause_and_holds_the_robot(sky: Sky, tmp_path: Path) -> None:
    going = sky.begin("goto", *FAR)
    await passing(sky, 2)
    sky.bridge.action_server.pause()  # the copter is not told: the bridge is killed first
    assert going[-1].paused, "its asker hears of it at once"
    again = Sky(tmp_path, mission=MISSION, vehicle=sky.vehicle, clock=sky.clock)
    again.bridge.orders.restore()
    await passing(again, 20)
    assert (mode_of(again), again.bridge.health().paused, again.belief("paused")) == (
        "BRAKE", True, (Atom("operator"),)
    )  # fmt: skip
    assert going[-1].state == "running"
    going = again.begin("goto", *GOAL, id="uav:t:99")
    await passing(again, 5)
    assert going[-1].paused
    assert await resume(again) == Outcome("succeeded", "the vehicle is in GUIDED")
    assert again.end(going).state == "succeeded"


async def test_a_vehicle_that_does_not_confirm_stays_paused(sky: Sky) -> None:
    going = sky.begin("goto", *GOAL)
    await pause(sky)
    sky.hears_us = lambda message: False
    outcome = await answered(sky, sky.bridge.orders.resume(), within=60)
    assert outcome.state == "failed"
    assert outcome.reason.startswith("no acknowledgement of MAV_CMD_DO_SET_MODE")
    assert (sky.bridge.action_server.paused, going[-1].state) == (True, "running")


async def test_on_the_ground_the_motors_are_left_as_they_are(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.armed()
    assert (await pause(sky)).state == "succeeded"
    assert sky.vehicle.autopilot.armed
    await resume(sky)
    sky.done("takeoff", 5)


async def test_a_stored_mission_goes_on_from_its_item(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    for name, argument in (("set_mode", "GUIDED"), ("arm_motors", True), ("upload_mission", TOUR)):
        sky.done(name, argument)
    flying = sky.begin("start_mission")
    while flying[-1].feedback.get("item", 0) < 2:
        await passing(sky, 1)
    await passing(sky, 2)
    await pause(sky)
    assert mode_of(sky) == "BRAKE"
    await passing(sky, 5)
    before = place(sky)
    await passing(sky, 30)
    assert is_at(sky, before)
    assert await resume(sky) == Outcome("succeeded", "the vehicle is in AUTO")
    await passing(sky, 3)
    assert flying[-1].feedback["item"] >= 2, "it does not begin again"
    assert sky.end(flying).state == "succeeded"


@pytest.mark.parametrize("reached", [0, 5, 40])
@pytest.mark.parametrize(("vehicle", "autopilot"), [("plane", "ardupilot"), ("plane", "px4"), ("copter", "px4")])
async def test_a_takeoff_by_a_mode_of_its_own_that_was_held_climbs_on_to_its_altitude_and_no_higher(
    tmp_path: Path, vehicle: str, autopilot: str, reached: float
) -> None:
    sky, top = sky_of(tmp_path, vehicle, autopilot), 0.0
    sky.done("arm_motors", True)
    climbing = sky.begin("takeoff", 60)
    sky.forward(lambda: sky.driver.vehicle.aloft and place(sky)[2] >= reached, "it climbs")
    assert (await pause(sky)).state == "succeeded"
    assert climbing[-1].paused
    assert (await resume(sky)).state == "succeeded"
    assert sky.end(climbing).state == "succeeded"
    for _ in range(30):
        await passing(sky, 1)
        top = max(top, place(sky)[2])
    assert top < 67


async def test_a_paused_robot_is_not_unattended(sky: Sky) -> None:
    assert sky.bridge.orders.unattended
    await pause(sky)
    assert not sky.bridge.orders.unattended
    await resume(sky)
    assert sky.bridge.orders.unattended
