"""A desk for a robot that does whatever it is told, and never comes to an end with it."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from bridged.bridge.action_log import ActionLog
from bridged.bridge.action_server import ActionServer
from bridged.bridge.composite_driver import CompositeDriver
from bridged.bridge.lease import Lease
from bridged.bridge.percepts import PerceptPublisher
from bridged.drivers.api import Execution, Order, Outcome, Setup, Value
from schemas.manifest.loader import ActionEntry, Manifest, RobotEntry
from schemas.mission.model import Robot
from schemas.wire.records import Action, ActionStatus
from tests.bridged.sky import VirtualClock


class Patient:
    """A robot that does whatever it is told, and never comes to an end with it."""

    orders: frozenset[Order] = frozenset()
    active, heard, overridden, silence = False, True, "", 0.0

    def __init__(self) -> None:
        self.runs: list[Execution] = []
        self.defect: Exception | None = None

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        if self.defect is not None:
            raise self.defect
        self.runs.append(Execution(name))
        return self.runs[-1]

    async def run(self) -> None:
        await asyncio.Event().wait()

    def refuses(self, entry: ActionEntry) -> str:
        return ""

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        if self.defect is not None:
            raise self.defect
        execution.end(outcome)


class Desk:
    """A desk for a patient robot with as many actions as wanted, none of which moves it."""

    def __init__(self, state: Path, actions: int) -> None:
        entry = ActionEntry(call="x", motion=False)
        self.manifest = manifest = Manifest(
            robot=RobotEntry(driver="x"), actions={f"a{n}": entry for n in range(actions)}
        )
        self.clock, self.robot = VirtualClock(), Patient()
        self.told: list[ActionStatus] = []
        self.wake = asyncio.Event()
        self.action_log = ActionLog(state / "r.actions")
        self.percepts = PerceptPublisher(
            manifest, ["uav", "other"], lambda *one: None, robot="r", boot="b", clock=self.clock
        )
        kind = SimpleNamespace(make_driver=lambda setup: self.robot)
        with patch("bridged.bridge.composite_driver.find_driver", lambda name: kind):
            driver = CompositeDriver(
                Setup("r", manifest, Robot(manifest="x"), state, self.clock, self.percepts.take, lambda: None)
            )
        self.action_server = ActionServer(
            manifest,
            driver,
            self.percepts,
            self.action_log,
            lambda agent, status: self.told.append(status),
            Lease(["uav", "other"], (), arms=False),
            robot="r",
            boot="b",
            clock=self.clock,
            wake=self.wake,
        )

    def ask(self, name: str, agent: str = "uav", **fields: Any) -> list[ActionStatus]:
        """Ask for an action; the list grows with its statuses."""
        heard: list[ActionStatus] = []
        self.action_server.ask(agent, name, Action(**fields), heard.append)  # type: ignore[arg-type]
        return heard

    def step(self, seconds: float = 0.0) -> None:
        self.clock.time += seconds
        self.action_server.step()

    def feedback(self) -> int:
        """How many figures of progress the agent perceives."""
        return sum(one.name == "feedback" for one in self.percepts.sets["uav"].present())
