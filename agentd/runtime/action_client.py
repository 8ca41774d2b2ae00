"""The actions that a mind performs, and those that a former life of its agent left running (docs/guides/restart.md).

An action is written down before the bridge is asked for it. So an agent that was killed knows which actions it may have
begun; it asks for each of them by its id, which begins nothing, and learns what became of it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mind.data.effects import PerformAction
from agentd.mind.data.inputs import ActionDone
from commd.client.actions import ActionRequests, describe
from schemas.wire.records import Action, ActionStatus
from schemas.wire.terms import Term

log = logging.getLogger("agent")

ANSWER_PATIENCE = 2.0
"""Wall seconds that the bridge has to say which of the former life's actions still run, before the agent reasons."""


class Journal(Protocol):
    """Where actions are written down."""

    def begun(self, action: Action) -> asyncio.Future[None] | None:
        """Note that an action is about to be asked for; it outlives this process when what this returns ends."""

    def ended(self, identity: str) -> None:
        """The mind has been told how an action ended: it need not be remembered."""


class NoJournal:
    """For agents without memory."""

    def begun(self, action: Action) -> None:
        """Nothing is noted."""

    def ended(self, identity: str) -> None:
        """Nothing was noted."""


class _Left:
    """An action that a former life has left."""

    def __init__(self, action: Action) -> None:
        self.action = action
        self.answered = asyncio.Event()
        """The bridge has said whether it runs."""
        self.joined = False
        """A plan waits for its end, or is about to."""
        self.status: asyncio.Task[ActionStatus] | None = None

    def running(self, status: ActionStatus) -> None:
        """The bridge says that it runs."""
        self.answered.set()


@dataclass
class _Noted:
    """What was found and noted of an action in the turn in which a plan has asked for it."""

    parameters: tuple[Term, ...] = ()
    refused: str = ""
    """Why it cannot be asked for."""
    left: _Left | None = None
    """It is one that a former life has begun."""
    kept: asyncio.Future[None] | None = None
    """Ends when it is written down."""
    error: Exception | None = None


