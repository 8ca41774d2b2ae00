"""What an agent perceives, for a program that looks on: the present set, and each change of it as it comes."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

from commd.bridge_watch import BridgeWatch
from commd.bus import Bus
from commd.perceiving import Perceiving
from commd.tasks import Tasks
from schemas.records import Perception
from schemas.terms import Term

ROOM = 10_000
"""Changes that wait to be read at most; the oldest go first, and are counted. The present set misses none."""


class Percepts:
    """The percepts of one agent, kept complete. `async for` goes through the changes from the first percept on."""

    def __init__(self, bus: Bus, agent: str, robot: str, inject: bool = False) -> None:
        """`inject`: the mission allows percepts by hand."""
        self.dropped = 0
        """Changes that nobody read in time."""
        self._changes: deque[Perception] = deque()
        self._changed = asyncio.Event()
        self.perceiving = Perceiving(bus, agent, robot, self._take, inject)
        self.bridge = BridgeWatch(bus, robot, self.perceiving.doubt, self.perceiving.forget)
        self._tasks = Tasks(f"perceiving for {agent}")
        for work in (self.perceiving.run(), self.bridge.run()):
            self._tasks.spawn(work)

    def present(self) -> list[Perception]:
        """What is perceived now."""
        return self.perceiving.present()

    def of(self, name: str) -> list[tuple[Term, ...]]:
        """The parameters of each percept of that name that holds now."""
        return [one.parameters for one in self.present() if one.name == name]

    async def until(self, condition: Callable[[Percepts], bool], patience: float) -> bool:
        """Wait until `condition(self)` holds, at most `patience` wall seconds. Returns whether it does."""
        try:
            async with asyncio.timeout(patience):
                while not condition(self):
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True

    def __aiter__(self) -> Percepts:
        return self

    async def __anext__(self) -> Perception:
        while not self._changes:
            await self._changed.wait()
        return self._changes.popleft()

    def close(self) -> None:
        """Look no longer."""
        self._tasks.cancel()

    def _take(self, change: Perception) -> None:
        if len(self._changes) >= ROOM:
            self._changes.popleft()
            self.dropped += 1
        self._changes.append(change)
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()
