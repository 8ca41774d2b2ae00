"""The bridge daemon on real Zenoh with a simulated turtle, all in one process and one event loop."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

from bridged.daemon import serve
from bridged.simulation.turtle.command import simulate
from bridged.simulation.turtle.turtle import Turtle
from commd.bus.bus import Bus, open_bus
from commd.client.percept_sync import PerceptSync
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Health, Perception
from schemas.wire.terms import Term
from tests.bridged.airfield import command_line

MISSIONS = Path(__file__).parents[2] / "missions"


class Studio:
    """The bridge daemon of the first robot of a mission, a turtle, a client that is its agent, and what both say."""

    def __init__(self, mission: Mission, bus: Bus, turtle: Turtle) -> None:
        self.mission, self.bus, self.turtle = mission, bus, turtle
        self.agent, self.robot = next(iter(mission.agents)), next(iter(mission.robots))
        self.told = 0
        self.health = Health()
        self.leave = asyncio.Event()
        """Ends the turtle."""
        self._ids = 0
        self.percepts = PerceptSync(bus, self.agent, self.robot, self._perceive)
        bus.subscribe(keys.health(bus.fleet, self.robot, "bridged"), Health, self._hear)

    async def do(self, name: str, *parameters: Term) -> ActionStatus:
        """Perform an action by a query, as an agent does."""
        self._ids += 1
        header = self.bus.header("action", self.agent)
        action = Action(header=header, id=f"{self.agent}:t:{self._ids}", parameters=parameters)
        key = keys.action(self.bus.fleet, self.agent, name)
        heard = [one.record async for one in self.bus.query(key, action, ActionStatus, 60)]
        assert heard, "nobody serves the action"
        assert heard[-1] is not None
        return heard[-1]

    def values(self, name: str) -> tuple[Term, ...]:
        """The arguments of a percept, none if it is not there."""
        present = self.percepts.named(name)
        return present[-1].parameters if present else ()

    def _perceive(self, _: Perception) -> None:
        self.told += 1

    def _hear(self, key: str, health: Health) -> None:
        self.health = health


@asynccontextmanager
async def in_the_studio(
    endpoint: str, state: Path, *, mission: Mission | None = None, simulated: bool = True
) -> AsyncIterator[Studio]:
    """Yield a studio whose daemon serves; it leaves at the end without an error."""
    declared = mission or load_mission(MISSIONS / "turtle.yaml")
    bus = partial(open_bus, endpoint, fleet=declared.fleet, daemon="agentd", patience=10)
    async with bus(name="board", mode="router"), bus(name="agent", mode="client") as client:
        studio, stop = Studio(declared, client, Turtle()), asyncio.Event()
        arguments = command_line(endpoint, state, studio.robot, simulated=True)
        daemon = asyncio.create_task(serve(declared, arguments, stop))
        perceiving = asyncio.create_task(studio.percepts.run())
        tasks: list[asyncio.Task[Any]] = [daemon, perceiving]
        if simulated:
            living = simulate(studio.turtle, endpoint, "turtle1/", declared.speed, studio.leave)
            tasks.append(asyncio.create_task(living))  # type: ignore[arg-type]
        try:
            yield studio
            stop.set()
            assert await daemon == 0
        finally:
            studio.leave.set()
            stop.set()
            perceiving.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
