"""Asking the one who runs the team: agents to create and to kill, the directory of services, files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.data.effects import TeamRequest
from agentd.mind.data.formula_failure import Failed, as_failed
from agentd.mind.data.inputs import TeamReply
from agentd.mind.data.intention import Intention
from agentd.mind.execution.waiting import fail_waiting, resume_waiting

Use = Callable[[Any], None]


class Request:
    """An intention that waits for the team's answer, and what it does with it."""

    def __init__(self, intention: Intention, result: Any, use: Use | None) -> None:
        self.intention, self.result, self.use = intention, result, use

    def answered(self, mind: Any, reply: TeamReply) -> None:
        """Go on with the answer, or fail with its error."""
        intention = self.intention
        if reply.error:
            fail_waiting(mind, intention, Failed(reply.error, reply.message))
            return
        if self.use is not None:
            try:
                self.use(reply.value)
            except Exception as error:  # a function of the program's may raise anything; it must not end the mind
                fail_waiting(mind, intention, as_failed(error))
                return
        mark = len(intention.trail)
        if self.result is not None and not unify(self.result, reply.value, intention.trail):
            undo(intention.trail, mark)
            fail_waiting(mind, intention, Failed("ia_failed"))
            return
        resume_waiting(mind, intention)


def request(mind: Any, what: str, arguments: tuple[Any, ...], result: Any = None, use: Use | None = None) -> bool:
    """Send a request; the running intention waits. ``result`` is unified with the answer."""
    if not mind.has_team:
        raise Failed("action_failed", f"nobody here can do what '{what}' asks for")
    mind.action_count += 1
    intention = mind.current
    mind.effects.append(TeamRequest(mind.action_count, what, arguments))
    mind.requests[mind.action_count] = Request(intention, result, use)
    mind.await_something(intention, f"team {what}", mind.action_count)
    return True
