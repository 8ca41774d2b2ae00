"""A real ground station behind a bridge that flies the simulated copter: it takes it, and that is noticed."""

import asyncio
from pathlib import Path

import pytest

from tests.bridged.drivers.mavlink.test_ground_stations import MavProxy, copter
from tests.bridged.radio import COPTER, Ride, riding
from tests.support.buses import until
from tests.support.ports import free_port


async def take_off(ride: Ride) -> None:
    """Armed and on the way up, by the bridge."""
    for name, arguments in (
        ("set_mode", {"mode": "GUIDED"}),
        ("arm_motors", {"arm": True}),
        ("takeoff", {"altitude": 9}),
    ):
        execution = ride.driver.perform(name, COPTER.actions[name], arguments)
        await until(lambda: execution.over or name == "takeoff", f"the end of {name}")  # noqa: B023
        assert execution.outcome is None or execution.outcome.state == "succeeded"


@pytest.mark.timeout(90)
def test_mavproxy_sees_the_copter_through_the_bridge_and_its_mode_is_an_override(tmp_path: Path) -> None:
    port, station = free_port(), free_port()

    async def body() -> None:
        async with (
            asyncio.timeout(60),
            riding(f"link: 'udpin:127.0.0.1:{port}', forward: 'udpout:127.0.0.1:{station}'") as [ride],
        ):
            await asyncio.to_thread(proxy.until, "online system 1")
            await take_off(ride)
            proxy.say("mode loiter")
            await asyncio.to_thread(proxy.until, "Mode LOITER")
            await until(lambda: ride.driver.overridden == "LOITER", "the bridge knows that others have it")
            refusal = ride.driver.refuses(COPTER.actions["goto"])
            assert refusal.cause == "pilot"

    with copter(f"udpout:127.0.0.1:{port}", "--speed", "5"):
        proxy = MavProxy(station, tmp_path)
        try:
            asyncio.run(body())
        finally:
            proxy.close()
