"""What others say on the bus on keys of their own: bytes with their encoding instead of records.

For robots that speak on Zenoh themselves. As everywhere on the bus, Zenoh's threads only hand over: what waits for the
event loop is bounded in number and in size, and what does not fit is counted. What this process says itself is not
heard back by it, and it neither listens nor answers to itself.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, deque
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock
from typing import Any, Protocol

import zenoh

BACKLOG = 1024
"""Samples of one subscription that may wait for the event loop; of more the oldest goes: the newest is the present. It
is a second of a thousand a second, in which a busy machine may leave the bridge without a core."""
LARGEST = 65_536
"""Bytes of the largest payload that is taken in."""
ROOM = 256 * LARGEST
"""Bytes of payload that may wait with them."""
BATCH = 64
"""Samples that are handed over in one go before the event loop turns to others."""
QUERY_AT_MOST = 3600.0
"""Wall seconds after which Zenoh ends a query that nobody ended: a bound behind the asker's own."""
REPLIES = 16
"""Replies to one query that may wait to be taken."""
log = logging.getLogger("bus")


@dataclass(frozen=True, slots=True)
class Sample:
    """What was put, asked or answered on a key."""

    key: str
    payload: bytes
    encoding: str
    """Such as `application/json`; Zenoh's default is `zenoh/bytes`."""
    deleted: bool = False
    """The key was deleted: there is no payload."""
    error: bool = False
    """It is an error reply: the payload says which."""


class _Declared(Protocol):
    def undeclare(self) -> None: ...


class _Handle:
    """Something declared on the bus."""

    def __init__(self, declared: _Declared, forget: Callable[[], None] = lambda: None) -> None:
        self._declared, self._forget = declared, forget

    def close(self) -> None:
        """Take it back."""
        self._forget()
        try:
            self._declared.undeclare()
        except zenoh.ZError as error:  # the session is closed already
            log.debug("not_withdrawn why=%s", error)


class Subscription(_Handle):
    """A subscriber; its figures count from its beginning."""

    def __init__(self, queue: _Queue, declared: _Declared, forget: Callable[[], None]) -> None:
        super().__init__(declared, forget)
        self._queue = queue

    @property
    def dropped(self) -> int:
        """Samples that did not fit: too many waited for the event loop."""
        return self._queue.dropped

    @property
    def too_large(self) -> int:
        """Samples of more than `LARGEST` bytes, which were not taken in."""
        return self._queue.too_large

    def close(self) -> None:
        """End it; what waits is not handed over any more."""
        self._queue.closed = True
        super().close()


