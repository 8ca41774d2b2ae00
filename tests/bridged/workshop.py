"""A bridge of any driver on an event loop and the wall clock, without a bus: what a robot's drivers do end to end."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from bridged.bridge.bridge import Bridge
from bridged.drivers.registry import check_manifest
from commd.common.clock import Clock
from schemas.manifest.loader import Manifest, read_manifest
from schemas.mission.model import read_mission
from schemas.wire.records import Action, ActionStatus, Header, Perception
from schemas.wire.terms import Term
from tests.support.buses import until

MISSION = """
mission: workshop
agents:
  smith: {program: smith.asl, robot: bench}
robots:
  bench: {manifest: bench.toml, simulate: {}}
"""


def checked(text: str) -> Manifest:
    """Read a manifest of which its drivers find nothing wrong."""
    manifest = read_manifest(text, "bench.toml")
    assert check_manifest(manifest) == []
    return manifest


def problems(text: str) -> list[str]:
    """Return what a manifest's drivers find wrong with it."""
    return [str(one) for one in check_manifest(read_manifest(text, "bench.toml"))]


class Workshop:
    """One robot's bridge, and what it has said."""

    def __init__(
        self, state: Path, manifest: Manifest, *, mission: str = MISSION, simulated: bool = False, speed: float = 1.0
    ) -> None:
        self.percepts: list[Perception] = []
        self.clock = Clock(speed)
        declared = read_mission(mission, state / "workshop.yaml")
        (self._robot,), (self._agent, *_) = declared.robots, declared.agents
        self.bridge = Bridge(
            declared,
            self._robot,
            manifest,
            self.clock,
            state / "bench.actions",
            lambda agent, change: self.percepts.append(change),
            lambda agent, status: None,
            boot="w",
            simulated=simulated,
        )
        self._ids = 0

    def begin(self, name: str, *parameters: Term) -> list[ActionStatus]:
        """Ask for an action; the list grows with its statuses."""
        self._ids += 1
        heard: list[ActionStatus] = []
        request = Action(header=Header(source=self._agent), id=f"{self._agent}:t:{self._ids}", parameters=parameters)
        self.bridge.action_server.ask(
            self._agent, name, request, lambda status: heard.append(status) if status else None
        )
        return heard

    async def do(self, name: str, *parameters: Term) -> ActionStatus:
        """Ask for an action and wait for its final status."""
        heard = self.begin(name, *parameters)
        await until(lambda: bool(heard) and heard[-1].final, f"the end of {name}")
        return heard[-1]

    def cancel(self) -> ActionStatus:
        """Cancel the action that was asked for last."""
        return self.bridge.action_server.cancel(self._agent, f"{self._agent}:t:{self._ids}")

    def present(self, name: str) -> list[tuple[Term, ...]]:
        """What the agent perceives now under a name."""
        return [one.parameters for one in self.bridge.percepts.sets[self._agent].present() if one.name == name]

    async def perceives(self, name: str, *parameters: Term) -> None:
        """Wait until the agent perceives just this under a name; no parameters: nothing any more."""
        wanted = [parameters] if parameters else []
        await until(lambda: self.present(name) == wanted, f"{name}{parameters}, last {self.present(name)}")


@asynccontextmanager
async def in_the_workshop(workshop: Workshop) -> AsyncIterator[Workshop]:
    """Run the robot's drivers."""
    running = asyncio.create_task(workshop.bridge.run())
    try:
        yield workshop
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        workshop.bridge.action_log.close()
