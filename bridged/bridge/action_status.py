"""Statuses as the bus, the ledger and the agents can take them, whatever a driver has said in them."""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Callable, Mapping
from numbers import Real
from types import MappingProxyType
from typing import get_args

from msgspec.structs import replace

from bridged.bridge.percepts import PerceptPublisher
from bridged.drivers.api import Outcome
from schemas.wire.records import Action, ActionStatus, Cause, Header, State

log = logging.getLogger("action")

_CAUSES = frozenset(get_args(Cause))
MAX_ID = 200
"""Characters of an action's id."""
MAX_REASON = 1000
"""Characters of a reason; what is more is left out."""
MAX_FIGURES = 64
"""Figures of one action's progress that its status carries."""
MAX_FIGURE_NAME = 100
"""Characters of a figure's name."""
NO_FIGURES: Mapping[str, float] = MappingProxyType({})


class Statuses:
    """Makes the statuses of one robot's actions."""

    def __init__(self, robot: str, boot: str, stamp: Callable[[], int], board: PerceptPublisher) -> None:
        self._robot, self._boot, self._stamp, self._board = robot, boot, stamp, board
        self._seq = 0

    def ended(self, action: Action, outcome: Outcome, feedback: Mapping[str, float] = NO_FIGURES) -> ActionStatus:
        """Return how an action has ended. A cause that no reader of the record would know becomes `driver`."""
        succeeded = outcome.state == "succeeded"
        if outcome.cause not in _CAUSES:  # drivers of others are not type-checked
            log.warning("robot=%s unknown cause %r of %s: taken as driver", self._robot, outcome.cause, action.name)
            outcome = dataclasses.replace(outcome, cause="driver")
        status = self.make(action, outcome.state, outcome.reason, feedback)
        return replace(status, result=succeeded, cause=None if succeeded else outcome.cause, order=outcome.order)

    def make(
        self, action: Action, state: State, reason: str = "", feedback: Mapping[str, float] = NO_FIGURES
    ) -> ActionStatus:
        """Return what has become of an action by now."""
        self._seq += 1
        return ActionStatus(
            header=Header(seq=self._seq, stamp=self._stamp(), source=self._robot, boot=self._boot),
            id=action.id,
            state=state,
            reason=legible(reason, MAX_REASON),
            feedback=figures(feedback),
            after=self._board.last_seq(action.agent),
            name=action.name,
            parameters=action.parameters,
        )


def legible(text: object, at_most: int) -> str:
    """Return a text that can be sent: no half characters, and no more of them than wanted."""
    whole = str(text).encode("utf-8", "replace").decode()
    return whole if len(whole) <= at_most else f"{whole[: at_most - 3]}..."


def figures(feedback: Mapping[str, float]) -> dict[str, float]:
    """Return the figures that are numbers: JSON knows no infinity, and an agent refuses what is none."""
    told: dict[str, float] = {}
    for what, value in feedback.items():
        if len(told) >= MAX_FIGURES:
            break
        if not isinstance(value, Real):
            continue
        try:
            number = float(value)
        except OverflowError:
            continue
        if math.isfinite(number):
            told[legible(what, MAX_FIGURE_NAME)] = number
    return told
