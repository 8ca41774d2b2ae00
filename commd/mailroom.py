"""Mail between the agents of one board: each message is handed to its receiver, in order, before its sender is told.

The seam for durable mail: `post` and `deliver` are where an outbox and an inbox on disk come in, and the records
already carry ids and receipts. Here nothing is on disk: what the receiver's daemon did not take is refused.
"""

from __future__ import annotations

import asyncio
from collections import Counter, defaultdict
from contextlib import aclosing

from commd.bus import Bus, Query
from schemas import keys
from schemas.names import check_name
from schemas.records import Health, Mail, Message, Receipt

HAND_OVER_TIMEOUT = 5.0
"""Wall seconds that a receiver's daemon has to take a batch."""


class Mailroom:
    """Takes batches from senders and hands each message to its receiver's daemon."""

    def __init__(self, bus: Bus, agents: set[str]) -> None:
        self.agents = agents
        """The agents of the mission, there or not."""
        self.counters: Counter[str] = Counter()
        self._bus = bus
        self._guests: set[str] = set()
        """Agents made at run time that have been seen alive."""
        self._order: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    async def post(self, query: Query[Mail]) -> None:
        """Serve an outbox: deliver a batch and tell its sender which messages were taken."""
        if query.record is None or not query.concrete:
            query.reply_error(query.error or "expected a Mail record on a concrete key")
            return
        refused: dict[int, str] = {}
        later: dict[int, str] = {}
        waits: dict[tuple[str, str], str] = {}
        for place, message in enumerate(query.record.messages):
            pair = message.sender, message.receiver
            reason = waits.get(pair) or await self.deliver(message)
            if reason == "receiver_not_found":
                refused[place] = reason
            elif reason:
                later[place] = waits[pair] = reason
        taken = len(query.record.messages) - len(refused) - len(later)
        query.reply(Receipt(taken=taken, refused=refused, later=later))

    async def deliver(self, message: Message) -> str:
        """Hand one message to its receiver. Returns why it was not taken, or an empty text."""
        self.counters["messages"] += 1
        if not await self._is_known(message.receiver):
            self.counters["refused"] += 1
            return "receiver_not_found"
        inbox = keys.inbox(self._bus.fleet, message.receiver)
        async with self._order[message.receiver]:  # one at a time: order is kept per pair
            reason = f"agent `{message.receiver}` is not there"
            async with aclosing(
                self._bus.query(inbox, Mail(messages=(message,)), Receipt, HAND_OVER_TIMEOUT)
            ) as replies:
                async for reply in replies:
                    if reply.record is None:
                        reason = reply.error
                    elif reply.record.taken:
                        reason = ""
                    else:
                        reason = reply.record.refused.get(0) or reply.record.later.get(0) or "not taken"
        if reason:
            self._guests.discard(message.receiver)
        self.counters["refused" if reason else "delivered"] += 1
        return reason

    async def _is_known(self, name: str) -> bool:
        """Whether an agent is of the mission, or was made at run time and is there."""
        if name in self.agents or name in self._guests:
            return True
        try:
            key = keys.alive(self._bus.fleet, check_name(name), "agentd", "*")
        except ValueError:
            return False
        if not await self._bus.tokens(key):
            return False
        self._guests.add(name)
        return True

    def health(self) -> Health:
        """Return the mail counters for the daemon's health."""
        return Health(counters={name: float(count) for name, count in sorted(self.counters.items())})
