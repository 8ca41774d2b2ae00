"""Internal actions that wait for something of their own: the intention is taken out of the round until they say so."""

from __future__ import annotations

from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import Awaited
from agentd.mind.execution.execution import await_something, fail_waiting, resume_waiting
from agentd.mind.state import MindState


class Suspension:
    """The running intention, waiting. It goes on, or fails, once; a dropped one does neither."""

    def __init__(self, mind: MindState, reason: str) -> None:
        self._mind, self._intention = mind, mind.own_intention
        await_something(mind, self._intention, Awaited("python", reason), self)

    @property
    def over(self) -> bool:
        """Whether nobody waits any more: it was ended, or its intention was dropped."""
        return self._mind.waiting.get(self._intention.id, (None, None))[1] is not self

    def resume(self) -> None:
        """The formula has succeeded."""
        if not self.over:
            resume_waiting(self._mind, self._intention)

    def fail(self, error: str, message: str = "") -> None:
        """The formula has failed; ``error`` and ``message`` are what the handler sees."""
        if not self.over:
            fail_waiting(self._mind, self._intention, Failed(error, message))


def suspend(mind: MindState, reason: str) -> Suspension:
    """Suspend the intention that runs an internal action declared with ``suspends=True``; the action returns True."""
    return Suspension(mind, reason)
