"""The way from a view to the fleet: dials until a router answers, and keeps the model filled from then on."""

from __future__ import annotations

import asyncio
from collections import Counter

from argosy.cli.operator_bus import ANY, Where, operator_bus
from argosy.fleet_model import TeamModel, TeamWatcher, steady_clock
from commd.bus.errors import BusClosed
from schemas.files.findings import Findings
from schemas.mission.model import Mission

DIAL_AGAIN = 1.0
"""Wall seconds between two attempts to reach the router; each takes some seconds itself."""


class Link:
    """Dials, and has a model that is there from the beginning."""

    def __init__(self, place: Where, mission: Mission | None) -> None:
        self.place = place
        self.model = TeamModel(steady_clock, fleet="" if place.fleet == ANY else place.fleet, mission=mission)
        self.problem = ""
        """Why no router was reached by now; empty: one was."""
        self.since = steady_clock()
        """When it was begun to dial."""
        self.failure = ""
        """Why dialling is of no use at all."""
        self.reached = False
        """Whether a router was ever reached."""
        self._watcher: TeamWatcher | None = None
        self._looked_at: Counter[str] = Counter()

    def look_at(self, agent: str) -> None:
        """Ask for a mind often and with all details."""
        self._looked_at[agent] += 1
        if self._watcher is not None:
            self._watcher.look_at(agent)

    def look_away(self, agent: str) -> None:
        """Ask for it as for all others again."""
        self._looked_at[agent] -= 1
        if self._watcher is not None:
            self._watcher.look_away(agent)

    async def run(self) -> None:
        """Dial and look until it is cancelled, or until dialling is of no use."""
        while True:
            try:
                async with operator_bus(self.place) as bus:
                    self.problem, self.reached = "", True
                    self._watcher = TeamWatcher(bus, self.model, self.place.fleet)
                    for agent in self._looked_at.elements():
                        self._watcher.look_at(agent)
                    self._watcher.start()
                    try:
                        await asyncio.Event().wait()
                    finally:
                        watcher, self._watcher = self._watcher, None
                        await watcher.stop()
            except BusClosed as closed:
                self.problem = str(closed)
            except Findings as findings:
                self.failure = str(findings)
                return
            await asyncio.sleep(DIAL_AGAIN)
