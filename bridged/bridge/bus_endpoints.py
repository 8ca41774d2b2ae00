"""The bridge on the bus (design sections 4 and 5): percepts put and repaired; actions, cancels and stops answered, and
what operators read and set of a vehicle: its parameters and its stored mission.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Coroutine, Iterable
from contextlib import suppress
from dataclasses import replace as replaced
from functools import partial
from typing import Any

import zenoh
from msgspec.structs import replace

from bridged.bridge.bridge import Bridge
from bridged.bridge.safety_orders import by_operator
from bridged.drivers.api import Driver, Execution, Outcome, VehicleStore
from bridged.drivers.argument_check import signature
from commd.bus.bus import Bus, Query
from commd.bus.errors import CannotServe
from commd.common.tasks import wait_at_most
from schemas.liveness import STATUS_EVERY
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
    Perception,
    Perceptions,
    StopOrder,
)
from schemas.wire.records import Outcome as OutcomeRecord
from schemas.wire.vehicle_records import ParameterRequest, PlanItem, StoredPlan, VehicleParameters

ACTION_BYTES = 128 * 1024
"""A larger request is refused unread: a mission of 700 items, each of eight long numbers, has 100 kB."""
FOLLOW_AT_MOST = 3600.0
"""Wall seconds for which a query follows an action; who waits longer asks again with the same id."""
REQUEST_AT_MOST = 300.0
"""Wall seconds of one request about a vehicle. A driver gives up earlier a vehicle that falls silent."""
REQUEST_BYTES = 1000
"""A larger one of these is refused unread."""
BY_HAND = "a parameter is set by hand, which this mission does not allow; `inject: true` in the mission file allows it"
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
        self._serving: list[Callable[[], None]] = []
        """What ends each kind of answers."""
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
            self._serving += (
                bus.serve(keys.percept(fleet, agent, "**"), Perception, partial(self._repair, agent)),
                bus.serve(keys.action(fleet, agent, "*"), Action, partial(self._act, agent), at_most=ACTION_BYTES),
                bus.serve(keys.cancel(fleet, agent), Cancel, partial(self._cancel, agent), urgent=True),
            )
        self._serving += (
            bus.serve(keys.manifest(fleet, self._robot), ManifestChange, self._read_or_change),
            *VehicleRequests(bus, self._robot, bridge.driver.own, self._inject).open(),
            bus.serve(keys.stop(fleet, self._robot), StopOrder, self._stop, urgent=True),
        )

    def close(self) -> None:
        """Answer no more queries: another bridge of the robot does."""
        while self._serving:
            self._serving.pop()()

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
        name, robot = query.key.rpartition("/")[2], query.record.robot
        if robot not in (None, self._robot):  # by an edited mission: the other one's bridge answers
            log.warning("robot=%s action %s of %s ignored: it is for the robot %s", self._robot, name, agent, robot)
            return None
        ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        def reply(status: ActionStatus | None) -> None:
            """Reply a status without waiting for anything else; None: a newer query takes the place. Never raises."""
            if ended.done():
                return
            try:
                if status is not None:
                    self.put_percepts()
                    query.reply(status)
                if status is None or status.final:
                    ended.set_result(None)
            except Exception as error:  # a status that cannot be sent must not fail its publisher
                ended.set_exception(error)

        self._bridge.action_server.ask(agent, name, query.record, reply, inject=self._inject)
        return ended.result() if ended.done() else _end_of(ended)

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


def _tell_outcome(query: Query[StopOrder], outcome: Outcome) -> None:
    query.reply(OutcomeRecord(ok=outcome.state == "succeeded", reason=outcome.reason))


async def _end_of(action: asyncio.Future[None]) -> None:
    """Wait for the end of an action, for `FOLLOW_AT_MOST` at most. Raises what was wrong with a status."""
    with suppress(TimeoutError):
        async with asyncio.timeout(FOLLOW_AT_MOST):
            await action


Progress = tuple[type[VehicleParameters] | type[StoredPlan], str, str]
"""The record that tells the progress of a request, and the figures of an execution for its fields `came` and `of`."""
PARAMETERS: Progress = (VehicleParameters, "params", "of")
ITEMS: Progress = (StoredPlan, "item", "items")


class VehicleRequests:
    """Answers for the vehicle of one robot."""

    def __init__(self, bus: Bus, robot: str, driver: Driver, inject: bool) -> None:
        """`inject`: the mission allows what is done by hand."""
        self._bus, self._robot, self._driver, self._inject = bus, robot, driver, inject
        self._busy = False
        """A request is being carried out; another one would share its link."""

    def open(self) -> tuple[Callable[[], None], ...]:
        """Begin to serve. Returns what ends that."""
        bus, most = self._bus, REQUEST_BYTES
        return (
            bus.serve(keys.parameters(bus.fleet, self._robot), ParameterRequest, self._parameters, at_most=most),
            bus.serve(keys.stored_plan(bus.fleet, self._robot), StoredPlan, self._plan, at_most=most),
        )

    async def _parameters(self, query: Query[ParameterRequest]) -> None:
        """Answer with all parameters, or set the one of the request: then the last reply has its value."""
        if query.error:
            raise CannotServe(query.error)
        request, values = query.record, dict[str, float]()
        if request is None:
            outcome = await self._follow(query, lambda store: store.read_parameters(values), PARAMETERS)
        else:
            outcome = await self._set(query, request)
            values = {request.name: request.value}
        succeeded = outcome.state == "succeeded"
        finite = {name: value for name, value in sorted(values.items()) if succeeded and math.isfinite(value)}
        query.reply(
            VehicleParameters(
                header=self._bus.header("parameters", self._robot),
                values=finite,
                left_out=tuple(sorted(values.keys() - finite.keys())) if succeeded else (),
                came=len(values),
                of=len(values),
                done=True,
                problem="" if succeeded else outcome.reason,
                cause=None if succeeded else outcome.cause,
            )
        )

    async def _set(self, query: Query[ParameterRequest], request: ParameterRequest) -> Outcome:
        """Set a parameter if the mission allows it, and log how that ended."""
        name, value, allow = request.name, request.value, request.allow_safety
        if self._inject:
            outcome = await self._follow(
                query, lambda store: store.set_parameter(name, value, allow_safety=allow), PARAMETERS
            )
        else:
            outcome = Outcome("refused", BY_HAND, "rights")
        ended = f"{outcome.state} {outcome.reason}".rstrip()
        log.info("robot=%s parameter %s = %g by hand: %s", self._robot, name, value, ended)
        return outcome

    async def _plan(self, query: Query[StoredPlan]) -> None:
        """Answer with the mission that the vehicle stores."""
        items: list[PlanItem] = []
        outcome = await self._follow(query, lambda store: store.read_plan(items), ITEMS)
        succeeded = outcome.state == "succeeded"
        autopilot, vehicle = self._driver.identified_as if isinstance(self._driver, VehicleStore) else (0, 0)
        query.reply(
            StoredPlan(
                header=self._bus.header("stored_plan", self._robot),
                items=tuple(items) if succeeded else (),
                autopilot=autopilot,
                vehicle=vehicle,
                came=len(items),
                of=len(items),
                done=True,
                problem="" if succeeded else outcome.reason,
            )
        )

    async def _follow(
        self, query: Query[Any], begin: Callable[[VehicleStore], Execution], progress: Progress
    ) -> Outcome:
        """Begin an execution and reply its progress until its end. Raises CannotServe if the driver has none."""
        driver = self._driver
        if not isinstance(driver, VehicleStore):
            raise CannotServe("its driver knows no parameters and no stored mission")
        if not query.concrete:
            raise CannotServe("expected the key of one robot")
        if not driver.heard:
            return Outcome("refused", "the vehicle is not heard", "link")
        if self._busy:
            return Outcome("refused", "another request of an operator is being carried out; try again later", "busy")
        self._busy = True
        try:
            execution, ended = begin(driver), asyncio.Event()
            execution.on_end(ended.set)
            with suppress(TimeoutError):
                async with asyncio.timeout(REQUEST_AT_MOST):
                    while not ended.is_set():
                        if not await wait_at_most(ended, STATUS_EVERY):
                            figures, (kind, came, of) = execution.feedback, progress
                            query.reply(kind(came=int(figures.get(came, 0)), of=int(figures.get(of, 0))))
            waited = f"; it waited for {execution.waits_for}" if execution.waits_for else ""
            late = Outcome("timed_out", f"not done within {REQUEST_AT_MOST:g} s{waited}", "deadline")
            if not execution.over:
                driver.stop(execution, late, hold=False)
            outcome = execution.outcome or late
            if outcome.order:
                outcome = replaced(outcome, reason=f"it ended, as the robot was ordered ({outcome.reason}); ask again")
            return outcome
        finally:
            self._busy = False
