"""An agent's outgoing mail: numbered per receiver, held until it is on disk, then handed to commd in batches, in order.

Nothing here touches the disk. New messages (`unsaved`) and those that commd has accepted (`gone`) go into the agent's
next checkpoint; `saved` is called when it is on disk, and only then a message leaves. A message is encoded once: these
bytes are what the checkpoint stores and what commd gets.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Final, cast
from weakref import WeakKeyDictionary

import msgspec

from agentd.persistence.checkpoint import Outgoing
from commd.bus.bus import Bus, boot_id
from commd.bus.errors import BusError
from commd.client.send_mail import ANSWER_TIMEOUT, Unsendable, encoded, hand_to_commd
from commd.common.tasks import wait_at_most
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import Header, Mail, Message, Receipt, Refusal
from schemas.wire.terms import Term

log = logging.getLogger("mail")

MOST_FOR_ONE = 10_000
"""Messages for one receiver that may wait here until commd accepts them; sending more fails."""
MOST_BYTES = 64 * 2**20
"""Bytes of all messages of an agent that may wait here."""
BATCH = 500
"""Messages in one query to commd."""
BATCH_BYTES = 2**20
"""Bytes of messages after which a batch is closed."""
RETRY_FIRST, RETRY_MOST = 0.1, 2.0
"""Wall seconds between two attempts to hand over mail, doubling."""
AT_ONCE: Final = 48
"""Batches of all agents of a process on their way to commd at a time. commd serves 256 queries at a time and refuses
further ones: a thousand agents would spend their time repeating queries."""


class Outbox:
    """The messages of one agent that commd has not accepted yet."""

    def __init__(
        self, bus: Bus, agent: str, on_refused: Callable[[Message, Refusal], None], counters: Counter[str]
    ) -> None:
        """`on_refused` gets each message that commd refuses permanently, and the reason.

        `counters` counts messages: sent, refused, not_answered (batches), defects.
        """
        self.numbering = boot_id() + boot_id()
        """Different in each life. After a power cut or a backup an old checkpoint would reuse numbers that boards know,
        and new messages would pass for repeated ones."""
        self.numbers: Counter[str] = Counter()
        """The number of the last message to each receiver."""
        self.counters = counters
        self.unsaved: list[Outgoing] = []
        """Messages since the last save began; `saved` is to be called when they are on disk."""
        self.gone: list[int] = []
        """Numbers of the messages that commd has accepted since the last save began: the next one removes them."""
        self.wire = bus.wire
        """The format in which messages are encoded."""
        self._bus, self._agent, self._on_refused = bus, agent, on_refused
        self._room: Counter[str] = Counter()
        """Messages that wait, by receiver, on disk or not."""
        self._bytes = self._number = 0
        self._ready: OrderedDict[str, deque[Outgoing]] = OrderedDict()
        """Messages on disk that may leave, by receiver; the receiver whose turn it is comes first."""
        self._not_before: dict[str, float] = {}
        """Loop times until which nothing is sent to receivers for which commd has no room."""
        self._pauses: dict[str, float] = {}
        self._empty = asyncio.Event()
        self._empty.set()
        self._news = asyncio.Event()
        self._again = asyncio.Event()
        self._turn = _turns.setdefault(bus, asyncio.Semaphore(AT_ONCE))
        self._task = asyncio.get_running_loop().create_task(self._hand_out())

    def __len__(self) -> int:
        return sum(self._room.values())

    # --- in ---

    def post(self, receivers: Sequence[str], performative: str, content: Term, identity: str, answers: str) -> None:
        """Accept one message for each receiver, all or none; no receiver comes twice. Raises Unsendable."""
        stamp, size = time.time_ns(), 0
        new: list[Outgoing] = []
        for number, receiver in enumerate(receivers, self._number + 1):
            message = Message(
                header=Header(seq=self.numbers[receiver] + 1, stamp=stamp, source=self._agent, boot=self.numbering),
                id=identity,
                sender=self._agent,
                performative=performative,
                receiver=receiver,
                content=content,
                in_reply_to=answers,
            )
            data = encoded(message, self.wire)
            size += len(data)
            if self._room[receiver] >= MOST_FOR_ONE:
                raise Unsendable("mailbox_full", f"{MOST_FOR_ONE} messages to '{receiver}' are waiting to be sent")
            if self._bytes + size > MOST_BYTES:
                waiting = f"{len(self)} messages of {self._bytes / 2**20:.0f} MB are waiting to be sent"
                raise Unsendable("mailbox_full", f"{waiting}, at most {MOST_BYTES / 2**20:.0f} MB may")
            new.append(Outgoing(number, receiver, message.header.seq, data))
            if len(new) == 1 < len(receivers):
                encode = msgspec.json.encode if self.wire == "json" else msgspec.msgpack.encode
                content = cast(Term, msgspec.Raw(encode(content)))  # once for all others
        for one in new:
            self.numbers[one.receiver] = one.seq
        self.unsaved += new
        self._count(new)

    def put(self, message: bytes, receiver: str, seq: int) -> None:
        """Accept a message that has its number already, and is encoded."""
        new = [Outgoing(self._number + 1, receiver, seq, message)]
        self.unsaved += new
        self._count(new)

    def _count(self, new: Sequence[Outgoing]) -> None:
        for one in new:
            self._room[one.receiver] += 1
            self._bytes += len(one.message)
            self._number = max(self._number, one.number)

    def restore(self, messages: Sequence[Outgoing]) -> None:
        """Continue with the messages that a former life has not handed over, under their numbers."""
        self._count(messages)
        self.saved(messages)

    def saved(self, messages: Sequence[Outgoing]) -> None:
        """Let these messages leave: they are on disk."""
        for one in messages:
            self._ready.setdefault(one.receiver, deque()).append(one)
        if messages:
            self._empty.clear()
            self._news.set()

    # --- out ---

    def retry_now(self) -> None:
        """Repeat failed attempts immediately: commd or the router is back."""
        self._not_before.clear()
        self._pauses.clear()
        self._again.set()
        self._news.set()

    async def drain(self, patience: float) -> None:
        """Wait until all messages on disk are handed over, at most `patience` wall seconds; then end."""
        if not await wait_at_most(self._empty, patience):
            log.warning("agent=%s mail_left messages=%d: commd has not taken them", self._agent, len(self))
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _hand_out(self) -> None:
        """Hand over one batch at a time, the next when commd has the last one on disk; for ever."""
        pause = RETRY_FIRST
        while True:
            try:
                self._news.clear()
                batch, next_at = self._batch()
                if not batch:
                    wait = None if next_at is None else max(0.0, next_at - asyncio.get_running_loop().time())
                    await wait_at_most(self._news, wait)
                    continue
                self._again.clear()
                async with self._turn:
                    messages = [one.message for one in batch]
                    receipt = await hand_to_commd(self._bus, self._agent, messages, ANSWER_TIMEOUT)
                pause = RETRY_FIRST
                self._settle(batch, receipt)
            except BusError as error:
                self.counters["not_answered"] += 1
                level = logging.WARNING if pause == RETRY_FIRST else logging.DEBUG
                log.log(level, "agent=%s mail_waits messages=%d why=commd: %s", self._agent, len(self), error)
                await wait_at_most(self._again, pause)
                pause = RETRY_FIRST if self._again.is_set() else min(pause * 2, RETRY_MOST)
            except Exception:  # a defect must not stop the mail silently
                self.counters["defects"] += 1
                log.exception("defect in argosy: handing out the mail of agent %s", self._agent)
                await wait_at_most(self._again, RETRY_MOST)

    def _batch(self) -> tuple[list[Outgoing], float | None]:
        """Return the next batch; if it is empty, with the loop time of the next attempt, if there is one."""
        now = asyncio.get_running_loop().time()
        batch: list[Outgoing] = []
        size, next_at = 0, None
        for receiver, waiting in list(self._ready.items()):
            until = self._not_before.get(receiver, 0.0)
            if until > now:
                next_at = until if next_at is None else min(next_at, until)
                continue
            for one in waiting:
                if len(batch) >= BATCH or (batch and size + len(one.message) > BATCH_BYTES):
                    self._ready.move_to_end(receiver)
                    return batch, None
                batch.append(one)
                size += len(one.message)
            self._ready.move_to_end(receiver)  # the next batch begins with the others
        return batch, next_at

    def _settle(self, batch: list[Outgoing], receipt: Receipt) -> None:
        """Remove the messages that commd has accepted or refused permanently; others wait until it has room."""
        now = asyncio.get_running_loop().time()
        later: dict[str, Refusal] = {}
        for place, one in enumerate(batch):
            receiver = one.receiver
            if reason := later.get(receiver) or receipt.later.get(place):
                later[receiver] = reason
                continue
            waiting = self._ready[receiver]
            waiting.popleft()  # a batch has the first messages of a receiver, in order
            if not waiting:
                del self._ready[receiver]
            self._room[receiver] -= 1
            if not self._room[receiver]:
                del self._room[receiver]
            self._bytes -= len(one.message)
            self.gone.append(one.number)
            if why := receipt.refused.get(place):
                self.counters["refused"] += 1
                made = codec(Message)
                message = made.decode(one.message, made.encodings[self.wire])
                log.warning("mail_refused id=%s receiver=%s why=%s", message.id, receiver, why)
                self._on_refused(message, why)
            else:
                self.counters["sent"] += 1
                self._pauses.pop(receiver, None)
        if not self._ready:
            self._empty.set()
        for receiver, reason in later.items():
            pause = self._pauses.get(receiver, RETRY_FIRST)
            if pause == RETRY_FIRST:
                log.warning("agent=%s mail_waits receiver=%s why=%s", self._agent, receiver, reason)
            self._not_before[receiver] = now + pause
            self._pauses[receiver] = min(pause * 2, RETRY_MOST)

    async def ahead(self, numbering: str, numbers: Mapping[str, int]) -> dict[str, int]:
        """Ask the board for the last numbers that it has of a numbering and later ones, until it answers.

        Return by how much they exceed `numbers`, by receiver.
        """
        outbox, pause = keys.outbox(self._bus.fleet, self._agent), RETRY_FIRST
        while True:
            with suppress(BusError):
                mail = Mail(numberings=(numbering, self.numbering))
                receipt = await self._bus.ask_one(outbox, mail, Receipt, ANSWER_TIMEOUT)
                found = receipt.numbers.items()
                return {one: seq - numbers.get(one, 0) for one, seq in found if seq > numbers.get(one, 0)}
            await asyncio.sleep(pause)
            pause = min(2 * pause, RETRY_MOST)


_turns: Final[WeakKeyDictionary[Bus, asyncio.Semaphore]] = WeakKeyDictionary()
"""The limit that the agents on a session share, by session."""
