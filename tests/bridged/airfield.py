"""The bridge daemon on real Zenoh with a simulated copter on real UDP, all in one process and one event loop."""

import asyncio
import time
from argparse import Namespace
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import Path

from bridged.daemon import serve
from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.link import open_link
from bridged.simulation.vehicle.vehicle import Vehicle
from commd.bus.bus import Bus, Reply, open_bus
from schemas.mission.model import Mission, read_mission
from schemas.wire import keys
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import Action, ActionStatus, Perception
from schemas.wire.terms import Term
from tests.bridged.sky import HOME, MISSION
from tests.support.buses import until
from tests.support.ports import free_port

SPEED = 10.0
STEP_WALL = 0.005


def command_line(endpoint: str, state: Path, *robots: str, **said: object) -> Namespace:
    """What the command line of the bridge daemon says."""
    unsaid = dict.fromkeys(("board", "keys", "speed", "link", "logs"), None) | {"until_home": False, "simulated": False}
    return Namespace(robots=list(robots), router=endpoint, state=state, **unsaid | said)


class Airfield:
    """What a test of the daemon has at hand."""

    def __init__(self, endpoint: str, state: Path, mission: str = MISSION, speed: float = SPEED) -> None:
        self.endpoint, self.state, self.speed = endpoint, state, speed
        self.link = f"udpin:127.0.0.1:{free_port()}"
        self.mission: Mission = read_mission(mission, Path("test.yaml"))
        self.vehicle = Vehicle(HOME)
        self.vehicle.autopilot.parameters.set("DISARM_DELAY", 127)  # s: its 10 s pass too soon on a busy machine
        self.stop = asyncio.Event()
        self.daemon: asyncio.Task[int]
        self.silent = False
        """Nothing gets through, either way."""
        self.withheld: set[str] = set()
        """Kinds of messages of the vehicle that do not get through."""
        self._ids = 0

    def arguments(self) -> Namespace:
        said = {"speed": self.speed, "link": self.link, "simulated": True}
        return command_line(self.endpoint, self.state, "uav1", **said)

    def start(self) -> asyncio.Task[int]:
        """Start the bridge daemon, perhaps another life of it."""
        self.stop.clear()
        self.daemon = asyncio.create_task(serve(self.mission, self.arguments(), self.stop))
        return self.daemon

    async def leave(self) -> None:
        """End the bridge daemon, which leaves its robot without an error."""
        self.stop.set()
        assert await self.daemon == 0

    async def mode_is(self, name: str) -> None:
        """Wait until the vehicle is in a mode."""
        await until(lambda: self.vehicle.autopilot.mode.name == name, f"the vehicle is in {name}")

    @asynccontextmanager
    async def router(self) -> AsyncIterator[Bus]:
        async with self._bus("board", "commd", mode="router") as bus:
            yield bus

    @asynccontextmanager
    async def client(self, name: str = "uav") -> AsyncIterator[Bus]:
        async with self._bus(name, "agentd") as bus:
            yield bus

    def _bus(self, name: str, daemon: str, mode: str = "client"):  # type: ignore[no-untyped-def]
        return open_bus(
            self.endpoint,
            fleet="test",
            name=name,
            daemon=daemon,
            mode="router" if mode == "router" else "client",
        )

    async def fly(self) -> None:
        """Be the simulated copter until cancelled."""
        address = LinkAddress.parse(self.link.replace("udpin", "udpout"))

        def hear(message: object, peer: object) -> None:
            if not self.silent:
                for answer in self.vehicle.receive(message):
                    link.send(answer)

        link = await open_link(address, hear, system=1, component=1)
        before = time.monotonic()
        try:
            while True:
                now = time.monotonic()
                for message in self.vehicle.advance((now - before) * self.speed):
                    if not self.silent and message.get_type() not in self.withheld:
                        link.send(message)
                before = now
                await asyncio.sleep(STEP_WALL)
        finally:
            await link.close()

    async def ask(
        self,
        bus: Bus,
        name: str,
        *parameters: Term,
        id: str = "",
        attempt: int = 1,
        timeout: float = 60,
        agent: str = "uav",
    ) -> list[ActionStatus]:
        """Perform an action as an agent does; returns its statuses. Fails on anything that is not one."""
        self._ids += 1
        identity, its_own = id or f"{agent}:t:{self._ids}", bus.header("action", agent)
        action = Action(header=its_own, id=identity, parameters=parameters, attempt=attempt)
        key, heard = keys.action("test", agent, name), list[ActionStatus]()
        async for reply in bus.query(key, action, ActionStatus, timeout):
            assert reply.record is not None, reply.error
            heard.append(reply.record)
        return heard

    async def do(self, bus: Bus, name: str, *parameters: Term, agent: str = "uav") -> ActionStatus:
        """Perform an action and return its final status."""
        heard = await self.ask(bus, name, *parameters, agent=agent)
        assert heard, "nobody serves the action"
        assert heard[-1].final
        return heard[-1]

    async def take_off(self, bus: Bus, altitude: float = 10) -> None:
        """Ready, armed and at an altitude."""
        for name, argument in (("set_mode", "GUIDED"), ("arm_motors", True), ("takeoff", altitude)):
            status = await self.do(bus, name, argument)
            assert status.state == "succeeded", status.reason


async def present(bus: Bus, agent: str = "uav") -> list[Reply[Perception]]:
    """What a repair query answers."""
    return [one async for one in bus.query(keys.percept("test", agent, "**"), None, Perception, 60)]


async def until_served(bus: Bus) -> None:
    """Wait until the bridge is on the bus and hears its vehicle."""
    await until(lambda: present(bus), "the bridge serves")


async def all_present(bus: Bus, names: Iterable[str]) -> bool:
    """Return whether percepts of all these names are present."""
    return {one.record.name for one in await present(bus) if one.record} >= set(names)


async def restored(copy: PerceptSet, bus: Bus) -> bool:
    """Take the present percepts into a copy; return whether they were complete."""
    return copy.restore([one.record for one in await present(bus) if one.record]) is not None


@asynccontextmanager
async def on_the_airfield(
    endpoint: str, state: Path, *, mission: str = MISSION, speed: float = SPEED
) -> AsyncIterator[Airfield]:
    """Yield an airfield with the copter switched on."""
    field = Airfield(endpoint, state, mission, speed)
    flying = asyncio.create_task(field.fly())
    try:
        yield field
    finally:
        flying.cancel()
        await asyncio.gather(flying, return_exceptions=True)


@asynccontextmanager
async def serving(
    endpoint: str, state: Path, *, client: str = "uav", mission: str = MISSION, speed: float = SPEED
) -> AsyncIterator[tuple[Airfield, Bus]]:
    """Yield an airfield whose bridge serves, and the bus of a client; the bridge leaves at the end without an error."""
    async with (
        on_the_airfield(endpoint, state, mission=mission, speed=speed) as field,
        field.router(),
        field.client(client) as bus,
    ):
        daemon = field.start()
        try:
            await until_served(bus)
            yield field, bus
            await field.leave()
        finally:
            daemon.cancel()
            field.daemon.cancel()


__all__ = ["Airfield", "all_present", "on_the_airfield", "present", "restored", "serving", "until", "until_served"]
