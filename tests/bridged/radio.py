"""Vehicles that only say and hear what a test wants, on real sockets, and drivers of robots at one link."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Reading, Setup
from bridged.drivers.mavlink.driver import MavlinkDriver
from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.drivers.mavlink.transport.signing import Signing
from commd.common.clock import Clock
from schemas.manifest.loader import Manifest, load_manifest
from schemas.mission.model import Robot, read_mission
from tests.support.buses import until

COPTER = load_manifest("copter")
BEAT = dialect.MAVLink_heartbeat_message(2, 3, 1, 4, 4, 3)
STATION_BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def place(altitude: float = 5.0) -> dialect.MAVLink_message:
    """A GLOBAL_POSITION_INT at so many metres above home."""
    height = round(altitude * 1000)
    return dialect.MAVLink_global_position_int_message(0, -276040330, -485183630, height, height, 0, 0, 0, 0)


class Speaker:
    """One end of a UDP link that a test speaks and listens with; `riding` closes all at its end."""

    used: ClassVar[list[Speaker]] = []

    def __init__(self, port: int = 0, system: int = 1, component: int = 1, signing: Signing | None = None) -> None:
        """Speaks to a port of this machine; without one to whom it last heard, from its own `port`."""
        self._socket = socket.socket(type=socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]
        self._to = ("127.0.0.1", port) if port else None
        self.encoder, self._signing = Encoder(system, component), signing
        self.counters, self.peers = WireCounters(), set[object]()
        """What was read, and the addresses that it came from."""
        self._framer = Framer(self.counters)
        self.heard: list[dialect.MAVLink_message] = []
        self.raw: list[bytes] = []
        self.used.append(self)

    def say(self, *messages: dialect.MAVLink_message) -> bytes:
        """Send messages, each in a datagram of its own; returns the last one."""
        packet = b""
        for message in messages:
            packet = self.encoder.pack(message, self._signing)
            self.send(packet)
        return packet

    def send(self, packet: bytes) -> None:
        if self._to is None:
            self.listen()
        assert self._to is not None, "nobody has spoken to this end yet"
        self._socket.sendto(packet, self._to)

    def listen(self) -> list[dialect.MAVLink_message]:
        """Everything heard so far."""
        with suppress(BlockingIOError):
            while True:
                data, address = self._socket.recvfrom(4096)
                self._to = self._to or address
                self.peers.add(address)
                self.raw.append(data)
                self.heard += self._framer.feed(data, datagram=True)
        return self.heard

    def kinds(self, *ids: int) -> set[str]:
        """What kinds of messages were heard, from everybody or from one pair of ids."""
        return {one.get_type() for one in self.listen() if not ids or spoken_as(one) == ids}

    def find(self, kind: str, **fields: float) -> list[dialect.MAVLink_message]:
        """All messages of a kind so far with these fields."""
        heard = [one for one in self.listen() if one.get_type() == kind]
        return [one for one in heard if all(getattr(one, name) == value for name, value in fields.items())]

    async def hears(self, kind: str, times: int = 1, **fields: float) -> dialect.MAVLink_message:
        """Wait until so many messages of a kind with these fields have come; returns the last of them."""
        await until(lambda: len(self.find(kind, **fields)) >= times, f"{times} {kind} {fields}")
        return self.find(kind, **fields)[-1]

    def command(self, number: int, *params: float) -> None:
        """Send a COMMAND_LONG to the autopilot of system 1."""
        padded = (*params, *([0.0] * (7 - len(params))))
        self.say(dialect.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()


def spoken_as(message: dialect.MAVLink_message) -> tuple[int, int]:
    """The ids of the sender."""
    return message.get_srcSystem(), message.get_srcComponent()


def robot_of(fields: str) -> Robot:
    """A robot of a mission file, by its fields in YAML's flow style."""
    text = f"mission: test\nagents: {{a: {{program: a.asl}}}}\nrobots:\n  uav: {{manifest: copter, {fields}}}\n"
    return read_mission(text, Path("test.yaml")).robots["uav"]


class Ride:
    """A driver that runs, and what its robot said."""

    def __init__(self, name: str, robot: Robot, shared: dict[str, Any], state: Path, manifest: Manifest) -> None:
        self.readings: list[Reading] = []
        self.steps: Callable[[], None] = lambda: None
        self.driver = MavlinkDriver(
            Setup(
                name,
                manifest,
                robot,
                Path(),
                Clock(),
                self.readings.append,
                lambda: self.steps(),
                state=state,
                shared=shared,
            )
        )
        self.running = asyncio.create_task(self.driver.run())

    @property
    def open(self) -> bool:
        """Whether its link is open."""
        return "bad_checksums" in self.driver.counters()

    def count(self, source: str) -> int:
        """Readings of a source so far."""
        return sum(reading.source == source for reading in self.readings)

    async def leave(self) -> None:
        """End the driver."""
        self.running.cancel()
        await asyncio.gather(self.running, return_exceptions=True)


@asynccontextmanager
async def riding(*fields: str, state: Path = Path(), manifest: Manifest = COPTER) -> AsyncIterator[list[Ride]]:
    """Drivers of robots with these fields, in one process, while the block lasts; their links are open."""
    shared: dict[str, Any] = {}
    rides = [Ride(f"uav{at}", robot_of(one), shared, state, manifest) for at, one in enumerate(fields, 1)]
    try:
        await until(lambda: all(ride.open or ride.running.done() for ride in rides), "the links are open")
        stations = [task for task in asyncio.all_tasks() if task.get_name().startswith("forward ")]
        if stations:  # one whose port is taken stays closed: some tests want that
            await asyncio.wait(stations, timeout=2)
        yield rides
    finally:
        for ride in rides:
            await ride.leave()
        while Speaker.used:
            Speaker.used.pop().close()
