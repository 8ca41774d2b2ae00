"""Run an environment with its minds: perform actions, feed percepts and outcomes, contain the user's mistakes."""

from __future__ import annotations

import heapq
import threading
from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Any

from agentd.environment import ActionFailed, Deferred, Environment
from agentd.extensions.user_code import UserCodeError
from agentd.language.terms.terms import Literal
from agentd.mind import Mind
from agentd.mind.data.effects import CancelAction, PerformAction
from agentd.mind.data.inputs import ActionDone
from agentd.values import plain_signature
from commd.process.user_code import MISTAKES, describe_error

MOST_REPORTED = 1000
"""Different mistakes of an environment that are reported."""


class EnvironmentHost:
    """An `Environment` with the minds in it. ``report`` gets a line for people about each mistake in it."""

    def __init__(self, environment: Environment, now: Callable[[], float], report: Callable[[str], object]) -> None:
        self._environment = environment
        self._board = environment._board
        self._report_line = report
        self._reported: set[str] = set()
        self.now = now
        self._minds: dict[str, Mind] = {}
        self._waiting: dict[tuple[str, int], Deferred] = {}
        self._settled: deque[tuple[str, int, Deferred]] = deque()
        self._calls: list[tuple[float, int, Callable[[], object]]] = []
        self._count = count()
        self._lock = threading.Lock()
        self._called = False
        """Whether `after` was called since the last `deliver`."""
        self._stirred = threading.Event()
        self._asleep = False
        environment._host = self

    def init(self, arguments: list[str]) -> None:
        """Initialize the environment. Raises `UserCodeError`."""
        try:
            self._environment.init(arguments)
        except MISTAKES as error:
            raise UserCodeError(f"the environment's init failed: {describe_error(error)}") from error
        except BaseException:  # the process ends: so must what init has begun
            self.stop()
            raise

    def join(self, mind: Mind) -> None:
        """Add a mind."""
        self._minds[mind.name] = mind
        self._board.join(mind.name)
        self._guarded("joined", self._environment.joined, mind.name)

    def took_over(self, mind: Mind, other: Mind) -> None:
        """Retract the other mind's own percepts from a mind that has become a copy of it."""
        self._board.recall(mind.name, self._board.seen_by(other.name))

    def leave(self, name: str) -> None:
        """Remove a mind."""
        self._minds.pop(name, None)
        self._board.leave(name)
        for key in [key for key in self._waiting if key[0] == name]:
            self._waiting.pop(key).forget(key)

    def perform(self, mind: Mind, action: PerformAction) -> None:
        """Execute an action; its outcome is fed to the mind, now or later."""
        name, parameters = action.name, action.parameters
        try:
            outcome = self._environment.execute(mind.name, Literal(plain_signature(name, len(parameters)), parameters))
        except ActionFailed as failed:
            mind.feed(ActionDone(action.id, False, str(failed)))
        except MISTAKES as error:
            reason = f"the environment's execute went wrong in {name}/{len(parameters)}: {describe_error(error)}"
            self._report(reason)
            mind.feed(ActionDone(action.id, False, reason))
        else:
            if outcome is True:
                mind.feed(ActionDone(action.id, True))
            else:
                self._outcome(mind, action, outcome)
        if self._board.changed:
            self._board.feed(self._minds)

    def _outcome(self, mind: Mind, action: PerformAction, outcome: Any) -> None:
        if outcome is False:
            mind.feed(ActionDone(action.id, False, f"the environment could not do {action.name}"))
        elif isinstance(outcome, Deferred):
            key = (mind.name, action.id)
            self._waiting[key] = outcome
            outcome.when_settled(key, lambda: self._on_settled(mind.name, action.id, outcome))
        else:
            reason = (
                f"the environment's execute returned {outcome!r} for {action.name}/{len(action.parameters)}; "
                "expected True, False or a Deferred"
            )
            self._report(reason)
            mind.feed(ActionDone(action.id, False, reason))

    def cancel(self, mind: Mind, action: CancelAction) -> None:
        """Forget an action: the intention that waited for it is gone."""
        key = (mind.name, action.id)
        deferred = self._waiting.pop(key, None)
        if deferred is not None:
            deferred.forget(key)

    def perceive(self, mind: Mind) -> None:
        """Update the percepts of a mind that asks for them."""
        self._guarded("perceive", self._environment.perceive, mind.name)
        self.deliver()

    def deliver(self) -> None:
        """Make the calls that are due, and feed the minds the changes since the last time."""
        newer = next(self._count)
        while (call := self._due_call(newer)) is not None:
            self._guarded("after", call)
        if self._board.changed:
            self._board.feed(self._minds)
        while self._settled:
            name, number, deferred = self._settled.popleft()
            if self._waiting.get((name, number)) is not deferred or deferred.outcome is None:
                continue  # it was cancelled; another agent of that name may wait for an action of its own
            del self._waiting[name, number]
            mind = self._minds.get(name)
            if mind is not None:
                mind.feed(ActionDone(number, *deferred.outcome))

    def _due_call(self, newer: int) -> Callable[[], object] | None:
        """Take a call that is due and not ``newer`` than this number: a call may schedule itself with no delay."""
        with self._lock:
            self._called = False
            if self._calls and self._calls[0][0] <= self.now() and self._calls[0][1] < newer:
                return heapq.heappop(self._calls)[2]
            return None

    def after(self, seconds: float, call: Callable[[], object]) -> None:
        """Call something in the environment's thread in `seconds` of the run's clock; negative ones count as 0."""
        with self._lock:
            heapq.heappush(self._calls, (self.now() + max(0.0, seconds), next(self._count), call))
            self._called = True
        if self._asleep:
            self._stirred.set()

    @property
    def due(self) -> float | None:
        """The time of the next call, in seconds."""
        with self._lock:
            return self._calls[0][0] if self._calls else None

    @property
    def stirred(self) -> bool:
        """Whether there is something to deliver."""
        return self._board.changed or self._called or bool(self._settled)

    @property
    def waited_for(self) -> bool:
        """Whether the outcome of an action is outstanding: it may come although nothing is due."""
        return bool(self._waiting)

    def sleep(self, seconds: float) -> None:
        """Wait until another thread changes something, at most `seconds` of real time (0 or more)."""
        self._asleep, self._board.on_change = True, self._stirred.set
        if not self.stirred:
            self._stirred.wait(seconds)
        self._asleep, self._board.on_change = False, None
        self._stirred.clear()

    def stop(self) -> None:
        """Stop the environment."""
        self._guarded("stop", self._environment.stop)

    def _report(self, text: str) -> None:
        """Report a mistake once: one that repeats in every step must not fill the screen."""
        if text not in self._reported and len(self._reported) < MOST_REPORTED:
            self._reported.add(text)
            self._report_line(text)

    def _guarded(self, what: str, call: Callable[..., object], *arguments: Any) -> None:
        try:
            call(*arguments)
        except MISTAKES as error:
            self._report(f"the environment's {what} went wrong: {describe_error(error)}")

    def _on_settled(self, name: str, number: int, deferred: Deferred) -> None:
        self._settled.append((name, number, deferred))
        if self._asleep:
            self._stirred.set()
