"""Perform the actions of a mind, and follow those that a former life has left running (docs/guides/restart.md).

An action is saved before the bridge is asked for it. So a killed agent knows which actions it may have begun; its next
life asks for each of them by its id, which begins nothing, and learns the outcome.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

from msgspec.structs import replace

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mind.data.effects import PerformAction
from agentd.mind.data.inputs import ActionDone
from agentd.persistence.checkpointer import Checkpointer
from agentd.runtime.mind_runner import MindRunner
from agentd.trace import Tracing
from commd.bus.bus import Bus
from commd.client.actions import ActionRequests, describe
from commd.common.tasks import Tasks
from schemas.wire.codec import BadRecord
from schemas.wire.records import Action, ActionStatus, Cause, State

log = logging.getLogger("agent")

ANSWER_PATIENCE = 2.0
"""Wall seconds for the bridge to say which actions of the former life still run, before the agent reasons."""


@dataclass(eq=False, slots=True)
class _Left:
    """An action that a former life has left running."""

    action: Action
    answered: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when the bridge has said whether it runs."""
    joined: bool = False
    """Whether a plan waits for its end, or is about to."""
    status: asyncio.Task[ActionStatus] | None = None

    def running(self, status: ActionStatus) -> None:
        """Take a status of the running action."""
        self.answered.set()


