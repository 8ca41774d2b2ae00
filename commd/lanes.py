"""Empties the lines of waiting messages: batch by batch, in order, one batch of a line on its way at a time.

A line goes on at once when its peer appears; while the peer is away or does not answer, a timer tries again. Lines
whose peers answer have couriers of their own, so that those which hang delay nobody else.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf

from commd import boxes
from commd.boxes import Tally
from commd.letters import Waiting
from commd.mail_clock import MailClock
from commd.store import Store, StoreFailed
from schemas.records import Receipt

log = logging.getLogger("mail")

RETRY_FIRST, RETRY_MOST = 0.05, 5.0
"""Wall seconds between two attempts, doubling."""
LATER_MOST = 2.0
"""The same for a peer that is there and has no room."""
COURIERS, PROBES = 32, 4
"""Batches on their way at the same time: to peers that answer, and to those that did not."""


@dataclass(frozen=True)
class NoAnswer:
    """A batch of which nothing is known to have been taken."""

    why: str
    """In words, for whoever looks at what waits."""
    certain: bool
    """Whether it is known that nothing was taken: the batch has not left, or there was nobody."""
    away: bool = False
    """Whether the peer is away, and with it for all its lines."""


@dataclass(eq=False, slots=True)
class Lane:
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
    state: str = ""
    removal: asyncio.Task[None] | None = None
    """Takes the last batch out of the file."""


@dataclass(eq=False, slots=True)
class Away:
    """A peer that is not there, and the lanes that wait for it: only one of them tries, now and then."""

    lanes: dict[str, Lane] = field(default_factory=dict)
    pause: float = RETRY_FIRST
    timer: asyncio.TimerHandle | None = None


class Lanes:
    """All lines that are not empty, and the couriers that empty them."""

    def __init__(
        self,
        store: Store,
        tally: Tally,
        clock: MailClock,
        carry: Callable[[str, Sequence[Waiting]], Awaitable[Receipt | NoAnswer]],
        give_up: Callable[[dict[int, str], set[str]], Awaitable[list[str]]],
        peer_of: Callable[[str], str],
    ) -> None:
        """`carry(line, batch)` takes a batch to its peer, which `peer_of(line)` names; `give_up(reasons by place,
        senders)` buries what the peer has refused, and says in which lines there is news for the senders."""
        self.counters: Counter[str] = Counter()
        self.before = 0
        """The last place of the former life of this daemon: up to it any message may have been taken by its peer."""
        self._store, self._tally, self._clock = store, tally, clock
        self._carry, self._give_up, self._peer_of = carry, give_up, peer_of
        self._lanes: dict[str, Lane] = {}
        self._away: dict[str, Away] = {}
        self._ready: dict[bool, deque[Lane]] = {False: deque(), True: deque()}
        self._wanted = {False: asyncio.Semaphore(0), True: asyncio.Semaphore(0)}
        self._loop = asyncio.get_running_loop()

    async def run(self) -> None:
        """Empty the lines, for ever."""
        couriers = [self._work(probing=False) for _ in range(COURIERS)]
        await asyncio.gather(*couriers, *(self._work(probing=True) for _ in range(PROBES)))

    def begin(self) -> None:
        """Take up what waits from the former life of this daemon."""
        self.before = self._tally.next - 1
        self.look()

    def look(self) -> None:
        """Take up any line that is not empty and that nobody empties."""
        for line in list(self._tally.lines):
            if line not in self._lanes:
                self.more(line)

    def more(self, line: str) -> None:
        """There is something new in a line."""
        if (lane := self._lanes.get(line)) is not None:
            lane.more = True
        else:
            self._lanes[line] = Lane(line)
            self._queue(self._lanes[line])

    def arrived(self, peer: str) -> None:
        """A peer is there: what waits for it goes at once."""
        away = self._away.pop(peer, Away())
        if away.timer is not None:
            away.timer.cancel()
        for lane in self._lanes.values():
            if lane.line in away.lanes or (lane.timer is not None and self._peer_of(lane.line) == peer):
                if lane.timer is not None:
                    lane.timer.cancel()
                lane.timer, lane.pause, lane.hung = None, RETRY_FIRST, False
                self._queue(lane)

    def may_be_taken(self, line: str, place: int) -> bool:
        """Whether the peer may have taken a message that is still in the file."""
        lane = self._lanes.get(line)
        return place <= self.before or (lane is not None and place <= lane.sent)

    def state(self, line: str) -> str:
        """Say what a line waits for."""
        lane = self._lanes.get(line)
        if lane is None:
            return ""
        if lane.timer is not None:
            return f"{lane.state}, next attempt in {max(0.0, lane.due - self._loop.time()):.1f} s"
        return lane.state

    def _queue(self, lane: Lane) -> None:
        if not lane.queued:
            lane.queued = True
            self._ready[lane.hung].append(lane)
            self._wanted[lane.hung].release()

    async def _work(self, probing: bool) -> None:
        while True:
            await self._wanted[probing].acquire()
            lane = self._ready[probing].popleft()
            lane.queued, lane.timer = False, None
            known, lane.sent = lane.sent, inf
            try:
                await self._advance(lane, known)
            except StoreFailed as failed:
                self._again(lane, known, NoAnswer(str(failed), certain=True))
            except Exception as error:  # one line's defect must not end what all others live by
                log.exception("defect in argosy: mail of line %s", lane.line)
                self._again(lane, known, NoAnswer(f"defect in argosy: {type(error).__name__}: {error}", certain=False))

    def _again(self, lane: Lane, known: float, why: NoAnswer) -> None:
        """Begin a line anew at its front: what was taken and is in the file still is sent again, and known there."""
        lane.sent, lane.after, lane.removal = max(known, lane.after), 0, None
        self._later(lane, why)

    async def _advance(self, lane: Lane, known: float) -> None:
        """Take one batch of a line to its peer and settle what became of it."""
        lane.more = False
        batch, more = await self._store.read(partial(boxes.front, line=lane.line, after=lane.after))
        if not batch:
            await self._finish(lane, known)
            return
        now, last = self._clock.now(), batch[-1].place
        # What is too late and has not left before is not sent: the sweep gives it up.
        doubtful = max(known, self.before)
        going = [one for one in batch if one.expires is None or one.expires > now or one.place <= doubtful]
        answer = await self._carry(lane.line, going) if going else Receipt()
        if isinstance(answer, Receipt) and answer.taken + len(answer.refused) + len(answer.later) != len(going):
            self.counters["bad_receipts"] += 1
            answer = NoAnswer(f"its receipt does not add up to {len(going)}: {answer}"[:200], certain=False)
        if isinstance(answer, NoAnswer):
            self.counters["unanswered"] += 1
            lane.sent = known if answer.certain else max(known, last)
            self._later(lane, answer)
            return
        await self._settle(lane, known, going, answer)
        if self._away:
            self.arrived(self._peer_of(lane.line))
        if answer.later:
            lane.after, lane.hung, lane.state = 0, False, next(iter(answer.later.values()))
            if answer.taken:
                lane.pause = RETRY_FIRST
            self._pause(lane, LATER_MOST)
            return
        lane.after, lane.pause, lane.hung, lane.state = last, RETRY_FIRST, False, ""
        if more or lane.more:
            self._queue(lane)
        else:
            await self._finish(lane, lane.sent)

    async def _settle(self, lane: Lane, known: float, batch: Sequence[Waiting], answer: Receipt) -> None:
        """Take out of the file what the peer has taken, and give up what it has refused."""
        refused = {one.place: answer.refused[i] for i, one in enumerate(batch) if i in answer.refused}
        taken = [one.place for i, one in enumerate(batch) if i not in answer.refused and i not in answer.later]
        self.counters["sent"] += len(taken)
        self.counters["refused"] += len(refused)
        await self._removed(lane)  # one at a time: what fails there is tried again from the front
        lane.sent = max(known, max(taken, default=0))
        if taken:
            lane.removal = self._loop.create_task(self._remove(taken))
        if refused:
            for line in await self._give_up(refused, {one.sender for one in batch if one.place in refused}):
                self.more(line)
        if answer.later:
            await self._removed(lane)

    async def _removed(self, lane: Lane) -> None:
        if (removal := lane.removal) is not None:
            lane.removal = None
            await removal

    async def _remove(self, places: list[int]) -> None:
        await self._store.write(lambda db: boxes.remove(db, self._tally, places))

    async def _finish(self, lane: Lane, known: float) -> None:
        """Forget a line that is empty, unless something came while we looked."""
        await self._removed(lane)
        lane.sent = known
        if lane.more:
            self._queue(lane)
        else:
            del self._lanes[lane.line]

    def _later(self, lane: Lane, answer: NoAnswer) -> None:
        """Try again when the peer is there, or after a pause that doubles."""
        lane.state, lane.hung = answer.why, True
        if answer.away:
            peer = self._peer_of(lane.line)
            away = self._away.setdefault(peer, Away())
            away.lanes[lane.line] = lane
            if away.timer is None:
                away.timer = self._loop.call_later(away.pause, self._probe, peer)
                away.pause = min(away.pause * 2, RETRY_MOST)
            return
        self._pause(lane, RETRY_MOST)

    def _pause(self, lane: Lane, most: float) -> None:
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
        if away.lanes:
            line = next(iter(away.lanes))
            self._queue(away.lanes.pop(line))
