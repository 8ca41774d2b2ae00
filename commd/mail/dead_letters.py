"""Give up mail: it becomes a dead letter, and its sender gets a notice, in one transaction."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from commd.common.tasks import in_step
from commd.mail import queries
from commd.mail.age_clock import SAVE_EVERY, MailClock
from commd.mail.delivery import DeliveryQueues
from commd.mail.message import OFFICE
from commd.mail.queries import Tally
from commd.mail.store import Store, StoreFailed
from schemas.wire.records import Refusal

log = logging.getLogger("mail")

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


class DeadLetters:
    """Gives up mail that was refused for good, has expired, or is for a receiver that has left."""

    def __init__(self, store: Store, tally: Tally, clock: MailClock, line_of: Callable[[str, str], str | None]) -> None:
        """`line_of(sender, receiver)` returns the line of a message; None = the receiver is unknown."""
        self.counters: Counter[str] = Counter()
        self._store, self._tally, self._clock, self._line_of = store, tally, clock, line_of
        self._unknown: dict[str, float] = {}
        """Unknown receivers of mail: since when, on the event loop's clock."""

    async def give_up(self, reasons: Mapping[int, Refusal], senders: Iterable[str]) -> list[str]:
        """Give up messages, with the reasons by place. Returns the lines that got notices."""
        senders = sorted(set(senders))
        lines = {one: line for one in senders if (line := self._line_of(OFFICE, one)) is not None}
        now = self._clock.now()
        noticed = await self._store.write(lambda db: queries.move_to_dead_letters(db, self._tally, reasons, lines, now))
        self.counters["given_up"] += len(reasons)
        why = _several(sorted({str(one) for one in reasons.values()}))
        log.warning("mail_given_up count=%d senders=%s why=%s", len(reasons), _several(senders), why)
        return noticed

    async def give_up_all(self, receiver: str, reason: Refusal, queues: DeliveryQueues) -> None:
        """Give up all mail to a receiver."""
        while self._tally.messages[receiver] and (
            found := await self._store.read(partial(queries.places_for, receiver=receiver, most=SWEEP))
        ):
            reasons = {place: reason for place, _ in found}
            for line in await self.give_up(reasons, {sender for _, sender in found}):
                queues.added(line)

    async def sweep(self, queues: DeliveryQueues) -> None:
        """Give up expired mail and mail to unknown receivers, and save the mail clock, for ever."""
        loop, saved, place = asyncio.get_running_loop(), self._clock.now(), self._tally.next
        look_at = loop.time() + LOOK_EVERY
        while True:
            await asyncio.sleep(in_step(loop.time(), SWEEP_EVERY if self._tally.expiring else REST))
            try:
                if loop.time() >= look_at:
                    look_at = loop.time() + LOOK_EVERY
                    queues.look()
                    await self._drop_unknown_receivers(queues)
                now = self._clock.now()
                if now - saved >= SAVE_EVERY and (self._tally.expiring or self._tally.next != place):
                    place = self._tally.next
                    self._clock.saved = await self._store.write(self._clock.save)
                    saved = now
                if self._tally.expiring:
                    await self._give_up_late(queues)
            except StoreFailed:
                self.counters["sweeps_failed"] += 1

    async def _drop_unknown_receivers(self, queues: DeliveryQueues) -> None:
        """Give up mail to receivers that have been unknown for `STRANGER`: they left as the mail arrived, or the
        mission has changed."""
        now = asyncio.get_running_loop().time()
        unknown = [one for one in list(self._tally.messages) if self._line_of(OFFICE, one) is None]
        self._unknown = {one: self._unknown.get(one, now) for one in unknown}
        for one, since in self._unknown.items():
            if now - since >= STRANGER:
                await self.give_up_all(one, Refusal(code="receiver_left"), queues)

    async def _give_up_late(self, queues: DeliveryQueues) -> None:
        late = await self._store.read(partial(queries.expired, now=self._clock.now(), most=LATE))
        now = self._clock.now()
        reasons: dict[int, Refusal] = {}
        senders: set[str] = set()
        for place, line, sender, end in late:
            # A message that may have arrived is sent again with no time left: only its receiver's side knows.
            doubtful = queues.may_be_taken(line, place)
            if doubtful and now < end + DOUBT:
                continue
            reasons[place] = Refusal(code="unknown" if doubtful else "expired")
            senders.add(sender)
            if len(reasons) == SWEEP:
                break
        if reasons:
            self.counters["expired"] += len(reasons)
            for line in await self.give_up(reasons, senders):
                queues.added(line)


def _several(texts: list[str]) -> str:
    """Return the first five of several texts."""
    return ",".join(texts[:5]) + (",..." if len(texts) > 5 else "")
