"""A robot's drivers as one: its own, and those that some of its percepts and actions name.

A driver that raises has failed what it was asked for; nobody else is left without an answer or an order by that.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import math
from collections import Counter
from collections.abc import Callable, Collection, Coroutine, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NoReturn
from weakref import WeakKeyDictionary

from bridged.drivers.api import Driver, Execution, Order, Outcome, Pausable, Reading, Setup, Value, defers
from bridged.drivers.argument_check import read_call
from bridged.drivers.registry import OURS, DriverError, find_driver
from commd.process.systemd import Loop
from commd.process.user_code import MISTAKES, describe_error
from schemas.files.findings import Findings
from schemas.files.text_files import MAY_PASS
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note

HOLD_PATIENCE = 10.0
"""Wall seconds in which a robot must hold that is ordered to by an action of its manifest."""
PAUSES = (0.5, 5.0)
"""First and longest wall seconds until a driver that could not open its link is run again."""
LASTS = 1.0
"""Wall seconds that a driver must have run until its last failure is no warning any more."""
HOPELESS = frozenset({errno.EADDRINUSE, errno.EACCES, errno.EPERM, errno.ENOTTY})
"""Errors of a link that waiting does not clear: its port is taken, its device is another user's, or no serial line."""
LACKS = ("perform", "run", "stop", "orders")
"""Of a driver, what shows that an object is none."""
DRIVER_RAISES = (*MISTAKES, KeyboardInterrupt)
"""What is a mistake of a driver: a signal raises nothing in a daemon."""
log = logging.getLogger("orders")
drivers_log = logging.getLogger("drivers")
_PAUSED = Outcome("cancelled", "paused by the operator", "operator")


@dataclass(frozen=True)
class _Begun:
    """Who carries an execution out, and whether it moves the robot."""

    driver: Driver
    motion: bool


