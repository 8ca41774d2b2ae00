"""How much work one formula may take: a mind that computes for ever hears nothing, and its robot is taken from it.

Work is counted in steps, not in time, so that a mind decides the same on a fast board, on a slow one and in a replay:
a fact looked at in a loop within a loop, a solution of an internal action, a rule that is asked. `Mind.steps_left`
is what the formula has left; it is full again for each formula of a body, each event and each condition waited for.
"""

from __future__ import annotations

from typing import Any, Final, NoReturn

from agentd.mind.data.formula_failure import Failed

MOST_STEPS: Final = 2_000_000
"""Steps of one formula: about a second on a desktop, some seconds on a small board."""
AFTERWARDS: Final = MOST_STEPS // 100
"""Steps left to the other plans of an event after the context of one took too many."""


class TooMuchWork(Failed):
    """A formula takes more than `MOST_STEPS`. Unlike other failures it does not just make a condition false."""


def too_much_work(mind: Any) -> NoReturn:
    """Fail the formula that has no steps left."""
    mind.steps_left = AFTERWARDS
    raise TooMuchWork("too_much_work", f"it takes more than {MOST_STEPS} steps")


def work(mind: Any, steps: int) -> None:
    """Count steps. Raises TooMuchWork."""
    mind.steps_left -= steps
    if mind.steps_left < 0:
        too_much_work(mind)
