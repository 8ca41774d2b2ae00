"""A simulated vehicle as a process: its link, its clock, its end."""

import asyncio
import signal
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.link import Link, LinkAddress, Peer, open_link
from bridged.simulation.vehicle import COMPONENT, Vehicle

TICK_S = 0.02
"""Shortest pause between two rounds, in wall seconds: at most 50 rounds a second at any speed."""

LONGEST_PAUSE_S = 0.25
"""Longest pause in wall seconds; what happens in flight without a message that is due is told no later."""

MOST_CATCH_UP_S = 1.0
"""Wall seconds that are made up for at once after a stop of the process; the rest never happened."""


class Simulation:
    """One vehicle on one link, at `speed` times real time."""

    def __init__(self, vehicle: Vehicle, speed: float, address: LinkAddress) -> None:
        self.vehicle = vehicle
        self.speed = speed
        self.address = address
        self._wake = asyncio.Event()
        self._link: Link | None = None
        self._seen = 0.0

    async def run(self, stop: asyncio.Event, started: Callable[[], None]) -> None:
        """Flies until `stop` is set; `started` is called once. Raises LinkError if the link cannot be opened."""
        self._seen = asyncio.get_running_loop().time()
        waiting = asyncio.create_task(stop.wait())
        waiting.add_done_callback(lambda _: self._wake.set())
        try:
            await self._switch_on()
            started()
            reboots = self.vehicle.reboots
            while not stop.is_set():
                self._wake.clear()
                self._catch_up()
                if self.vehicle.reboots != reboots:
                    reboots = self.vehicle.reboots
                    await self._switch_on()  # another socket: the vehicle speaks from another port (recorded)
                await self._pause()
        finally:
            waiting.cancel()
            await self._switch_off()

    async def _switch_on(self) -> None:
        await self._switch_off()
        self._link = await open_link(self.address, self._receive, system=self.vehicle.system, component=COMPONENT)

    async def _switch_off(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            await link.close()

    async def _pause(self) -> None:
        await asyncio.sleep(TICK_S)
        due = self.vehicle.seconds_until_due() / self.speed - TICK_S
        if due > 0:
            try:
                async with asyncio.timeout(min(due, LONGEST_PAUSE_S)):
                    await self._wake.wait()
            except TimeoutError:
                return

    def _catch_up(self) -> None:
        now = asyncio.get_running_loop().time()
        passed, self._seen = now - self._seen, now
        self._send(self.vehicle.advance(min(passed, MOST_CATCH_UP_S) * self.speed))

    def _receive(self, message: dialect.MAVLink_message, peer: Peer) -> None:
        del peer
        self._catch_up()
        self._send(self.vehicle.receive(message))
        self._wake.set()

    def _send(self, messages: list[dialect.MAVLink_message]) -> None:
        if self._link is not None:
            for message in messages:
                self._link.send(message)


async def simulate(
    vehicle: Vehicle, address: LinkAddress, speed: float, started: Callable[[], None] = lambda: None
) -> None:
    """Runs the vehicle until SIGTERM or SIGINT; `started` is called when the link is open. Raises LinkError."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    await Simulation(vehicle, speed, address).run(stop, started)