class CompositeDriver:
    """A `bridged.drivers.api.Driver`: state and orders are those of the robot's own driver, actions of each one.

    A robot whose driver knows no order (a turtle has no mode to hold in) has actions of its manifest instead.
    `perform`, `order`, `pause`, `resume`, `stop` and `hold` never raise.
    """

    def __init__(self, setup: Setup, loop: Loop | None = None) -> None:
        """Make the drivers, of a manifest that nothing is wrong with; each turn of the robot's own is a beat of `loop`.

        Raises OSError or ValueError.
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
        try:
            execution = driver.perform(name, entry, arguments)
            if not isinstance(execution, Execution):
                raise self._no_execution(driver, execution)
        except DRIVER_RAISES as error:
            return self._defect(driver, "perform", name, error)
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
            return Execution(order, Outcome("succeeded", f"{self.under_way} is under way"))
        for execution, begun in list(self._of.items()):
            if not (by_itself and begun.driver is self.own):  # whose driver ends them itself
                self._end(execution, ending)
        try:
            return self.own.order(order, ending, insist=insist) if by_itself else self._by_action(order)
        except DRIVER_RAISES as error:
            return self._defect(self.own, "order", order, error)

    def pause(self, interrupted: Collection[Execution]) -> Execution:
        """Hold the robot until `resume`; `interrupted` end without a word to their followers; others continue."""
        for execution in interrupted:
            begun = self._of.get(execution)
            if begun is not None and not (begun.driver is self.own and isinstance(self.own, Pausable)):
                self._end(execution, _PAUSED)
        try:
            if isinstance(self.own, Pausable):
                return self.own.pause(interrupted)
            if "hold" in self.own.orders:
                return self.own.order("hold", _PAUSED, insist=True)
            return self._by_action("hold")
        except DRIVER_RAISES as error:
            return self._defect(self.own, "pause", "pause", error)

    def resume(self) -> Execution:
        """Bring the robot back into the state before the pause, if its driver can."""
        if isinstance(self.own, Pausable):
            try:
                return self.own.resume()
            except DRIVER_RAISES as error:
                return self._defect(self.own, "resume", "continue", error)
        return Execution("continue", Outcome("succeeded"))

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution by its driver; a robot that cannot hold by itself does it by the manifest's `orders`.

        The reason of an execution that was to end in a hold says so if the robot does not hold yet.
        """
        ran, begun = not execution.over, self._of.get(execution)
        driver = self.own if begun is None else begun.driver
        try:
            driver.stop(execution, outcome, hold=hold)
            if ran and hold and self._holds_by_action:
                said = self._hold(outcome)
                if said and execution.outcome is not None:
                    execution.outcome = replace(execution.outcome, reason=f"{execution.outcome.reason}; {said}")
        except DRIVER_RAISES as error:
            self._defect(driver, "stop", execution.name, error)
        execution.end(outcome)

    def hold(self, execution: Execution, ending: Outcome) -> None:
        """Let the robot stay where it is although what moved it has ended: whoever has it now does not move it."""
        try:
            if self._holds_by_action:
                self._hold(ending)
            elif begun := self._of.get(execution):
                begun.driver.stop(execution, ending, hold=True)
        except DRIVER_RAISES as error:
            self._defect(self.own, "stop", f"hold after {execution.name}", error)

    @property
    def active(self) -> bool:
        """Whether the robot is armed, or may be moving since a motion was begun."""
        if self.own.orders:
            return self.own.active
        halt = None if self._halt is None else self._halt.outcome
        return self._moving and bool(self._manifest.orders) and (halt is None or halt.state != "succeeded")

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

    def speak_for_agent(self, present: bool) -> None:
        """Say whether an agent is there."""
        for driver in self._drivers.values():
            driver.speak_for_agent(present)

    def adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest, of the same drivers.

        Raises ValueError, before anything has changed, if it has no order to end a motion by. Raises Findings,
        ValueError or OSError if a driver cannot, when all others have adopted it.
        """
        if self.active and (gone := sorted(self._manifest.orders.keys() - manifest.orders.keys() - self.own.orders)):
            raise ValueError(f"orders.{gone[0]}: the robot may be moving, and this order ends it; stop it first")
        failures: list[Findings | ValueError | OSError] = []
        for name, driver in self._drivers.items():
            try:
                driver.adopt(manifest.part(name))
            except (Findings, ValueError, OSError) as error:
                failures.append(error)
            except DRIVER_RAISES as error:
                failures.append(DriverError(name, f"adopt raised {describe_error(error)}"))
        if failures:
            raise failures[0]
        self._manifest = manifest
        self.orders = self._known_orders()

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
        on_turn = self._loop.beat if own else lambda: None
        setup = replace(self._setup, manifest=self._manifest.part(name), on_turn=on_turn)
        if not own:
            tell = setup.on_reading
            setup = replace(setup, on_reading=lambda reading: tell(replace(reading, driver=name)))
        try:
            driver = self._drivers[name] = find_driver(name).make_driver(setup)
        except DRIVER_RAISES as error:  # drivers may be anybody's
            ours = name in OURS and isinstance(error, ValueError | OSError)
            if ours or isinstance(error, Findings) or (isinstance(error, OSError) and error.errno in MAY_PASS):
                raise
            raise DriverError(name, f"make_driver raised {describe_error(error)}") from error
        if lacks := [one for one in LACKS if not hasattr(driver, one)]:
            raise DriverError(name, f"make_driver returned {driver!r}, expected a driver: it has no {', '.join(lacks)}")
        loop = self._loop if own else Loop.unwatched()
        self._supervisor[name] = DriverSupervisor(self._setup.name, name, driver, partial(self._failed, name), loop)

    def _failed(self, name: str, why: str) -> None:
        """A driver does not run: percepts of an auxiliary one are withdrawn, and what it carries out has failed."""
        own = name == self._manifest.robot.driver
        if not own or name not in OURS:  # ours show by percepts of their own that the robot's link is down
            for source in {entry.source for entry in self._manifest.part(name).percepts.values()}:
                self._setup.on_reading(Reading(source, None, "" if own else name))
        for execution, begun in list(self._of.items()):
            if begun.driver is self._drivers[name]:
                self._end(execution, Outcome("failed", why))

    def step(self) -> None:
        """Let time pass: end a hold that has not happened in time and that nobody else waits for."""
        if self._halt is not None and self._setup.clock.wall() > self._halt_until:
            outcome = Outcome("timed_out", f"not done within {HOLD_PATIENCE:g} s", "deadline")
            self.stop(self._halt, outcome, hold=False)

    def _name_of(self, driver: Driver) -> str:
        return next(name for name, one in self._drivers.items() if one is driver)

    def _no_execution(self, driver: Driver, value: object) -> DriverError:
        what = repr(value)
        if isinstance(value, Coroutine):
            value.close()
            what = "a coroutine (it is `async def`)"
        return DriverError(self._name_of(driver), f"perform returned {what}, expected an Execution")

    def _defect(self, driver: Driver, function: str, name: str, error: BaseException) -> Execution:
        """Log an exception of a driver; return an execution of `name` that has failed by it."""
        if not isinstance(error, DriverError):
            error = DriverError(self._name_of(driver), f"{function} raised {describe_error(error)}")
        log.error("robot=%s %s: %s", self._setup.name, name, error)
        return Execution(name, Outcome("failed", str(error)))

    def _end(self, execution: Execution, ending: Outcome) -> None:
        if not execution.over:
            self.stop(execution, ending, hold=False)

    @property
    def _holds_by_action(self) -> bool:
        return "hold" not in self.own.orders and "hold" in self._manifest.orders

    def _hold(self, ending: Outcome) -> str:
        """End what moves the robot, and let it hold by its action. Returns why it does not hold yet, for people."""
        for execution, begun in list(self._of.items()):
            if begun.motion:
                self._end(execution, ending)
        halt = self._by_action("hold")
        self._halt_until = self._setup.clock.wall() + HOLD_PATIENCE
        halt.on_end(partial(self._tell_unheld, halt))
        return _not_done(halt) or ("" if halt.over else "hold is not confirmed yet")

    def _tell_unheld(self, halt: Execution) -> None:
        if said := _not_done(halt):
            log.error("robot=%s may be moving: %s", self._setup.name, said)

    def _by_action(self, order: Order) -> Execution:
        """Carry out an order as the manifest's `orders` say."""
        said = self._manifest.orders.get(order)
        if said is None:
            return Execution(order, Outcome("failed", f"the manifest has no order `{order}`"))
        name, arguments = read_call(self._manifest, said)
        execution = self.perform(name, self._manifest.actions[name], arguments)
        self._halt, self._halt_order, self._halt_until = execution, order, math.inf
        return execution


