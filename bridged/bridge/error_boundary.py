"""A driver's defects as outcomes: what raises has failed, and nobody waits for it or is left out because of it."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping

from bridged.bridge.composite_driver import CompositeDriver
from bridged.drivers.api import Execution, Order, Outcome, Value
from schemas.manifest.loader import ActionEntry

log = logging.getLogger("actions")


class ErrorBoundary:
    """The calls by which a robot is moved and stopped; none of them raises."""

    def __init__(self, driver: CompositeDriver) -> None:
        self._driver = driver

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action."""
        try:
            return self._driver.perform(name, entry, arguments)
        except Exception as error:
            return _failed(name, error)

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> Execution:
        """Begin an order."""
        try:
            return self._driver.order(order, ending, insist=insist)
        except Exception as error:
            return _failed(order, error)

    def pause(self, interrupted: Collection[Execution]) -> Execution:
        """Begin to hold the robot; `interrupted` are over then, whatever the driver does."""
        try:
            return self._driver.pause(interrupted)
        except Exception as error:
            return _failed("pause", error)

    def resume(self) -> Execution:
        """Begin to bring the robot back into the state before the pause."""
        try:
            return self._driver.resume()
        except Exception as error:
            return _failed("continue", error)

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution; it is over then, whatever the driver does."""
        try:
            self._driver.stop(execution, outcome, hold=hold)
        except Exception:
            log.exception("defect in the driver when %s was to end", execution.name)
        execution.end(outcome)

    def hold(self, execution: Execution, ending: Outcome) -> None:
        """Let the robot stay where it is although what moved it has ended."""
        try:
            self._driver.hold(execution, ending)
        except Exception:
            log.exception("defect in the driver when the robot was to hold after %s", execution.name)


def _failed(name: str, error: Exception) -> Execution:
    log.error("defect in the driver at %s", name, exc_info=error)
    execution = Execution(name)
    execution.end(Outcome("failed", f"defect in the driver: {type(error).__name__}: {error}"))
    return execution
