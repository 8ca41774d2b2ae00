"""Asking the one who runs the team: agents to create and to kill, the directory of services, files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.data.effects import TeamRequest
from agentd.mind.data.formula_failure import Failed, as_failed
from agentd.mind.data.inputs import TeamReply
from agentd.mind.data.intention import Awaited, Request
from agentd.mind.execution.execution import await_something, fail_waiting, resume_waiting
from agentd.mind.state import MindState


def take_reply(mind: MindState, reply: TeamReply) -> None:
    """Let the intention that waits for a reply go on with it, or fail with its error."""
    request = mind.requests.pop(reply.id, None)
    if request is None:
        return
    intention = request.intention
    if reply.error:
        fail_waiting(mind, intention, Failed(reply.error, reply.message))
        return
    if request.use is not None:
        try:
            request.use(reply.value)
        except Exception as error:  # a function of the program's may raise anything; it must not end the mind
            fail_waiting(mind, intention, as_failed(error))
            return
    mark = len(intention.trail)
    if request.result is not None and not unify(request.result, reply.value, intention.trail):
        undo(intention.trail, mark)
        fail_waiting(mind, intention, Failed("ia_failed"))
        return
    resume_waiting(mind, intention)


def request(
    mind: MindState, what: str, arguments: tuple[Any, ...], result: Any = None, use: Callable[[Any], None] | None = None
) -> bool:
    """Send a request; the running intention waits. ``result`` is unified with the answer."""
    if not mind.has_team:
        raise Failed("action_failed", f"nobody here can do what '{what}' asks for")
    mind.action_count += 1
    intention = mind.own_intention
    mind.effects.append(TeamRequest(mind.action_count, what, arguments))
    mind.requests[mind.action_count] = Request(intention, result, use)
    await_something(mind, intention, Awaited("team", what), mind.action_count)
    return True