class Publisher(_Handle):
    """Puts on one key."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        super().__init__(publisher)
        self._publisher = publisher

    @property
    def matching(self) -> bool:
        """Whether somebody outside this process subscribes to the key now."""
        return matching(self._publisher)

    def put(self, payload: bytes, encoding: str) -> None:
        """Send now, dropped if the way is congested. Raises OSError if the session is closed."""
        try:
            self._publisher.put(payload, encoding=encoding)
        except zenoh.ZError as error:
            raise OSError(f"cannot put: {error}") from None


class Querier(_Handle):
    """Asks on one key."""

    def __init__(
        self,
        session: zenoh.Session,
        querier: zenoh.Querier,
        loop: asyncio.AbstractEventLoop,
        counters: Counter[str],
    ) -> None:
        super().__init__(querier)
        self._session, self._querier, self._loop, self._counters = session, querier, loop, counters

    @property
    def matching(self) -> bool:
        """Whether somebody outside this process serves the key now."""
        return matching(self._querier)

    async def ask(self, payload: bytes, encoding: str) -> AsyncGenerator[Sample, None]:
        """Ask everybody who serves the key and yield each reply as it is made, until all have ended, also if this is
        closed meanwhile.

        Leaving the loop early cancels the query. Raises OSError if the session is closed.
        """
        replies: asyncio.Queue[Sample | None] = asyncio.Queue()
        token = zenoh.CancellationToken()

        def arrived(reply: Sample | None) -> None:
            if reply is None or replies.qsize() < REPLIES:
                replies.put_nowait(reply)
            else:
                self._counters["dropped"] += 1

        def callback(reply: zenoh.Reply) -> None:
            self._soon(arrived, _read_reply(reply))

        try:
            self._session.get(  # the querier's own `get` would end when it is closed
                self._querier.key_expr,
                zenoh.handlers.Callback(callback, lambda: self._soon(arrived, None), indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=QUERY_AT_MOST,
                allowed_destination=zenoh.Locality.REMOTE,
                payload=payload,
                encoding=encoding,
                cancellation_token=token,
            )
        except zenoh.ZError as error:
            raise OSError(f"cannot ask: {error}") from None
        try:
            async with asyncio.timeout(QUERY_AT_MOST + 1):
                while (reply := await replies.get()) is not None:
                    yield reply
        finally:
            token.cancel()  # type: ignore[no-untyped-call]

    def _soon(self, function: Callable[[Sample | None], None], item: Sample | None) -> None:
        try:
            self._loop.call_soon_threadsafe(function, item)
        except RuntimeError:  # the loop has ended, and with it whoever asked
            return


class RawBus:
    """The part of a session that carries bytes. Made by `commd.bus.bus.Bus`."""

    def __init__(
        self,
        session: zenoh.Session,
        loop: asyncio.AbstractEventLoop,
        counters: Counter[str],
        hand_over: Callable[[Callable[[Any], None]], Any],
        declare: Callable[[str, str], Callable[[], None]],
    ) -> None:
        """`hand_over` makes of a function for queries a callback of Zenoh's that is bounded as the bus's own are;
        `declare(kind, key)` notes a declaration and returns what forgets it."""
        self._session, self._loop, self._counters, self._hand_over = session, loop, counters, hand_over
        self._declare = declare

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Subscription:
        """Call `handler` on the event loop for each sample that others put on a matching key, in order."""
        queue = _Queue(self._loop, handler, self._counters)
        declared = self._session.declare_subscriber(
            key, zenoh.handlers.Callback(queue.push, indirect=False), allowed_origin=zenoh.Locality.REMOTE
        )
        return Subscription(queue, declared, self._declare("subscriber", key))

    def tap(self, key: str, take: Callable[[zenoh.Sample], None]) -> _Handle:
        """Call `take` for each sample that anybody puts on a matching key, of whatever size, on a thread of Zenoh's.

        For a recorder: it must be quick, never wait, and bound what it keeps itself.
        """
        declared = self._session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))
        return _Handle(declared, self._declare("subscriber", key))

    def publisher(self, key: str) -> Publisher:
        """Declare that this process puts on a key."""
        return Publisher(
            self._session.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        )

    def querier(self, key: str) -> Querier:
        """Declare that this process asks on a key."""
        querier = self._session.declare_querier(
            key, target=zenoh.QueryTarget.ALL, allowed_destination=zenoh.Locality.REMOTE
        )
        return Querier(self._session, querier, self._loop, self._counters)

    def serve(self, key: str, answer: Callable[[Sample], Sample | None]) -> _Handle:
        """Answer queries of others on a key with what `answer` says on the event loop at once; None = no reply."""

        def reply(query: zenoh.Query) -> None:
            with query:
                said = answer(_read_query(query))
                try:
                    if said is not None and said.error:
                        query.reply_err(said.payload, encoding=said.encoding)
                    elif said is not None:
                        query.reply(said.key, said.payload, encoding=said.encoding)
                except zenoh.ZError as error:
                    self._counters["replies_lost"] += 1
                    log.debug("reply_lost key=%s why=%s", key, error)

        queryable = self._session.declare_queryable(key, self._hand_over(reply), allowed_origin=zenoh.Locality.REMOTE)
        return _Handle(queryable, self._declare("queryable", key))

    async def look_up(self, key: str, seconds: float) -> list[Sample]:
        """Ask everybody who serves a key, the router's admin space too. Returns the replies of so many wall seconds."""
        return [reply for reply in await self._look_up(key, seconds) if not reply.error]

    async def answers(self, key: str, seconds: float) -> bool:
        """Ask everybody who serves a key, and return whether anybody said anything, if only what is wrong."""
        return any(reply.payload != b"Timeout" for reply in await self._look_up(key, seconds))  # that is Zenoh's own

    async def _look_up(self, key: str, seconds: float) -> list[Sample]:
        replies: asyncio.Queue[Sample | None] = asyncio.Queue()

        def soon(reply: Sample | None) -> None:
            with suppress(RuntimeError):  # the loop has ended, and with it whoever asked
                self._loop.call_soon_threadsafe(replies.put_nowait, reply)

        def arrived(reply: zenoh.Reply) -> None:
            soon(_read_reply(reply))

        try:
            self._session.get(
                key,
                zenoh.handlers.Callback(arrived, lambda: soon(None), indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=seconds,
            )
        except zenoh.ZError as error:
            log.debug("not_asked key=%s why=%s", key, error)
            return []
        found: list[Sample] = []
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds + 1):  # Zenoh ends the query itself; the second is for its last word
                while (reply := await replies.get()) is not None:
                    found.append(reply)
        return found


