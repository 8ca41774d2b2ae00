"""Fills the model of a fleet from the bus: subscribes, and asks minds and boards now and then. It gives no orders."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field

from argosy.cli.operator_bus import ANY
from argosy.fleet_model.model import FleetModel, named
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError, QueryTimeout
from schemas.liveness import MIND_EVERY
from schemas.wire import keys
from schemas.wire.mind_records import MindActivity, MindView
from schemas.wire.records import (
    ActionStatus,
    BoardServices,
    Health,
    Mailboxes,
    Perception,
    Perceptions,
    RunningMission,
    RunState,
)

TICK = 0.25
"""Wall seconds between two updates of the model and of who is to be asked."""
DETAIL, MAIL = 0.5, 2.0
"""Wall seconds between two requests for a mind that is looked at, and for the mailboxes."""
DECISIONS = 30
"""Decisions that a detailed view is asked for."""
ANSWER_TIMEOUT = 2.0
"""Wall seconds."""
AT_ONCE = 32
"""Minds that are asked at the same time."""


@dataclass(frozen=True)
class Wanted:
    """What an observer asks for besides vehicles, actions and health."""

    minds_every: float = MIND_EVERY
    """Wall seconds between two requests for each mind that nobody looks at."""
    beliefs_per_tick: int = 0
    """Minds that are asked for their beliefs, too, per tick: few, so that a large fleet is not loaded by it."""
    beliefs_about: Mapping[str, str] = field(default_factory=dict)
    """Minds that are asked for their beliefs each time, and of what functor; empty: of any."""
    whole_fleet: bool = True
    """Activity, messages, mailboxes, directories, the mission and the run."""


class FleetObserver:
    """Keeps a model up to date while the bus is open, and after the router was away."""

    def __init__(self, bus: Bus, model: FleetModel, fleet: str = ANY, wanted: Wanted = Wanted()) -> None:
        """`fleet` may be `ANY`: then the first fleet that is heard is observed."""
        self.bus, self.model, self.wanted = bus, model, wanted
        self.looked_at: Counter[str] = Counter()
        """Agents whose minds are asked often and for all details, and by how many viewers."""
        self.asks_minds = True
        """Off while the load of idle daemons is measured."""
        self._tasks: list[asyncio.Task[None]] = []
        self._asking: dict[str, asyncio.Task[None]] = {}
        self._due: dict[str, float] = {}
        self._beliefs_asked: dict[str, float] = {}
        self._news = asyncio.Event()
        """Set when a daemon came that has percepts to publish, or through which they come."""
        if bus.router_up:
            model.router(up=True)
        bus.on_router(model.router)
        model.fleet = model.fleet or ("" if fleet == ANY else fleet)
        bus.watch(keys.alive(model.fleet or ANY, "*", "*", "*"), self._token)
        if model.fleet:
            self._listen()

    def look_at(self, agent: str) -> None:
        """Ask for this mind often and with all details."""
        self.looked_at[agent] += 1
        self._due[agent] = 0.0

    def look_away(self, agent: str) -> None:
        """End one `look_at`."""
        self.looked_at[agent] -= 1
        if self.looked_at[agent] <= 0:
            del self.looked_at[agent]

    def start(self) -> None:
        """Begin to ask, and to update the model."""
        works = [self._tick, self._repair, *([self._mail] if self.wanted.whole_fleet else [])]
        self._tasks = [asyncio.create_task(work()) for work in works]

    async def stop(self) -> None:
        """End all requests."""
        for task in (tasks := [*self._tasks, *self._asking.values()]):
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def look_at_percepts(self) -> None:
        """Take the percepts that are present: those that were published before the subscription."""
        model = self.model
        with suppress(BusClosed):
            await self.bus.ask_all(keys.percept(model.fleet, "*", "**"), Perception, ANSWER_TIMEOUT, model.percept)

    def _token(self, key: str, alive: bool) -> None:
        parsed = named(key)
        if not self.model.fleet and parsed is not None and alive:
            self.model.fleet = parsed[0]
            self._listen()
        self.model.token(key, alive)
        if alive and ("/alive/bridged/" in key or "/alive/commd/" in key):
            self._news.set()

    def _listen(self) -> None:
        fleet, model, subscribe = self.model.fleet, self.model, self.bus.subscribe
        subscribe(keys.health(fleet, "*", "*"), Health, self._health)
        subscribe(keys.percepts(fleet, "*"), Perceptions, model.percepts)
        subscribe(keys.percept_by_hand(fleet, "*", "*"), Perception, model.percept)
        subscribe(keys.status(fleet, "*", "*"), ActionStatus, model.status)
        if self.wanted.whole_fleet:
            subscribe(keys.trace(fleet, "*", "activity"), MindActivity, model.activity)
            subscribe(keys.services(fleet, "*"), BoardServices, model.services)
            subscribe(keys.run(fleet, "*"), RunState, model.run_published)

    def _health(self, key: str, health: Health) -> None:
        robot_seen_by = self.model.roster.robot_seen_by
        self.model.health(key, health)
        if self.model.roster.robot_seen_by != robot_seen_by:
            self._news.set()

    async def _tick(self) -> None:
        while True:
            try:
                self.model.tick()
                if self.asks_minds:
                    self._ask_due_minds(time.monotonic())
                self.model.defect = ""
            except Exception as error:  # reported where it is seen: silence would look like a fleet at rest
                self.model.defect = f"who is there is not known any more: {type(error).__name__}: {error}"
            await asyncio.sleep(TICK)

    def _ask_due_minds(self, now: float) -> None:
        every, due = self.wanted.minds_every, list[str]()
        for place, (name, agent) in enumerate(self.model.agents.items()):
            at = self._due.setdefault(name, now + place % 16 / 16 * every)  # spread over the period
            if agent.there and at <= now and name not in self._asking:
                due.append(name)
        due = sorted(due, key=self._due.__getitem__)[: AT_ONCE - len(self._asking)]  # each has its turn
        summaries = [name for name in due if name not in self.looked_at]
        longest_ago = sorted(summaries, key=lambda name: self._beliefs_asked.get(name, 0.0))
        with_beliefs = longest_ago[: self.wanted.beliefs_per_tick]
        for name in due:
            self._due[name] = now + (DETAIL if name in self.looked_at else every)
            query = "?last=0;beliefs=0"
            if name in self.looked_at:
                query = f"?plans=true;last={DECISIONS}"
            elif name in self.wanted.beliefs_about:
                about = self.wanted.beliefs_about[name]
                query = f"?last=0;about={about}" if about else "?last=0"
            elif name in with_beliefs:
                query, self._beliefs_asked[name] = "?last=0", now
            task = self._asking[name] = asyncio.create_task(self._ask_mind(name, query))
            task.add_done_callback(lambda _, name=name: self._asking.pop(name, None))  # type: ignore[misc]
        for gone in self._due.keys() - self.model.agents.keys():
            del self._due[gone]
            self._beliefs_asked.pop(gone, None)

    async def _ask_mind(self, agent: str, query: str) -> None:
        try:
            view = await self.bus.ask_one(keys.mind(self.model.fleet, agent) + query, None, MindView, ANSWER_TIMEOUT)
        except BusError as error:
            self.model.mind_unanswered(agent, "" if isinstance(error, QueryTimeout) else str(error))
        else:
            self.model.mind(agent, view, detailed="plans" in query)

    async def _mail(self) -> None:
        while True:
            if self.model.boards and self.bus.router_up:
                await self._look_at_mailboxes()
            await asyncio.sleep(MAIL)

    async def _look_at_mailboxes(self) -> None:
        heard: set[str] = set()

        def answered(key: str, mailboxes: Mailboxes | None, error: str = "") -> None:
            self.model.mailboxes(key, mailboxes, error)
            if (parsed := keys.parse(key)) is not None:
                heard.add(parsed[1])

        with suppress(BusClosed):
            key = keys.mailboxes(self.model.fleet, "*")
            for other, error in (await self.bus.ask_all(key, Mailboxes, ANSWER_TIMEOUT, answered)).items():
                answered(other, None, error)
        for board in self.model.boards.keys() - heard:
            self.model.mailboxes(keys.mailboxes(self.model.fleet, board), None, "its commd does not answer")

    async def _repair(self) -> None:
        """Ask for percepts, directories and the mission when a daemon came: earlier records were missed."""
        bus, model = self.bus, self.model
        while True:
            await self._news.wait()
            await asyncio.sleep(2 * TICK)
            self._news.clear()
            await self.look_at_percepts()
            if self.wanted.whole_fleet:
                services, mission = keys.services(model.fleet, "*"), keys.mission(model.fleet, "*")
                with suppress(BusClosed):
                    await bus.ask_all(services, BoardServices, ANSWER_TIMEOUT, model.services)
                    await bus.ask_all(mission, RunningMission, ANSWER_TIMEOUT, model.mission_published)
