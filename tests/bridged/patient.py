"""A desk for a robot that does whatever it is told, and never comes to an end with it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bridged.bridge.action_log import ActionLog
from bridged.bridge.action_server import ActionServer
from bridged.bridge.lease import Lease
from bridged.bridge.percepts import PerceptPublisher
from bridged.drivers.api import Execution, Order, Outcome, Value
from schemas.manifest.loader import ActionEntry, Manifest, RobotEntry
from schemas.wire.records import Action, ActionStatus


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
        self.now, self.robot = 0.0, Patient()
        self.told: list[ActionStatus] = []
        self.ledger = ActionLog(state / "r.actions")
        self.board = PerceptPublisher(
            manifest, ["uav", "other"], lambda *one: None, robot="r", boot="b", stamp=lambda: 0
        )
        self.action_server = ActionServer(
            manifest,
            self.robot,  # type: ignore[arg-type]
            self.board,
            self.ledger,
            lambda agent, status: self.told.append(status),
            Lease(["uav", "other"], (), arms=False),
            robot="r",
            boot="b",
            stamp=lambda: 0,
            now=lambda: self.now,
        )

    def ask(self, name: str, agent: str = "uav", **fields: Any) -> list[ActionStatus]:
        """Ask for an action; the list grows with its statuses."""
        heard: list[ActionStatus] = []
        self.action_server.ask(agent, name, Action(**fields), heard.append)  # type: ignore[arg-type]
        return heard

    def feedback(self) -> int:
        """How many figures of progress the agent perceives."""
        return sum(one.name == "feedback" for one in self.board.sets["uav"].present())
