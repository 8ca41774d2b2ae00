"""A vehicle that comes home is said to come home, whoever sent it there."""

import asyncio
import logging
from pathlib import Path

import pytest

from bridged.bridge.safety_orders import FIRST_HEARD, Step
from bridged.drivers.mavlink.vehicle.flight_modes import COMING_HOME
from tests.bridged.bridge.test_safety_orders import leaving, mode_of, passing, take_over
from tests.bridged.sky import Sky

RTL, LAND = 6, 9


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return Sky(tmp_path).flying(20)


@pytest.mark.parametrize(("mode", "order"), [(RTL, "rtl"), (LAND, "land")])
async def test_a_bridge_that_stops_says_that_its_vehicle_comes_home_by_others(sky: Sky, mode: int, order: str) -> None:
    take_over(sky, mode)
    await passing(sky, 2)
    left = await leaving(sky, sky.bridge.orders.shut_down("rtl"))
    assert (left.state, left.order) == ("ordered", order)
    assert left.text == f"{order}: the vehicle is in {order.upper()}, which others set"


async def test_a_bridge_that_is_started_again_and_stops_at_once_hears_its_vehicle_first(
    sky: Sky, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridged.bridge.safety_orders.AGAIN", 0.001)
    sky.done("goto", -27.6036, -48.5180, 20)
    sky = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    left = asyncio.ensure_future(sky.bridge.orders.shut_down("rtl", stay=300.0))
    modes = set()
    while not left.done():
        await passing(sky, 0.5)
        modes.add(mode_of(sky))
    assert "RTL" in modes
    assert (await left).state == "disarmed"


@pytest.mark.parametrize(("answered", "wall"), [(True, FIRST_HEARD), (False, 0.0)])
async def test_a_bridge_that_stops_waits_in_bounds_for_a_vehicle_never_heard(
    tmp_path: Path, answered: bool, wall: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridged.bridge.safety_orders.AGAIN", 0.001)
    sky = Sky(tmp_path)
    sky.we_hear = lambda message: False
    if answered:
        sky.bridge.lease.restore("uav", False)
    began = sky.clock.wall()
    left = await leaving(sky, sky.bridge.orders.shut_down("rtl", stay=300.0))
    assert (left.state, left.text) == ("unconfirmed", "never heard")
    assert wall <= sky.clock.wall() - began <= wall + 3


async def test_a_lost_agent_of_a_vehicle_others_bring_home_is_fine(sky: Sky, caplog: pytest.LogCaptureFixture) -> None:
    take_over(sky, RTL)
    await passing(sky, 2)
    with caplog.at_level(logging.INFO):
        sky.bridge.orders.agent_lost("uav", "a test", (Step("hold", 1.0), Step("rtl")))
        await passing(sky, 5)
    errors = [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR]
    assert [one for one in errors if "is left in" in one] == []
    assert any("it comes home in RTL" in record.getMessage() for record in caplog.records)
    assert "left_to_others" not in {note.code for note in sky.bridge.notes()}


def test_modes_that_bring_a_vehicle_of_any_kind_home_or_down() -> None:
    assert {"RTL", "SMART_RTL", "LAND", "QLAND", "QRTL", "AUTOLAND"} <= COMING_HOME
    assert not COMING_HOME & {"HOLD", "LOITER", "BRAKE", "GUIDED", "AUTO"}
