"""An action that runs: its followers, its progress as percepts, its statuses, and the pause that stops its clock."""

from __future__ import annotations

import dataclasses
import logging
import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from numbers import Real
from types import MappingProxyType
from typing import get_args

from msgspec.structs import replace

from bridged.bridge.action_log import ActionLog
from bridged.bridge.percepts import PerceptPublisher
from bridged.drivers.api import Execution, Outcome
from commd.common.clock import Clock
from schemas.manifest.loader import ActionEntry, Argument
from schemas.manifest.rules import FUNCTOR
from schemas.wire.records import Action, ActionStatus, Cause, Header, State
from schemas.wire.terms import Atom, Term, number

MAX_FOLLOWERS = 16
"""Queries that may wait for the end of one action; the newest are kept."""
MAX_FEEDBACK = 16
"""Figures of one action's progress that its agent perceives at most."""
MAX_ID = 200
"""Characters of an action's id."""
MAX_REASON = 1000
"""Characters of a reason; the rest is cut."""
MAX_FIGURES = 64
"""Figures of one action's progress that its status carries."""
MAX_FIGURE_NAME = 100
"""Characters of a figure's name."""
FEEDBACK = "feedback"
"""The percept of progress: `feedback(Action, Figure, Value)`."""
PAUSED, BY_OPERATOR = "paused", (Atom("operator"),)
"""The percept of the operator's pause, `paused(operator)`, which every agent of the robot has while it lasts."""
CAUSE = "cause"
"""The figure that is a text: what hinders the action."""
NO_FIGURES: Mapping[str, float] = MappingProxyType({})
_CAUSES = frozenset(get_args(Cause))
log = logging.getLogger("actions")

Follower = Callable[[ActionStatus | None], None]
"""Called with each status of an action from now on; the last one is final, or None if a newer query took the place."""


@dataclass(eq=False)
class RunningAction:
    """An action that runs."""

    request: Action
    entry: ActionEntry
    execution: Execution
    deadline_at: float
    """In mission seconds without those of pauses."""
    deadline: float
    """Mission seconds from its begin."""
    status: ActionStatus
    """The last one."""
    told_at: float
    """When `running` was published last, in mission seconds."""
    arguments: dict[str, Argument]
    held: bool = False
    """It is to be begun, or begun again, when the operator continues."""
    published: bool = False
    """Observers have its first status."""
    noted: bool = False
    """Its begin is in the log."""
    cause: str = ""
    """What hindered it by the last status."""
    logged_cause: str = ""
    followers: list[tuple[str, Follower]] = field(default_factory=list)
    """Who asked, and the follower; one for each asker that has a name."""
    figures: frozenset[str] = frozenset()
    """Those that its agent perceives now."""

    def join(self, asker: str, follower: Follower) -> None:
        """Add a follower. It replaces the former one of its asker, which has given up that query."""
        follower(self.status)
        former = [one for one in self.followers if asker and one[0] == asker]
        for one in former or self.followers[: max(0, len(self.followers) - MAX_FOLLOWERS + 1)]:
            self.followers.remove(one)
            one[1](None)
        self.followers.append((asker, follower))

    def show(self, percepts: PerceptPublisher, feedback: Mapping[str, float], cause: str = "") -> None:
        """Let the agent perceive these figures and the cause, as far as the manifest wants them, and no others."""
        agent, action = self.request.agent, Atom(self.request.name)
        told: dict[str, Term] = {what: number(value) for what, value in feedback.items()}
        if cause:
            told[CAUSE] = cause
        wanted = self.entry.feedback
        named = (what for what in told if FUNCTOR.fullmatch(what) and (wanted is None or what in wanted))
        shown = sorted(named)[:MAX_FEEDBACK]
        for what in sorted(self.figures.difference(shown)):
            percepts.withdraw(agent, FEEDBACK, (action, Atom(what)))
        for what in shown:
            percepts.show(agent, FEEDBACK, (action, Atom(what), told[what]), key=(0, 1))
        self.figures = frozenset(shown)


class Pause:
    """The operator's pause, in which deadlines do not run; one that a former run of the bridge has begun continues."""

    def __init__(self, action_log: ActionLog, percepts: PerceptPublisher, robot: str, now: Callable[[], float]) -> None:
        self._action_log, self._percepts, self._robot, self._now = action_log, percepts, robot, now
        self.since: float | None = None
        """Mission time at which it began; None = the robot is not paused."""
        self._over = 0.0
        """Mission seconds of the pauses that are over."""
        if action_log.paused:
            self.since = now()
            self._percepts.show_all(PAUSED, BY_OPERATOR)

    @property
    def elapsed(self) -> float:
        """Mission seconds so far without those of pauses."""
        return (self._now() if self.since is None else self.since) - self._over

    def begin(self) -> None:
        """Begin a pause, unless one lasts."""
        if self.since is None:
            self.since = self._now()
            self._changed("paused by the operator")

    def end(self) -> None:
        """End the pause if one lasts."""
        if self.since is not None:
            self._over += self._now() - self.since
            self.since = None
            self._changed("not paused any longer")

    def _changed(self, change: str) -> None:
        self._percepts.show_all(PAUSED, None if self.since is None else BY_OPERATOR)
        log.info("robot=%s %s", self._robot, change)
        self._action_log.pause(self.since is not None)


class Statuses:
    """Makes the statuses of one robot's actions; whatever a driver says, the bus and the action log take them."""

    def __init__(self, robot: str, boot: str, clock: Clock, percepts: PerceptPublisher) -> None:
        self._robot, self._boot, self._clock, self._percepts = robot, boot, clock, percepts
        self._seq = 0

    def ended(self, request: Action, outcome: Outcome, feedback: Mapping[str, float] = NO_FIGURES) -> ActionStatus:
        """Return how an action has ended. A cause that the records do not know becomes `driver`."""
        succeeded = outcome.state == "succeeded"
        if outcome.cause not in _CAUSES:  # drivers of others are not type-checked
            log.warning("robot=%s unknown cause %r of %s: taken as driver", self._robot, outcome.cause, request.name)
            outcome = dataclasses.replace(outcome, cause="driver")
        status = self.make(request, outcome.state, outcome.reason, feedback)
        return replace(status, result=succeeded, cause=None if succeeded else outcome.cause, order=outcome.order)

    def make(
        self, request: Action, state: State, reason: str = "", feedback: Mapping[str, float] = NO_FIGURES
    ) -> ActionStatus:
        """Return a status of an action, with figures that are finite numbers: JSON has no infinity."""
        self._seq += 1
        figures: dict[str, float] = {}
        for what, value in (feedback or NO_FIGURES).items():
            if len(figures) >= MAX_FIGURES:
                break
            with suppress(OverflowError):
                if isinstance(value, Real) and math.isfinite(figure := float(value)):
                    figures[legible(what, MAX_FIGURE_NAME)] = figure
        return ActionStatus(
            header=Header(seq=self._seq, stamp=time.time_ns(), source=self._robot, boot=self._boot),
            id=request.id,
            state=state,
            reason=legible(reason, MAX_REASON),
            feedback=figures,
            after=self._percepts.sets[request.agent].seq,
            name=request.name,
            parameters=request.parameters,
        )


def legible(text: object, at_most: int) -> str:
    """Return a text that can be sent: without lone surrogates, cut to `at_most` characters."""
    whole = str(text).encode("utf-8", "replace").decode()
    return whole if len(whole) <= at_most else f"{whole[: at_most - 3]}..."
