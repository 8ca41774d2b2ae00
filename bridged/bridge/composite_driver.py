"""The body of a robot: its own driver, and those that some of its percepts and actions name, as one driver."""

from __future__ import annotations

import asyncio
import logging
import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from weakref import WeakKeyDictionary

from bridged.bridge.driver_supervisor import DriverSupervisor, may_come
from bridged.drivers import find_driver
from bridged.drivers.api import Driver, Execution, Order, Outcome, Pausable, Reading, Setup, Value, defers
from bridged.drivers.argument_check import read_call
from commd.process.systemd import Loop
from schemas.files.findings import Findings
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note

HOLD_PATIENCE = 10.0
"""Wall seconds in which a robot must hold that was told so by an action of its manifest."""
log = logging.getLogger("orders")
_PAUSED = Outcome("cancelled", "paused by the operator", "operator")


@dataclass(frozen=True)
class _Begun:
    """Who carries an execution out, and whether it moves the robot."""

    driver: Driver
    motion: bool


class CompositeDriver:
    """A `bridged.drivers.api.Driver`: state and orders are the robot's own driver's, actions each one's own.

    A robot whose driver knows no order (a turtle has no mode to hold in) has actions of its manifest instead.
    """

    def __init__(self, setup: Setup, loop: Loop | None = None) -> None:
        """Make the drivers, of a manifest that nothing is wrong with; each look of the robot's own is a beat of `loop`.

        Raises OSError or ValueError, in words.
        """
        self._setup, self._loop = setup, loop or Loop.unwatched()
        self._manifest = setup.manifest
        self._drivers: dict[str, Driver] = {}
        self._supervisor: dict[str, DriverSupervisor] = {}
        self._of: WeakKeyDictionary[Execution, _Begun] = WeakKeyDictionary()
        self._moving = False
        """Whether a motion was begun, for a robot that cannot tell itself."""
        self._halt: Execution | None = None
        """The order since then that is to end it."""
        self._halt_order: Order = "hold"
        self._halt_until = math.inf
        """When the halt must have ended, in wall seconds, if nobody else sees to it."""
        self.alone = True
        """No other robot is served by this process: it may end if the robot's link cannot be opened."""
        for name in setup.manifest.drivers():
            self._make(name)
        self.own = self._drivers[setup.manifest.robot.driver]
        """The driver of the robot itself."""
        self.orders: frozenset[Order] = self._known_orders()
        """Those that the robot itself knows, and those that its manifest has an action for."""

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action by its driver."""
        driver = self._drivers[self._manifest.driver_of(entry)]
        execution = driver.perform(name, entry, arguments)
        self._of[execution] = _Begun(driver, entry.motion)
        if entry.motion:
            self.may_be_moving()
        return execution

    def may_be_moving(self) -> None:
        """A motion begins, or began in a former life of the bridge: the robot is not left without an order."""
        self._moving, self._halt, self._halt_until = True, None, math.inf

    def refuses(self, entry: ActionEntry) -> Outcome | None:
        """Why an action cannot begin now, by its driver and, if it moves the robot, the robot's own; None if it can."""
        name = self._manifest.driver_of(entry)
        driver = self._drivers[name]
        if problem := self._supervisor[name].problem:
            return Outcome("refused", problem)
        return driver.refuses(entry) or (self.own.refuses(entry) if entry.motion and driver is not self.own else None)

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> Execution:
        """Begin an order by the robot's driver, or by the action that the manifest names for it; actions end.

        One that does not `insist` leaves a safer motion alone.
        """
        by_itself = order in self.own.orders
        if not (by_itself or insist) and defers(order, self.under_way):
            execution = Execution(order)
            execution.end(Outcome("succeeded", f"{self.under_way} is under way"))
            return execution
        for execution, begun in list(self._of.items()):
            if not (by_itself and begun.driver is self.own):  # whose driver ends them itself
                self._end(execution, ending)
        return self.own.order(order, ending, insist=insist) if by_itself else self._by_action(order)

    def pause(self, interrupted: Collection[Execution]) -> Execution:
        """Hold the robot until `resume`; `interrupted` end without a word, other actions go on."""
        for execution in interrupted:
            begun = self._of.get(execution)
            if begun is not None and not (begun.driver is self.own and isinstance(self.own, Pausable)):
                self._end(execution, _PAUSED)
        if isinstance(self.own, Pausable):
            return self.own.pause(interrupted)
        if "hold" in self.own.orders:
            return self.own.order("hold", _PAUSED, insist=True)
        return self._by_action("hold")

    def resume(self) -> Execution:
        """Bring the robot back into the state before the pause, if its driver can."""
        if isinstance(self.own, Pausable):
            return self.own.resume()
        execution = Execution("continue")
        execution.end(Outcome("succeeded"))
        return execution

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution by its driver; a robot that cannot hold by itself does it by the manifest's `orders`.

        The reason of an execution that was to end in a hold says so if the robot does not hold yet.
        """
        ran, begun = not execution.over, self._of.get(execution)
        (self.own if begun is None else begun.driver).stop(execution, outcome, hold=hold)
        if ran and hold and self._holds_by_action:
            said = self._hold(outcome)
            if said and execution.outcome is not None:
                execution.outcome = replace(execution.outcome, reason=f"{execution.outcome.reason}; {said}")

    def hold(self, execution: Execution, ending: Outcome) -> None:
        """Let the robot stay where it is although what moved it has ended: whoever has it now does not move it."""
        if self._holds_by_action:
            self._hold(ending)
        elif begun := self._of.get(execution):
            begun.driver.stop(execution, ending, hold=True)

    @property
    def active(self) -> bool:
        """Whether the robot is armed, or may be moving since a motion was begun."""
        if self.own.orders:
            return self.own.active
        halt = None if self._halt is None else self._halt.outcome
        return self._moving and bool(self._manifest.orders) and (halt is None or halt.state != "succeeded")

    @property
    def airborne(self) -> bool:
        """Whether the robot is armed and off the ground."""
        return self.own.airborne

    @property
    def under_way(self) -> Order | None:
        """The order that is being carried out: as the robot shows itself, or the last one by an action."""
        if self.own.orders:
            return self.own.under_way
        return None if self._halt is None or _not_done(self._halt) else self._halt_order

    @property
    def arms(self) -> bool:
        """Whether the robot itself tells that it is in use; of another one it is known from its actions alone."""
        return bool(self.own.orders)

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
        """Go on by another manifest, of the same drivers. Raises ValueError if it has no order to end a motion by."""
        if self.active and (gone := sorted(self._manifest.orders.keys() - manifest.orders.keys() - self.own.orders)):
            raise ValueError(f"orders.{gone[0]}: the robot may be moving, and this order ends it; stop it first")
        self._manifest = manifest
        self.orders = self._known_orders()
        for name, driver in self._drivers.items():
            driver.adopt(manifest.part(name))

    async def run(self) -> None:
        """Run all drivers until cancelled; one that fails is a warning, and is run again if its link was not there.

        Raises what the own driver of a robot fails by that is alone in its process, unless waiting may help.
        """
        own = self._manifest.robot.driver
        others = [supervisor.keep_apart() for name, supervisor in self._supervisor.items() if name != own]
        tasks = [asyncio.create_task(one) for one in others]
        try:
            await (self._supervisor[own].keep(may_come) if self.alone else self._supervisor[own].keep_apart())
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def counters(self) -> dict[str, float]:
        """Figures of all drivers; of those that several have, the sum."""
        counters: Counter[str] = Counter()
        for driver in self._drivers.values():
            counters.update(driver.counters())
        return dict(counters)

    def notes(self) -> list[Note]:
        """Return the warnings of all drivers, and of those that do not run."""
        notes = [Note("driver_down", one.problem, name) for name, one in self._supervisor.items() if one.problem]
        notes += [note for driver in self._drivers.values() for note in driver.notes()]
        if self._halt is not None and (said := _not_done(self._halt)):
            notes.append(Note("may_be_moving", f"the robot may be moving: {said}"))
        return notes

    def _known_orders(self) -> frozenset[Order]:
        return self.own.orders | self._manifest.orders.keys()

    def _make(self, name: str) -> None:
        own = name == self._manifest.robot.driver
        step = self._own_step if own else self._step
        setup = replace(self._setup, manifest=self._manifest.part(name), on_step=step)
        if not own:
            tell = setup.on_reading
            setup = replace(setup, on_reading=lambda reading: tell(replace(reading, driver=name)))
        try:
            driver = self._drivers[name] = find_driver(name).make_driver(setup)
        except (Findings, ValueError, OSError):
            raise
        except Exception as error:  # drivers may be anybody's
            raise ValueError(f"driver `{name}` cannot be made: {type(error).__name__}: {error}") from error
        loop = self._loop if own else Loop.unwatched()
        self._supervisor[name] = DriverSupervisor(self._setup.name, name, driver, partial(self._failed, name), loop)

    def _failed(self, name: str, why: str) -> None:
        """A driver does not run: what it carries out has failed, and what an auxiliary one told holds no longer."""
        for execution, begun in list(self._of.items()):
            if begun.driver is self._drivers[name]:
                self._end(execution, Outcome("failed", why))
        if name != self._manifest.robot.driver:
            for source in {entry.source for entry in self._manifest.part(name).percepts.values()}:
                self._setup.on_reading(Reading(source, None, name))
        self._step()

    def _step(self) -> None:
        """A driver has looked at its executions: also at a hold that nobody else waits for."""
        if self._halt is not None and self._setup.clock.wall() > self._halt_until:
            outcome = Outcome("timed_out", f"not done within {HOLD_PATIENCE:g} s", "deadline")
            self.stop(self._halt, outcome, hold=False)
        self._setup.on_step()

    def _own_step(self) -> None:
        """The robot's own driver has come round."""
        self._loop.beat()
        self._step()

    def _end(self, execution: Execution, ending: Outcome) -> None:
        if not execution.over:
            self._of[execution].driver.stop(execution, ending, hold=False)

    @property
    def _holds_by_action(self) -> bool:
        return "hold" not in self.own.orders and "hold" in self._manifest.orders

    def _hold(self, ending: Outcome) -> str:
        """End what moves the robot, and let it hold by its action. Returns in words why it does not hold yet."""
        for execution, begun in list(self._of.items()):
            if begun.motion:
                self._end(execution, ending)
        halt = self._by_action("hold")
        self._halt_until = self._setup.clock.wall() + HOLD_PATIENCE
        halt.ended = lambda: self._tell_unheld(halt)
        if halt.over:
            self._tell_unheld(halt)
        return _not_done(halt) or ("" if halt.over else "hold is not confirmed yet")

    def _tell_unheld(self, halt: Execution) -> None:
        if said := _not_done(halt):
            log.error("robot=%s may be moving: %s", self._setup.name, said)

    def _by_action(self, order: Order) -> Execution:
        """Carry out an order as the manifest's `orders` say."""
        said = self._manifest.orders.get(order)
        if said is None:
            execution = Execution(order)
            execution.end(Outcome("failed", f"the manifest has no order `{order}`"))
            return execution
        name, arguments = read_call(self._manifest, said)
        execution = self.perform(name, self._manifest.actions[name], arguments)
        self._halt, self._halt_order, self._halt_until = execution, order, math.inf
        return execution


def _not_done(halt: Execution) -> str:
    """In words that an order has ended without success; empty if it has not."""
    outcome = halt.outcome
    if outcome is None or outcome.state == "succeeded":
        return ""
    return f"`{halt.name}` {outcome.state.replace('_', ' ')}: {outcome.reason}"