class ActionClient:
    """The actions of one agent, between its mind and its robot."""

    def __init__(
        self,
        bus: Bus,
        runner: MindRunner,
        tracing: Tracing,
        action_requests: ActionRequests | None,
        checkpointer: Checkpointer,
        on_interrupted: Callable[[Literal], None],
        tasks: Tasks,
    ) -> None:
        """`action_requests` is None without a robot; `on_interrupted` gets the end of an action that no plan awaits."""
        self._bus, self._runner, self._tracing, self._agent = bus, runner, tracing, runner.mind.name
        self._action_requests, self._checkpointer, self._tasks = action_requests, checkpointer, tasks
        self._on_interrupted = on_interrupted
        self._left: dict[str, _Left] = {}
        self._identities: dict[int, str] = {}
        """The ids of the actions that intentions wait for, by number; empty: not requested yet."""
        self._dropped: set[int] = set()

    def begin(self, effect: PerformAction) -> None:
        """Perform an action; the mind is fed its end.

        It is noted here, in the turn of the effect, so that the save of this turn has it; the bridge is asked for it
        when it is on disk.
        """
        number, requests = effect.id, self._action_requests
        self._identities[number] = ""
        if requests is None:
            self._end(number, _ended("refused", "request", f"agent {self._agent} has no robot to do {effect.name}"))
            return
        try:
            parameters = tuple(map(to_wire, effect.parameters))
            for left in self._left.values():
                if not left.joined and (left.action.name, left.action.parameters) == (effect.name, parameters):
                    left.joined = True
                    self._tasks.spawn(self._join(number, left))
                    return
            identity = f"{self._agent}:{self._bus.boot}:{number}"
            action = Action(id=identity, agent=self._agent, name=effect.name, parameters=parameters)
            self._checkpointer.begun(action, partial(self._request, requests, number, action))
        except (BadTerm, BadRecord) as bad:
            self._end(number, _ended("refused", "request", f"{effect.name}: {bad}"))
        except Exception as defect:
            self._fail(number, defect)

    def cancel(self, number: int) -> None:
        """Cancel the action with this number in the mind (1 or more): the intention that waited for it is gone."""
        identity = self._identities.get(number)
        if identity == "":
            self._dropped.add(number)
        elif identity is not None and self._action_requests is not None:
            self._tasks.spawn(self._action_requests.cancel(identity))

    def _request(self, requests: ActionRequests, number: int, action: Action) -> None:
        self._identities[number] = action.id
        try:
            if number in self._dropped:
                self._end(number, _DROPPED)
            else:
                requests.begin(action, partial(self._end, number))
        except Exception as defect:
            self._fail(number, defect)

    def _fail(self, number: int, defect: Exception) -> None:
        """Let a defect fail the plan, which must not wait forever, and not the daemon with all its agents."""
        what = {"message": f"performing an action of agent {self._agent}", "exception": defect}
        asyncio.get_running_loop().call_exception_handler(what)
        if number in self._identities:
            self._end(number, _ended("failed", None, f"defect in agentd: {type(defect).__name__}: {defect}"))

    def _end(self, number: int, status: ActionStatus) -> None:
        if identity := self._identities.pop(number):
            self._checkpointer.ended(identity)
        self._dropped.discard(number)
        done = ActionDone(number, status.state == "succeeded", status.reason, status.state, status.cause or "")
        self._tracing.activity.ended(self._runner.mind.cycle, done)
        self._runner.feed(done)
        if status.id:  # after the mind's turn: the intention does not wait for the log
            self._bus.afterwards(partial(log.info, "agent=%s %s", self._agent, describe(status)))

    # --- actions of a former life ---

    async def take_up(self, actions: Iterable[Action]) -> list[Literal]:
        """Ask for the outcome of actions that a former life has begun, for at most `ANSWER_PATIENCE` wall seconds.

        Returns `interrupted(Action, State, Reason)` for each that has ended. A plan that performs one that still runs
        joins it; `on_interrupted` gets the end of those that no plan has joined.
        """
        gone: list[Literal] = []
        if self._action_requests is None:
            for action in actions:
                self._checkpointer.ended(action.id)
                gone.append(_interrupted(action, "failed", "the agent has no robot any more"))
            return gone
        left = [_Left(action) for action in actions]
        if not left:
            return []
        early = True

        async def follow(one: _Left) -> None:
            assert one.status is not None
            status = await one.status
            log.info("agent=%s left by a former life: %s", self._agent, describe(status))
            one.answered.set()
            self._left.pop(one.action.id, None)
            if one.joined:
                return
            if early:
                gone.append(self._ended(one, status))
            else:
                self._on_interrupted(self._ended(one, status))

        for one in left:
            asked = self._action_requests.perform(replace(one.action, attempt=2), on_status=one.running)
            one.status = asyncio.get_running_loop().create_task(asked)
            self._left[one.action.id] = one
            self._tasks.spawn(follow(one))
        answers = [asyncio.ensure_future(one.answered.wait()) for one in left]
        _, silent = await asyncio.wait(answers, timeout=ANSWER_PATIENCE)
        for wait in silent:
            wait.cancel()
        early = False
        return gone

    def _ended(self, left: _Left, status: ActionStatus) -> Literal:
        """Forget an action that has ended without a plan that waits for it, and return its event."""
        self._checkpointer.ended(left.action.id)
        return _interrupted(left.action, status.state, status.reason)

    async def _join(self, number: int, left: _Left) -> None:
        """Wait for the end of an action that a former life has begun."""
        assert left.status is not None
        if number in self._dropped:  # the plan that was about to wait is gone
            left.joined = False
            if left.action.id not in self._left:  # it has ended meanwhile
                self._on_interrupted(self._ended(left, left.status.result()))
            self._end(number, _DROPPED)
            return
        self._identities[number] = left.action.id
        log.info("agent=%s goes on with %s, which a former life has begun", self._agent, left.action.name)
        self._end(number, await asyncio.shield(left.status))


def _ended(state: State, cause: Cause | None, reason: str) -> ActionStatus:
    """Return the end of an action that the bridge was not asked for."""
    return ActionStatus(id="", state=state, cause=cause, reason=reason)


_DROPPED = _ended("cancelled", "cancelled", "the agent has dropped it")


def _interrupted(action: Action, state: str, reason: str) -> Literal:
    parameters = tuple(from_wire(parameter) for parameter in action.parameters)
    performed = Literal(signature(action.name, len(parameters)), parameters)
    return Literal(signature("interrupted", 3), (performed, atom(state), reason))
