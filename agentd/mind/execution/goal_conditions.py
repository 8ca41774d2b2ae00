"""Goal conditions (``<:``): a goal ends when its condition holds, wherever its plan is (rule 94)."""

from __future__ import annotations

from typing import Any

from agentd.mind.data.intention import Intention
from agentd.mind.execution.dropping import end_goal
from agentd.mind.execution.execution import condition_holds
from agentd.mind.state import MindState

_PRUNE_AT = 64
"""With so many more goals it is looked which of them are over."""


def watch(mind: MindState, intention: Intention, frame: Any) -> None:
    """Ask the condition of a goal again when beliefs change. Goals that have ended otherwise are forgotten in time."""
    watched = mind.goal_conditions
    watched.append((intention, frame))
    if len(watched) % _PRUNE_AT == 0:
        watched[:] = [(other, its) for other, its in watched if any(f is its for f in other.stack)]


def check_goal_conditions(mind: MindState) -> None:
    """After beliefs have changed: end the goals whose conditions hold now, wherever their plans are."""
    left = []
    for intention, frame in mind.goal_conditions:
        place = next((n for n, other in enumerate(intention.stack) if other is frame), None)
        if place is None:
            continue
        if condition_holds(mind, intention, frame):
            end_goal(mind, intention, place, True)
        else:
            left.append((intention, frame))
    mind.goal_conditions[:] = left
