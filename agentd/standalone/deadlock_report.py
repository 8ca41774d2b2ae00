"""What is told when a run ends because nothing is left to do, while intentions still wait."""

from __future__ import annotations

from collections.abc import Iterable

from agentd.mind import Mind
from agentd.mind.data.effects import Log
from agentd.mind.data.intention import PLAN, Intention, wait_text
from agentd.mind.execution.control_flow import Fork
from agentd.mind.introspection.failure_text import brief, code_of, event_text, goal_text, written

MOST_TOLD = 10
"""So many intentions are named; of further ones the number."""

_MOST_GOALS = 5


def stuck(minds: Iterable[Mind]) -> list[tuple[Mind, Intention]]:
    """The intentions that wait or are suspended; one that waits for its branches is not stuck, they are."""
    return [
        (mind, intention)
        for mind in minds
        for intention in mind.all_intentions()
        if (intention.stack or intention.held) and not isinstance(mind.waiting.get(intention.id, (None, None))[1], Fork)
    ]


def stuck_note(intention: Intention) -> Log:
    """The note for an intention that nothing lets go on any more."""
    if not intention.stack and intention.held is not None:
        return Log("warning", f"{event_text(intention.held)} was suspended before it began, and nothing resumes it")
    frames = intention.stack[::-1]
    details = [f"in the plan for {', called by '.join(_goals(intention))}{', ...' if frames[_MOST_GOALS:] else ''}"]
    step = intention.last
    if step is None:
        return Log("warning", "an intention does not run any more", tuple(details))
    formula = brief(written(step, code_of(step, frames[0])))
    if intention.suspended is not None:
        text = f"the intention was suspended after {formula}, and nothing resumes it"
    else:
        text = f"{formula} waits for what cannot come any more"
        if intention.waiting is not None and intention.waiting.kind not in ("time", "formula", "event"):
            details.insert(0, f"it waits for: {wait_text(intention.waiting)}")
    return Log("warning", text, tuple(details), step.syntax.position)


def _goals(intention: Intention) -> list[str]:
    found = []
    for frame in intention.stack[: -1 - _MOST_GOALS : -1]:
        position = frame[PLAN].syntax.position
        found.append(f"{goal_text(frame)} ({position.file}:{position.line})")
    return found
