"""Deliver the lines of waiting messages in order, one batch of a line at a time, by queries.

Delivery of a line continues when its peer appears; while the peer is away or does not answer, a timer retries. Lines
whose peers answer have workers of their own, so that hung peers delay no others.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import TypeAlias
from weakref import WeakValueDictionary

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, QueryFailed, QueryTimeout
from commd.common.tasks import Tasks
from commd.liveness.presence import Tokens
from commd.mail import queries
from commd.mail.age_clock import MailClock
from commd.mail.message import StoredMessage, adds_up, read, read_plain
from commd.mail.queries import Tally
from commd.mail.store import Store, StoreFailed
from schemas.wire import keys
from schemas.wire.codec import BadRecord, TooDeep
from schemas.wire.records import Mail, Message, Receipt, Refusal

log = logging.getLogger("mail")

RETRY_FIRST, RETRY_MOST = 0.05, 5.0
"""Wall seconds between two attempts: the first pause, doubled up to the second figure."""
LATER_MOST = 2.0
"""The longest pause, in wall seconds, for a peer that is present and has no room."""
MAX_CODE, MAX_TEXT = 64, 500
"""Characters of the code and of the text of a peer's refusal that are kept."""
WORKERS, PROBES = 32, 8
"""Batches in flight to peers that answer, and to peers that did not; to receivers here, and as many to other boards."""
OF_ONE, PROBES_OF_ONE = 16, 2
"""The same to one process or one board: one that hangs leaves workers for the others."""
ANSWER_TIMEOUT, SLOWEST = 5.0, 10_000
"""Wall seconds that another board has to commit a batch, and bytes per second of the slowest link: the time that the
batch and those before it take on such a link is added."""
ABSORB_TIMEOUT = 10.0
"""Wall seconds that a receiver has to take a batch."""
RECEIPT_SIZE = 64
"""Bytes of a receipt on the air."""

Deliver: TypeAlias = Callable[[tuple[Message, ...]], Awaitable[Receipt | None]]
"""Hands a batch to a receiver in this process; None = no answer, to be sent again."""
Air: TypeAlias = Callable[[str, str, int], Awaitable[bool]]
"""A model of the radio: `air(sender, receiver, size)` lasts as one transmission of `size` bytes, and returns whether it
arrived."""


@dataclass(frozen=True)
class NotTaken:
    """A batch that was not taken, as far as is known."""

    why: str
    """For people."""
    certain: bool
    """Whether nothing was taken for certain: the batch was not sent, or there was no receiver."""
    away: bool = False
    """Whether the peer is away, for all its lines."""
    unreadable: bool = False
    """Whether the peer can never read some message of the batch."""


