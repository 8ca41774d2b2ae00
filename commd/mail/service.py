"""A board's mail: taken from senders and from other boards, kept on disk, carried on until its receiver has it.

Whoever holds a message answers for it: it is removed here only when whoever comes next has it on disk, and if it is
given up here its sender is told from here (docs/guides/mail.md).
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from sqlite3 import Connection

from msgspec.structs import replace

from commd.bus.bus import Bus, Query
from commd.mail import queries
from commd.mail.age_clock import MailClock
from commd.mail.dead_letters import Undelivered
from commd.mail.delivery import RETRY_MOST, DeliveryQueues
from commd.mail.inspection import list_mailboxes
from commd.mail.message import LARGEST, SLACK, StoredMessage, letter
from commd.mail.queries import Tally
from commd.mail.store import Store, StoreFailed, open_store
from commd.mail.transport import Air, Deliver, Directory, Peers
from schemas.mission.model import RESERVED, MailRules
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.keys import check_name
from schemas.wire.records import Health, Mail, Mailboxes, Message, Note, Receipt, Refusal

log = logging.getLogger("mail")


class MailService:
    """Takes mail, keeps it and carries it on."""

    def __init__(
        self,
        bus: Bus,
        store: Store,
        tally: Tally,
        clock: MailClock,
        directory: Directory,
        rules: MailRules,
        air: Air | None = None,
    ) -> None:
        """`tally` is what `store` counts; `bus.name` is the board."""
        self.counters: Counter[str] = Counter()
        self.store = store
        """The board's file: its facts are kept there too."""
        self._bus, self._tally, self.clock, self._rules = bus, tally, clock, rules
        self._peers = Peers(bus, clock, directory, air)
        self._undelivered = Undelivered(store, tally, clock, self._line)
        peers = self._peers
        self._delivery_queues = DeliveryQueues(
            store, tally, clock, peers.carry, self._undelivered.give_up, peers.of, peers.group_of
        )
        self.ask_around: Callable[[], Awaitable[None]] | None = None
        """Lets the directory hear who has joined other boards just now; asked before a receiver is refused."""
        self.everybody_known = True
        """Whether the directory knows by now who joined in former lives: else it refuses nobody."""
        self._hosted: dict[str, tuple[Callable[[], None], ...]] = {}
        self._moving: asyncio.Task[bool] | None = None

    @property
    def directory(self) -> Directory:
        """Who can be sent to, and where."""
        return self._peers.directory

    @directory.setter
    def directory(self, directory: Directory) -> None:
        self._peers.directory, self.everybody_known = directory, True

    @property
    def names(self) -> Collection[str]:
        """All who can be sent to, there or away."""
        return self.directory.names()

    @property
    def waiting(self) -> int:
        """How many messages are in the file."""
        return self._tally.messages.total()

    @property
    def counters_now(self) -> Counter[str]:
        """What became of messages so far, from their coming to their going."""
        return self.counters + self._delivery_queues.counters + self._undelivered.counters + self.store.counters

    def state_of(self, sender: str, receiver: str) -> str:
        """Say what the mail of a pair waits for; empty if it is on its way or none waits."""
        return self._delivery_queues.state(self._line(sender, receiver) or "")

    async def run(self) -> None:
        """Carry mail on, for ever. Whom this board hosts by then is known."""
        moved = await self._lines_moved()
        while not moved:
            await asyncio.sleep(RETRY_MOST)
            moved = await self._lines_moved()
        self._peers.watch(self._delivery_queues.arrived)
        self._delivery_queues.begin()
        self._bus.serve(keys.mailboxes(self._bus.fleet, self._bus.name), Mailboxes, self._list)
        await asyncio.gather(self._delivery_queues.run(), self._undelivered.sweep(self._delivery_queues))

    # Who lives here

    def host(self, name: str) -> None:
        """Serve the mail of an agent, a client or a node that lives on this board."""
        if name not in self._hosted:
            fleet = self._bus.fleet
            self._hosted[name] = (
                self._bus.serve(keys.outbox(fleet, name), Mail, self._post),
                self._bus.serve(keys.mail(fleet, name, "*"), Mail, self._receive),
            )
            if self._tally.messages[name]:
                self._moving = asyncio.create_task(self._lines_moved())

    async def unhost(self, name: str) -> None:
        """Serve somebody no more who has left for good: what waits for it is given up."""
        for withdraw in self._hosted.pop(name, ()):
            withdraw()
        await self.gone(name)

    async def gone(self, name: str) -> None:
        """Give up what waits here for somebody who has left for good."""
        await self._undelivered.give_up_all(name, Refusal(code="receiver_left"), self._delivery_queues)

    def attach(self, name: str, deliver: Deliver) -> Callable[[], None]:
        """Hand the mail of a receiver in this process to `deliver(batch)`, batch by batch. Returns what ends it."""
        self._peers.attached[name] = deliver
        self._delivery_queues.arrived(name)
        return lambda: self._peers.attached.pop(name, None) and None

    async def _lines_moved(self) -> bool:
        """Let what waits wait where it belongs by now: an agent may have moved to another board. Returns False when the
        disk does not do it."""
        try:
            for line in list(self._tally.lines):
                receiver = line.rpartition(">")[2]
                belongs = self._line("", receiver)
                if belongs is not None and (">" in line) != (">" in belongs):
                    home = belongs == receiver
                    await self.store.write(partial(queries.move, tally=self._tally, line=line, home=home))
                    self._delivery_queues.more(belongs if home else line)
        except StoreFailed:
            return False
        return True

    def _line(self, sender: str, receiver: str) -> str | None:
        """Return the line in which a message waits; None if nobody knows its receiver."""
        board = self.directory.board_of(receiver)
        if receiver in self._hosted or board == self._bus.name:
            return receiver
        return None if board is None else f"{sender}>{receiver}"

    # Mail that comes in

    async def take(self, messages: Sequence[Message], also: Callable[[Connection], None] | None = None) -> Receipt:
        """Take mail from senders of this board. When it returns, what was taken is on disk.

        `also(connection)` becomes part of the same transaction. Raises StoreFailed: nothing was taken.
        """
        self.counters["posted"] += len(messages)
        now = self.clock.now()
        letters = [self._kept(one, self._line(one.sender, one.receiver), now, self._rules.ttl) for one in messages]
        # What this board's own offices tell stands in no mailbox's way: nobody keeps it until there is room.
        own = all(one.sender in RESERVED for one in messages)
        return await self._write(letters, now, None if own else self._rules.mailbox, also)

    async def _post(self, query: Query[Mail]) -> None:
        """Serve an outbox."""
        if query.record is None or not query.concrete:
            query.reply_error(query.error or "expected a Mail record on a concrete key")
            return
        if query.record.numberings and not query.record.messages:
            await self._tell_numbers(query, query.record.numberings)
            return
        self.counters["posted"] += len(query.record.messages)
        sender, now = keys.parse(query.key)[1], self.clock.now()  # type: ignore[index]
        if not self.everybody_known and any(self._line("", one.receiver) is None for one in query.record.messages):
            query.reply_error(f"board {self._bus.name} is still reading who joined it")
            return
        if self.ask_around is not None and any(self._line("", one.receiver) is None for one in query.record.messages):
            await self.ask_around()
        letters = [
            self._kept(one, self._line(sender, one.receiver), now, self._rules.ttl)
            if one.sender == sender
            else Refusal(code="wrong_address", text=f"its sender is not {sender}")
            for one in query.record.messages
        ]
        await self._answer(query, letters, now)

    async def _tell_numbers(self, query: Query[Mail], numberings: tuple[str, ...]) -> None:
        """Say how far this board has taken the mail of a sender."""
        sender = keys.parse(query.key)[1]  # type: ignore[index]
        try:
            numbers = await self.store.read(
                partial(queries.numbers_of, sender=sender, former=numberings[0], left_out=numberings[1:])
            )
        except StoreFailed as failed:
            query.reply_error(str(failed))
            return
        query.reply(Receipt(numbers=numbers))

    async def _receive(self, query: Query[Mail]) -> None:
        """Serve what another board brings for a receiver of this one."""
        if query.record is None or not query.concrete:
            query.reply_error(query.error or "expected a Mail record on a concrete key")
            return
        self.counters["received"] += len(query.record.messages)
        _, receiver, (_, sender) = keys.parse(query.key)  # type: ignore[misc]
        now = self.clock.now()
        letters = [
            self._kept(one, receiver, now, None, SLACK)
            if (one.sender, one.receiver) == (sender, receiver)
            else Refusal(code="wrong_address", text=f"it came as mail from {sender} to {receiver}")
            for one in query.record.messages
        ]
        await self._answer(query, letters, now)

    async def _answer(self, query: Query[Mail], letters: Sequence[StoredMessage | Refusal], now: float) -> None:
        try:
            query.reply(await self._write(letters, now, self._rules.mailbox))
        except StoreFailed as failed:  # nothing is taken: it will come again
            query.reply_error(str(failed))

    def _kept(
        self, message: Message, line: str | None, now: float, ttl: float | None, slack: int = 0
    ) -> StoredMessage | Refusal:
        """Return a message as it is kept, or why it is refused for good. `ttl` is for one that brings none."""
        if line is None:
            return Refusal(code="receiver_not_found")
        ttl = message.ttl if message.ttl is not None else ttl
        try:
            check_name(message.sender)
            kept = letter(message, line, None if ttl is None else now + ttl)
        except ValueError as bad:
            return Refusal(code="not_sendable", text=str(bad))
        if len(kept.message) > LARGEST + slack and self._travels_as(message) > LARGEST + slack:
            return Refusal(code="message_too_large")
        return kept

    def _travels_as(self, message: Message) -> int:
        """Return the bytes of a message on the bus: JSON writes many numbers shorter than MessagePack does."""
        return len(codec(Message).encode(message, self._bus.wire))

    async def _write(
        self,
        letters: Sequence[StoredMessage | Refusal],
        now: float,
        bound: int | None,
        also: Callable[[Connection], None] | None = None,
    ) -> Receipt:
        """Put a batch on disk, and let it go on from there. Reasons stand where messages are refused."""
        good = [one for one in letters if isinstance(one, StoredMessage)]

        def write(db: Connection) -> list[str]:
            if also is not None:
                also(db)
            return queries.put(db, self._tally, good, now, bound)

        outcomes = iter(await self.store.write(write) if good or also is not None else ())
        refused: dict[int, Refusal] = {}
        later: dict[int, Refusal] = {}
        for place, one in enumerate(letters):
            if isinstance(one, Refusal):
                refused[place] = one
            elif (outcome := next(outcomes)) == queries.FULL:
                later[place] = Refusal(code=queries.FULL)
            else:
                self.counters["taken" if outcome == queries.TAKEN else "duplicates"] += 1
        for line in {one.line for one in good}:
            self._delivery_queues.more(line)
        self.counters["turned_away"] += len(refused)
        self.counters["later"] += len(later)
        return Receipt(taken=len(letters) - len(refused) - len(later), refused=refused, later=later)

    # What is told of it

    async def _list(self, query: Query[Mailboxes]) -> None:
        """Serve what waits here and what was given up."""
        try:
            listed = await self.store.read(
                partial(list_mailboxes, now=self.clock.now(), state=self._delivery_queues.state)
            )
        except StoreFailed as failed:
            query.reply_error(str(failed))
            return
        about = (self._bus.header("mailboxes"), self._bus.name, str(self.store.path), self.store.synchronous)
        header, board, store, synchronous = about
        query.reply(
            replace(
                listed, header=header, board=board, store=store, synchronous=synchronous, dead_count=self._tally.dead
            ),
            keys.mailboxes(self._bus.fleet, self._bus.name),
        )

    def health(self) -> Health:
        """Return the mail counters for the daemon's health."""
        counters = self.counters_now
        counters["waiting"] = self.waiting
        counters["dead"] = self._tally.dead
        aside = "a corrupt mail file was set aside: "
        notes = [Note("mail_file_set_aside", aside + name, name) for name in self.store.set_aside]
        notes += [Note("mail_file_damaged", f"{self.store.path}: {why}") for why in self.store.damaged]
        if self.store.note:
            notes.append(Note("mail_refused", self.store.note))
        return Health(counters={name: float(count) for name, count in sorted(counters.items())}, notes=tuple(notes))


