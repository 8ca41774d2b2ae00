"""The world of a trial: the true state of its vehicles, and the faults that befall it."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

from argosy.processes.supervisor import Child
from argosy.trial.faults import BoardDown, DiskFull, Fault, Kill, LinkCut
from argosy.trial.network import Network
from schemas.geo import distance

SAMPLED = 0.2
"""Virtual seconds between two looks at the vehicles."""


@dataclass
class Seen:
    """What is known of a vehicle in truth."""

    vehicle: Any
    """`bridged.simulation.copter.protocol.mavlink_interface.Vehicle`."""
    flown: float = 0.0
    """Metres over ground."""
    highest: float = 0.0
    """Metres above home."""
    farthest: float = 0.0
    """Metres from home, horizontally."""
    charge: float = 1.0
    """Least share of its battery that was left by the autopilot's count, 0 to 1."""
    last: tuple[float, float] | None = None

    @property
    def armed(self) -> bool:
        """Whether its motors turn."""
        return bool(self.vehicle.copter.armed)

    @property
    def height(self) -> float:
        """Metres above home."""
        copter = self.vehicle.copter
        return float(copter.motion.position.up - copter.home_on_chart.up)

    @property
    def mode(self) -> str:
        """Flight mode."""
        return str(self.vehicle.copter.mode.name)

    def place(self) -> tuple[float, float]:
        """Latitude and longitude in degrees."""
        where = self.vehicle.copter.place
        return where.lat, where.lon

    def look(self) -> None:
        """Follow its way."""
        here = self.place()
        if self.last is not None:
            self.flown += distance(self.last, here)
        self.last = here
        copter = self.vehicle.copter
        self.highest = max(self.highest, self.height)
        self.charge = min(self.charge, copter.battery.remaining / 100)
        if copter.home is not None:
            self.farthest = max(self.farthest, distance((copter.home.lat, copter.home.lon), here))


@dataclass
class World:
    """All vehicles, by robot, and what befalls them and their boards."""

    network: Network
    routers: dict[str, str]
    """Endpoint of each board's router."""
    faults: Iterable[Fault]
    children: Callable[[], list[Child]]
    vehicles: dict[str, Seen] = field(default_factory=dict)
    nearest: float = float("inf")
    """Least distance of two vehicles in the air, in metres."""
    down: dict[str, float] = field(default_factory=dict)
    """Until when each board is down."""
    full: dict[str, float] = field(default_factory=dict)
    """Until when the disk of each board is full."""
    looks: list[Callable[[], None]] = field(default_factory=list)
    """Called after each look at the vehicles."""

    async def run(self) -> None:
        """Watch and let faults happen, for ever."""
        loop = self.network.loop
        for fault in self.faults:
            loop.call_at(fault.at, self._happen, fault)
        while True:
            await asyncio.sleep(SAMPLED)
            for seen in self.vehicles.values():
                seen.look()
            in_air = [seen for seen in self.vehicles.values() if seen.armed and seen.height > 1]
            for one, other in combinations(in_air, 2):
                apart = distance(one.place(), other.place())
                self.nearest = min(self.nearest, (apart**2 + (one.height - other.height) ** 2) ** 0.5)
            for look in self.looks:
                look()

    def _happen(self, fault: Fault) -> None:
        match fault:
            case Kill():
                for child in self.children():
                    if child.alive and fault.hits(child.process):
                        child.signal(signal.SIGKILL)
            case BoardDown(board=board, seconds=seconds):
                self.down[board] = max(self.down.get(board, 0.0), fault.at + seconds)
                for child in self.children():
                    if child.process.board == board and child.process.kind.daemon and child.alive:
                        child.signal(signal.SIGKILL)
            case DiskFull(board=board, seconds=seconds):
                self.full[board] = max(self.full.get(board, 0.0), fault.at + seconds)
            case LinkCut(sender=sender, receiver=receiver, seconds=seconds, both=both):
                there = self.routers[sender], self.routers[receiver]
                self.network.cut((there, there[::-1]) if both else (there,), seconds)
            case _:
                pass  # a vehicle's own, which it has from the start

    def disk_is_full(self, board: str) -> bool:
        """Return whether the disk of a board is full now."""
        return self.network.loop.time() < self.full.get(board, 0.0)

    async def board_is_up(self, board: str) -> None:
        """Wait until a board is there to start a process."""
        if (left := self.down.get(board, 0.0) - self.network.loop.time()) > 0:
            await asyncio.sleep(left)
            await self.board_is_up(board)  # it may have died again meanwhile
