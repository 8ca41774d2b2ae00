"""What an agent perceives, for a program that looks on: the present set, and each change of it as it comes."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable

from commd.bus.bus import Bus
from commd.client.percept_sync import PerceptSync
from commd.common.tasks import Tasks
from commd.liveness.bridge_presence import BridgePresence
from schemas.wire.records import Perception
from schemas.wire.terms import Term

ROOM = 10_000
"""Changes that wait for a loop at most; the oldest go first, and are counted. The present set misses none."""


class Percepts:
    """The percepts of one agent, kept complete. `async for` goes through what is perceived now, then each change."""

    def __init__(self, bus: Bus, agent: str, robot: str, inject: bool = False) -> None:
        """`inject`: the mission allows percepts by hand."""
        self.dropped = 0
        """Changes that a loop did not come to in time."""
        self._loops: list[deque[Perception]] = []
        """What each loop has still to read."""
        self._changed = asyncio.Event()
        self.perceiving = PerceptSync(bus, agent, robot, self._take, inject)
        self.bridge = BridgePresence(bus, robot, self.perceiving.doubt, self.perceiving.forget)
        self._tasks = Tasks(f"perceiving for {agent}")
        for work in (self.perceiving.run(), self.bridge.run()):
            self._tasks.spawn(work)

    def present(self) -> list[Perception]:
        """What is perceived now."""
        return self.perceiving.present()

    def of(self, name: str) -> list[tuple[Term, ...]]:
        """The parameters of each percept of that name that holds now."""
        return [one.parameters for one in self.perceiving.named(name)]

    async def until(self, condition: Callable[[Percepts], bool], patience: float) -> bool:
        """Wait until `condition(self)` holds, at most `patience` wall seconds. Returns whether it does."""
        try:
            async with asyncio.timeout(patience):
                while not condition(self):
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True

    async def __aiter__(self) -> AsyncIterator[Perception]:
        changes = deque(self.present())
        self._loops.append(changes)
        try:
            while True:
                while not changes:
                    await self._changed.wait()
                yield changes.popleft()
        finally:
            self._loops = [other for other in self._loops if other is not changes]

    def close(self) -> None:
        """Look no longer."""
        self._tasks.cancel()

    def _take(self, change: Perception) -> None:
        for changes in self._loops:
            if len(changes) >= ROOM:
                changes.popleft()
                self.dropped += 1
            changes.append(change)
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()
