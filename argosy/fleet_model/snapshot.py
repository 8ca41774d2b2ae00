"""The observer on the bus: hears what a fleet says and looks into each mind now and then, to fill a picture."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

from argosy.fleet_model.picture import Picture
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError
from schemas.liveness import SILENT_AFTER
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from schemas.wire.records import ActionStatus, Health, Perception

MIND_PERIOD = 0.5
"""Wall seconds between two looks at a mind."""
ANSWER_TIMEOUT = 2.0


class Observer:
    """Keeps a picture of one fleet up to date while the bus is open."""

    def __init__(self, bus: Bus, picture: Picture) -> None:
        self.bus, self.picture = bus, picture
        self.watching_minds = asyncio.Event()
        """Cleared while the daemons are to be left in peace, to measure what they use when idle."""
        self.watching_minds.set()
        self.silent: set[str] = set()
        """Agents that have not answered for `SILENT_AFTER` while the router did."""
        self.router_lost: float | None = None
        """Wall seconds of the monotonic clock at which the router was lost; None while it is there."""
        self._tasks: list[asyncio.Task[None]] = []
        bus.on_router(self._router)
        fleet = bus.fleet
        self._new = asyncio.Event()
        """Set when somebody came who has percepts to tell, or through whom they come."""
        bus.watch(keys.alive(fleet, "*", "*", "*"), self._token)
        bus.subscribe(keys.health(fleet, "*", "*"), Health, picture.heard_health)
        bus.subscribe(keys.percept(fleet, "*", "*"), Perception, self._percept)
        bus.subscribe(keys.status(fleet, "*", "*"), ActionStatus, picture.status)

    def _percept(self, key: str, percept: Perception) -> None:
        if percept.header.source:  # what people tell an agent by hand is nothing that its vehicle has told
            self.picture.percept(key, percept)

    def _token(self, key: str, alive: bool) -> None:
        self.picture.token(key, alive)
        if alive and ("/alive/bridged/" in key or "/alive/commd/" in key):
            self._new.set()

    def _router(self, up: bool) -> None:
        if up:
            if self.router_lost is not None:
                away = time.monotonic() - self.router_lost
                self.picture.journal.add("argosy", f"the router answers again, after {away:.1f} s")
            self.router_lost = None
        elif self.router_lost is None:
            self.router_lost = time.monotonic()
            self.picture.journal.add("argosy", "the router does not answer", "warning")

    def start(self) -> None:
        """Begin to look at the minds, and at what may have been missed."""
        self._new.clear()
        self._tasks += [asyncio.create_task(self._watch_mind(agent)) for agent in self.picture.agents]
        self._tasks.append(asyncio.create_task(self._repair()))

    async def _repair(self) -> None:
        """Look at the percepts anew when a daemon is back: what was said meanwhile was not heard."""
        while True:
            await self._new.wait()
            await asyncio.sleep(MIND_PERIOD)
            self._new.clear()
            await self.look_at_percepts()

    async def look_at_percepts(self) -> None:
        """Take in the percepts that are present already: what was said before anybody listened."""
        for agent in self.picture.eyes:
            everything = keys.percept(self.bus.fleet, agent, "**")
            with suppress(BusClosed):
                await self.bus.ask_all(everything, Perception, ANSWER_TIMEOUT, self.picture.percept)

    async def look_at_mind(self, agent: str) -> bool:
        """Ask one agent for its mind. Returns whether it answered."""
        key = f"{keys.mind(self.bus.fleet, agent)}?last=0"  # a run shows no decisions: they need not be told
        try:
            view = await self.bus.ask_one(key, None, MindView, ANSWER_TIMEOUT)
        except BusError:
            return False
        self.picture.mind(view)
        return True

    async def _watch_mind(self, agent: str) -> None:
        heard = time.monotonic()
        while True:
            if not self.watching_minds.is_set():
                await self.watching_minds.wait()
                heard = time.monotonic()
            if await self.look_at_mind(agent) or self.router_lost is not None:
                heard = time.monotonic()
                self.silent.discard(agent)
            elif time.monotonic() - heard > SILENT_AFTER:
                self.silent.add(agent)
            await asyncio.sleep(MIND_PERIOD)

    async def stop(self) -> None:
        """Look no longer."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
