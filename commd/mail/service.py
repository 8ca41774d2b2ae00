"""A board's mail service: stores messages of senders and of other boards, and delivers them.

A message is removed here only when the next one on its way has it on disk. If it is given up here, because it was
refused for good, has expired, or is for a receiver that has left, it becomes a dead letter, and its sender gets a
notice, in one transaction (docs/guides/mail.md).
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from sqlite3 import Connection

from msgspec.structs import replace

from commd.bus.bus import Bus, Query
from commd.bus.errors import CannotServe
from commd.common.tasks import in_step
from commd.mail import queries
from commd.mail.age_clock import SAVE_EVERY, MailClock
from commd.mail.delivery import RETRY_MOST, Air, Deliver, DeliveryQueues, Peers
from commd.mail.inspection import list_mailboxes
from commd.mail.message import LARGEST, OFFICE, SLACK, StoredMessage, stored
from commd.mail.queries import Tally
from commd.mail.store import Store, StoreFailed, open_store
from schemas.mission.model import RESERVED, MailRules
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.keys import is_name
from schemas.wire.records import Health, Mail, Mailboxes, Message, Note, Receipt, Refusal

EXPECTED = "expected a Mail record on a concrete key"
SWEEP_EVERY = 0.25
"""Wall seconds between two checks for expired messages..."""
REST = 1.0
"""... and while no message expires."""
LOOK_EVERY = 5.0
"""Wall seconds between two checks for lines without delivery (there should be none) and unknown receivers."""
DOUBT = 60.0
"""Seconds for which an expired message is kept that may have arrived: its receiver's side knows."""
STRANGER = 60.0
"""Wall seconds for which mail to an unknown receiver is kept."""
SWEEP = 500
"""Messages given up in one transaction."""
LATE = 2_000
"""Expired messages read in one sweep: those that may have arrived stay in front for a while."""
log = logging.getLogger("mail")
MOST_SENDERS = 20_000
"""Names made at run time on one other board, by which mail is taken between two starts: a board may make them up."""