class _Queue:
    """Samples on their way from Zenoh's threads to the event loop: one wake-up for as many as have come."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, handler: Callable[[Sample], None], counters: Counter[str]
    ) -> None:
        self._loop, self._handler, self._counters = loop, handler, counters
        self._waiting: deque[Sample] = deque()
        self._bytes = 0
        """Of payload that wait."""
        self._lock = Lock()
        self._called = False
        """The event loop has been told that something waits."""
        self.closed = False
        self.dropped = self.too_large = 0

    def push(self, sample: zenoh.Sample) -> None:
        """Take in a sample, on a thread of Zenoh's."""
        if len(sample.payload) > LARGEST:
            self.too_large += 1
            self._counters["bad_input"] += 1
            return
        read = _read_sample(sample)
        with self._lock:
            self._bytes += len(read.payload)
            while len(self._waiting) >= BACKLOG or (self._waiting and self._bytes > ROOM):
                self._bytes -= len(self._waiting.popleft().payload)
                self.dropped += 1
                self._counters["dropped"] += 1
            self._waiting.append(read)
            called, self._called = self._called, True
        if not called:
            try:
                self._loop.call_soon_threadsafe(self._drain)
            except RuntimeError:  # the loop has ended
                self.closed = True

    def _drain(self) -> None:
        for _ in range(BATCH):
            with self._lock:
                if self.closed or not self._waiting:
                    self._called = False
                    return
                sample = self._waiting.popleft()
                self._bytes -= len(sample.payload)
            try:
                self._handler(sample)
            except Exception as error:  # one sample must not stop those after it
                self._loop.call_exception_handler({"message": f"a sample on {sample.key}", "exception": error})
        self._loop.call_soon(self._drain)


def matching(declared: zenoh.Publisher | zenoh.Querier) -> bool:
    try:
        status: Any = declared.matching_status  # an object that is always true, whatever its stub says
        return bool(status.matching)
    except zenoh.ZError:
        return False


def _read_sample(sample: zenoh.Sample) -> Sample:
    deleted = sample.kind == zenoh.SampleKind.DELETE
    return Sample(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding), deleted)


def _read_query(query: zenoh.Query) -> Sample:
    payload = b"" if query.payload is None or len(query.payload) > LARGEST else query.payload.to_bytes()
    return Sample(str(query.key_expr), payload, str(query.encoding or ""))


def _read_reply(reply: zenoh.Reply) -> Sample:
    if reply.ok is not None and len(reply.ok.payload) > LARGEST:
        said = f"a reply of {len(reply.ok.payload)} bytes, {LARGEST} at most are read"
        return Sample("", said.encode(), "text/plain", error=True)
    if reply.ok is not None:
        return _read_sample(reply.ok)
    payload = b"" if reply.err is None else reply.err.payload.to_bytes()
    return Sample("", payload, "text/plain", error=True)
