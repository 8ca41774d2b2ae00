"""Mail that is given up: it becomes a dead letter, and a notice tells its sender, both in one transaction."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from commd.mail import queries
from commd.mail.age_clock import SAVE_EVERY, MailClock
from commd.mail.delivery import DeliveryQueues
from commd.mail.message import OFFICE
from commd.mail.queries import Tally
from commd.mail.store import Store, StoreFailed
from schemas.wire.records import Refusal

log = logging.getLogger("mail")

SWEEP_EVERY = 0.25
"""Wall seconds between two looks for messages whose time is over."""
LOOK_EVERY = 20
"""Sweeps between two looks for lines that nobody empties: there should be none."""
DOUBT = 60.0
"""Seconds beyond its time for which a message is kept that may have arrived, until its receiver's side says so."""
STRANGER = 60.0
"""Wall seconds for which mail waits for a receiver whom nobody knows."""
SWEEP = 500
"""Messages given up in one transaction."""
LATE = 2_000
"""Late messages looked at in one sweep: those that may have arrived stand in front of others for a while."""


class Undelivered:
    """Gives up what was refused for good, what is too late, and what waits for somebody who has left."""

    def __init__(self, store: Store, tally: Tally, clock: MailClock, line_of: Callable[[str, str], str | None]) -> None:
        """`line_of(sender, receiver)` says where a message waits; None = nobody knows the receiver."""
        self.counters: Counter[str] = Counter()
        self._store, self._tally, self._clock, self._line_of = store, tally, clock, line_of
        self._strangers: dict[str, float] = {}
        """Receivers of mail whom nobody knows: since when, on the event loop's clock."""

    async def give_up(self, reasons: Mapping[int, Refusal], senders: Iterable[str]) -> list[str]:
        """Give up messages, with the reasons by place. Returns the lines in which notices wait now."""
        senders = sorted(set(senders))
        lines = {one: line for one in senders if (line := self._line_of(OFFICE, one)) is not None}
        now = self._clock.now()
        noticed = await self._store.write(lambda db: queries.bury(db, self._tally, reasons, lines, now))
        self.counters["given_up"] += len(reasons)
        told = _several(senders), _several(sorted({str(one) for one in reasons.values()}))
        log.warning("mail_given_up count=%d senders=%s why=%s", len(reasons), *told)
        return noticed

    async def give_up_all(self, receiver: str, reason: Refusal, delivery_queues: DeliveryQueues) -> None:
        """Give up all that waits for a receiver."""
        while self._tally.messages[receiver] and (
            found := await self._store.read(partial(queries.places_for, receiver=receiver, most=SWEEP))
        ):
            reasons = {place: reason for place, _ in found}
            for line in await self.give_up(reasons, {sender for _, sender in found}):
                delivery_queues.more(line)

    async def sweep(self, delivery_queues: DeliveryQueues) -> None:
        """Give up what has waited longer than it may, and write down the time meanwhile, for ever."""
        saved, place, rounds = self._clock.now(), self._tally.next, 0
        while True:
            await asyncio.sleep(SWEEP_EVERY)
            rounds += 1
            if rounds % LOOK_EVERY == 0:
                delivery_queues.look()
            try:
                if rounds % LOOK_EVERY == 0:
                    await self._give_up_strangers(delivery_queues)
                now = self._clock.now()
                if now - saved >= SAVE_EVERY and (self._tally.expiring or self._tally.next != place):
                    place = self._tally.next
                    self._clock.saved = await self._store.write(self._clock.save)
                    saved = now
                if self._tally.expiring:
                    await self._give_up_late(delivery_queues)
            except StoreFailed:
                self.counters["sweeps_failed"] += 1

    async def _give_up_strangers(self, delivery_queues: DeliveryQueues) -> None:
        """Give up what waits for somebody whom nobody has known for a while: one that left just as the mail came, or
        that the mission does not name any more."""
        now = asyncio.get_running_loop().time()
        unknown = [one for one in list(self._tally.messages) if self._line_of(OFFICE, one) is None]
        self._strangers = {one: self._strangers.get(one, now) for one in unknown}
        for one, since in self._strangers.items():
            if now - since >= STRANGER:
                await self.give_up_all(one, Refusal(code="receiver_left"), delivery_queues)

    async def _give_up_late(self, delivery_queues: DeliveryQueues) -> None:
        late = await self._store.read(partial(queries.expired, now=self._clock.now(), most=LATE))
        now = self._clock.now()
        reasons: dict[int, Refusal] = {}
        senders: set[str] = set()
        for place, line, sender, end in late:
            # What may have arrived is sent again without time left: only its receiver's side knows.
            doubtful = delivery_queues.may_be_taken(line, place)
            if doubtful and now < end + DOUBT:
                continue
            reasons[place] = Refusal(code="unknown" if doubtful else "expired")
            senders.add(sender)
            if len(reasons) == SWEEP:
                break
        if reasons:
            self.counters["expired"] += len(reasons)
            for line in await self.give_up(reasons, senders):
                delivery_queues.more(line)


def _several(texts: list[str]) -> str:
    """The first few of several texts."""
    return ",".join(texts[:5]) + (",..." if len(texts) > 5 else "")