def _not_done(halt: Execution) -> str:
    """Say that an order has ended without success; empty if it has not."""
    outcome = halt.outcome
    if outcome is None or outcome.state == "succeeded":
        return ""
    return f"`{halt.name}` {outcome.state.replace('_', ' ')}: {outcome.reason}"


class DriverSupervisor:
    """Runs a driver for as long as the bridge does."""

    def __init__(self, robot: str, name: str, driver: Driver, on_failure: Callable[[str], None], loop: Loop) -> None:
        """`on_failure` is called with the reason each time that the driver has stopped.

        The driver's turns are beats of `loop`, from the first one after it began to wait: opening a link may take long.
        """
        self._loop = loop
        self._robot, self._name, self._driver, self._on_failure = robot, name, driver, on_failure
        self.problem = ""
        """Why the driver does not run; empty while it does."""

    async def keep(self, worth_waiting: Callable[[OSError], bool]) -> None:
        """Run it until cancelled, again after each OSError that is worth waiting for. Raises every other failure."""
        loop, (pause, longest) = asyncio.get_running_loop(), PAUSES
        while True:
            running, began = loop.call_later(LASTS, self._runs), loop.time()
            loop.call_soon(self._loop.rest)  # after its first readings, when it waits for its link to open
            try:
                await self._run()
            except OSError as error:
                if not worth_waiting(error):
                    if self._name in OURS:
                        raise
                    raise DriverError(self._name, f"run raised {describe_error(error)}") from error
                self._loop.rest()
                pause = pause if loop.time() - began < LASTS else PAUSES[0]
                self._failed(str(error) or type(error).__name__, "it is tried again")
            finally:
                running.cancel()
            await asyncio.sleep(pause)
            pause = min(2 * pause, longest)

    async def _run(self) -> NoReturn:
        """Run the driver until cancelled. Raises OSError, and DriverError for any other end."""
        try:
            await self._driver.run()
        except (*DRIVER_RAISES, asyncio.CancelledError) as error:
            task = asyncio.current_task()
            if isinstance(error, asyncio.CancelledError) and task is not None and task.cancelling():
                raise
            cause: BaseException = error
            while isinstance(cause, BaseExceptionGroup) and len(cause.exceptions) == 1:
                cause = cause.exceptions[0]
            if isinstance(cause, OSError):
                raise cause from cause.__cause__
            raise DriverError(self._name, f"run raised {describe_error(cause)}") from error
        raise DriverError(self._name, "run returned, expected it to run until it is cancelled")

    async def keep_apart(self) -> None:
        """Run it until cancelled; its failure is nobody else's, and is left at a warning."""
        try:
            await self.keep(lambda error: True)
        except DriverError as error:
            self._loop.end()
            self._failed(error.what, "it is not run again before the bridge is restarted")
            await asyncio.Event().wait()

    def _runs(self) -> None:
        if self.problem:
            drivers_log.info("robot=%s driver `%s` runs again", self._robot, self._name)
        self.problem = ""

    def _failed(self, why: str, then: str) -> None:
        problem = f"driver `{self._name}` does not run: {why}; {then}"
        if problem != self.problem:
            drivers_log.error("robot=%s %s", self._robot, problem)
        self.problem = problem
        try:
            self._on_failure(problem)
        except Exception as error:  # of the bridge: the driver is tried again all the same
            asyncio.get_running_loop().call_exception_handler({"message": problem, "exception": error})


def may_come(error: OSError) -> bool:
    """Whether a link may be there later: a device, a name, a cable; a port that is taken is not."""
    cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
    return cause.errno not in HOPELESS
