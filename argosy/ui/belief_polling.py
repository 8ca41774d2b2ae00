"""What agents believe, looked at now and then for the map: one mind after the other, so that none is asked often."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

from argosy.fleet_model import TeamModel
from commd.bus.bus import Bus
from commd.bus.errors import BusError
from schemas.wire import keys
from schemas.wire.mind_records import BeliefView, MindView

PERIOD = 0.25
"""Wall seconds between two questions, to whomever."""
EACH = 2.0
"""Wall seconds between two questions to the same agent."""
ANSWER_TIMEOUT = 2.0


class BeliefPolling:
    """Keeps the beliefs of all agents, some seconds old."""

    def __init__(self) -> None:
        self.beliefs: dict[str, tuple[BeliefView, ...]] = {}

    async def run(self, bus: Bus, model: TeamModel) -> None:
        """Ask one agent after the other until cancelled."""
        asked: dict[str, float] = {}
        while True:
            there = [name for name, agent in model.agents.items() if agent.there and agent.silent is None]
            for gone in self.beliefs.keys() - model.agents.keys():
                del self.beliefs[gone]
            name = min(there, key=lambda one: asked.get(one, 0.0), default=None)
            if name is not None and bus.router_up and asked.get(name, 0.0) <= time.monotonic() - EACH:
                asked[name] = time.monotonic()
                await self._ask(bus, model, name)
            await asyncio.sleep(PERIOD)

    async def _ask(self, bus: Bus, model: TeamModel, name: str) -> None:
        agent = model.agents[name]
        if agent.detail is not None and (agent.detailed or 0.0) > model.now() - EACH:  # a page looks at it anyway
            self.beliefs[name] = agent.detail.believed
            return
        key = keys.mind(model.fleet, name) + "?last=0"
        with suppress(BusError):
            self.beliefs[name] = (await bus.ask_one(key, None, MindView, ANSWER_TIMEOUT)).believed