class MailService:
    """Stores and delivers the mail of one board."""

    def __init__(
        self,
        bus: Bus,
        store: Store,
        tally: Tally,
        clock: MailClock,
        homes: Mapping[str, str],
        rules: MailRules,
        air: Air | None = None,
    ) -> None:
        """`tally` has the counts of `store`; `bus.name` is the board; `homes` as in `open_mail_service`."""
        self.counters: Counter[str] = Counter()
        self.store = store
        """The board's mail file, which the directory uses too."""
        self._bus, self._tally, self.clock, self._rules = bus, tally, clock, rules
        self._peers = Peers(bus, clock, homes, air)
        self._queues = DeliveryQueues(store, tally, clock, self._peers, self.give_up)
        self._unknown: dict[str, float] = {}
        """Unknown receivers of mail: since when, on the event loop's clock."""
        self.ask_around: Callable[[], Awaitable[None]] | None = None
        """Asks the other boards who has joined them, before an unknown receiver is refused."""
        self.everybody_known = True
        """Whether the directory has read who joined before; until then no receiver is refused as unknown."""
        self._senders: dict[str, set[str]] = {}
        """Names of other boards that have sent mail here since the start, by their beginning: the name of their board,
        for those made at run time. Each is remembered for good, here and by its receiver."""
        self._full_groups: set[str] = set()
        self._hosted: dict[str, tuple[Callable[[], None], ...]] = {}
        self._moving: asyncio.Task[bool] | None = None

    def know_everybody(self, homes: Mapping[str, str]) -> None:
        """Deliver to these receivers, and no others, from now on; `homes` as in `open_mail_service`."""
        self._peers.homes, self.everybody_known = homes, True

    @property
    def homes(self) -> Mapping[str, str]:
        """All receivers, present or away, and their boards."""
        return self._peers.homes

    @property
    def waiting(self) -> int:
        """Number of messages in the file."""
        return self._tally.messages.total()

    @property
    def counters_now(self) -> Counter[str]:
        """Totals of what became of messages."""
        return self.counters + self._queues.counters + self.store.counters

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
        try:
            await self._sweep()
        finally:
            await self._queues.end()

    def host(self, name: str) -> None:
        """Serve the mail of an agent, a client or a node of this board."""
        if name not in self._hosted:
            fleet = self._bus.fleet
            self._hosted[name] = (
                self._bus.serve(keys.outbox(fleet, name), Mail, partial(self._post, name)),
                self._bus.serve(keys.mail(fleet, name, "*"), Mail, partial(self._receive, name)),
            )
            if self._tally.messages[name]:
                self._moving = asyncio.create_task(self._lines_moved())

    async def unhost(self, name: str) -> None:
        """Stop to serve a name that has left for good, and give up its mail."""
        for withdraw in self._hosted.pop(name, ()):
            withdraw()
        await self.gone(name)

    async def gone(self, name: str) -> None:
        """Give up all mail to a receiver that has left for good."""
        reason = Refusal(code="receiver_left")
        while self._tally.messages[name] and (
            found := await self.store.read(partial(queries.places_for, receiver=name, most=SWEEP))
        ):
            await self.give_up({place: reason for place, _ in found}, {sender for _, sender in found})

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
        board = self._peers.homes.get(receiver)
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

    async def _post(self, sender: str, query: Query[Mail]) -> None:
        """Serve the outbox of a sender of this board."""
        mail, now = query.required(EXPECTED), self.clock.now()
        if mail.numberings and not mail.messages:  # how much of it has this board taken?
            former, *left_out = mail.numberings
            numbers = partial(queries.numbers_of, sender=sender, former=former, left_out=left_out)
            query.reply(Receipt(numbers=await self.store.read(numbers)))
            return
        self.counters["posted"] += len(mail.messages)
        if any(self._line("", receiver) is None for receiver in {one.receiver for one in mail.messages}):
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

    async def _receive(self, receiver: str, query: Query[Mail]) -> None:
        """Serve mail of another board to a receiver of this one."""
        mail, now, sender = query.required(EXPECTED), self.clock.now(), query.key.rpartition("/")[2]
        self.counters["received"] += len(mail.messages)
        turned_away = self._turned_away(sender)
        rows = [
            turned_away or self._row(one, receiver, now, None, SLACK)
            if (one.sender, one.receiver) == (sender, receiver)
            else Refusal(code="wrong_address", text=f"it came as mail from {sender} to {receiver}")
            for one in mail.messages
        ]
        query.reply(await self._write(rows, now, self._rules.mailbox))

    def _turned_away(self, sender: str) -> Refusal | None:
        """Count a sender of another board. Return why its mail is refused: this is no name, or there were too many."""
        group = sender.partition("_")[0]
        names = self._senders.get(group, set())
        if sender in names:
            return None
        if not is_name(sender):
            return Refusal(code="wrong_address", text=f"`{sender}` is no name")
        if len(names) < MOST_SENDERS:
            self._senders.setdefault(group, names).add(sender)
            return None
        why = f"mail of {MOST_SENDERS} other names that begin with {group} has come to board {self._bus.name}"
        if group not in self._full_groups:
            self._full_groups.add(group)
            log.warning("too_many_senders group=%s: %s; further ones are refused", group, why)
        return Refusal(code="too_many_senders", text=why)

    def _row(
        self, message: Message, line: str | None, now: float, ttl: float | None, slack: int = 0
    ) -> StoredMessage | Refusal:
        """Return the row of a message, or why it is refused for good. `ttl`: wall seconds, if the message has none."""
        if line is None:
            return Refusal(code="receiver_not_found")
        ttl = message.ttl if message.ttl is not None else ttl
        try:
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

    async def give_up(self, reasons: Mapping[int, Refusal], senders: set[str]) -> None:
        """Give up messages of these senders, with the reasons by place, and start the delivery of the notices."""
        lines = {one: line for one in sorted(senders) if (line := self._line(OFFICE, one)) is not None}
        now = self.clock.now()
        noticed = await self.store.write(lambda db: queries.move_to_dead_letters(db, self._tally, reasons, lines, now))
        self.counters["given_up"] += len(reasons)
        why = _several({str(one) for one in reasons.values()})
        log.warning("mail_given_up count=%d senders=%s why=%s", len(reasons), _several(senders), why)
        for line in noticed:
            self._queues.added(line)

    async def _sweep(self) -> None:
        """Give up expired mail and mail to unknown receivers, and save the mail clock, for ever."""
        loop, saved, place = asyncio.get_running_loop(), self.clock.now(), self._tally.next
        look_at = loop.time() + LOOK_EVERY
        while True:
            await asyncio.sleep(in_step(loop.time(), SWEEP_EVERY if self._tally.expiring else REST))
            try:
                if loop.time() >= look_at:
                    look_at = loop.time() + LOOK_EVERY
                    self._queues.look()
                    await self._drop_unknown_receivers(loop.time())
                now = self.clock.now()
                if now - saved >= SAVE_EVERY and (self._tally.expiring or self._tally.next != place):
                    place = self._tally.next
                    self.clock.saved = await self.store.write(self.clock.save)
                    saved = now
                if self._tally.expiring:
                    await self._give_up_late()
            except StoreFailed:
                self.counters["sweeps_failed"] += 1

    async def _drop_unknown_receivers(self, now: float) -> None:
        """Give up mail to receivers that have been unknown for `STRANGER` at `now`, on the event loop's clock: they
        left as the mail arrived, or the mission has changed."""
        unknown = [one for one in list(self._tally.messages) if self._line(OFFICE, one) is None]
        self._unknown = {one: self._unknown.get(one, now) for one in unknown}
        for one, since in self._unknown.items():
            if now - since >= STRANGER:
                await self.gone(one)

    async def _give_up_late(self) -> None:
        """Give up what has expired, at most `SWEEP` messages."""
        late = await self.store.read(partial(queries.expired, now=self.clock.now(), most=LATE))
        now = self.clock.now()
        reasons: dict[int, Refusal] = {}
        senders: set[str] = set()
        for place, line, sender, end in late:
            # A message that may have arrived is sent again with no time left: only its receiver's side knows.
            doubtful = self._queues.may_be_taken(line, place)
            if doubtful and now < end + DOUBT:
                continue
            reasons[place] = Refusal(code="unknown" if doubtful else "expired")
            senders.add(sender)
            if len(reasons) == SWEEP:
                break
        if reasons:
            self.counters["expired"] += len(reasons)
            await self.give_up(reasons, senders)

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
        notes = [Note("mail_file_set_aside", aside + name, name) for name in self.store.file.set_aside]
        notes += [Note("mail_file_damaged", f"{self.store.path}: {why}") for why in self.store.file.damaged]
        if self.store.note:
            notes.append(Note("mail_refused", self.store.note))
        return Health(counters={name: float(count) for name, count in sorted(counters.items())}, notes=tuple(notes))


