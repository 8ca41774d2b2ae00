"""The way to the fleet: a session on the bus that is tried for until it opens, and the fleet that is found there."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager

from argosy.cli.operator_bus import ANY, Where, operator_bus, unreached
from argosy.fleet_model import steady_clock
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from schemas.wire import keys

AGAIN = 2.0
"""Wall seconds after which the router is dialled again, and after which a fleet is looked for again."""


class Link:
    """The session, or why there is none."""

    def __init__(self, place: Where, begin: Callable[[Bus, str], AbstractAsyncContextManager[object]]) -> None:
        self._place = place
        self._begin = begin
        """Makes what follows a fleet on the bus; it is kept open."""
        self.bus: Bus | None = None
        self.fleet = "" if place.fleet == ANY else place.fleet
        self.problem = "looking for the router"
        self.changed = steady_clock()
        """Unix seconds since when the router is as it is."""
        self.fleets: tuple[str, ...] = ()
        """Where several are on the router and none was named."""
        self._seen_up = False
        self.was_up = False
        """Whether the router was reached ever."""
        self.unreached: tuple[str, ...] = ()

    @property
    def up(self) -> bool:
        """Whether a router is reached now."""
        return self.bus is not None and self.bus.router_up

    async def run(self) -> None:
        """Dial until the router is there, find the fleet, and keep following it; returns never."""
        while True:
            try:
                async with operator_bus(self._place) as bus:
                    self.bus, self.was_up = bus, True
                    self._seen_up = True
                    bus.on_router(self._router)
                    self._say("")
                    await self._follow(bus)
            except BusClosed as closed:
                self._say(str(closed))
            finally:
                self.bus = None
            await asyncio.sleep(AGAIN)

    async def _follow(self, bus: Bus) -> None:
        while not self.fleet:
            await self._find(bus)
        async with self._begin(bus, self.fleet):
            self._say("")
            while True:
                if self._place.mission is not None:
                    self.unreached = tuple(await unreached(bus))
                await asyncio.sleep(AGAIN)

    async def _find(self, bus: Bus) -> None:
        """Look for the fleet on the router, if none was named: the only one, or the one that is chosen on the page."""
        tokens = await bus.tokens(keys.alive(ANY, "*", "*", "*"))
        self.fleets = tuple(sorted({parsed[0] for token in tokens if (parsed := keys.parse(token))}))
        if len(self.fleets) == 1:
            self.fleet = self.fleets[0]
        elif not self.fleets:
            self._say("no fleet is on this router yet")
            await asyncio.sleep(AGAIN)
        else:
            self._say("several fleets are on this router: choose one")
            await asyncio.sleep(AGAIN / 4)

    def choose(self, fleet: str) -> bool:
        """Follow one of several fleets. Returns whether it is one of them, and none was chosen before."""
        if self.fleet or fleet not in self.fleets:
            return False
        self.fleet = fleet
        return True

    def _router(self, up: bool) -> None:
        if up == self._seen_up:
            return
        self._seen_up, self.changed = up, steady_clock()
        print(f"argosy ui: the router {'is back' if up else 'is lost: it is tried for'}", file=sys.stderr, flush=True)

    def _say(self, problem: str) -> None:
        """Keep the problem for the pages, and tell it once where the command was started."""
        if problem and problem != self.problem:
            print(f"argosy ui: {problem}; it is tried again", file=sys.stderr, flush=True)
        if problem != self.problem:
            self.problem, self.changed = problem, steady_clock()
