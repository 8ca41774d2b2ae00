"""A flight by mavsdk, as a process of its own: `python -m tests.bridged.clients.mavsdk_flight URL`.

Prints one line per step that is done. Ends with exit code 1 and the reason at the first step that fails.
"""

import asyncio
import math
import sys
from collections.abc import AsyncIterator, Callable
from typing import Any

from mavsdk.asyncio.mavsdk import Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.component_type import ComponentType

GOAL = (-27.603683, -48.518052, 15.0)
"""Degrees, degrees, metres above home."""


async def until(stream: AsyncIterator[Any], wish: Callable[[Any], bool], what: str, seconds: float = 90.0) -> Any:
    last: Any = None
    try:
        async with asyncio.timeout(seconds):
            async for last in stream:
                if wish(last):
                    return last
    except TimeoutError:
        pass
    raise SystemExit(f"mavsdk: no {what} in {seconds:g} s, last: {last}")


def done(step: str) -> None:
    print(step, flush=True)


async def fly(url: str) -> None:
    config = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(config) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=15.0)
        if system is None:
            raise SystemExit("mavsdk: no autopilot found in 15 s")
        done("connected")
        action, telemetry = ActionAsync(system), TelemetryAsync(system)
        await telemetry.set_rate_position(5.0)
        await telemetry.set_rate_health(2.0)
        await telemetry.set_rate_landed_state(2.0)
        await until(
            telemetry.subscribe_health(),
            lambda health: health.is_global_position_ok and health.is_home_position_ok and health.is_armable,
            "health",
        )
        done("healthy")
        home = await telemetry.home()
        await action.set_takeoff_altitude(5.0)
        await action.arm()
        await until(telemetry.subscribe_armed(), lambda armed: armed, "arming")
        done("armed")
        await action.takeoff()
        await until(
            telemetry.subscribe_position(), lambda at: abs(at.relative_altitude_m - 5.0) < 0.3, "takeoff to 5 m"
        )
        await until(telemetry.subscribe_in_air(), lambda flying: flying, "in_air")
        done("taken off")
        lat, lon, height = GOAL
        await action.goto_location(lat, lon, home.absolute_altitude_m + height, math.nan)
        await until(
            telemetry.subscribe_position(),
            lambda at: (
                abs(at.latitude_deg - lat) < 1e-5
                and abs(at.longitude_deg - lon) < 1e-5
                and abs(at.relative_altitude_m - height) < 0.5
            ),
            "arrival",
        )
        done("arrived")
        await action.return_to_launch()
        await until(telemetry.subscribe_armed(), lambda armed: not armed, "disarming", 60.0)
        at = await telemetry.position()
        if abs(at.latitude_deg - home.latitude_deg) > 1e-5 or abs(at.relative_altitude_m) > 0.3:
            raise SystemExit(f"mavsdk: landed at {at}, home is {home}")
        done("landed and disarmed at home")


if __name__ == "__main__":
    asyncio.run(fly(sys.argv[1]))
