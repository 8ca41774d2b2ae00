"""The agents that can be sent to: those of the mission, and those made at run time as their tokens come and go."""

from __future__ import annotations

import asyncio
import logging
from collections import defaultdict
from collections.abc import Iterable

from commd.bus import Bus
from schemas import keys

PATIENCE = 2.0
"""Wall seconds that the tokens which are there have to be told."""
log = logging.getLogger("roster")


class Roster:
    """Names of agents, in a fixed order: the mission's first, then the others as they came."""

    def __init__(self, bus: Bus, mission_agents: Iterable[str]) -> None:
        self.mission = tuple(mission_agents)
        self.names: dict[str, None] = dict.fromkeys(self.mission)
        """All of them; ask with ``in``."""
        self._alive: defaultdict[str, set[str]] = defaultdict(set)
        """The tokens that are there, by name; the bus may tell of one more than once."""
        self._bus = bus

    async def watch(self) -> None:
        """Follow the agents of other daemons; returns when those are known that are there already.

        What is claimed on the bus is claimed before, or when this has returned (see `Bus.claim`).
        """
        everybody = keys.alive(self._bus.fleet, "*", "agentd", "*")
        there = await self._bus.tokens(everybody)
        self._bus.watch(everybody, self._token)
        until = asyncio.get_running_loop().time() + PATIENCE
        while any(key not in self._alive[_name(key)] for key in there):
            if asyncio.get_running_loop().time() > until:
                log.warning("roster_incomplete there=%d known=%d", len(there), len(self._alive))
                return
            await asyncio.sleep(0.01)

    def add(self, name: str) -> None:
        """An agent of this daemon has begun."""
        self.names[name] = None

    def remove(self, name: str) -> None:
        """An agent of this daemon has ended. Those of the mission are expected to come back."""
        if name not in self.mission:
            self.names.pop(name, None)

    def _token(self, key: str, alive: bool) -> None:
        name = _name(key)
        tokens = self._alive[name]
        if alive:
            tokens.add(key)
            self.add(name)
            return
        tokens.discard(key)
        if not tokens:
            del self._alive[name]
            self.remove(name)


def _name(key: str) -> str:
    """Whose token a key is."""
    parsed = keys.parse(key)
    return parsed[1] if parsed is not None else ""
