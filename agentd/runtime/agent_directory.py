"""Who can be sent to, and the board of each: the mission's agents, and those that joined a board at run time.

The directory of the own board knows them all, also those of boards that are away; what the boards put keeps this up to
date, and it is asked again now and then, because a put may be lost.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Iterable, Mapping

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.common.tasks import wait_at_most
from schemas.mission.model import RESERVED
from schemas.wire import keys
from schemas.wire.records import BoardServices

PATIENCE = 2.0
"""Wall seconds that the directory has at the start; later it is asked again."""
AGAIN = 0.1
ASK_EVERY = 30.0
ASK_AGAIN = 1.0
"""Wall seconds until a directory that did not answer is asked again: its token may be here before what it serves."""
ASK_TIMEOUT = 5.0
log = logging.getLogger("roster")


class AgentDirectory:
    """Names in a fixed order: the mission's first, then the others as they came."""

    def __init__(self, bus: Bus, mission: Mapping[str, str]) -> None:
        """`mission`: whom the mission names as a receiver of mail, and the board of each."""
        self.mission = mission
        self.names: dict[str, str] = dict(mission)
        """All of them, there or away, and their boards; ask with ``in``."""
        self.on_change: list[Callable[[], None]] = []
        """Called whenever names came or went."""
        self._bus = bus
        self._said: dict[str, BoardServices] = {}
        self._here: dict[str, str] = {}
        """Those made by this daemon, and their boards."""
        self._ended: set[str] = set()
        """Those that this daemon has ended, until their board says so too."""
        self._met: dict[str, None] = {}
        """Those that have written to us before any board told of them."""
        self._remembered: dict[str, None] = {}
        """Those whom agents of this daemon knew in a former life, until a board's directory has answered."""
        self._ask = asyncio.Event()

    async def watch(self, boards: Collection[str]) -> None:
        """Follow what the boards say; returns when the directories of these boards have answered, or in a moment."""
        self._bus.subscribe(keys.services(self._bus.fleet, "*"), BoardServices, lambda _, said: self.told(said))
        for board in boards:
            self._bus.watch(keys.alive(self._bus.fleet, board, "commd", "*"), lambda _, alive: self._hurry(alive))
        try:
            async with asyncio.timeout(PATIENCE):
                for board in boards:
                    while True:
                        if await self._refresh(board):
                            break
                        await asyncio.sleep(AGAIN)
        except TimeoutError:
            log.warning("the directory of %s does not answer yet: only the mission's agents are known", board)

    async def follow(self, boards: Collection[str]) -> None:
        """Ask the directories of these boards again, when one is back and now and then, for ever."""
        pause = ASK_EVERY
        while True:
            await wait_at_most(self._ask, pause)
            self._ask.clear()
            answered = [await self._refresh(board) for board in boards]
            pause = ASK_EVERY if all(answered) else ASK_AGAIN

    def add(self, name: str, board: str) -> None:
        """An agent of this daemon has begun."""
        self._ended.discard(name)
        if name not in self.mission:
            self._here[name] = board
        self._settle()

    def remove(self, name: str) -> None:
        """An agent of this daemon has ended. Those of the mission are expected to come back."""
        if self._here.pop(name, None) is not None:
            self._ended.add(name)
            self._settle()

    def met(self, name: str) -> None:
        """Somebody has written to us. Who can write can be written to, even if the word of its board was lost."""
        if name not in self.names and name not in self._ended and name not in RESERVED:
            self._met[name] = None
            self._ask.set()
            self._settle()

    def remember(self, names: Iterable[str]) -> None:
        """An agent of this daemon has had mail for or from these in a former life; the directory may know better."""
        if not self._said:
            self._remembered |= {name: None for name in names if name not in RESERVED}
            self._settle()

    def told(self, said: BoardServices) -> None:
        """A board has said who lives there."""
        known = self._said.get(said.board)
        if known is not None and said.header.boot == known.header.boot and said.version <= known.version:
            return
        self._said[said.board] = said
        self._settle()

    def _settle(self) -> None:
        """Bring the names up to date; those that stay keep their places."""
        homes: dict[str, str] = {}
        for board, said in self._said.items():
            for name in said.agents:
                homes.setdefault(name, board)
        self._ended &= homes.keys()
        self._met = {name: None for name in self._met if name not in homes}
        homes = {name: board for name, board in homes.items() if name not in self._ended} | self._here
        homes = dict.fromkeys(self._remembered, "") | homes | dict.fromkeys(self._met, "") | dict(self.mission)
        if homes == self.names:
            return
        for name in [name for name in self.names if name not in homes]:
            del self.names[name]
        self.names.update(homes)
        for handler in self.on_change:
            handler()

    def _hurry(self, there: bool) -> None:
        if there:
            self._ask.set()

    async def _refresh(self, board: str) -> bool:
        """Ask a board's directory for all that it knows. Returns whether it has answered."""
        answered = False

        def told(_: str, services: BoardServices) -> None:
            nonlocal answered
            answered = True
            self._remembered = {}
            self.told(services)
            self._settle()

        try:
            await self._bus.ask_all(keys.services(self._bus.fleet, board), BoardServices, ASK_TIMEOUT, told)
        except BusClosed as closed:
            log.debug("not_asked board=%s why=%s", board, closed)
        if answered and self._met:
            log.info("unknown senders=%s", ",".join(self._met))
        return answered