@asynccontextmanager
async def open_mailroom(
    bus: Bus,
    directory: Directory,
    rules: MailRules,
    folder: Path,
    air: Air | None = None,
    clock: MailClock | None = None,
    everybody_known: bool = True,
) -> AsyncIterator[MailService]:
    """Open the mail of the board `bus.name`, kept in `folder`, and carry it on until the end.

    Without `everybody_known` it refuses no receiver as unknown until it has another directory. Raises Findings if its
    file cannot be used.
    """
    tally, clock = Tally(), clock or MailClock()

    def count(db: Connection) -> None:  # the first time as soon as there is a file: it may not be readable yet
        clock.load_once(db)
        tally.count(db)

    async with open_store(folder / f"{bus.name}.mail", rules.synchronous, count) as store:
        with suppress(StoreFailed):  # what is told of a message's age may be less than the truth then
            clock.saved = await store.write(clock.save)
        mail_service = MailService(bus, store, tally, clock, directory, rules, air)
        mail_service.everybody_known = everybody_known
        for name in directory.names():
            if directory.board_of(name) == bus.name:
                mail_service.host(name)
        owner, running = asyncio.current_task(), asyncio.create_task(mail_service.run())

        def ended(task: asyncio.Task[None]) -> None:
            if not task.cancelled() and owner is not None:
                owner.cancel()  # without it nothing would be carried on, and nobody told

        running.add_done_callback(ended)
        try:
            yield mail_service
        except asyncio.CancelledError:
            if running.done() and (defect := running.exception()) is not None:
                raise defect from None
            raise
        finally:
            running.remove_done_callback(ended)
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
            with suppress(StoreFailed):
                await store.write(clock.save)
