"""Receive the mail of one name exactly once: the common part of the inboxes of agents and of Python programs
(docs/guides/mail.md).

`commd` offers a message until it is *done with*: its effects are on disk (an agent), or the next one was asked for (a
program). Repeated messages are recognised by the numbers that each sender gives to its messages.
"""

from __future__ import annotations

import asyncio
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

from commd.bus.bus import Bus, Query
from schemas.wire import keys
from schemas.wire.records import Mail, Message, Receipt, Refusal

NUMBERINGS = 1_000
"""Numberings remembered per sender: it has a new one only when it begins without memory of what it sent. More than the
500 that a batch of commd's can bring: the whole batch may come again."""
EXPIRED: Final = Refusal(code="expired")
OUT_OF_ORDER: Final = Refusal(code="out_of_order", text="it follows one that is expired")


class MessageRefused(ValueError):
    """A message that can never be taken."""

    def __init__(self, reason: Refusal) -> None:
        super().__init__(str(reason))
        self.reason = reason


def is_expired(message: Message) -> bool:
    """Return whether the time to live of a message is over."""
    return message.ttl is not None and message.ttl <= 0


class Numbered(NamedTuple):
    """Whose numbers they are."""

    sender: str
    numbering: str


@dataclass(slots=True)
class Progress:
    """The numbers of the last messages of one numbering that arrived, were handed over, and are done with."""

    arrived: int = 0
    """It may have been refused."""
    handed: int = 0
    done: int = 0


class Waiting(NamedTuple):
    """A message of a batch that was handed over and may not be done with yet."""

    place: int
    progress: Progress
    message: Message


class ReceiveOnce:
    """Serves the inbox of one name; subclasses say which messages are done with."""

    FULL: ClassVar[Refusal] = Refusal(code="mailbox_full")
    """Why no message can be handed over now."""
    NOT_DONE: ClassVar[Refusal] = Refusal(code="not_absorbed")
    """Why a message is to be offered again that was handed over."""

    def __init__(
        self,
        bus: Bus,
        name: str,
        read: Callable[[Message], Callable[[], None]],
        room: Callable[[], bool],
        patience: Callable[[], float],
        missing: Callable[[str, int], None] = lambda sender, count: None,
    ) -> None:
        """`read` returns what hands a message over, and raises MessageRefused; `room` says whether there is room now.

        A query waits `patience()` wall seconds until its messages are done with. `missing(sender, count)` is called
        for messages that did not arrive: given up on the way, which their sender knows, or lost with a file.
        """
        self.counters: Counter[str] = Counter()
        """received, refused, later, missing: messages so far; repeated ones count in `refused` and `later` again."""
        self._read, self._room, self._patience, self._missing = read, room, patience, missing
        self._progress: dict[str, OrderedDict[str, Progress]] = {}
        """By sender and numbering; the numberings used last are at the end."""
        self._changed = asyncio.Event()
        """Set and replaced whenever something is done with."""
        self._leaving = False
        """Whether no query is kept waiting any longer."""
        self._bounds: set[asyncio.Timeout] = set()
        """Of the queries that wait for messages to be done with."""
        self.withdraw = bus.serve(keys.inbox(bus.fleet, name), Mail, self._receive)
        """Takes no mail any more."""

    def restore(self, done: Mapping[Numbered, int]) -> None:
        """Continue where the process before this one ended."""
        for whose, seq in done.items():
            self._progress.setdefault(whose.sender, OrderedDict())[whose.numbering] = Progress(seq, seq, seq)

    def of(self, whose: Numbered) -> Progress:
        """Return the numbers of a numbering that is used now; the one used longest ago may be forgotten for it."""
        sender, numbering = whose
        numberings = self._progress.get(sender)
        if numberings is None:
            numberings = self._progress[sender] = OrderedDict()
        progress = numberings.get(numbering)
        if progress is not None:
            numberings.move_to_end(numbering)
            return progress
        if len(numberings) >= NUMBERINGS:
            numberings.popitem(last=False)
        progress = numberings[numbering] = Progress()
        return progress

    def done(self, numbers: Mapping[Numbered, int]) -> None:
        """Let `commd` have the receipts of all messages up to these numbers."""
        for whose, seq in numbers.items():
            progress = self.of(whose)
            progress.done = max(progress.done, seq)
            progress.handed = max(progress.handed, seq)
        if numbers:
            self._notify()

    def _notify(self) -> None:
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def _receive(self, query: Query[Mail]) -> None:
        messages = query.required("expected a Mail record on a concrete key").messages
        refused, later = dict[int, Refusal](), dict[int, Refusal]()
        waits: list[Waiting] = []
        full = False
        held: set[Numbered] = set()
        """Of whom a message is refused as too late: were a later one taken, it would pass for taken when it comes again
        because this answer was lost."""
        for place, message in enumerate(messages):
            whose, seq = Numbered(message.sender, message.header.boot), message.header.seq
            progress = self.of(whose)
            try:
                hand_over = self._read(message)
                if seq and seq <= progress.handed:
                    waits.append(Waiting(place, progress, message))
                    continue
                if is_expired(message):
                    raise MessageRefused(EXPIRED)
            except MessageRefused as bad:
                refused[place] = bad.reason
                self._arrived(whose, progress, seq)
                if bad.reason.code == EXPIRED.code:
                    held.add(whose)
                continue
            if whose in held:
                later[place] = OUT_OF_ORDER
            elif full := full or not self._room():
                later[place] = self.FULL
            else:
                self._arrived(whose, progress, seq)
                hand_over()
                self.counters["received"] += 1
                if seq:
                    progress.handed = seq
                    waits.append(Waiting(place, progress, message))
        later |= dict.fromkeys(await self._until_done(waits), self.NOT_DONE)
        self.counters["refused"] += len(refused)
        self.counters["later"] += len(later)
        query.reply(Receipt(taken=len(messages) - len(refused) - len(later), refused=refused, later=later))

    def _arrived(self, whose: Numbered, progress: Progress, seq: int) -> None:
        if progress.arrived and seq > progress.arrived + 1:
            self.counters["missing"] += seq - progress.arrived - 1
            self._missing(whose.sender, seq - progress.arrived - 1)
        progress.arrived = max(progress.arrived, seq)

    async def _until_done(self, waits: Sequence[Waiting]) -> list[int]:
        """Wait within bounds until messages are done with. Returns the places of those that are not."""
        left = list(waits)
        with suppress(TimeoutError):
            async with asyncio.timeout(self._patience()) as bound:
                self._bounds.add(bound)
                try:
                    while (
                        left := [one for one in left if one.message.header.seq > one.progress.done]
                    ) and not self._leaving:
                        await self._changed.wait()
                finally:
                    self._bounds.discard(bound)
        return [one.place for one in left]
