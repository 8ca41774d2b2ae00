"""Empties the lines of waiting messages: batch by batch, in order, one batch of a line on its way at a time.

A line goes on at once when its peer appears; while the peer is away or does not answer, a timer tries again. Lines
whose peers answer have workers of their own, so that peers that hang delay no others.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf

from commd.mail import queries
from commd.mail.age_clock import MailClock
from commd.mail.message import QueuedMessage, adds_up
from commd.mail.queries import Tally
from commd.mail.store import Store, StoreFailed
from schemas.wire.records import Receipt, Refusal

log = logging.getLogger("mail")

RETRY_FIRST, RETRY_MOST = 0.05, 5.0
"""Wall seconds between two attempts, doubling."""
LATER_MOST = 2.0
"""The same for a peer that is there and has no room."""
MAX_CODE, MAX_TEXT = 64, 500
"""Characters of the code and of the text of a peer's refusal that are kept."""
WORKERS, PROBES = 32, 8
"""Batches on their way at the same time, to receivers here and as many to other boards: to peers that answer, and to
those that did not."""
OF_ONE, PROBES_OF_ONE = 16, 2
"""The same to one process or one board: should it hang, the others are not kept."""


@dataclass(frozen=True)
class NotTaken:
    """A batch of which nothing is known to have been taken."""

    why: str
    """In words, for whoever looks at what waits."""
    certain: bool
    """Whether it is known that nothing was taken: the batch has not left, or there was nobody."""
    away: bool = False
    """Whether the peer is away, and with it for all its lines."""
    unreadable: bool = False
    """Whether the peer can read something in the batch neither now nor ever."""


@dataclass(eq=False, slots=True)
class DeliveryQueue:
    """One line that is not empty."""

    line: str
    after: int = 0
    """The last place that was taken by the peer; it may be in the file still."""
    sent: float = 0
    """The last place that may have been taken by the peer; infinite while a batch is on its way."""
    pause: float = RETRY_FIRST
    due: float = 0.0
    """When it is tried again, on the event loop's clock."""
    timer: asyncio.TimerHandle | None = None
    queued: bool = False
    more: bool = False
    """Something has come since the last look into the file."""
    hung: bool = False
    """The last attempt was in vain: the next one is a probe."""
    alone: bool = False
    """The peer could not read the last batch: the next one is a single message, to find which it is."""
    state: str = ""
    removal: asyncio.Task[None] | None = None
    """Takes the last batch out of the file."""


@dataclass(eq=False, slots=True)
class Away:
    """A peer that is not there, and the lanes that wait for it: only one of them tries, now and then."""

    delivery_queues: dict[str, DeliveryQueue] = field(default_factory=dict)
    pause: float = RETRY_FIRST
    timer: asyncio.TimerHandle | None = None


class _WorkerPool:
    """The lanes of one kind that are ready, and how many workers serve each group of them."""

    def __init__(self, workers: int, of_one: int) -> None:
        """At most `of_one` of the `workers` serve one group at the same time."""
        self.workers = workers
        self._of_one = of_one
        self._ready: deque[DeliveryQueue] = deque()
        self._wanted = asyncio.Semaphore(0)
        """Counts `_ready`."""
        self._busy: Counter[str] = Counter()
        """Workers by the group that they serve."""
        self._held: dict[str, deque[DeliveryQueue]] = {}
        """Lanes whose group has as many workers as it may, by group."""

    def add(self, lane: DeliveryQueue) -> None:
        """Let a lane wait for a worker."""
        self._ready.append(lane)
        self._wanted.release()

    async def next(self, group_of: Callable[[str], str]) -> tuple[DeliveryQueue, str]:
        """Wait for a lane whose group may have another worker. Returns it and the group, for `free`."""
        while True:
            await self._wanted.acquire()
            lane = self._ready.popleft()
            group = group_of(lane.line)
            if self._busy[group] < self._of_one:
                self._busy[group] += 1
                return lane, group
            self._held.setdefault(group, deque()).append(lane)

    def free(self, group: str) -> None:
        """Let the next lane of a group have the worker; all of them if it was the last one, as groups may change."""
        self._busy[group] -= 1
        held = self._held.get(group, deque())
        for _ in range(min(1 if self._busy[group] else len(held), len(held))):
            self.add(held.popleft())
        if not held:
            self._held.pop(group, None)
        if not self._busy[group]:
            del self._busy[group]


