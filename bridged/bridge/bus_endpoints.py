"""The bridge on the bus: percepts put and repaired, actions, cancels and stops answered (design sections 4 and 5)."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Iterable
from contextlib import suppress
from functools import partial

import zenoh
from msgspec.structs import replace

from bridged.bridge.action_server import ActionServer
from bridged.bridge.live_manifest import RunningManifest
from bridged.bridge.percepts import PerceptPublisher
from bridged.bridge.safety_orders import SafetyOrders, by_operator
from bridged.drivers.api import Order
from bridged.drivers.api import Outcome as OfOrder
from bridged.drivers.argument_check import signature
from commd.bus.bus import Bus, Query
from schemas.manifest.loader import ActionDescription, Manifest
from schemas.manifest.rules import BRIDGE_ACTIONS
from schemas.wire import keys
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import (
    Action,
    ActionStatus,
    Cancel,
    LiveManifest,
    ManifestChange,
    Outcome,
    Perception,
    StopOrder,
)

ACTION_BYTES = 128 * 1024
"""A larger request is refused unread: a mission of 700 items, each of eight long numbers, has 100 kB."""
FOLLOW_AT_MOST = 3600.0
"""Wall seconds for which a query follows an action; who waits longer asks again with the same id."""
BY_HAND = "asked by hand, which this mission does not allow; say `inject: true` in the mission file to allow it"
log = logging.getLogger("bridged")


class Service:
    """Answers for one robot under the names of its agents."""

    def __init__(self, bus: Bus, robot: str, agents: Iterable[str], inject: bool = False) -> None:
        """`inject`: the mission allows actions by hand."""
        self._bus, self._robot = bus, robot
        self._agents, self._inject = tuple(agents), inject
        self._stops = 0
        """Orders that have arrived and are not begun."""

    def publish_percept(self, agent: str, perception: Perception) -> None:
        """Put one change of what an agent perceives."""
        self._bus.put(keys.percept(self._bus.fleet, agent, perception.name), perception)

    def publish_status(self, agent: str, status: ActionStatus) -> None:
        """Put a status for observers, after the agent's own answer has been sent."""
        key = keys.status(self._bus.fleet, agent, status.name)
        asyncio.get_running_loop().call_soon(self._bus.put, key, status)

    def open(
        self, percepts: PerceptPublisher, action_server: ActionServer, orders: SafetyOrders, live: RunningManifest
    ) -> None:
        """Begin to serve. Orders and manifest changes are served as actions are, in the order of arrival: an
        action behind a stop is refused."""
        bus, fleet = self._bus, self._bus.fleet
        for agent in self._agents:
            bus.serve(keys.percept(fleet, agent, "**"), Perception, partial(self._repair, agent, percepts.sets[agent]))
            bus.serve(
                keys.action(fleet, agent, "*"),
                Action,
                partial(self._act, agent, action_server, live),
                at_most=ACTION_BYTES,
            )
            cancel = partial(self._cancel, agent, action_server)
            bus.serve(
                keys.cancel(fleet, agent),
                Cancel,
                cancel,
                urgent=True,
            )
        change = partial(self._read_or_change, live)
        bus.serve(
            keys.manifest(fleet, self._robot),
            ManifestChange,
            change,
        )
        stop = partial(self._stop, action_server, orders)
        bus.serve(
            keys.stop(fleet, self._robot),
            StopOrder,
            stop,
            urgent=True,
        )

    async def _repair(self, agent: str, present: PerceptSet, query: Query[Perception]) -> None:
        """Answer with every present belief of an agent that the query asks for, each on its own key."""
        asked = zenoh.KeyExpr(query.key)
        for perception in present.snapshot():
            key = keys.percept(self._bus.fleet, agent, perception.name)
            if asked.intersects(zenoh.KeyExpr(key)):
                query.reply(perception, key)

    def _act(
        self, agent: str, action_server: ActionServer, live: RunningManifest, query: Query[Action]
    ) -> Awaitable[None] | None:
        """Carry out a valid request on a concrete key; answer any other query with descriptions of actions."""
        if not query.concrete or query.record is None:
            self._describe(agent, live.manifest, query)
            return None
        name = query.key.rpartition("/")[2]
        following = _Following(query)
        if self._inject or not is_by_hand(agent, query.record):
            action_server.ask(agent, name, query.record, following.hear)
        else:
            action_server.turn_away(agent, name, query.record, BY_HAND, following.hear)
        return following.to_its_end()

    def _describe(self, agent: str, manifest: Manifest, query: Query[Action]) -> None:
        asked = zenoh.KeyExpr(query.key)
        for name, entry in (manifest.actions | BRIDGE_ACTIONS).items():
            key = keys.action(self._bus.fleet, agent, name)
            if asked.intersects(zenoh.KeyExpr(key)):
                description = ActionDescription(
                    name=name,
                    signature=signature(name, entry),
                    confirm=entry.confirm,
                    deadline=float(entry.deadline),
                    problem=query.error,
                )
                query.reply(description, key)

    def _cancel(self, agent: str, action_server: ActionServer, query: Query[Cancel]) -> None:
        if query.record is None or not query.concrete:
            query.reply_error(query.error or 'expected the id of an action: {"id": "..."}')
            return
        by = query.record.header.source
        if self._inject or by == agent:
            query.reply(action_server.cancel(agent, query.record.id, by or "hand"))
        else:
            query.reply(action_server.leave(agent, query.record.id, BY_HAND))

    def _read_or_change(self, live: RunningManifest, query: Query[ManifestChange]) -> None:
        """Answer with the running manifest, after the change in the query, if there is one."""
        key = keys.manifest(self._bus.fleet, self._robot)
        if query.error or (query.record is not None and not query.concrete):
            query.reply_error(query.error or "a change is for one robot: ask on its own key")
            return
        problems: list[str] = []
        if query.record is not None:
            problems = live.change(query.record)
            log.info("robot=%s manifest: %s", self._robot, "; ".join(problems) or f"version {live.version}")
            if not problems:
                self._bus.put(key, self._told(live))
        query.reply(self._told(live, problems), key)

    def _told(self, live: RunningManifest, problems: Iterable[str] = ()) -> LiveManifest:
        return replace(live.told(self._robot, problems), header=self._bus.header("manifest", self._robot))

    def _stop(
        self, action_server: ActionServer, orders: SafetyOrders, query: Query[StopOrder]
    ) -> Awaitable[None] | None:
        """Block actions and carry the order out; or release them; or pause and continue."""
        if query.record is None or not query.concrete:
            query.reply_error(
                query.error or 'expected an order: {"order": "hold"}, land, rtl, release, pause or continue'
            )
            return None
        order = query.record.order
        if order == "pause":
            return self._answer(orders.pause(), query)
        if order == "continue":
            return self._answer(orders.resume(), query)
        if order == "release":
            if self._stops:  # one that came before it: it has its turn first
                return self._release(orders, query)
            _tell_outcome(query, orders.release())
            return None
        action_server.block(by_operator(order))
        self._stops += 1
        return self._carry_out(orders, order, query)

    async def _release(self, orders: SafetyOrders, query: Query[StopOrder]) -> None:
        _tell_outcome(query, orders.release())

    async def _answer(self, outcome: Awaitable[OfOrder], query: Query[StopOrder]) -> None:
        _tell_outcome(query, await outcome)

    async def _carry_out(self, orders: SafetyOrders, order: Order, query: Query[StopOrder]) -> None:
        self._stops -= 1
        _tell_outcome(query, await orders.operator(order))


