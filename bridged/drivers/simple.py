"""A base class for drivers of simple robots: without modes, without a pilot, and with no way down to order."""

from __future__ import annotations

import math
from collections.abc import Mapping

from bridged.drivers.api import Execution, Order, Outcome, Reading, Setup, Value
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note


class SimpleDriver:
    """A `bridged.drivers.api.Driver` but for `run` and `perform`; the manifest's `orders` are actions."""

    orders: frozenset[Order] = frozenset()

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.manifest = setup.manifest
        self._heard_at = -math.inf

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action whose arguments have been checked."""
        raise NotImplementedError

    async def run(self) -> None:
        """Carry the robot's traffic until cancelled."""
        raise NotImplementedError

    def report(self, source: str, fields: Mapping[str, object] | None) -> None:
        """Pass on a reading of a source of the manifest; no fields = it holds no longer."""
        self._heard_at = self.setup.clock.wall()
        self.setup.on_reading(Reading(source, fields))
        self.setup.on_turn()

    def refuses(self, entry: ActionEntry) -> Outcome | None:
        """Return None: nobody else has the robot."""
        return None

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> Execution:
        """Fail: the robot knows no order."""
        return Execution(order, Outcome("failed", f"the driver has no order `{order}`"))

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution; a command that was sent is not taken back."""
        execution.end(outcome)

    @property
    def active(self) -> bool:
        """False: leaving it needs no order, as far as its state shows."""
        return False

    @property
    def heard(self) -> bool:
        """Whether it was heard within `link_loss`."""
        return self.silence <= self.manifest.robot.link_loss

    @property
    def silence(self) -> float:
        """Wall seconds since it was heard; infinite if it never was."""
        return self.setup.clock.wall() - self._heard_at

    @property
    def airborne(self) -> bool:
        """False."""
        return False

    @property
    def under_way(self) -> Order | None:
        """None: the robot shows no modes."""
        return None

    @property
    def overridden(self) -> str:
        """Empty: nobody else has it."""
        return ""

    def speak_for_agent(self, present: bool) -> None:
        """Ignore whether an agent is present."""

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest."""
        self.manifest = manifest

    def counters(self) -> dict[str, float]:
        """No figures."""
        return {}

    def notes(self) -> list[Note]:
        """No warnings."""
        return []