class DeliveryQueues:
    """All lines that are not empty, and the workers that empty them."""

    def __init__(
        self,
        store: Store,
        tally: Tally,
        clock: MailClock,
        carry: Callable[[str, Sequence[QueuedMessage]], Awaitable[Receipt | NotTaken]],
        give_up: Callable[[dict[int, Refusal], set[str]], Awaitable[list[str]]],
        peer_of: Callable[[str], str],
        group_of: Callable[[str], str],
    ) -> None:
        """`carry(line, batch)` takes a batch to its peer, which `peer_of(line)` names; lines of one `group_of(line)`
        are likely to hang together; `give_up(reasons by place, senders)` buries what the peer has refused, and says in
        which lines there is news for the senders."""
        self.counters: Counter[str] = Counter()
        self.before = 0
        """The last place of the former life of this daemon: up to it any message may have been taken by its peer."""
        self._store, self._tally, self._clock = store, tally, clock
        self._carry, self._give_up, self._peer_of = carry, give_up, peer_of
        self._group_of = group_of
        self._delivery_queues: dict[str, DeliveryQueue] = {}
        self._away: dict[str, Away] = {}
        self._pools = {
            (remote, probing): _WorkerPool(PROBES, PROBES_OF_ONE) if probing else _WorkerPool(WORKERS, OF_ONE)
            for remote in (False, True)
            for probing in (False, True)
        }
        self._loop = asyncio.get_running_loop()

    async def run(self) -> None:
        """Empty the lines, for ever."""
        await asyncio.gather(*(self._work(pool) for pool in self._pools.values() for _ in range(pool.workers)))

    def begin(self) -> None:
        """Take up what waits from the former life of this daemon."""
        self.before = self._tally.next - 1
        self.look()

    def look(self) -> None:
        """Take up any line that is not empty and that nobody empties."""
        for line in list(self._tally.lines):
            if line not in self._delivery_queues:
                self.more(line)

    def more(self, line: str) -> None:
        """There is something new in a line."""
        if (lane := self._delivery_queues.get(line)) is not None:
            lane.more = True
        else:
            self._delivery_queues[line] = DeliveryQueue(line)
            self._queue(self._delivery_queues[line])

    def arrived(self, peer: str) -> None:
        """A peer is there: what waits for it goes at once."""
        self._back(peer)
        for lane in self._delivery_queues.values():
            if lane.timer is not None and self._peer_of(lane.line) == peer:
                lane.timer.cancel()
                self._at_once(lane)

    def _back(self, peer: str) -> None:
        """A peer that was away answers: the lanes that waited for it go on."""
        if (away := self._away.pop(peer, None)) is not None:
            if away.timer is not None:
                away.timer.cancel()
            for lane in away.delivery_queues.values():
                self._at_once(lane)

    def _at_once(self, lane: DeliveryQueue) -> None:
        lane.timer, lane.pause, lane.hung, lane.alone = None, RETRY_FIRST, False, False
        self._queue(lane)

    def may_be_taken(self, line: str, place: int) -> bool:
        """Whether the peer may have taken a message that is still in the file."""
        lane = self._delivery_queues.get(line)
        return place <= self.before or (lane is not None and place <= lane.sent)

    def state(self, line: str) -> str:
        """Say what a line waits for."""
        lane = self._delivery_queues.get(line)
        if lane is None:
            return ""
        if lane.timer is not None:
            return f"{lane.state}, next attempt in {max(0.0, lane.due - self._loop.time()):.1f} s"
        return lane.state

    def _queue(self, lane: DeliveryQueue) -> None:
        if not lane.queued:
            lane.queued = True
            self._pools[">" in lane.line, lane.hung].add(lane)

    async def _work(self, pool: _WorkerPool) -> None:
        while True:
            lane, group = await pool.next(self._group_of)
            lane.queued, lane.timer = False, None
            known, lane.sent = lane.sent, inf
            try:
                await self._advance(lane, known)
            except StoreFailed as failed:
                self._again(lane, known, NotTaken(str(failed), certain=True))
            except Exception as error:  # one line's defect must not end what all others live by
                log.exception("defect in argosy: mail of line %s", lane.line)
                self._again(lane, known, NotTaken(f"defect in argosy: {type(error).__name__}: {error}", certain=False))
            finally:
                pool.free(group)

    def _again(self, lane: DeliveryQueue, known: float, why: NotTaken) -> None:
        """Begin a line anew at its front: what was taken and is in the file still is sent again, and known there."""
        lane.sent, lane.after, lane.removal = max(known, lane.after), 0, None
        self._later(lane, why)

    async def _advance(self, lane: DeliveryQueue, known: float) -> None:
        """Take one batch of a line to its peer and settle what became of it."""
        lane.more = False
        most = 1 if lane.alone else queries.BATCH
        batch, more = await self._store.read(partial(queries.front, line=lane.line, after=lane.after, most=most))
        if not batch:
            await self._finish(lane, known)
            return
        now, last = self._clock.now(), batch[-1].place
        # What is too late and has not left before is not sent: the sweep gives it up.
        doubtful = max(known, self.before)
        going = [one for one in batch if one.expires is None or one.expires > now or one.place <= doubtful]
        answer = await self._carry(lane.line, going) if going else Receipt()
        if isinstance(answer, NotTaken) and answer.unreadable and len(going) == 1:
            # It would stand in the way of all behind it for ever.
            answer = Receipt(refused={0: Refusal(code="unreadable", text=answer.why[:200])})
        if isinstance(answer, Receipt) and not adds_up(answer, len(going)):
            self.counters["bad_receipts"] += 1
            answer = NotTaken(f"its receipt does not add up to {len(going)}: {answer}"[:200], certain=False)
        if isinstance(answer, NotTaken):
            self.counters["unanswered"] += 1
            lane.sent = known if answer.certain else max(known, last)
            self._later(lane, answer)
            return
        lane.alone = False
        await self._settle(lane, known, going, answer)
        if going:
            self._back(self._peer_of(lane.line))
        if answer.later:
            lane.after, lane.hung, lane.state = 0, False, str(next(iter(answer.later.values())))
            if answer.taken or (last > known and ">" not in lane.line):  # it was offered something new
                lane.pause = RETRY_FIRST
            self._pause(lane, LATER_MOST)
            return
        lane.after, lane.pause, lane.hung, lane.state = last, RETRY_FIRST, False, ""
        if more or lane.more:
            self._queue(lane)
        else:
            await self._finish(lane, lane.sent)

    async def _settle(self, lane: DeliveryQueue, known: float, batch: Sequence[QueuedMessage], answer: Receipt) -> None:
        """Take out of the file what the peer has taken, and give up what it has refused."""
        refused = {one.place: _bounded(answer.refused[i]) for i, one in enumerate(batch) if i in answer.refused}
        taken = [one.place for i, one in enumerate(batch) if i not in answer.refused and i not in answer.later]
        self.counters["sent"] += len(taken)
        self.counters["refused"] += len(refused)
        await self._removed(lane)  # one at a time: what fails there is tried again from the front
        # A receiver that says `later` may have a message in hand, as a program does that is not done with it.
        in_hand = [one.place for i, one in enumerate(batch) if i in answer.later and ">" not in lane.line]
        lane.sent = max(known, max(taken + in_hand, default=0))
        if taken:
            lane.removal = self._loop.create_task(self._remove(taken))
        if refused:
            for line in await self._give_up(refused, {one.sender for one in batch if one.place in refused}):
                self.more(line)
        if answer.later:
            await self._removed(lane)

    async def _removed(self, lane: DeliveryQueue) -> None:
        if (removal := lane.removal) is not None:
            lane.removal = None
            await removal

    async def _remove(self, places: list[int]) -> None:
        await self._store.write(lambda db: queries.remove(db, self._tally, places))

    async def _finish(self, lane: DeliveryQueue, known: float) -> None:
        """Forget a line that is empty, unless something came while we looked."""
        await self._removed(lane)
        lane.sent = known
        if lane.more:
            self._queue(lane)
        else:
            del self._delivery_queues[lane.line]

    def _later(self, lane: DeliveryQueue, answer: NotTaken) -> None:
        """Try again when the peer is there, or after a pause that doubles."""
        lane.state, lane.hung, lane.alone = answer.why, True, answer.unreadable
        if answer.away:
            peer = self._peer_of(lane.line)
            away = self._away.setdefault(peer, Away())
            away.delivery_queues[lane.line] = lane
            if away.timer is None:
                self._probe_later(peer, away)
            return
        self._pause(lane, RETRY_MOST)

    def _pause(self, lane: DeliveryQueue, most: float) -> None:
        """Try a line again after a pause that doubles, up to `most`."""
        pause = min(lane.pause, most)
        lane.pause = pause * 2
        lane.due = self._loop.time() + pause
        lane.timer = self._loop.call_later(pause, self._queue, lane)

    def _probe(self, peer: str) -> None:
        """Let one of the lines that wait for a peer try whether it is there."""
        away = self._away.get(peer)
        if away is None:
            return
        away.timer = None
        if away.delivery_queues:
            line = next(iter(away.delivery_queues))
            self._queue(away.delivery_queues.pop(line))
        if away.delivery_queues:  # the one that tries may find its line empty, and not come back
            self._probe_later(peer, away)

    def _probe_later(self, peer: str, away: Away) -> None:
        away.timer = self._loop.call_later(away.pause, self._probe, peer)
        away.pause = min(away.pause * 2, RETRY_MOST)


def _bounded(refusal: Refusal) -> Refusal:
    """Return what is kept of a peer's refusal: it is stored, and travels to the sender."""
    return Refusal(code=refusal.code[:MAX_CODE], text=refusal.text[:MAX_TEXT])