@asynccontextmanager
async def open_mail_service(
    bus: Bus,
    homes: Mapping[str, str],
    rules: MailRules,
    folder: Path,
    air: Air | None = None,
    clock: MailClock | None = None,
    everybody_known: bool = True,
) -> AsyncIterator[MailService]:
    """Open the mail of the board `bus.name`, stored in `folder`, and deliver it until the end.

    `homes` has all receivers, present or away, and the boards whose commd stores their mail. Without `everybody_known`
    no receiver is refused as unknown until `know_everybody`. Raises Findings if the file cannot be used.
    """
    tally, clock = Tally(), clock or MailClock()

    def count(db: Connection) -> None:  # first called when the file can be read
        if clock.found is None:
            clock.load(db)
        tally.count(db)

    async with open_store(folder / f"{bus.name}.mail", rules.synchronous, count) as store:
        with suppress(StoreFailed):  # the ages of messages may then be too low
            clock.saved = await store.write(clock.save)
        mail_service = MailService(bus, store, tally, clock, homes, rules, air)
        mail_service.everybody_known = everybody_known
        for name, home in homes.items():
            if home == bus.name:
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


def _several(texts: set[str]) -> str:
    """Return the first five of several texts."""
    return ",".join(sorted(texts)[:5]) + (",..." if len(texts) > 5 else "")
