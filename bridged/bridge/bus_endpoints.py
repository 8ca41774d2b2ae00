"""The bridge on the bus: percepts put and repaired, actions, cancels and stops answered (design sections 4 and 5)."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Iterable
from contextlib import suppress
from functools import partial
from typing import Any

import zenoh
from msgspec.structs import replace

from bridged.bridge.bridge import Bridge
from bridged.bridge.safety_orders import by_operator
from bridged.bridge.vehicle_requests import VehicleRequests
from bridged.drivers.api import Outcome as OfOrder
from bridged.drivers.argument_check import signature
from commd.bus.bus import Bus, Query
from commd.bus.errors import CannotServe
from schemas.manifest.loader import ActionDescription
from schemas.manifest.rules import BRIDGE_ACTIONS
from schemas.wire import keys
from schemas.wire.records import (
    Action,
    ActionStatus,
    Cancel,
    Health,
    LiveManifest,
    ManifestChange,
    OperatorOrder,
    Outcome,
    Perception,
    Perceptions,
    StopOrder,
)

ACTION_BYTES = 128 * 1024
"""A larger request is refused unread: a mission of 700 items, each of eight long numbers, has 100 kB."""
FOLLOW_AT_MOST = 3600.0
"""Wall seconds for which a query follows an action; who waits longer asks again with the same id."""
log = logging.getLogger("bridged")


class Service:
    """Answers for one robot under the names of its agents."""

    def __init__(self, bus: Bus, robot: str, agents: Iterable[str], inject: bool = False) -> None:
        """`inject`: the mission allows actions by hand."""
        self._bus, self._robot = bus, robot
        self._agents, self._inject = tuple(agents), inject
        of_agent = ((agent, keys.percepts(bus.fleet, agent)) for agent in self._agents)
        self._percepts = {agent: (key, bus.raw.publisher(key)) for agent, key in of_agent}
        self._changes: dict[str, list[Perception]] = {}
        """What was published and is not put yet, by agent."""
        self._observed: set[str] = set()
        """Agents whose percepts somebody subscribes to by their names."""
        for agent in self._agents:
            bus.listened(keys.percept(bus.fleet, agent, "*"), partial(self._observe, agent))
        self._statuses = {agent: bus.raw.publisher(keys.status(bus.fleet, agent, "*")) for agent in self._agents}
        self._stops = 0
        """Orders that have arrived and are not begun."""

    def _observe(self, agent: str, somebody: bool) -> None:
        (self._observed.add if somebody else self._observed.discard)(agent)

    def publish_percept(self, agent: str, change: Perception) -> None:
        """Put a change of what an agent perceives in the next pass of the loop, or before a record that refers to it.

        What one pass has read goes out together, for all robots of the process: one wake-up of Zenoh's thread, of the
        router and of the agents' daemon serves all of it.
        """
        if not self._changes:
            asyncio.get_running_loop().call_soon(self.put_percepts)
        self._changes.setdefault(agent, []).append(change)

    def put_percepts(self) -> None:
        """Put all changes so far: those of an agent together, and each by its name while somebody subscribes to it."""
        made, self._changes = self._changes, {}
        for agent, changes in made.items():
            key, publisher = self._percepts[agent]
            self._bus.put(key, Perceptions(changes=tuple(changes)), publisher=publisher)
            if agent in self._observed:
                for perception in changes:
                    self._bus.put(keys.percept(self._bus.fleet, agent, perception.name), perception)

    def health(self) -> Health:
        """Return the bridge's health, of which the percepts are those that were put."""
        self.put_percepts()
        return self._bridge.health()

    def publish_status(self, agent: str, status: ActionStatus) -> None:
        """Put a status for observers, if there are any, after the percepts that it refers to.

        Zenoh is asked each time: it tells of a new subscriber later than of the action that this one asks for next.
        """
        if self._statuses[agent].matching:
            self.put_percepts()
            self._bus.put(keys.status(self._bus.fleet, agent, status.name), status)

    def open(self, bridge: Bridge) -> None:
        """Begin to serve. Orders and manifest changes are served as actions are, in the order of arrival: an
        action behind a stop is refused."""
        self._bridge, bus, fleet = bridge, self._bus, self._bus.fleet
        for agent in self._agents:
            bus.serve(keys.percept(fleet, agent, "**"), Perception, partial(self._repair, agent))
            bus.serve(keys.action(fleet, agent, "*"), Action, partial(self._act, agent), at_most=ACTION_BYTES)
            bus.serve(keys.cancel(fleet, agent), Cancel, partial(self._cancel, agent), urgent=True)
        bus.serve(keys.manifest(fleet, self._robot), ManifestChange, self._read_or_change)
        VehicleRequests(bus, self._robot, bridge.driver.own, self._inject).open()
        bus.serve(keys.stop(fleet, self._robot), StopOrder, self._stop, urgent=True)

    async def _repair(self, agent: str, query: Query[Perception]) -> None:
        """Answer with every present belief of an agent that the query asks for, each on its own key."""
        asked = zenoh.KeyExpr(query.key)
        self.put_percepts()
        for perception in self._bridge.percepts.sets[agent].snapshot():
            key = keys.percept(self._bus.fleet, agent, perception.name)
            if asked.intersects(zenoh.KeyExpr(key)):
                query.reply(perception, key)

    def _act(self, agent: str, query: Query[Action]) -> Coroutine[Any, Any, None] | None:
        """Carry out a valid request on a concrete key; answer any other query with descriptions of actions."""
        if not query.concrete or query.record is None:
            self._describe(agent, query)
            return None
        name = query.key.rpartition("/")[2]
        following = _Following(query, self.put_percepts)
        self._bridge.action_server.ask(agent, name, query.record, following.hear, inject=self._inject)
        return following.ended.result() if following.ended.done() else following.wait()

    def _describe(self, agent: str, query: Query[Action]) -> None:
        asked = zenoh.KeyExpr(query.key)
        for name, entry in (self._bridge.live.manifest.actions | BRIDGE_ACTIONS).items():
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

    def _cancel(self, agent: str, query: Query[Cancel]) -> None:
        cancel = query.required('expected the id of an action: {"id": "..."}')
        status = self._bridge.action_server.cancel(agent, cancel.id, cancel.header.source, inject=self._inject)
        self.put_percepts()
        query.reply(status)

    def _read_or_change(self, query: Query[ManifestChange]) -> None:
        """Answer with the running manifest, after the change in the query, if there is one."""
        key, live = keys.manifest(self._bus.fleet, self._robot), self._bridge.live
        if query.error or (query.record is not None and not query.concrete):
            raise CannotServe(query.error or "a change is for one robot: ask on its own key")
        problems: list[str] = []
        if query.record is not None:
            problems = live.change(query.record)
            log.info("robot=%s manifest: %s", self._robot, "; ".join(problems) or f"version {live.version}")
            if not problems:
                self._bus.put(key, self._told())
        query.reply(self._told(problems), key)

    def _told(self, problems: Iterable[str] = ()) -> LiveManifest:
        told = self._bridge.live.told(self._robot, problems)
        return replace(told, header=self._bus.header("manifest", self._robot))

    def _stop(self, query: Query[StopOrder]) -> Coroutine[Any, Any, None] | None:
        """Block actions and carry the order out; or release them; or pause and continue."""
        asked = query.required('expected an order: {"order": "hold"}, land, rtl, release, pause or continue')
        match asked.order:
            case "release" if not self._stops:
                _tell_outcome(query, self._bridge.orders.release())
                return None
            case "hold" | "land" | "rtl" as order:
                self._bridge.action_server.block(by_operator(order))
                self._stops += 1
        return self._carry_out(query, asked.order)

    async def _carry_out(self, query: Query[StopOrder], order: OperatorOrder) -> None:
        """Carry out an order of the operator in its turn: a release after the orders that came before it."""
        orders = self._bridge.orders
        match order:
            case "release":
                outcome = orders.release()
            case "pause":
                outcome = await orders.pause()
            case "continue":
                outcome = await orders.resume()
            case "hold" | "land" | "rtl":
                self._stops -= 1
                outcome = await orders.operator(order)
        _tell_outcome(query, outcome)


def _tell_outcome(query: Query[StopOrder], outcome: OfOrder) -> None:
    query.reply(Outcome(ok=outcome.state == "succeeded", reason=outcome.reason))


class _Following:
    """Replies to one query with each status of its action, without waiting for anything else."""

    def __init__(self, query: Query[Action], put_percepts: Callable[[], None]) -> None:
        """`put_percepts` puts those that a status refers to."""
        self._query, self._put_percepts = query, put_percepts
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done when the action has ended; its exception is what was wrong with a status."""

    def hear(self, status: ActionStatus | None) -> None:
        """Take in a status; None: a newer query takes the place. Never raises."""
        if self.ended.done():
            return
        try:
            if status is not None:
                self._put_percepts()
                self._query.reply(status)
            if status is None or status.final:
                self.ended.set_result(None)
        except Exception as error:  # a status that cannot be sent must not fail its publisher
            self.ended.set_exception(error)

    async def wait(self) -> None:
        """Wait for the end of the action, for `FOLLOW_AT_MOST` at most. Raises what was wrong with a status."""
        with suppress(TimeoutError):
            async with asyncio.timeout(FOLLOW_AT_MOST):
                await self.ended
