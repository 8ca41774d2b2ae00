"""Real ground stations behind a bridge that flies the simulated copter: they watch it, take it, and that is noticed."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from tests.bridged.drivers.mavlink.test_ground_stations import ROOT, copter
from tests.bridged.radio import COPTER, Ride, riding
from tests.support.buses import until
from tests.support.ports import free_port

SPEED = "5"


def with_a_copter(station: int, body: Callable[[Ride], Coroutine[Any, Any, None]], seconds: float = 60) -> None:
    """Run `body` with a bridge's driver on a simulated copter, forwarding to a port; both are gone afterwards."""

    async def everything(port: int) -> None:
        async with (
            asyncio.timeout(seconds),
            riding(f"link: 'udpin:127.0.0.1:{port}', forward: 'udpout:127.0.0.1:{station}'") as [ride],
        ):
            await body(ride)

    port = free_port()
    with copter(f"udpout:127.0.0.1:{port}", "--speed", SPEED):
        asyncio.run(everything(port))


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
def test_mavutil_sees_the_copter_through_the_bridge_and_its_mode_is_an_override() -> None:
    station = free_port()

    async def body(ride: Ride) -> None:
        client = [sys.executable, "-m", "tests.bridged.clients.pymavlink_watch", f"udpin:127.0.0.1:{station}", "LOITER"]
        watching = await asyncio.create_subprocess_exec(
            *client,
            cwd=ROOT,
            env={**os.environ, "MAVLINK20": "1"},
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
        )
        assert watching.stdin is not None
        assert watching.stdout is not None
        try:
            assert await watching.stdout.readline() == b"heard system 1\n"
            assert await watching.stdout.readline() == b"sees where it is\n"
            await take_off(ride)
            watching.stdin.write(b"now\n")
            assert await watching.stdout.readline() == b"mode LOITER\n"
            await until(lambda: ride.driver.overridden == "LOITER", "the bridge knows that others have it")
            refusal = ride.driver.refuses(COPTER.actions["goto"])
            assert refusal is not None
            assert refusal.cause == "pilot"
        finally:
            if watching.returncode is None:
                watching.kill()
            await watching.wait()

    with_a_copter(station, body)
