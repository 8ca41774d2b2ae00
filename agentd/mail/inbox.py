"""An agent's incoming mail: each message once, and acknowledged when its effects are on disk.

A message is *fed* to the mind, *absorbed* when the mind has taken it in a cycle, and *kept* when a checkpoint that
holds what came of it is on disk (`absorb` and `kept`); only then commd hears that it is taken. What is asked for again
meanwhile is not fed twice.
"""

from __future__ import annotations

import asyncio
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

from commd.bus.bus import Bus, Query
from schemas.wire import keys
from schemas.wire.records import Mail, Message, Receipt, Refusal

PATIENCE = 5.0
"""Wall seconds for which an answer to commd waits for the mind and the disk; then the rest is to be sent again."""
NUMBERINGS = 1_000
"""Numberings remembered per sender: it has a new one only when it begins without memory of what it sent. More than the
500 that a batch of commd's can bring: the whole batch may come again."""


class MessageRefused(ValueError):
    """A message that can never be taken."""

    def __init__(self, reason: Refusal) -> None:
        super().__init__(str(reason))
        self.reason = reason


class Numbered(NamedTuple):
    """Whose numbers they are."""

    sender: str
    numbering: str


class Inbox:
    """What comes in for one agent."""

    def __init__(
        self,
        bus: Bus,
        agent: str,
        room: Callable[[], bool],
        read: Callable[[Message], Callable[[], None]],
        missing: Callable[[str, int], None],
    ) -> None:
        """`room` says whether the mind can take a message now.

        `read` returns what feeds a message to the mind, and raises MessageRefused. `missing(sender, count)` hears of
        messages that did not come: given up on the way, which their sender knows, or lost with a file.
        """
        self.counters: Counter[str] = Counter()
        self._room, self._read, self._missing = room, read, missing
        self._fed: OrderedDict[Numbered, int] = OrderedDict()
        """The last number that was handed to the mind."""
        self._come: dict[Numbered, int] = {}
        """The last number that came, of each numbering in `_fed`; it may have been refused."""
        self._waiting: deque[tuple[Numbered, int]] = deque()
        """What is in the mind's mailbox, in its order; number 0: a message without one."""
        self._absorbed: dict[Numbered, int] = {}
        """What the mind has taken and no save has begun to hold."""
        self._kept: dict[Numbered, int] = {}
        self._changed = asyncio.Event()
        self.close = bus.serve(keys.inbox(bus.fleet, agent), Mail, self._receive)
        """Takes no mail any more."""

    def restore(self, kept: Mapping[Numbered, int]) -> None:
        """Go on where a former life of the agent ended."""
        self._kept |= kept
        self._fed |= kept
        self._come |= kept

    # --- on the way into the checkpoint ---

    def unnumbered(self) -> None:
        """A message that does not come from commd was put into the mind's mailbox."""
        self._waiting.append((_NOBODY, 0))

    def absorb(self, left: int) -> bool:
        """The mind has so many messages left in its mailbox. Returns whether a save is due that somebody waits for."""
        while len(self._waiting) > left:
            whose, seq = self._waiting.popleft()
            if seq:
                self._absorbed[whose] = seq
        return bool(self._absorbed)

    def taken_last(self, left: int) -> tuple[str, str, int] | None:
        """The last message that the mind, which has so many left, has taken and no save has begun to hold."""
        place = len(self._waiting) - left - 1
        if place >= 0 and self._waiting[place][1]:
            whose, seq = self._waiting[place]
        elif self._absorbed:
            whose, seq = next(reversed(self._absorbed.items()))
        else:
            return None
        return whose.sender, whose.numbering, seq

    def take_absorbed(self) -> dict[Numbered, int]:
        """Return what a save that begins now has to hold; `kept` is to be called when it does."""
        found, self._absorbed = self._absorbed, {}
        return found

    def kept(self, numbers: Mapping[Numbered, int]) -> None:
        """What came of the messages up to these numbers is on disk: they are taken."""
        if not numbers:
            return
        self._kept |= numbers
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    def _forget(self, sender: str) -> None:
        """Remember the last numberings of a sender only."""
        known = [whose for whose in self._fed if whose.sender == sender]
        for whose in known[:-NUMBERINGS]:
            del self._fed[whose]
            self._come.pop(whose, None)
            self._kept.pop(whose, None)

    # --- on the bus ---

    async def _receive(self, query: Query[Mail]) -> None:
        if query.record is None or not query.concrete:
            query.reply_error(query.error or "expected a Mail record on a concrete key")
            return
        messages = query.record.messages
        refused: dict[int, Refusal] = {}
        later: dict[int, Refusal] = {}
        waits: dict[int, tuple[Numbered, int]] = {}
        full = False
        held: set[Numbered] = set()
        """Of whom a message is refused as too late: were a later one taken, it would pass for taken when it comes again
        because this answer was lost."""
        for place, message in enumerate(messages):
            whose, seq = Numbered(message.sender, message.header.boot), message.header.seq
            try:
                feed = self._read(message)
            except MessageRefused as bad:
                refused[place] = bad.reason
                self._note(whose, seq)
                continue
            if seq and seq <= self._fed.get(whose, 0):
                waits[place] = whose, seq
                self._fed.move_to_end(whose)
                continue
            if message.ttl is not None and message.ttl <= 0:
                refused[place] = Refusal(code="expired")
                held.add(whose)
                self._note(whose, seq)
                continue
            if whose in held:
                later[place] = Refusal(code="out_of_order", text="it follows one that is expired")
                continue
            full = full or not self._room()
            if full:
                later[place] = Refusal(code="mailbox_full", text="the mailbox of the mind is full")
                continue
            self._note(whose, seq)
            feed()
            self.counters["received"] += 1
            self._waiting.append((whose, seq))
            if seq:
                if whose not in self._fed:
                    self._forget(message.sender)
                self._fed[whose] = seq
                self._fed.move_to_end(whose)
                waits[place] = whose, seq
        await self._wait_for(waits)
        later |= dict.fromkeys(waits, Refusal(code="not_absorbed", text="the mind has not absorbed it"))
        self.counters["refused"] += len(refused)
        self.counters["later"] += len(later)
        taken = len(messages) - len(refused) - len(later)
        query.reply(Receipt(taken=taken, refused=refused, later=later))

    def _note(self, whose: Numbered, seq: int) -> None:
        """Note that a number has come, and tell of those before it that have not."""
        last = self._come.get(whose, 0)
        if last and seq > last + 1:
            self.counters["missing"] += seq - last - 1
            self._missing(whose.sender, seq - last - 1)
        if seq > last:
            self._come[whose] = seq

    async def _wait_for(self, waits: dict[int, tuple[Numbered, int]]) -> None:
        """Take out of `waits` what is kept, until nothing is left or patience is over."""
        loop = asyncio.get_running_loop()
        until = loop.time() + PATIENCE
        while True:
            changed = self._changed
            for place, (whose, seq) in list(waits.items()):
                if seq <= self._kept.get(whose, 0):
                    del waits[place]
            left = until - loop.time()
            if not waits or left <= 0:
                return
            try:
                await asyncio.wait_for(changed.wait(), left)
            except TimeoutError:
                continue


_NOBODY = Numbered("", "")