class ActionClient:
    """The actions of one agent, between its mind and its hands."""

    def __init__(
        self,
        agent: str,
        life: str,
        action_requests: ActionRequests | None,
        journal: Journal,
        feed: Callable[[ActionDone], None],
        spawn: Callable[[Coroutine[Any, Any, None]], object],
        on_interrupted: Callable[[Literal], None],
    ) -> None:
        """`life` makes the ids of this life's actions its own; `on_interrupted` hears of what ended without a plan that
        waited for it.
        """
        self._agent, self._life, self._action_requests, self._journal = agent, life, action_requests, journal
        self._feed, self._spawn, self._on_interrupted = feed, spawn, on_interrupted
        self._left: dict[str, _Left] = {}
        self._identities: dict[int, str] = {}
        """Of the actions that intentions wait for; empty: it has not been asked for yet."""
        self._dropped: set[int] = set()

    def begin(self, effect: PerformAction) -> None:
        """Carry out what a plan asks for; the mind hears of its end.

        That it is about to begin is noted here, in the turn in which the mind has asked for it: the save of that turn
        holds it.
        """
        self._identities[effect.id] = ""
        try:
            noted = self._noted(effect)
        except BadTerm as bad:
            noted = _Noted(refused=f"{effect.name}: {bad}")
        except Exception as error:  # it fails this plan, not the daemon with all its agents
            noted = _Noted(error=error)
        self._spawn(self._perform(effect, noted))

    def _noted(self, effect: PerformAction) -> _Noted:
        """What is to be known of an action before it is asked for. Raises BadTerm, and whatever a defect may raise."""
        if self._action_requests is None:
            return _Noted(refused=f"agent {self._agent} has no robot to do {effect.name}")
        noted = _Noted(parameters=tuple(map(to_wire, effect.parameters)))
        if left := self._same(effect.name, noted.parameters):
            noted.left, left.joined = left, True
            return noted
        identity = f"{self._agent}:{self._life}:{effect.id}"
        action = Action(id=identity, agent=self._agent, name=effect.name, parameters=noted.parameters)
        noted.kept = self._journal.begun(action)
        return noted

    def cancel(self, number: int) -> None:
        """The intention that waited for an action is gone."""
        identity = self._identities.get(number)
        if identity == "":
            self._dropped.add(number)
        elif identity is not None and self._action_requests is not None:
            self._spawn(self._action_requests.cancel(identity))

    async def _perform(self, effect: PerformAction, noted: _Noted) -> None:
        try:
            done, status = await self._outcome(effect, noted)
        except Exception as error:  # the intention must not wait for ever for an answer that cannot come
            reason = f"defect in agentd: {type(error).__name__}: {error}"
            if identity := self._identities.get(effect.id):
                self._journal.ended(identity)
            self._feed(ActionDone(effect.id, False, reason, "failed"))
            raise
        finally:
            identity = self._identities.pop(effect.id, "")
            self._dropped.discard(effect.id)
        if identity:
            self._journal.ended(identity)
        self._feed(done)
        if status is not None:  # after the mind's turn: the intention does not wait for the log
            asyncio.get_running_loop().call_soon(log.info, "agent=%s %s", self._agent, describe(status))

    async def _outcome(self, effect: PerformAction, noted: _Noted) -> tuple[ActionDone, ActionStatus | None]:
        if noted.error is not None:
            raise noted.error
        if self._action_requests is None or noted.refused:
            return ActionDone(effect.id, False, noted.refused, "refused", "request"), None
        dropped = ActionDone(effect.id, False, "the agent has dropped it", "cancelled", "cancelled"), None
        if (left := noted.left) is not None:
            if effect.id in self._dropped:
                self._let_go(left)
                return dropped
            status = await self._join(effect.id, left)
            return _done(effect.id, status), status
        identity = f"{self._agent}:{self._life}:{effect.id}"
        self._identities[effect.id] = identity
        if effect.id in self._dropped:
            return dropped
        status = await self._action_requests.perform(identity, effect.name, noted.parameters, kept=noted.kept)
        return _done(effect.id, status), status

    # --- what a former life has left ---

    async def take_up(self, actions: Iterable[Action]) -> list[Literal]:
        """Ask what became of actions that a former life has begun, for at most `ANSWER_PATIENCE` wall seconds.

        Returns `interrupted(Action, State, Reason)` for each that has ended. A plan that performs one which still runs
        joins it; `on_interrupted` hears of the end of those that no plan has joined.
        """
        gone: list[Literal] = []
        if self._action_requests is None:
            for action in actions:
                self._journal.ended(action.id)
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
            asked = self._action_requests.perform(
                one.action.id, one.action.name, one.action.parameters, on_status=one.running, attempt=2
            )
            one.status = asyncio.get_running_loop().create_task(asked)
            self._left[one.action.id] = one
            self._spawn(follow(one))
        answers = [asyncio.ensure_future(one.answered.wait()) for one in left]
        _, silent = await asyncio.wait(answers, timeout=ANSWER_PATIENCE)
        for wait in silent:
            wait.cancel()
        early = False
        return gone

    def _same(self, name: str, parameters: tuple[Term, ...]) -> _Left | None:
        """The action of a former life that is the one which a plan performs now."""
        for one in self._left.values():
            if not one.joined and (one.action.name, one.action.parameters) == (name, parameters):
                return one
        return None

    def _ended(self, left: _Left, status: ActionStatus) -> Literal:
        """It has ended and no plan has waited for it. Returns what the mind is told of that."""
        self._journal.ended(left.action.id)
        return _interrupted(left.action, status.state, status.reason)

    def _let_go(self, left: _Left) -> None:
        """The plan that was about to wait for its end is gone."""
        left.joined = False
        if left.action.id not in self._left:  # it has ended meanwhile
            assert left.status is not None
            self._on_interrupted(self._ended(left, left.status.result()))

    async def _join(self, number: int, left: _Left) -> ActionStatus:
        assert left.status is not None
        left.joined = True
        self._identities[number] = left.action.id
        log.info("agent=%s goes on with %s, which a former life has begun", self._agent, left.action.name)
        return await asyncio.shield(left.status)


def _done(number: int, status: ActionStatus) -> ActionDone:
    return ActionDone(number, status.state == "succeeded", status.reason, status.state, status.cause or "")


def _interrupted(action: Action, state: str, reason: str) -> Literal:
    parameters = tuple(from_wire(parameter) for parameter in action.parameters)
    performed = Literal(signature(action.name, len(parameters)), parameters)
    return Literal(signature("interrupted", 3), (performed, atom(state), reason))
