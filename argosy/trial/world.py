"""The world of a trial: the true state of its vehicles and turtles, and the faults that befall it."""

from __future__ import annotations

import asyncio
import math
import random
import signal
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from argosy.processes.supervisor import Child
from argosy.stop.command import order_robot
from argosy.trial.faults import BoardDown, ClockStep, DiskFull, Fault, Kill, LinkCut, LinkNoise, Operator, StopOrder
from argosy.trial.network import LEASE, Network
from argosy.trial.power_loss import lose_power
from argosy.trial.process import Machine
from bridged.simulation.turtle.turtle import Turtle
from commd.bus.bus import open_bus
from commd.bus.errors import BusClosed
from schemas.geo import EARTH_RADIUS, distance

SAMPLED = 0.2
"""Virtual seconds between two looks at the vehicles."""
BURST = (0.1, 1.5)
"""Virtual seconds of a burst of loss: shorter than a lease, so that all that was sent arrives after it."""
AT_REST = 0.3
"""m/s below which a rover is at rest."""
PATIENCE = 3.0
"""Virtual seconds for an operator to reach a router, and before he repeats what was not confirmed."""


@dataclass
class Seen:
    """What is known of a vehicle in truth."""

    vehicle: Any
    """`bridged.simulation.vehicle.vehicle.Vehicle`."""
    flown: float = 0.0
    """Metres over ground."""
    farthest: float = 0.0
    """Metres from home, horizontally."""
    charge: float = 1.0
    """Least share of its battery that was left by the autopilot's count, 0 to 1."""
    misled: float = 0.0
    """Metres by which its autopilot was wrong about its position at most."""
    place: tuple[float, float] = (0.0, 0.0)
    """Where it was seen last: latitude and longitude in degrees."""
    _truth: Any = None
    """The same, on the vehicle's map."""

    @property
    def armed(self) -> bool:
        """Whether its motors turn."""
        return bool(self.vehicle.autopilot.armed)

    @property
    def parked(self) -> bool:
        """Whether it is a rover at rest: it needs no motors for that, and nobody to bring it down."""
        if self.vehicle.kind.name != "rover":
            return False
        motion = self.vehicle.autopilot.motion
        return math.hypot(motion.north.velocity, motion.east.velocity) < AT_REST

    @property
    def pilots_mode(self) -> str:
        """Flight mode that the pilot who has it has set; empty: no pilot has it."""
        switch = self.vehicle.vehicle_faults.switch
        return "" if switch is None else str(switch.name)

    @property
    def piloted(self) -> bool:
        """Whether a pilot has it, and nobody has changed his mode."""
        return self.pilots_mode == self.mode

    @property
    def landed_by_pilot(self) -> bool:
        """Whether a pilot has landed it in this run."""
        return bool(self.vehicle.vehicle_faults.landed)

    @property
    def height(self) -> float:
        """Metres above home."""
        copter = self.vehicle.autopilot
        return float(copter.motion.up.position - copter.home_on_chart.up)

    @property
    def mode(self) -> str:
        """Flight mode."""
        return str(self.vehicle.autopilot.mode.name)

    @property
    def estimated(self) -> tuple[float, float]:
        """Latitude and longitude in degrees as its autopilot estimates them."""
        where = self.vehicle.autopilot.place
        return where.lat, where.lon

    def look(self) -> None:
        """Follow its way."""
        copter = self.vehicle.autopilot
        if (truth := copter.truth) != self._truth:
            here = copter.true_place.lat, copter.true_place.lon
            if self._truth is not None:
                self.flown += distance(self.place, here)
            if copter.home is not None:
                self.farthest = max(self.farthest, distance((copter.home.lat, copter.home.lon), here))
            self.place, self._truth = here, truth
        self.misled = max(self.misled, copter.estimate.error.flat())
        self.charge = min(self.charge, copter.battery.remaining / 100)


