"""An action that a function carries out: what its results and feedback mean."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Generator, Mapping
from typing import Any, cast

from bridged.drivers.api import Execution, Outcome, Value
from bridged.drivers.python.plugins import Function
from bridged.drivers.python.worker_threads import Raised, Result

MAX_RATE = 500.0
"""Times in a wall second that a generator is asked for its progress, at most: one need not pause by itself."""


class Call(Execution):
    """One call of a function for an action; of a generator, until its end or until the action is over."""

    def __init__(self, name: str, function: str) -> None:
        super().__init__(name, waits_for=f"`{function}` to return")
        self.function = function
        self._told: dict[str, float] = {}
        self._over = threading.Event()

    def work(self, function: Function, arguments: Mapping[str, Value]) -> Any:
        """Call the function, in a thread. Returns what it returned, at last."""
        returned = function(**arguments)
        return self._drive(cast(Generator[Any, None, Any], returned)) if inspect.isgenerator(returned) else returned

    def abandon(self) -> None:
        """Close the generator at its next `yield`; a function runs on."""
        self._over.set()

    def look(self) -> None:
        """Take over the latest feedback, in the event loop."""
        if not self.over:
            self.feedback = self._told

    def _drive(self, generator: Generator[Any, None, Any]) -> Any:
        while not self._over.is_set():
            try:
                self._told = _figures(next(generator))
            except StopIteration as end:
                return end.value
            self._over.wait(1 / MAX_RATE)
        generator.close()
        return None


def _figures(told: object) -> dict[str, float]:
    """The numbers of what a generator yields; anything else is left out."""
    if not isinstance(told, Mapping):
        return {}
    items = ((str(name), value) for name, value in told.items())
    return {name: float(value) for name, value in items if isinstance(value, int | float)}


def outcome_of(function: str, result: Result) -> Outcome:
    """Return what a result means: nothing or True is success, False and a text are not, nor is an exception."""
    match result:
        case Raised(_, text):
            return Outcome("failed", text)
    match result.value:
        case None | True:
            return Outcome("succeeded")
        case False:
            return Outcome("failed", f"`{function}` returned False")
        case str(text):
            return Outcome("failed", text or f"`{function}` returned an empty text")
        case other:
            said = f"`{function}` returned a {type(other).__name__}: expected None, True, False or a text why not"
            return Outcome("failed", said)
