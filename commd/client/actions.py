"""Request an action once, and follow it to its final status."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable
from contextlib import aclosing, suppress

from msgspec.structs import replace

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError
from commd.client.percept_sync import PerceptSync
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
        self._wanted: dict[str, bool] = {}
        """Running actions, and whether the agent still wants them."""
        self._timers: set[asyncio.Timeout] = set()
        """Of the queries that wait for replies."""
        bridge.fell_silent.append(self._give_up)

    async def perform(
        self,
        action: Action,
        patience: float = ACCEPT_PATIENCE,
        on_status: Callable[[ActionStatus], None] | None = None,
        kept: asyncio.Future[None] | None = None,
    ) -> ActionStatus:
        """Request an action and return its final status; the bridge has `patience` wall seconds to accept it.

        The query is repeated with the same id after `ACTION_ASKED_AGAIN` without a status, and when the router is lost
        or back; the bridge joins it to the running action, or replies how that ended. Never raises, and always ends:
        the action has failed after `BUS_GRACE` without a status, and after the bridge's deadline. `on_status` is called
        with each status before the final one. An `attempt` above 1 follows a request of an earlier process: the bridge
        starts nothing, and refuses an unknown id. `kept` is awaited before the first query.
        """
        self._wanted[action.id] = True
        try:
            status = await self._follow(action, patience, on_status, kept)
        finally:
            del self._wanted[action.id]
        if status.after is not None:
            await self._perceiving.seen(status.header.boot, status.after, AFTER_PATIENCE)
        self.counters[status.state] += 1
        return status

    async def _follow(
        self,
        action: Action,
        patience: float,
        on_status: Callable[[ActionStatus], None] | None,
        kept: asyncio.Future[None] | None,
    ) -> ActionStatus:
        loop, reason = asyncio.get_running_loop(), "bridge_lost: nobody serves this action"
        key, attempt, heard = keys.action(self._bus.fleet, self._agent, action.name), action.attempt, loop.time()
        until, late = heard + patience, f"the bridge has not taken it within {patience:g} s"

        def ended(state: State, cause: Cause, why: str) -> ActionStatus:
            return ActionStatus(id=action.id, state=state, result=False, cause=cause, reason=why, name=action.name)

        def failed(why: str) -> ActionStatus:
            return ended("failed", "unreachable", why)

        async def ready() -> bool:
            if kept is not None:
                await kept
            timer.reschedule(min(until, loop.time() + ACTION_ASKED_AGAIN))
            return self._wanted[action.id]  # the agent may have dropped it meanwhile

        while True:
            taken = silent = False
            if not self._wanted[action.id]:  # repeated now, it could begin after its cancellation
                return ended("cancelled", "cancelled", "the agent has dropped it")
            if self._bridge.hangs:
                return failed(_HANGS)
            request = replace(action, header=self._bus.header("action", self._agent), attempt=attempt)
            try:
                async with (
                    asyncio.timeout_at(until) as timer,
                    aclosing(self._bus.query(key, request, ActionStatus, QUERY_TIMEOUT, ready=ready)) as replies,
                ):
                    self._timers.add(timer)
                    async for reply in replies:
                        if reply.record is None:
                            reason = reply.error
                            continue
                        if reply.record.final:
                            return reply.record
                        heard, taken = loop.time(), True
                        if on_status is not None:
                            on_status(reply.record)
                        if reply.record.deadline is not None:
                            until = heard + self._to_wall(reply.record.deadline) + ASKERS_MARGIN
                            late = "no outcome within its deadline"
                        timer.reschedule(min(until, heard + ACTION_ASKED_AGAIN))
                        reason = "bridge_lost: its answers ended without an outcome"
                    if not taken and not self._wanted[action.id]:
                        return ended("cancelled", "cancelled", "the agent has dropped it")
            except BadRecord as bad:
                return ended("failed", "request", f"cannot be sent: {bad}")
            except BusClosed as closed:
                reason = f"bridge_lost: {closed}"
            except TimeoutError:
                if self._bridge.hangs:
                    return failed(_HANGS)
                silent = True  # the query is broken, or the bridge is busy; its health shows whether it hangs
            finally:
                self._timers.discard(timer)
            if self._bridge.gone:
                return failed("bridge_lost: the bridge of this robot is not running")
            if loop.time() >= until:
                return failed(late)
            if not silent and loop.time() - max(heard, self._bridge.router_since) > BUS_GRACE:
                return failed(reason if self._bus.router_up else "bridge_lost: no router")
            attempt += taken  # a request without any reply may not have arrived: it must still begin
            self.counters["asked_again"] += 1
            await asyncio.sleep(RETRY)

    def _give_up(self) -> None:
        """End all waiting: the bridge hangs."""
        for timer in [timer for timer in self._timers if not timer.expired()]:
            timer.reschedule(asyncio.get_running_loop().time())

    async def cancel(self, identity: str) -> None:
        """Ask the bridge to end an action that the agent has dropped, and do not repeat its query."""
        if identity in self._wanted:
            self._wanted[identity] = False
        key = keys.cancel(self._bus.fleet, self._agent)
        loop = asyncio.get_running_loop()
        began = loop.time()
        while loop.time() < min(max(began, self._bridge.router_since) + BUS_GRACE, began + ACCEPT_PATIENCE):
            with suppress(BusError):
                request = Cancel(header=self._bus.header("cancel", self._agent), id=identity)
                await self._bus.ask_one(key, request, ActionStatus, ACTION_ASKED_AGAIN)
                return
            await asyncio.sleep(RETRY)
        self.counters["cancels_unanswered"] += 1
        log.warning("cancel_unanswered id=%s", identity)


def describe(status: ActionStatus) -> str:
    """Return the outcome of an action as one line, for logs."""
    return f"action={status.name} id={status.id} state={status.state} {status.reason}".rstrip()