class Peers:
    """Receivers of this board and other boards: which are alive, and how a batch gets there."""

    def __init__(self, bus: Bus, clock: MailClock, homes: Mapping[str, str], air: Air | None) -> None:
        self.homes, self._air = homes, air
        """All receivers, present or away, and the boards whose commd stores their mail."""
        self.attached: dict[str, Deliver] = {}
        """Receivers in this process."""
        self._bus, self._clock = bus, clock
        self._in_flight: Counter[str] = Counter()
        """Bytes of the batches that wait for their receipts, by board."""
        self._alive = Tokens()

    def watch(self, arrived: Callable[[str], None]) -> None:
        """Watch the fleet's liveliness tokens; call `arrived(name)` when a board or a receiver appears."""

        def token(key: str, alive: bool) -> None:
            parsed = keys.parse_alive(key)
            if parsed is None or parsed[2] in ("bridged", "argosy"):
                return
            _, name, daemon, boot = parsed
            self._alive.note(name, f"{daemon}/{boot}", alive)
            if alive:
                arrived(name)

        self._bus.watch(keys.alive(self._bus.fleet, "*", "*", "*"), token)

    def of(self, line: str) -> str:
        """Return the peer that takes the mail of a line: a receiver of this board, or another board."""
        _, remote, receiver = line.partition(">")
        return self.homes.get(receiver, receiver) if remote else line

    def group_of(self, line: str) -> str:
        """Return what a line hangs with: the process of its receiver on this board, or another board."""
        peer = self.of(line)
        if ">" not in line and len(alive := self._alive.get(peer, ())) == 1:
            return next(iter(alive))
        return peer

    async def carry(self, line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        """Send a batch of a line to its peer."""
        now = self._clock.now()
        if (deliver := self.attached.get(line)) is not None:
            receipt = await deliver(tuple(one.current(now, read) for one in batch))
            return receipt or NotTaken(f"{line} does not answer", certain=False)
        mail, peer = Mail(messages=tuple(one.current(now, read_plain) for one in batch)), self.of(line)
        sender, remote, receiver = line.partition(">")
        size = sum(len(one.message) for one in batch) if remote else 0
        air = self._air if remote else None
        if air is not None and not await air(sender, receiver, size):
            return NotTaken("lost on the air", certain=True)
        self._in_flight[peer] += size
        if remote:
            key = keys.mail(self._bus.fleet, receiver, sender)
            timeout = ANSWER_TIMEOUT + self._in_flight[peer] / SLOWEST
        else:
            key, timeout = keys.inbox(self._bus.fleet, line), ABSORB_TIMEOUT
        there = peer in self._alive
        try:
            receipt = await self._bus.ask_one(key, mail, Receipt, timeout)
        except BusClosed as closed:
            return NotTaken(str(closed), certain=True)
        except BadRecord as bad:
            return NotTaken(f"it cannot be written: {bad}", certain=True, unreadable=True)
        except QueryTimeout as timed_out:
            if not timed_out.nobody:
                return NotTaken(f"{peer}: {timed_out}", certain=False)
            if there or peer in self._alive:
                # A router that denies a query ends it immediately, as it does when nobody serves the key.
                denied = ": or does its router deny it?" if self._clock.now() - now < timeout / 2 else ""
                return NotTaken(f"{peer} does not answer{denied}", certain=False)
            return NotTaken(f"{peer} is away", certain=True, away=True)
        except QueryFailed as failed:
            return NotTaken(f"{peer} does not take it: {failed}", certain=False, unreadable=failed.code == TooDeep.code)
        finally:
            self._in_flight[peer] -= size
        if air is not None and not await air(receiver, sender, RECEIPT_SIZE):
            return NotTaken("its receipt was lost on the air", certain=False)
        return receipt


@dataclass(eq=False, slots=True)
class DeliveryQueue:
    """The delivery of one line that is not empty."""

    line: str
    after: int = 0
    """The last place that the peer has taken; it may still be in the file."""
    sent: float = 0
    """The last place that the peer may have taken; infinite while a batch is in flight."""
    pause: float = RETRY_FIRST
    due: float = 0.0
    """Time of the next attempt, on the event loop's clock."""
    timer: asyncio.TimerHandle | None = None
    queued: bool = False
    added: bool = False
    """Whether messages were added since the file was last read."""
    hung: bool = False
    """Whether the last attempt failed: the next one is a probe."""
    alone: bool = False
    """Whether the peer could not read the last batch: the next one is a single message, to find the unreadable one."""
    state: str = ""
    removal: asyncio.Task[object] | None = None
    """Removes the last batch from the file."""


@dataclass(eq=False, slots=True)
class Away:
    """A peer that is away, and the queues that wait for it; only one of them probes it."""

    queues: dict[str, DeliveryQueue] = field(default_factory=dict)
    pause: float = RETRY_FIRST
    timer: asyncio.TimerHandle | None = None


class DeliveryQueues:
    """The deliveries of all lines that are not empty, and their workers."""

    def __init__(
        self,
        store: Store,
        tally: Tally,
        clock: MailClock,
        peers: Peers,
        give_up: Callable[[Mapping[int, Refusal], set[str]], Awaitable[None]],
    ) -> None:
        """`give_up(reasons, senders)` makes dead letters of messages, with the reasons by place."""
        self.counters: Counter[str] = Counter()
        self.before = 0
        """The last place of the process before this one: its peer may have taken any message up to there."""
        self._store, self._tally, self._clock = store, tally, clock
        self._peers, self._give_up = peers, give_up
        self._lines: dict[str, DeliveryQueue] = {}
        self._away: dict[str, Away] = {}
        self._tasks = Tasks("delivering mail")
        self._begun = False
        kinds = [(remote, probing) for remote in (False, True) for probing in (False, True)]
        self._workers = {kind: asyncio.Semaphore(PROBES if kind[1] else WORKERS) for kind in kinds}
        """For lines to other boards or not, that probe or not."""
        self._of_one: WeakValueDictionary[tuple[bool, bool, str], asyncio.Semaphore] = WeakValueDictionary()
        """The same for each group of lines, while it has any that wait or are served."""
        self._loop = asyncio.get_running_loop()

    def begin(self) -> None:
        """Start to deliver, with what the process before this one left."""
        self.before, self._begun = self._tally.next - 1, True
        self.look()

    async def end(self) -> None:
        """Deliver no more."""
        self._begun = False
        await self._tasks.end()

    def look(self) -> None:
        """Start the delivery of each line that is not empty."""
        for line in list(self._tally.lines):
            if line not in self._lines:
                self.added(line)

    def added(self, line: str) -> None:
        """Deliver messages that were added to a line."""
        if (queue := self._lines.get(line)) is not None:
            queue.added = True
        elif self._begun:
            self._lines[line] = DeliveryQueue(line)
            self._queue(self._lines[line])

    def arrived(self, peer: str) -> None:
        """A peer has appeared: deliver what waits for it now."""
        self._back(peer)
        for queue in self._lines.values():
            if queue.timer is not None and self._peers.of(queue.line) == peer:
                queue.timer.cancel()
                self._retry_now(queue)

    def _back(self, peer: str) -> None:
        """A peer that was away answers: continue with the queues that waited for it."""
        if (away := self._away.pop(peer, None)) is not None:
            if away.timer is not None:
                away.timer.cancel()
            for queue in away.queues.values():
                self._retry_now(queue)

    def _retry_now(self, queue: DeliveryQueue) -> None:
        queue.timer, queue.pause, queue.hung, queue.alone = None, RETRY_FIRST, False, False
        self._queue(queue)

    def may_be_taken(self, line: str, place: int) -> bool:
        """Whether the peer may have taken the message at `place`, which is still in the file."""
        queue = self._lines.get(line)
        return place <= self.before or (queue is not None and place <= queue.sent)

    def state(self, line: str) -> str:
        """Return what a line waits for, for people."""
        queue = self._lines.get(line)
        if queue is None:
            return ""
        if queue.timer is not None:
            return f"{queue.state}, next attempt in {max(0.0, queue.due - self._loop.time()):.1f} s"
        return queue.state

    def _queue(self, queue: DeliveryQueue) -> None:
        if self._begun and not queue.queued:
            queue.queued = True
            self._tasks.spawn(self._work(queue))

    async def _work(self, queue: DeliveryQueue) -> None:
        """Send a batch of a line when there is a worker for its kind and group."""
        kind = ">" in queue.line, queue.hung
        most = asyncio.Semaphore(PROBES_OF_ONE if queue.hung else OF_ONE)
        of_one = self._of_one.setdefault((*kind, self._peers.group_of(queue.line)), most)
        async with of_one, self._workers[kind]:
            queue.queued, queue.timer = False, None
            known, queue.sent = queue.sent, inf
            try:
                await self._advance(queue, known)
            except StoreFailed as failed:
                self._again(queue, known, NotTaken(str(failed), certain=True))
            except Exception as error:  # a defect in one line must not stop the others
                log.exception("defect in argosy: mail of line %s", queue.line)
                self._again(queue, known, NotTaken(f"defect in argosy: {type(error).__name__}: {error}", certain=False))

    def _again(self, queue: DeliveryQueue, known: float, why: NotTaken) -> None:
        """Restart a line at its front: messages that were taken and are still in the file are sent again, and known
        there."""
        queue.sent, queue.after, queue.removal = max(known, queue.after), 0, None
        self._later(queue, why)

    async def _advance(self, queue: DeliveryQueue, known: float) -> None:
        """Send one batch of a line to its peer, and act on the answer."""
        queue.added = False
        most = 1 if queue.alone else queries.BATCH
        batch, more = await self._store.read(partial(queries.front, line=queue.line, after=queue.after, most=most))
        if not batch:
            await self._finish(queue, known)
            return
        now, last = self._clock.now(), batch[-1].place
        # An expired message that was never sent is not sent: the sweep gives it up.
        doubtful = max(known, self.before)
        going = [one for one in batch if one.expires is None or one.expires > now or one.place <= doubtful]
        answer = await self._peers.carry(queue.line, going) if going else Receipt()
        if isinstance(answer, NotTaken) and answer.unreadable and len(going) == 1:
            # It would block all behind it for ever.
            answer = Receipt(refused={0: Refusal(code="unreadable", text=answer.why[:200])})
        if isinstance(answer, Receipt) and not adds_up(answer, len(going)):
            self.counters["bad_receipts"] += 1
            answer = NotTaken(f"its receipt does not account for all {len(going)}: {answer}"[:200], certain=False)
        if isinstance(answer, NotTaken):
            self.counters["unanswered"] += 1
            queue.sent = known if answer.certain else max(known, last)
            self._later(queue, answer)
            return
        queue.alone = False
        await self._settle(queue, known, going, answer)
        if going and self._away:
            self._back(self._peers.of(queue.line))
        if answer.later:
            queue.after, queue.hung, queue.state = 0, False, str(next(iter(answer.later.values())))
            if answer.taken or (last > known and ">" not in queue.line):  # it was offered a new message
                queue.pause = RETRY_FIRST
            self._pause(queue, LATER_MOST)
            return
        queue.after, queue.pause, queue.hung, queue.state = last, RETRY_FIRST, False, ""
        if more or queue.added:
            self._queue(queue)
        else:
            await self._finish(queue, queue.sent)

    async def _settle(
        self, queue: DeliveryQueue, known: float, batch: Sequence[StoredMessage], answer: Receipt
    ) -> None:
        """Remove what the peer has taken, and give up what it has refused."""
        refused = {  # bounded: they are stored, and sent to the senders
            batch[i].place: Refusal(code=why.code[:MAX_CODE], text=why.text[:MAX_TEXT])
            for i, why in answer.refused.items()
        }
        taken = [one.place for i, one in enumerate(batch) if i not in answer.refused and i not in answer.later]
        self.counters["sent"] += len(taken)
        self.counters["refused"] += len(refused)
        await self._removed(queue)  # one at a time: after a failure the line restarts at its front
        # A receiver that answers `later` may be working on the message, as a program does.
        in_work = [one.place for i, one in enumerate(batch) if i in answer.later and ">" not in queue.line]
        queue.sent = max(known, max(taken + in_work, default=0))
        if taken:
            queue.removal = self._loop.create_task(
                self._store.write(partial(queries.remove, tally=self._tally, places=taken))
            )
        if refused:
            await self._give_up(refused, {one.sender for one in batch if one.place in refused})
        if answer.later:
            await self._removed(queue)

    async def _removed(self, queue: DeliveryQueue) -> None:
        if (removal := queue.removal) is not None:
            queue.removal = None
            await removal

    async def _finish(self, queue: DeliveryQueue, known: float) -> None:
        """End the delivery of an empty line, unless messages were added meanwhile."""
        await self._removed(queue)
        queue.sent = known
        if queue.added:
            self._queue(queue)
        else:
            del self._lines[queue.line]

    def _later(self, queue: DeliveryQueue, answer: NotTaken) -> None:
        """Retry when the peer appears, or after a pause that doubles."""
        queue.state, queue.hung, queue.alone = answer.why, True, answer.unreadable
        if answer.away:
            peer = self._peers.of(queue.line)
            away = self._away.setdefault(peer, Away())
            away.queues[queue.line] = queue
            if away.timer is None:
                self._probe_later(peer, away)
            return
        self._pause(queue, RETRY_MOST)

    def _pause(self, queue: DeliveryQueue, most: float) -> None:
        """Retry a line after a pause that doubles, up to `most` wall seconds."""
        pause = min(queue.pause, most)
        queue.pause = pause * 2
        queue.due = self._loop.time() + pause
        queue.timer = self._loop.call_later(pause, self._queue, queue)

    def _probe(self, peer: str) -> None:
        """Let one of the lines that wait for a peer probe it."""
        away = self._away.get(peer)
        if away is None:
            return
        away.timer = None
        if away.queues:
            line = next(iter(away.queues))
            self._queue(away.queues.pop(line))
        if away.queues:  # the one that probes may find its line empty
            self._probe_later(peer, away)

    def _probe_later(self, peer: str, away: Away) -> None:
        away.timer = self._loop.call_later(away.pause, self._probe, peer)
        away.pause = min(away.pause * 2, RETRY_MOST)