@dataclass
class World:
    """All vehicles and turtles, by robot, and what befalls them and their boards."""

    network: Network
    routers: dict[str, str]
    """Endpoint of each board's router."""
    faults: Iterable[Fault]
    children: Callable[[], list[Child]]
    robots: tuple[str, ...] = ()
    """All robots of the mission."""
    vehicles: dict[str, Seen] = field(default_factory=dict)
    turtles: dict[str, Turtle] = field(default_factory=dict)
    nearest: float = float("inf")
    """Least distance of two vehicles in the air, in metres."""
    machines: dict[str, Machine] = field(default_factory=dict)
    """Each board, by its name."""
    state: Path = Path("state")
    """Folder with the files of all boards."""
    fleet: str = ""
    dice: random.Random = field(default_factory=lambda: random.Random(0))
    stopped: dict[str, StopOrder] = field(default_factory=dict)
    """The order of the operator that each robot has confirmed, until he gives it back."""
    operators: list[asyncio.Task[None]] = field(default_factory=list)
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
            self._look_who_is_near()
            for look in self.looks:
                look()

    def _look_who_is_near(self) -> None:
        """Compare the vehicles in the air; those that are farther apart by latitude or longitude alone need no look."""
        in_air = sorted((*seen.place, seen.height) for seen in self.vehicles.values() if seen.armed and seen.height > 1)
        for place, (north, east, height) in enumerate(in_air):
            metres = math.radians(math.cos(math.radians(north))) * EARTH_RADIUS * 0.99  # of a degree, at least
            for other in in_air[place + 1 :]:
                if math.radians(other[0] - north) * EARTH_RADIUS > self.nearest:
                    break
                if abs(other[1] - east) * metres > self.nearest:
                    continue
                apart = distance((north, east), other[:2])
                self.nearest = min(self.nearest, math.hypot(apart, height - other[2]))

    def _happen(self, fault: Fault) -> None:
        match fault:
            case Kill():
                for child in self.children():
                    if child.alive and fault.hits(child.process):
                        child.signal(signal.SIGKILL)
            case BoardDown(board=board, seconds=seconds):
                machine = self.machine(board)
                machine.down_until = machine.booted = max(machine.down_until, fault.at + seconds)
                daemons = [one for one in self.children() if one.process.board == board and one.process.kind.daemon]
                pids = {child.pid for child in daemons if child.alive}
                lost = [one for one in self.network.sessions if getattr(one.owner, "pid", None) in pids]
                self.network.close(*lost, lease=LEASE)  # nothing says that it ends
                for child in daemons:
                    if child.alive:
                        child.signal(signal.SIGKILL)
                machine.boots += 1
                lose_power(
                    self.state, [board, *(name for one in daemons for name in one.process.subject.split())], self.dice
                )
            case DiskFull(board=board, seconds=seconds):
                machine = self.machine(board)
                machine.full_until = max(machine.full_until, fault.at + seconds)
            case ClockStep(board=board, by=by):
                self.machine(board).ahead += by
            case LinkCut(sender=sender, receiver=receiver, seconds=seconds, both=both):
                there = self.routers[sender], self.routers[receiver]
                self.network.cut((there, there[::-1]) if both else (there,), seconds)
            case LinkNoise(sender=sender, receiver=receiver, seconds=seconds, delay=delay, bursts=bursts):
                there, at = (self.routers[sender], self.routers[receiver]), fault.at
                for line in (there, there[::-1]):
                    self.network.noise[line] = fault.at + seconds, delay
                while bursts and (at := at + self.dice.expovariate(bursts / 60)) < fault.at + seconds:
                    self.network.loop.call_at(at, self.network.cut, (there, there[::-1]), self.dice.uniform(*BURST))
            case Operator(robot=robot):
                for one in [robot] if robot else self.robots:
                    self.operators.append(asyncio.create_task(self._stop(one, fault)))
            case _:
                pass  # a vehicle's own, which it has from the start

    async def _stop(self, robot: str, fault: Operator) -> None:
        """Order a robot, and give it back."""
        await self._confirmed(robot, fault.order)
        self.stopped[robot] = fault.order
        if fault.seconds is not None:
            await asyncio.sleep(fault.seconds)
            self.stopped.pop(robot, None)
            await self._confirmed(robot, "continue" if fault.order == "pause" else "release")

    async def _confirmed(self, robot: str, order: str) -> None:
        """Repeat an order until the robot has confirmed it."""
        while True:
            with suppress(BusClosed):
                router = next(iter(self.routers.values()))
                async with open_bus(
                    router, fleet=self.fleet, name="operator", daemon="argosy", patience=PATIENCE
                ) as bus:
                    if (await order_robot(bus, self.fleet, robot, order)).ok:
                        return
            await asyncio.sleep(PATIENCE)

    def machine(self, board: str) -> Machine:
        """Return a board."""
        return self.machines.setdefault(board, Machine(board))

    async def board_is_up(self, board: str) -> None:
        """Wait until a board is there to start a process."""
        if (left := self.machine(board).down_until - self.network.loop.time()) > 0:
            await asyncio.sleep(left)
            await self.board_is_up(board)  # it may have died again meanwhile
