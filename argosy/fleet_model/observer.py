"""Fills a model of a fleet from the bus: listens, and looks into the minds now and then. It orders nothing."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from contextlib import suppress

from argosy.cli.operator_bus import ANY
from argosy.fleet_model.model import TeamModel
from argosy.fleet_model.naming import named
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError, QueryTimeout
from schemas.liveness import MIND_EVERY
from schemas.wire import keys
from schemas.wire.mind_records import MindDeeds, MindView
from schemas.wire.records import ActionStatus, BoardServices, Health, Mailboxes, Perception, RunningMission, RunState

TICK = 0.25
"""Wall seconds between two looks at who is due."""
DETAIL, SUMMARY, MAIL = 0.5, MIND_EVERY, 2.0
"""Wall seconds between two looks at a mind that is looked at, at each other mind, and at the mailboxes."""
DECISIONS = 30
"""Decisions that a detailed view is asked for."""
ANSWER_TIMEOUT = 2.0
AT_ONCE = 32
"""Minds that are asked at the same time."""


def steady_clock() -> float:
    """Return Unix seconds of a clock that never jumps, and that goes on while the machine sleeps."""
    return _EPOCH + time.clock_gettime(time.CLOCK_BOOTTIME)


_EPOCH = time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)


class TeamWatcher:
    """Keeps a model up to date while the bus is open, and after it was away."""

    def __init__(self, bus: Bus, model: TeamModel, fleet: str = ANY) -> None:
        """`fleet` may be `ANY`: then the first that shows itself is the one."""
        self.bus, self.model = bus, model
        self.looked_at: Counter[str] = Counter()
        """The agents whose minds are asked for often and with all details, and by how many."""
        self._tasks: list[asyncio.Task[None]] = []
        self._asking: dict[str, asyncio.Task[None]] = {}
        self._due: dict[str, float] = {}
        self._news = asyncio.Event()
        """Set when somebody came who has percepts to tell, or through whom they come."""
        self._listening = False
        if bus.router_up:
            model.router(up=True)
        bus.on_router(model.router)
        model.fleet = model.fleet or ("" if fleet == ANY else fleet)
        bus.watch(keys.alive(model.fleet or ANY, "*", "*", "*"), self._token)
        if model.fleet:
            self._listen()

    def look_at(self, agent: str) -> None:
        """Ask for this mind often and with all details, until as many have looked away."""
        self.looked_at[agent] += 1
        self._due[agent] = 0.0

    def look_away(self, agent: str) -> None:
        """Ask for this mind as for all others again."""
        self.looked_at[agent] -= 1
        if self.looked_at[agent] <= 0:
            del self.looked_at[agent]

    def start(self) -> None:
        """Begin to look."""
        self._tasks = [asyncio.create_task(work()) for work in (self._tick, self._mail, self._repair)]

    async def stop(self) -> None:
        """Look no longer."""
        for task in (tasks := [*self._tasks, *self._asking.values()]):
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _token(self, key: str, alive: bool) -> None:
        parsed = named(key)
        if not self.model.fleet and parsed is not None and alive:
            self.model.fleet = parsed[0]
            self._listen()
        self.model.token(key, alive)
        if alive and ("/alive/bridged/" in key or "/alive/commd/" in key):
            self._news.set()

    def _listen(self) -> None:
        """Hear what the fleet says."""
        fleet, model = self.model.fleet, self.model
        self.bus.subscribe(keys.health(fleet, "*", "*"), Health, self._health)
        self.bus.subscribe(keys.percept(fleet, "*", "*"), Perception, model.percept)
        self.bus.subscribe(keys.status(fleet, "*", "*"), ActionStatus, model.status)
        self.bus.subscribe(keys.trace(fleet, "*", "deeds"), MindDeeds, model.deeds)
        self.bus.subscribe(keys.services(fleet, "*"), BoardServices, model.services)
        self.bus.subscribe(keys.run(fleet, "*"), RunState, model.run_told)

    def _health(self, key: str, health: Health) -> None:
        eyes = self.model.eyes
        self.model.health(key, health)
        if self.model.eyes != eyes:
            self._news.set()

    async def _tick(self) -> None:
        while True:
            try:
                self.model.tick()
                self._ask_who_is_due(time.monotonic())
                self.model.defect = ""
            except Exception as error:  # said where it is seen: silence would look like a fleet that rests
                self.model.defect = f"who is there is not known any more: {type(error).__name__}: {error}"
            await asyncio.sleep(TICK)

    def _ask_who_is_due(self, now: float) -> None:
        for place, (name, agent) in enumerate(self.model.agents.items()):
            due = self._due.setdefault(name, now + place % 16 / 16 * SUMMARY)  # not all of them at the same moment
            if not agent.there or due > now or name in self._asking or len(self._asking) >= AT_ONCE:
                continue
            detailed = name in self.looked_at
            self._due[name] = now + (DETAIL if detailed else SUMMARY)
            task = self._asking[name] = asyncio.create_task(self._look_at_mind(name, detailed))
            task.add_done_callback(lambda _, name=name: self._asking.pop(name, None))  # type: ignore[misc]
        for name in self._due.keys() - self.model.agents.keys():
            del self._due[name]

    async def _look_at_mind(self, agent: str, detailed: bool) -> None:
        wanted = f"?plans=true;last={DECISIONS}" if detailed else "?last=0;beliefs=0"
        key = keys.mind(self.model.fleet, agent) + wanted
        try:
            view = await self.bus.ask_one(key, None, MindView, ANSWER_TIMEOUT)
        except BusError as error:
            self.model.mind_unanswered(agent, "" if isinstance(error, QueryTimeout) else str(error))
        else:
            self.model.mind(agent, view, detailed=detailed)

    async def _mail(self) -> None:
        while True:
            if self.model.boards and self.bus.router_up:
                await self._look_at_mailboxes()
            await asyncio.sleep(MAIL)

    async def _look_at_mailboxes(self) -> None:
        heard: set[str] = set()

        def told(key: str, mailboxes: Mailboxes | None, error: str = "") -> None:
            self.model.mailboxes(key, mailboxes, error)
            if (parsed := keys.parse(key)) is not None:
                heard.add(parsed[1])

        with suppress(BusClosed):
            key = keys.mailboxes(self.model.fleet, "*")
            for other, error in (await self.bus.ask_all(key, Mailboxes, ANSWER_TIMEOUT, told)).items():
                told(other, None, error)
        for board in self.model.boards.keys() - heard:
            self.model.mailboxes(keys.mailboxes(self.model.fleet, board), None, "its commd does not answer")

    async def _repair(self) -> None:
        """Look at percepts, services and the mission again when a daemon came: what it told before was not heard."""
        while True:
            await self._news.wait()
            await asyncio.sleep(2 * TICK)
            self._news.clear()
            bus, model = self.bus, self.model
            with suppress(BusClosed):
                await bus.ask_all(keys.percept(model.fleet, "*", "**"), Perception, ANSWER_TIMEOUT, model.percept)
                await bus.ask_all(keys.services(model.fleet, "*"), BoardServices, ANSWER_TIMEOUT, model.services)
                await bus.ask_all(keys.mission(model.fleet, "*"), RunningMission, ANSWER_TIMEOUT, model.mission_told)