def _tell_outcome(query: Query[StopOrder], outcome: OfOrder) -> None:
    query.reply(Outcome(ok=outcome.state == "succeeded", reason=outcome.reason))


class _Following:
    """Replies to one query with each status of its action, without waiting for anything else."""

    def __init__(self, query: Query[Action]) -> None:
        self._query = query
        self._first: ActionStatus | None = None
        """A status from within the request itself; not sent if the action is over when the request returns."""
        self._asked = False
        self._ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def hear(self, status: ActionStatus | None) -> None:
        """Take in a status; None: a newer query takes the place. Never raises."""
        if self._ended.done():
            return
        try:
            if status is not None and not status.final and not self._asked:
                self._first = status
                return
            if status is not None:
                self._query.reply(status)
            if status is None or status.final:
                self._ended.set_result(None)
        except Exception as error:  # a status that cannot be sent must not fail its publisher
            self._ended.set_exception(error)

    def to_its_end(self) -> Awaitable[None] | None:
        """Return the wait for the end of the action, None if it has ended. Raises what was wrong with a status."""
        self._asked = True
        if self._first is not None:
            self.hear(self._first)
        if self._ended.done():
            self._ended.result()
            return None
        return self._wait()

    async def _wait(self) -> None:
        """Wait for the end, for `FOLLOW_AT_MOST` at most."""
        with suppress(TimeoutError):
            async with asyncio.timeout(FOLLOW_AT_MOST):
                await self._ended


def is_by_hand(agent: str, request: Action) -> bool:
    """Whether a request is not the agent's own: an agent gives its requests an id and its name as source."""
    return not (request.id and request.header.source == agent)
