"""A simulated vehicle as a process: links, clock, shutdown."""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.link import Ids, LinkAddress, Peer
from bridged.simulation.vehicle.fault_injection import Faults, FaultyLink
from bridged.simulation.vehicle.vehicle import COMPONENT, Vehicle

LATE_S = 0.1
"""Wall seconds from which a round of the simulation counts as late: five steps at speed 1."""

REPORT_EVERY_S = 5.0
"""Wall seconds between two reports."""


@dataclass
class RealtimeMonitor:
    """Counter of late rounds and skipped time; reports them now and then when they have grown."""

    log: Callable[[str], None]
    rounds: int = 0
    late: int = 0
    worst: float = 0.0
    """Wall seconds of the latest round."""
    lost: float = 0.0
    """Wall seconds that were skipped after the process stood still for too long."""
    _reported: tuple[int, float] = (0, 0.0)
    _reported_at: float = -math.inf

    def round(self, late: float, now: float) -> None:
        """Note a round that begins `now`, and `late` after it was due, both in wall seconds."""
        self.rounds += 1
        if late > LATE_S:
            self.late += 1
            self.worst = max(self.worst, late)
        if now >= self._reported_at + REPORT_EVERY_S:
            self._reported_at = now
            self.report()

    def report(self) -> None:
        """Report new counts."""
        if (self.late, self.lost) != self._reported:
            self._reported = self.late, self.lost
            self.log(
                f"late: {self.late} of {self.rounds} rounds by more than {LATE_S:g} s, at worst by {self.worst:.1f} s; "
                f"{self.lost:.1f} s skipped"
            )


TICK_S = 0.02
"""Shortest pause between two rounds, in wall seconds: at most 50 rounds a second at any speed."""

LONGEST_PAUSE_S = 0.25
"""Longest pause in wall seconds: bounds the delay of events in flight."""

MOST_CATCH_UP_S = 1.0
"""Wall seconds that are caught up after a stop of the process; the rest is skipped."""

LEAVE_S = 1.0
"""Wall seconds that the companion task of a vehicle has to end."""


class Simulation:
    """One vehicle on its links, at `speed` times real time."""

    def __init__(self, vehicle: Vehicle, speed: float, addresses: Sequence[LinkAddress], faults: Faults) -> None:
        """One address for each channel of the vehicle."""
        self.vehicle = vehicle
        self.speed = speed
        self.addresses = addresses
        self.faults = faults
        self._wake = asyncio.Event()
        self._links: list[FaultyLink] = []
        self._seen = 0.0
        self.pace = RealtimeMonitor(
            lambda words: print(f"simulated {vehicle.kind.name} {vehicle.system} {words}", file=sys.stderr, flush=True)
        )

    async def run(self, stop: asyncio.Event, started: Callable[[], None]) -> None:
        """Fly until `stop` is set; `started` is called once. Raises LinkError if a link cannot be opened."""
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
            self.pace.report()
            await self._switch_off()

    async def _switch_on(self) -> None:
        await self._switch_off()
        for channel, address in enumerate(self.addresses):
            link = FaultyLink(
                address,
                partial(self._receive, channel),
                Ids(self.vehicle.system, COMPONENT),
                lambda _, channel=channel: self.vehicle.signing_state.gate(channel),  # type: ignore[misc]
                self.faults,
                lambda: self.vehicle.age,
            )
            await link.open()
            self._links.append(link)

    async def _switch_off(self) -> None:
        links, self._links = self._links, []
        for link in links:
            report = link.report()
            if report:
                print(f"{link.address}: packets {report}", file=sys.stderr, flush=True)
            await link.close()

    async def _pause(self) -> None:
        loop = asyncio.get_running_loop()
        pause = min(max(TICK_S, self.vehicle.seconds_until_due() / self.speed), LONGEST_PAUSE_S)
        begun = loop.time()
        timer = loop.call_later(pause, self._wake.set)
        try:
            await self._wake.wait()
        finally:
            timer.cancel()
        if (rest := begun + TICK_S - loop.time()) > 0:
            pause = TICK_S
            await asyncio.sleep(rest)
        self.pace.round(loop.time() - begun - pause, loop.time())

    def _catch_up(self) -> None:
        now = asyncio.get_running_loop().time()
        passed, self._seen = now - self._seen, now
        self.pace.lost += max(0.0, passed - MOST_CATCH_UP_S)
        self._send(0, self.vehicle.advance(min(passed, MOST_CATCH_UP_S) * self.speed))
        self._send_waiting()
        for link in self._links:
            link.deliver_late()

    def _receive(self, channel: int, message: dialect.MAVLink_message, peer: Peer) -> None:
        del peer
        self._catch_up()
        self._send(channel, self.vehicle.receive(message, channel))
        self._send_waiting()
        self._wake.set()

    def _send_waiting(self) -> None:
        for channel in range(len(self._links)):
            self._send(channel, self.vehicle.waiting(channel))

    def _send(self, channel: int, messages: list[dialect.MAVLink_message]) -> None:
        if channel < len(self._links):
            for message in messages:
                self._links[channel].send(message, signing=self.vehicle.signing_state.signing)


async def simulate(
    vehicle: Vehicle,
    addresses: Sequence[LinkAddress],
    speed: float,
    stop: asyncio.Event,
    started: Callable[[], None] = lambda: None,
    faults: Faults | None = None,
    beside: Callable[[asyncio.Event], Coroutine[Any, Any, None]] | None = None,
) -> None:
    """Run the vehicle at `speed` times real time until `stop` is set. Raises LinkError.

    `started` is called when the links are open.

    `beside` is what else the process does, until the event is set; the vehicle flies on if it ends.
    """
    other = asyncio.create_task(beside(stop)) if beside is not None else None
    try:
        await Simulation(vehicle, speed, addresses, faults or Faults()).run(stop, started)
    finally:
        stop.set()
        if other is not None:
            await asyncio.wait([other], timeout=LEAVE_S)
