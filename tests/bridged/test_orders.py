"""What the bridge orders without an agent, and that a pilot is above it: a simulated copter, virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.driver import MavlinkDriver
from bridged.drivers.robot import Execution, Order
from bridged.orders import Step
from tests.bridged.sky import Sky, is_command

LOITER, GUIDED = 5, 4
HOME_AT_LAST = (Step("hold", 5.0), Step("rtl"))


def take_over(sky: Sky, mode: int = LOITER) -> None:
    """A pilot, or another ground station, sets a mode."""
    sky.downlink.extend(sky.vehicle.receive(dialect.MAVLink_set_mode_message(1, 1, mode)))


async def passing(sky: Sky, seconds: float) -> None:
    """Let mission time pass while the orders run."""
    until = sky.clock.time + seconds
    while sky.clock.time < until:
        sky.step()
        await asyncio.sleep(0)


async def leaving(sky: Sky, left: Awaitable[str]) -> str:
    """Let mission time pass until the bridge has left."""
    task = asyncio.ensure_future(left)
    for _ in range(60):
        if task.done():
            break
        await passing(sky, 1)
    return await task


def mode_of(sky: Sky) -> str:
    return sky.vehicle.copter.mode.name


def flown(body: Callable[[Sky], Awaitable[None]], sky: Sky) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(60):
            await body(sky)

    asyncio.run(bounded())


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return Sky(tmp_path).flying(20)


def test_a_vehicle_that_the_pilot_has_is_left_to_the_pilot_when_the_agent_is_lost(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        take_over(sky)
        await passing(sky, 3)
        sent = len(sky.commands(dialect.MAV_CMD_DO_SET_MODE))
        sky.bridge.orders.agent_lost("uav", "its token is gone", HOME_AT_LAST)
        await passing(sky, 20)
        assert mode_of(sky) == "LOITER"
        assert len(sky.commands(dialect.MAV_CMD_DO_SET_MODE)) == sent
        said = "agent uav is lost; the vehicle is left in LOITER, which others set (pilot, ground station or failsafe)"
        assert f"{said}: nothing is ordered" in sky.bridge.health().notes

    flown(body, sky)


def test_a_pilot_who_takes_over_while_the_vehicle_holds_for_a_lost_agent_keeps_it(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        sky.bridge.orders.agent_lost("uav", "its token is gone", HOME_AT_LAST)
        await passing(sky, 3)
        assert mode_of(sky) == "BRAKE"
        take_over(sky)
        await passing(sky, 20)
        assert mode_of(sky) == "LOITER"

    flown(body, sky)


def test_a_pilot_who_takes_over_while_the_vehicle_cannot_be_heard_keeps_it(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        sky.we_hear = lambda message: False
        await passing(sky, 8)
        sky.bridge.orders.agent_lost("uav", "its token is gone", (Step("rtl"),))
        await passing(sky, 2)
        take_over(sky)
        sky.we_hear = lambda message: True
        await passing(sky, 20)
        assert mode_of(sky) == "LOITER"

    flown(body, sky)


def test_an_agents_own_way_home_is_no_takeover_when_it_shows_only_after_a_lost_link(sky: Sky) -> None:
    home = sky.begin("return_to_launch")
    sky.we_hear = lambda message: False
    sky.forward(lambda: home[-1].final, "the end of the link")
    sky.wait(10)
    sky.we_hear = lambda message: True
    sky.forward(lambda: sky.belief("state") == ("RTL", True, True), "the vehicle is heard again", 5)
    assert sky.driver.overridden == ""
    assert sky.belief("override") is None


def test_a_lost_agents_vehicle_that_nobody_took_over_holds_and_returns(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        sky.bridge.orders.agent_lost("uav", "its token is gone", HOME_AT_LAST)
        await passing(sky, 3)
        assert mode_of(sky) == "BRAKE"
        await passing(sky, 10)
        assert mode_of(sky) == "RTL"

    flown(body, sky)


def test_a_bridge_that_stops_leaves_a_pilots_vehicle_to_the_pilot_and_says_so(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        take_over(sky)
        await passing(sky, 3)
        assert await leaving(sky, sky.bridge.orders.shut_down("rtl")) == "left to the pilot in LOITER, armed"
        await passing(sky, 5)
        assert mode_of(sky) == "LOITER"

    flown(body, sky)


def test_a_vehicle_that_somebody_flew_before_the_bridge_started_is_left_to_them(sky: Sky, tmp_path: Path) -> None:
    take_over(sky)
    sky.wait(3)
    later = Sky(tmp_path / "later", vehicle=sky.vehicle)

    async def body(sky: Sky) -> None:
        await passing(sky, 3)
        assert await leaving(sky, sky.bridge.orders.shut_down("rtl")) == "left to the pilot in LOITER, armed"

    flown(body, later)


def test_an_agent_that_takes_control_again_is_answered_for_again(sky: Sky) -> None:
    take_over(sky)
    sky.wait(3)
    assert sky.do("set_mode", "GUIDED").state == "succeeded"

    async def body(sky: Sky) -> None:
        assert (await leaving(sky, sky.bridge.orders.shut_down("rtl"))).startswith("rtl: the vehicle is in RTL")

    flown(body, sky)


def test_the_operators_order_goes_through_against_any_mode(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        take_over(sky)
        await passing(sky, 3)
        ordered = asyncio.ensure_future(sky.bridge.orders.operator("land"))
        await passing(sky, 5)
        assert (await ordered).state == "succeeded"
        assert mode_of(sky) == "LAND"

    flown(body, sky)


def test_who_flew_last_is_not_answered_for_in_a_later_flight(sky: Sky) -> None:
    assert sky.bridge.lease.answers == "uav"
    assert sky.do("land").state == "succeeded"
    sky.wait(2)
    assert sky.bridge.lease.answers == ""
    sky.begin("set_mode", "GUIDED")
    assert sky.bridge.lease.answers == "uav", "the next one that acts holds it again"


def test_a_restarted_bridge_answers_for_nobody_if_its_vehicle_is_not_armed(sky: Sky, tmp_path: Path) -> None:
    flying = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    flying.wait(2)
    assert flying.bridge.lease.answers == "uav"
    assert sky.do("land").state == "succeeded"
    parked = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    parked.wait(2)
    assert parked.bridge.lease.answers == ""


def test_a_lost_agents_vehicle_that_refuses_to_return_lands_and_it_is_said(
    sky: Sky, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(message: dialect.MAVLink_message) -> bool:
        if is_command(dialect.MAV_CMD_DO_SET_MODE)(message) and message.param2 == 6:
            ack = dialect.MAVLink_command_ack_message(message.command, dialect.MAV_RESULT_FAILED, 0, 0, 1, 191)
            sky.downlink.append(ack)
            return False
        return True

    async def body(sky: Sky) -> None:
        sky.hears_us = refuse
        sky.bridge.orders.agent_lost("uav", "its token is gone", (Step("hold", 1.0), Step("rtl")))
        await passing(sky, 10)
        assert mode_of(sky) == "LAND"

    flown(body, sky)
    assert "the vehicle did not do the last that was ordered, so land is ordered instead" in caplog.text


def test_a_vehicle_that_this_life_of_the_bridge_has_not_heard_when_its_agent_is_lost_returns_once_it_is(
    sky: Sky, tmp_path: Path
) -> None:
    async def body(again: Sky) -> None:
        again.we_hear = lambda message: False
        again.bridge.orders.agent_lost("uav", "its token is gone", HOME_AT_LAST)
        await passing(again, 3)
        said = "agent uav is lost; the robot was never heard: it is brought to safety when it is"
        assert said in again.bridge.health().notes
        again.we_hear = lambda message: True
        while mode_of(again) != "RTL":
            await passing(again, 1)
        assert said not in again.bridge.health().notes

    flown(body, Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock))


def test_a_vehicle_whose_driver_cannot_be_told_one_order_is_told_the_next(
    sky: Sky, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = MavlinkDriver.order

    def broken(driver: MavlinkDriver, which: Order, reason: str, *, insist: bool) -> Execution:
        if which == "rtl":
            raise KeyError("rtl")
        return order(driver, which, reason, insist=insist)

    monkeypatch.setattr(MavlinkDriver, "order", broken)

    async def body(sky: Sky) -> None:
        sky.bridge.orders.agent_lost("uav", "its token is gone", (Step("rtl"),))
        while mode_of(sky) != "LAND":
            await passing(sky, 1)
        while sky.bridge.lease.closed:
            await passing(sky, 1)
        assert sky.bridge.lease.holder == ""

    flown(body, sky)


def test_a_defect_while_a_lost_agent_is_answered_for_does_not_keep_the_robot_from_the_others(
    sky: Sky, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(seconds: float) -> None:
        raise KeyError("pause")

    monkeypatch.setattr(sky.clock, "sleep", broken)

    async def body(sky: Sky) -> None:
        sky.bridge.orders.agent_lost("uav", "its token is gone", HOME_AT_LAST)
        assert sky.bridge.lease.closed
        while sky.bridge.lease.closed:
            await passing(sky, 1)
        assert sky.bridge.lease.holder == ""

    flown(body, sky)
    assert "defect while the lost agent uav is answered for" in caplog.text


def test_while_the_bridge_leaves_its_robot_the_operator_cannot_let_the_agents_act_again(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        left = asyncio.ensure_future(sky.bridge.orders.shut_down("rtl"))
        await passing(sky, 0.1)
        released = sky.bridge.orders.release()
        assert (released.state, released.reason) == ("refused", "the bridge stops: it takes no action any more")
        assert sky.begin("goto", 0.0, 0.0, 20)[-1].reason == "the bridge stops: rtl"
        assert (await leaving(sky, left)).startswith("rtl: the vehicle is in RTL")

    flown(body, sky)


def test_after_a_release_the_copter_takes_targets_when_its_agent_has_set_the_mode(sky: Sky) -> None:
    async def body(sky: Sky) -> None:
        ordered = asyncio.ensure_future(sky.bridge.orders.operator("hold"))
        while not ordered.done():
            await passing(sky, 0.5)
        assert mode_of(sky) == "BRAKE"
        assert sky.bridge.orders.release().state == "succeeded"
        assert sky.begin("goto", -27.6036, -48.5180, 20)[-1].state == "refused"
        mode = sky.begin("set_mode", "GUIDED")
        await passing(sky, 5)
        assert mode[-1].state == "succeeded"
        assert sky.begin("goto", -27.6036, -48.5180, 20)[-1].state == "accepted"

    flown(body, sky)
