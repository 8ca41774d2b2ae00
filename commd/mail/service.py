"""A board's mail service: stores messages of senders and of other boards, and delivers them.

A message is removed here only when the next one on its way has it on disk; if it is given up here, this board notifies
its sender (docs/guides/mail.md).
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
from commd.bus.errors import CannotServe
from commd.mail import queries
from commd.mail.age_clock import MailClock
from commd.mail.dead_letters import DeadLetters
from commd.mail.delivery import RETRY_MOST, DeliveryQueues
from commd.mail.inspection import list_mailboxes
from commd.mail.message import LARGEST, SLACK, StoredMessage, stored
from commd.mail.queries import Tally
from commd.mail.store import Store, StoreFailed, open_store
from commd.mail.transport import Air, Deliver, Directory, Peers
from schemas.mission.model import RESERVED, MailRules
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.keys import check_name
from schemas.wire.records import Health, Mail, Mailboxes, Message, Note, Receipt, Refusal

EXPECTED = "expected a Mail record on a concrete key"
log = logging.getLogger("mail")


class MailService:
    """Stores and delivers the mail of one board."""

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
        """`tally` has the counts of `store`; `bus.name` is the board."""
        self.counters: Counter[str] = Counter()
        self.store = store
        """The board's mail file, which the directory uses too."""
        self._bus, self._tally, self.clock, self._rules = bus, tally, clock, rules
        self._peers = Peers(bus, clock, directory, air)
        self._dead_letters = DeadLetters(store, tally, clock, self._line)
        self._queues = DeliveryQueues(store, tally, clock, self._peers, self._dead_letters)
        self.ask_around: Callable[[], Awaitable[None]] | None = None
        """Asks the other boards who has joined them, before an unknown receiver is refused."""
        self.everybody_known = True
        """Whether the directory has read who joined before; until then no receiver is refused as unknown."""
        self._hosted: dict[str, tuple[Callable[[], None], ...]] = {}
        self._moving: asyncio.Task[bool] | None = None

    def know_everybody(self, directory: Directory) -> None:
        """Take the receivers of mail from `directory` from now on: it has read who joined before."""
        self._peers.directory, self.everybody_known = directory, True

    @property
    def names(self) -> Collection[str]:
        """All receivers, present or away."""
        return self._peers.directory.names()

    @property
    def waiting(self) -> int:
        """Number of messages in the file."""
        return self._tally.messages.total()

    @property
    def counters_now(self) -> Counter[str]:
        """Totals of what became of messages."""
        return self.counters + self._queues.counters + self._dead_letters.counters + self.store.counters

    def state_of(self, sender: str, receiver: str) -> str:
        """Return what the mail of a pair waits for, for people; empty if it is in flight or none waits."""
        return self._queues.state(self._line(sender, receiver) or "")

    async def run(self) -> None:
        """Deliver mail, for ever. Call it when the names of this board are known."""
        moved = await self._lines_moved()
        while not moved:
            await asyncio.sleep(RETRY_MOST)
            moved = await self._lines_moved()
        self._peers.watch(self._queues.arrived)
        self._queues.begin()
        self._bus.serve(keys.mailboxes(self._bus.fleet, self._bus.name), Mailboxes, self._list)
        await asyncio.gather(self._queues.run(), self._dead_letters.sweep(self._queues))

    def host(self, name: str) -> None:
        """Serve the mail of an agent, a client or a node of this board."""
        if name not in self._hosted:
            fleet = self._bus.fleet
            self._hosted[name] = (
                self._bus.serve(keys.outbox(fleet, name), Mail, self._post),
                self._bus.serve(keys.mail(fleet, name, "*"), Mail, self._receive),
            )
            if self._tally.messages[name]:
                self._moving = asyncio.create_task(self._lines_moved())

    async def unhost(self, name: str) -> None:
        """Stop to serve a name that has left for good, and give up its mail."""
        for withdraw in self._hosted.pop(name, ()):
            withdraw()
        await self.gone(name)

    async def gone(self, name: str) -> None:
        """Give up mail to a receiver that has left for good."""
        await self._dead_letters.give_up_all(name, Refusal(code="receiver_left"), self._queues)

    def attach(self, name: str, deliver: Deliver) -> Callable[[], None]:
        """Hand the mail of a receiver in this process to `deliver(batch)`. Returns what ends it."""
        self._peers.attached[name] = deliver
        self._queues.arrived(name)
        return lambda: self._peers.attached.pop(name, None) and None

    async def _lines_moved(self) -> bool:
        """Move waiting mail to the present boards of its receivers. Returns False if the disk fails."""
        try:
            for line in list(self._tally.lines):
                receiver = line.rpartition(">")[2]
                belongs = self._line("", receiver)
                if belongs is not None and (">" in line) != (">" in belongs):
                    home = belongs == receiver
                    await self.store.write(partial(queries.move, tally=self._tally, line=line, home=home))
                    self._queues.added(belongs if home else line)
        except StoreFailed:
            return False
        return True

    def _line(self, sender: str, receiver: str) -> str | None:
        """Return the line in which a message waits; None if its receiver is unknown."""
        board = self._peers.directory.board_of(receiver)
        if receiver in self._hosted or board == self._bus.name:
            return receiver
        return None if board is None else f"{sender}>{receiver}"

    async def take(self, messages: Sequence[Message], also: Callable[[Connection], None] | None = None) -> Receipt:
        """Store mail of senders of this board; it is on disk on return.

        `also(connection)` becomes part of the same transaction. Raises StoreFailed: nothing was taken.
        """
        self.counters["posted"] += len(messages)
        now = self.clock.now()
        rows = [self._row(one, self._line(one.sender, one.receiver), now, self._rules.ttl) for one in messages]
        # Notices of this board bypass the mailbox quota: nobody would keep them until there is room.
        own = all(one.sender in RESERVED for one in messages)
        return await self._write(rows, now, None if own else self._rules.mailbox, also)

    async def _post(self, query: Query[Mail]) -> None:
        """Serve the outbox of a sender of this board."""
        mail, sender, now = query.required(EXPECTED), keys.parse(query.key)[1], self.clock.now()  # type: ignore[index]
        if mail.numberings and not mail.messages:  # how much of it has this board taken?
            former, *left_out = mail.numberings
            numbers = partial(queries.numbers_of, sender=sender, former=former, left_out=left_out)
            query.reply(Receipt(numbers=await self.store.read(numbers)))
            return
        self.counters["posted"] += len(mail.messages)
        if any(self._line("", one.receiver) is None for one in mail.messages):
            if not self.everybody_known:
                raise CannotServe(f"board {self._bus.name} is still reading who joined it")
            if self.ask_around is not None:
                await self.ask_around()
        rows = [
            self._row(one, self._line(sender, one.receiver), now, self._rules.ttl)
            if one.sender == sender
            else Refusal(code="wrong_address", text=f"its sender is not {sender}")
            for one in mail.messages
        ]
        query.reply(await self._write(rows, now, self._rules.mailbox))

    async def _receive(self, query: Query[Mail]) -> None:
        """Serve mail of another board to a receiver of this one."""
        mail = query.required(EXPECTED)
        self.counters["received"] += len(mail.messages)
        _, receiver, (_, sender) = keys.parse(query.key)  # type: ignore[misc]
        now = self.clock.now()
        rows = [
            self._row(one, receiver, now, None, SLACK)
            if (one.sender, one.receiver) == (sender, receiver)
            else Refusal(code="wrong_address", text=f"it came as mail from {sender} to {receiver}")
            for one in mail.messages
        ]
        query.reply(await self._write(rows, now, self._rules.mailbox))

    def _row(
        self, message: Message, line: str | None, now: float, ttl: float | None, slack: int = 0
    ) -> StoredMessage | Refusal:
        """Return the row of a message, or why it is refused for good. `ttl`: if the message has none."""
        if line is None:
            return Refusal(code="receiver_not_found")
        ttl = message.ttl if message.ttl is not None else ttl
        try:
            check_name(message.sender)
            row = stored(message, line, None if ttl is None else now + ttl)
        except ValueError as bad:
            return Refusal(code="not_sendable", text=str(bad))
        # JSON writes many numbers shorter than MessagePack does.
        largest = LARGEST + slack
        if len(row.message) > largest and len(codec(Message).encode(message, self._bus.wire)) > largest:
            return Refusal(code="message_too_large")
        return row

    async def _write(
        self,
        rows: Sequence[StoredMessage | Refusal],
        now: float,
        bound: int | None,
        also: Callable[[Connection], None] | None = None,
    ) -> Receipt:
        """Write a batch to disk and start its delivery; a `Refusal` takes the place of a refused message.

        Raises StoreFailed: nothing was taken, and the sender repeats it.
        """
        good = [one for one in rows if isinstance(one, StoredMessage)]
        put = partial(queries.put, tally=self._tally, messages=good, now=now, bound=bound, also=also)
        outcomes = iter(await self.store.write(put) if good or also is not None else ())
        refused: dict[int, Refusal] = {}
        later: dict[int, Refusal] = {}
        for place, one in enumerate(rows):
            if isinstance(one, Refusal):
                refused[place] = one
            elif (outcome := next(outcomes)) == queries.FULL:
                later[place] = Refusal(code=queries.FULL)
            else:
                self.counters["taken" if outcome == queries.TAKEN else "duplicates"] += 1
        for line in {one.line for one in good}:
            self._queues.added(line)
        self.counters["turned_away"] += len(refused)
        self.counters["later"] += len(later)
        return Receipt(taken=len(rows) - len(refused) - len(later), refused=refused, later=later)

    async def _list(self, query: Query[Mailboxes]) -> None:
        """Serve the list of waiting and given up mail."""
        listed = await self.store.read(partial(list_mailboxes, now=self.clock.now(), state=self._queues.state))
        listed = replace(
            listed,
            header=self._bus.header("mailboxes"),
            board=self._bus.name,
            store=str(self.store.path),
            synchronous=self.store.synchronous,
            dead_count=self._tally.dead,
        )
        query.reply(listed, keys.mailboxes(self._bus.fleet, self._bus.name))

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
async def open_mail_service(
    bus: Bus,
    directory: Directory,
    rules: MailRules,
    folder: Path,
    air: Air | None = None,
    clock: MailClock | None = None,
    everybody_known: bool = True,
) -> AsyncIterator[MailService]:
    """Open the mail of the board `bus.name`, stored in `folder`, and deliver it until the end.

    Without `everybody_known` no receiver is refused as unknown until it has another directory. Raises Findings if the
    file cannot be used.
    """
    tally, clock = Tally(), clock or MailClock()

    def count(db: Connection) -> None:  # first called when the file can be read
        if clock.found is None:
            clock.load(db)
        tally.count(db)

    async with open_store(folder / f"{bus.name}.mail", rules.synchronous, count) as store:
        with suppress(StoreFailed):  # the ages of messages may then be too low
            clock.saved = await store.write(clock.save)
        mail_service = MailService(bus, store, tally, clock, directory, rules, air)
        mail_service.everybody_known = everybody_known
        for name in directory.names():
            if directory.board_of(name) == bus.name:
                mail_service.host(name)
        owner, running = asyncio.current_task(), asyncio.create_task(mail_service.run())

        def ended(task: asyncio.Task[None]) -> None:
            if not task.cancelled() and owner is not None:
                owner.cancel()  # without it nothing would be delivered

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
