"""Goal conditions (``<:``): a goal ends when its condition holds, wherever its plan is (rule 94)."""

from __future__ import annotations

from typing import Any

from agentd.mind.dropping import end_goal
from agentd.mind.execution import condition_holds


def check_goal_conditions(mind: Any) -> None:
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
