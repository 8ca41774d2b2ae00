"""The connection of a view to its fleet: dials until a router answers, finds the fleet and keeps the model filled."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable

from argosy.cli.operator_bus import ANY, Where, operator_bus, unreached
from argosy.fleet_model.mission_clock import steady_clock
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.observer import FleetObserver, Wanted
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from schemas.wire import keys

DIAL_AGAIN = 1.0
"""Wall seconds between two attempts to reach the router; each takes some seconds itself."""
LOOK_AGAIN = 2.0
"""Wall seconds between two searches for a fleet, and between two checks of which boards are reached."""
CHOICE = 0.5
"""Wall seconds between two checks of whether a fleet has been chosen."""


class FleetLink:
    """A model that is there from the beginning, and the session that fills it, or why there is none."""

    def __init__(
        self,
        place: Where,
        wanted: Wanted = Wanted(),  # noqa: B008 - it is frozen
        *,
        choosing: bool = False,
        notify: Callable[[str], None] = lambda text: None,
    ) -> None:
        """`choosing`: of several fleets on the router wait for `choose`, otherwise the first that is heard is shown.

        `notify` takes problems and losses of the router as text.
        """
        self.place, self._wanted, self._choosing, self._notify = place, wanted, choosing, notify
        self.model = FleetModel(steady_clock, fleet="" if place.fleet == ANY else place.fleet, mission=place.mission)
        self.bus: Bus | None = None
        self.problem = ""
        """Why no fleet is observed; empty: one is, or the router is dialled for the first time."""
        self.since = steady_clock()
        """Unix seconds since when the link is as it is."""
        self.reached = False
        """Whether a router was ever reached."""
        self.fleets: tuple[str, ...] = ()
        """The fleets on the router, where none was named."""
        self.unreached: tuple[str, ...] = ()
        """Boards of the mission that are not reached, each with the reason."""
        self._looked_at: Counter[str] = Counter()
        self._observer: FleetObserver | None = None

    @property
    def fleet(self) -> str:
        """The fleet that is shown; empty until it is known."""
        return self.model.fleet

    @property
    def up(self) -> bool:
        """Whether a router is reached now."""
        return self.bus is not None and self.bus.router_up

    def look_at(self, agent: str) -> None:
        """Ask for a mind often and with all details."""
        self._looked_at[agent] += 1
        if self._observer is not None:
            self._observer.look_at(agent)

    def look_away(self, agent: str) -> None:
        """End one `look_at`."""
        self._looked_at[agent] -= 1
        if self._observer is not None:
            self._observer.look_away(agent)

    def choose(self, fleet: str) -> bool:
        """Show one of several fleets. Returns whether it is one of them, and none was chosen before."""
        if self.fleet or fleet not in self.fleets:
            return False
        self.model.fleet = fleet
        return True

    async def run(self) -> None:
        """Dial, find the fleet and observe it until cancelled. Raises Findings if the router can never be reached."""
        while True:
            try:
                async with operator_bus(self.place) as bus:
                    self.bus, self.reached = bus, True
                    bus.on_router(self._router)
                    self._set_problem("")
                    while self._choosing and not self.fleet:
                        await self._find(bus)
                    await self._observe(bus)
            except BusClosed as closed:
                self._set_problem(str(closed))
            finally:
                self.bus = None
            await asyncio.sleep(DIAL_AGAIN)

    async def _find(self, bus: Bus) -> None:
        """Take the only fleet on the router, or wait a moment for one to come or to be chosen."""
        tokens = await bus.tokens(keys.alive(ANY, "*", "*", "*"))
        self.fleets = tuple(sorted({parsed[0] for token in tokens if (parsed := keys.parse(token))}))
        if len(self.fleets) == 1:
            self.model.fleet = self.fleets[0]
            self._set_problem("")
        else:
            some = "several fleets are on this router: choose one"
            self._set_problem(some if self.fleets else "no fleet is on this router yet")
            await asyncio.sleep(CHOICE if self.fleets else LOOK_AGAIN)

    async def _observe(self, bus: Bus) -> None:
        self._set_problem("")
        observer = self._observer = FleetObserver(bus, self.model, self.place.fleet, self._wanted)
        for agent in self._looked_at.elements():
            observer.look_at(agent)
        observer.start()
        try:
            while True:
                self.unreached = tuple(await unreached(bus))
                await asyncio.sleep(LOOK_AGAIN)
        finally:
            self._observer = None
            await observer.stop()

    def _router(self, up: bool) -> None:
        if up != self.model.router_up:  # called before the model takes it
            self.since = steady_clock()
            self._notify("the router is back" if up else "the router is lost; trying again")

    def _set_problem(self, problem: str) -> None:
        if problem != self.problem:
            self.problem, self.since = problem, steady_clock()
            if problem:
                self._notify(f"{problem}; trying again")
