"""The body of a robot: its own driver, and those that some of its percepts and actions name, as one driver."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from weakref import WeakKeyDictionary

from bridged.arguments import read_call
from bridged.drivers import find_driver
from bridged.drivers.robot import Driver, Execution, Order, Outcome, Setup, Value
from schemas.manifest import ActionEntry, Manifest


class Body:
    """A `bridged.drivers.robot.Driver`: state and orders are the robot's own driver's, actions each one's own.

    A robot whose driver knows no order (a turtle has no mode to hold in) has actions of its manifest instead.
    """

    def __init__(self, setup: Setup) -> None:
        """Make the drivers, of a manifest that nothing is wrong with. Raises OSError or ValueError, in words."""
        self._setup = setup
        self._manifest = setup.manifest
        self._drivers: dict[str, Driver] = {}
        for name in setup.manifest.drivers():
            self._make(name)
        self.own = self._drivers[setup.manifest.robot.driver]
        """The driver of the robot itself."""
        self._of: WeakKeyDictionary[Execution, Driver] = WeakKeyDictionary()
        self._moving = False
        """Whether a motion was begun, for a robot that cannot tell itself."""
        self._halt: Execution | None = None
        """The order since then that is to end it."""
        self.orders: frozenset[Order] = self._known_orders()
        """Those that the robot itself knows, and those that its manifest has an action for."""

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action by its driver."""
        driver = self._drivers[self._manifest.driver_of(entry)]
        execution = driver.perform(name, entry, arguments)
        self._of[execution] = driver
        if entry.motion:
            self._moving, self._halt = True, None
        return execution

    def refuses(self, entry: ActionEntry) -> str:
        """Why an action cannot begin now: what its driver says, or the robot's own if it moves the robot."""
        driver = self._drivers[self._manifest.driver_of(entry)]
        refusal = driver.refuses(entry)
        return refusal or (self.own.refuses(entry) if entry.motion and driver is not self.own else "")

    def order(self, order: Order, reason: str, *, insist: bool) -> Execution:
        """Begin an order by the robot's driver, or by the action that the manifest names for it."""
        for execution, driver in list(self._of.items()):
            if not execution.over and driver is not self.own:
                driver.stop(execution, Outcome("failed", reason), hold=False)
        if order in self.own.orders:
            return self.own.order(order, reason, insist=insist)
        return self._by_action(order, reason)

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution by its driver; a robot that cannot hold by itself does it by the manifest's `orders`."""
        ran = not execution.over
        self._of.get(execution, self.own).stop(execution, outcome, hold=hold)
        if ran and hold and "hold" not in self.own.orders and "hold" in self._manifest.orders:
            self._by_action("hold", outcome.reason)

    @property
    def active(self) -> bool:
        """Whether the robot is armed, or may be moving since a motion was begun."""
        if self.own.orders:
            return self.own.active
        halt = None if self._halt is None else self._halt.outcome
        return self._moving and bool(self._manifest.orders) and (halt is None or halt.state != "succeeded")

    @property
    def heard(self) -> bool:
        """Whether the robot can be heard."""
        return self.own.heard

    @property
    def silence(self) -> float:
        """Wall seconds since it was heard last."""
        return self.own.silence

    @property
    def overridden(self) -> str:
        """In what others have it."""
        return self.own.overridden

    def speak_for_agent(self, present: bool) -> None:
        """Say whether an agent is there."""
        for driver in self._drivers.values():
            driver.speak_for_agent(present)

    def adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest, of the same drivers."""
        self._manifest = manifest
        self.orders = self._known_orders()
        for name, driver in self._drivers.items():
            driver.adopt(manifest.part(name))

    async def run(self) -> None:
        """Run all drivers until cancelled; the first that fails ends the others."""
        async with asyncio.TaskGroup() as group:
            for driver in self._drivers.values():
                group.create_task(driver.run())

    def counters(self) -> dict[str, float]:
        """Figures of all drivers."""
        counters: dict[str, float] = {}
        for driver in self._drivers.values():
            counters |= driver.counters()
        return counters

    def notes(self) -> list[str]:
        """Warnings of all drivers."""
        return [note for driver in self._drivers.values() for note in driver.notes()]

    def _known_orders(self) -> frozenset[Order]:
        return self.own.orders | self._manifest.orders.keys()

    def _make(self, name: str) -> None:
        setup = replace(self._setup, manifest=self._manifest.part(name))
        if name != self._manifest.robot.driver:
            tell = setup.on_reading
            setup = replace(setup, on_reading=lambda reading: tell(replace(reading, driver=name)))
        self._drivers[name] = find_driver(name).make_driver(setup)

    def _by_action(self, order: Order, reason: str) -> Execution:
        """Carry out an order as the manifest's `orders` say."""
        for execution, driver in list(self._of.items()):
            if not execution.over:
                driver.stop(execution, Outcome("failed", reason), hold=False)
        said = self._manifest.orders.get(order)
        if said is None:
            execution = Execution(order)
            execution.end(Outcome("failed", f"the manifest has no order `{order}`"))
            return execution
        name, arguments = read_call(self._manifest, said)
        execution = self.perform(name, self._manifest.actions[name], arguments)
        self._halt = execution
        return execution
