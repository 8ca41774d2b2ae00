"""Request an action once, and follow it to its final status."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from msgspec.structs import replace

from commd.bus.bus import Bus, Reply
from commd.bus.errors import BusClosed, BusError
from commd.client.percept_sync import PerceptSync
from commd.common.tasks import Alarm, Tasks
from commd.liveness.bridge_presence import BridgePresence
from schemas.liveness import ACTION_ASKED_AGAIN, BUS_GRACE
from schemas.wire import keys
from schemas.wire.codec import BadRecord
from schemas.wire.records import Action, ActionStatus, Cancel, Cause, State

log = logging.getLogger("actions")

ACCEPT_PATIENCE = 15.0
"""Wall seconds for a bridge to accept or refuse an action; only then its deadline is known."""
ASKERS_MARGIN = 5.0
"""Wall seconds to wait beyond the deadline: the bridge ends the action, not the client."""
QUERY_TIMEOUT = 3600.0
"""Wall seconds after which the query of a running action is repeated, with the same id."""
AFTER_PATIENCE = 2.0
"""Wall seconds that a status waits for the percepts before it: one that was lost with the router is repaired after the
bridge's next health record at the latest."""
RETRY = 0.2
_HANGS = "bridge_lost: the bridge is alive but sends no health records: it hangs"
_UNWANTED = "the agent has dropped it"


@dataclass(eq=False)
class _Request:
    """An action that is asked for until it has ended; times are those of the event loop."""

    action: Action
    on_end: Callable[[ActionStatus], None]
    on_status: Callable[[ActionStatus], None] | None
    attempt: int
    heard: float
    """When it was begun, or its last status came."""
    until: float
    """When it has failed."""
    late: str
    """Why it has failed then."""
    due: float = 0.0
    """When it is looked at: its query is silent, or the next one is due."""
    reason: str = "bridge_lost: nobody serves this action"
    """Why it fails if it is asked in vain for too long."""
    wanted: bool = True
    """Whether the agent still wants it."""
    taken: bool = False
    """Whether this query had a status."""
    begun: bool = False
    """Whether the bridge may have begun it."""
    close: Callable[[], object] | None = None
    """Ends the query; None between two queries."""


