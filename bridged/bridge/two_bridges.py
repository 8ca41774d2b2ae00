"""Two bridges of one robot, started while their boards were cut apart: one gives way when they hear each other."""

from __future__ import annotations

import asyncio
from collections import Counter
from contextlib import suppress

from bridged.bridge.bridge import Bridge
from bridged.bridge.bus_endpoints import Service
from commd.bus.bus import Bus
from commd.bus.errors import AlreadyRunning
from commd.common.clock import Clock
from schemas.wire import keys
from schemas.wire.records import Health

NEAR, ROUNDED = 5.0, 0.1
"""Wall seconds between two starts below which the boot ids decide, and by which the `uptime` of a record is inexact."""
UNDECIDED = 10
"""Records of the other bridge after which it has not given way by its age."""


def gives_way(boot: str, uptime: float, other: Health, heard: int = 1) -> bool:
    """Whether a bridge gives way to the other of its robot: as at the start, the one that was there first stays.

    Never do both: the uptime in a record is that of its sending, so each underestimates the other's. So both may stay
    if they started `NEAR` apart, until one has `heard` the other's records for a while.
    """
    older = other.uptime - uptime - ROUNDED
    near = NEAR if heard < UNDECIDED else 2 * NEAR
    return older > NEAR or (older > -near and other.header.boot < boot)


async def run_alone(bus: Bus, bridge: Bridge, service: Service, clock: Clock) -> None:
    """Run a bridge until it gives way to another one of its robot, which it leaves to that one without an order.

    Raises AlreadyRunning then, and what `Bridge.run` raises, each in a group.
    """
    async with asyncio.TaskGroup() as running:
        running.create_task(bridge.run())
        error = await _other(bus, bridge.name, clock)
        service.close()
        bridge.orders.leave_to_other(str(error))
        raise error


async def _other(bus: Bus, robot: str, clock: Clock) -> AlreadyRunning:
    """Wait until a bridge is heard that this one gives way to."""
    heard = asyncio.Queue[str](1)
    records = Counter[str]()

    def word(_: str, health: Health) -> None:
        if (boot := health.header.boot) == bus.boot:
            return
        records[boot] += 1
        if gives_way(bus.boot, clock.wall(), health, records[boot]):
            with suppress(asyncio.QueueFull):
                heard.put_nowait(boot)

    bus.subscribe(keys.health(bus.fleet, robot, bus.daemon), Health, word)
    while True:  # the last record of a bridge that has ended may come late: its token does not
        if others := await bus.tokens(keys.alive(bus.fleet, robot, bus.daemon, await heard.get())):
            return bus.taken(robot, others)