class ActionRequests:
    """The actions of one agent on the bus."""

    def __init__(
        self,
        bus: Bus,
        agent: str,
        perceiving: PerceptSync,
        bridge: BridgePresence,
        to_wall: Callable[[float], float] = float,
    ) -> None:
        """`to_wall` converts mission seconds to wall seconds."""
        self._to_wall = to_wall
        self.counters: Counter[str] = Counter()
        self._bus, self._agent, self._perceiving, self._bridge = bus, agent, perceiving, bridge
        self._loop = asyncio.get_running_loop()
        self._running: dict[str, _Request] = {}
        self._alarm = Alarm(self._look)
        self._unwanted: set[str] = set()
        """Ids of actions that are over for the agent, and that the bridge may still carry out."""
        self._tasks = Tasks("cancelling an action")
        self._closed = False
        bridge.fell_silent.append(self._look)
        bridge.came.append(self._cancel_unwanted)

    async def perform(
        self,
        action: Action,
        patience: float = ACCEPT_PATIENCE,
        on_status: Callable[[ActionStatus], None] | None = None,
    ) -> ActionStatus:
        """Request an action as `begin` does, and return its final status. Raises what `on_status` raises."""
        ended: asyncio.Future[ActionStatus] = self._loop.create_future()

        def end(status: ActionStatus) -> None:
            if not ended.done():
                ended.set_result(status)

        def hear(status: ActionStatus) -> None:
            try:
                if on_status is not None:
                    on_status(status)
            except Exception as error:
                if not ended.done():
                    ended.set_exception(error)

        self.begin(action, end, patience, hear)
        try:
            return await ended
        finally:
            self._forget(action.id)

    def begin(
        self,
        action: Action,
        on_end: Callable[[ActionStatus], None],
        patience: float = ACCEPT_PATIENCE,
        on_status: Callable[[ActionStatus], None] | None = None,
    ) -> None:
        """Request an action; `on_end` is called once, with its final status, on the event loop.

        The bridge has `patience` wall seconds to accept it. The query is repeated with the same id after
        `ACTION_ASKED_AGAIN` without a status, and when the router is lost or back; the bridge joins it to the running
        action, or replies how that ended. It always ends: the action has failed after `BUS_GRACE` without a status, and
        after the bridge's deadline; a bridge that may have begun it is then told to end it, when it is back.
        `on_status` is called with each status before the final one. An `attempt` above 1 follows a request of an
        earlier process: the bridge starts nothing, and refuses an unknown id.
        """
        if self._closed:
            return
        now, late = self._loop.time(), f"the bridge has not taken it within {patience:g} s"
        one = _Request(action, on_end, on_status, action.attempt, now, now + patience, late)
        self._running[action.id] = one
        self._ask(one)

    def close(self) -> None:
        """Ask for nothing any more; nobody hears the ends of what runs."""
        self._closed = True
        for identity in list(self._running):
            self._forget(identity)
        self._alarm.cancel()
        self._tasks.cancel()

    def _forget(self, identity: str) -> _Request | None:
        one = self._running.pop(identity, None)
        if one is not None and one.close is not None:
            one.close()
        return one

    def _ask(self, one: _Request) -> None:
        """Send the query of an action."""
        if not one.wanted:  # repeated now, it could begin after its cancellation
            self._fail(one, _UNWANTED, "cancelled", "cancelled")
            return
        if self._bridge.hangs:
            self._fail(one, _HANGS)
            return
        key = keys.action(self._bus.fleet, self._agent, one.action.name)
        header, robot = self._bus.header("action", self._agent), self._bridge.robot
        request = replace(one.action, header=header, attempt=one.attempt, robot=robot)
        one.taken, one.begun = False, one.begun or self._bridge.up or one.attempt > 1
        try:
            one.close = self._bus.ask(key, request, ActionStatus, QUERY_TIMEOUT, partial(self._heard, one))
        except BadRecord as bad:
            self._fail(one, f"cannot be sent: {bad}", cause="request")
        except BusClosed as closed:
            one.reason = f"bridge_lost: {closed}"
            self._ask_again(one, silent=False)
        else:
            self._watch(one, min(one.until, self._loop.time() + ACTION_ASKED_AGAIN))

    def _heard(self, one: _Request, reply: Reply[ActionStatus] | None) -> None:
        """Take a reply to the query of an action, None: its end."""
        status = None if reply is None else reply.record
        if self._running.get(one.action.id) is not one:
            return
        if reply is None and not one.taken and not one.wanted:
            self._fail(one, _UNWANTED, "cancelled", "cancelled")
        elif reply is None:
            self._ask_again(one, silent=False)
        elif status is None:
            one.reason = reply.error
        elif status.final:
            one.close = None  # the bridge ends the query: to cancel it costs more than to hear its end
            self._end(one, status)
        else:
            one.heard, one.taken, one.begun = self._loop.time(), True, True
            if status.deadline is not None:
                one.until = one.heard + self._to_wall(status.deadline) + ASKERS_MARGIN
                one.late = "no outcome within its deadline"
            one.reason = "bridge_lost: its answers ended without an outcome"
            self._watch(one, min(one.until, one.heard + ACTION_ASKED_AGAIN))
            if one.on_status is not None:
                one.on_status(status)

    def _ask_again(self, one: _Request, *, silent: bool) -> None:
        """Repeat a query that has ended, or is `silent`, unless the action has failed."""
        now, close, one.close = self._loop.time(), one.close, None
        if silent and close is not None:
            close()
        if self._bridge.gone:
            self._fail(one, "bridge_lost: the bridge of this robot is not running")
        elif now >= one.until:
            self._fail(one, one.late)
        elif not silent and now - max(one.heard, self._bridge.router_since) > BUS_GRACE:
            self._fail(one, one.reason if self._bus.router_up else "bridge_lost: no router")
        else:
            one.attempt += one.taken  # a request without any reply may not have arrived: it must still begin
            self.counters["asked_again"] += 1
            self._watch(one, now + RETRY)

    def _watch(self, one: _Request, due: float) -> None:
        one.due = due
        self._alarm.by(due)

    def _look(self) -> None:
        """Look at what is due, or at everything if the bridge hangs."""
        for one in list(self._running.values()):
            if self._bridge.hangs:
                self._fail(one, _HANGS)
            elif one.due > self._loop.time():
                self._alarm.by(one.due)
            elif one.close is None:
                self._ask(one)
            else:  # the query is broken, or the bridge is busy; its health shows whether it hangs
                self._ask_again(one, silent=True)

    def _fail(self, one: _Request, why: str, state: State = "failed", cause: Cause = "unreachable") -> None:
        name = one.action.name
        if cause == "unreachable" and one.begun:
            self._unwanted.add(one.action.id)
            if self._bridge.up:
                self._tasks.spawn(self.cancel(one.action.id))
        self._end(one, ActionStatus(id=one.action.id, state=state, result=False, cause=cause, reason=why, name=name))

    def _end(self, one: _Request, status: ActionStatus) -> None:
        """Report the end of an action, behind the percepts that it refers to."""

        def report() -> None:
            if self._closed:
                return
            self.counters[status.state] += 1
            try:
                one.on_end(status)
            except Exception as defect:  # the other actions are looked at nevertheless
                what = {"message": f"reporting the end of action {one.action.name}", "exception": defect}
                self._loop.call_exception_handler(what)

        self._forget(one.action.id)
        if status.after is None:
            report()
        else:
            self._perceiving.when_seen(status.header.boot, status.after, AFTER_PATIENCE, report)

    def _cancel_unwanted(self) -> None:
        """Cancel what has failed for the agent without the bridge's word: it would hinder what the agent does next."""
        for identity in self._unwanted:
            self._tasks.spawn(self.cancel(identity))

    async def cancel(self, identity: str) -> None:
        """Ask the bridge to end an action that the agent has dropped, and do not repeat its query.

        A bridge that is away is asked again when it is back.
        """
        self._unwanted.add(identity)
        if (one := self._running.get(identity)) is not None:
            one.wanted = False
        key = keys.cancel(self._bus.fleet, self._agent)
        loop = asyncio.get_running_loop()
        began = loop.time()
        while loop.time() < min(max(began, self._bridge.router_since) + BUS_GRACE, began + ACCEPT_PATIENCE):
            with suppress(BusError):
                request = Cancel(header=self._bus.header("cancel", self._agent), id=identity)
                await self._bus.ask_one(key, request, ActionStatus, ACTION_ASKED_AGAIN)
                self._unwanted.discard(identity)
                return
            await asyncio.sleep(RETRY)
        self.counters["cancels_unanswered"] += 1
        log.warning("cancel_unanswered id=%s", identity)


def describe(status: ActionStatus) -> str:
    """Return the outcome of an action as one line, for logs."""
    return f"action={status.name} id={status.id} state={status.state} {status.reason}".rstrip()
