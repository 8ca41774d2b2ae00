"""Publish, subscribe, query and serve bytes with their encoding, on keys that are not Argosy's.

For robots that speak Zenoh themselves. Zenoh's threads only hand over to the event loop; what waits for it is bounded
in number and in size, and what does not fit is counted. This process does not receive its own samples and queries.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from threading import Lock
from typing import Any

import zenoh

from commd.bus.loop_dispatch import LoopDispatch
from commd.bus.session import Declaration

BACKLOG = 1024
"""Samples of one subscription that may wait for the event loop; of more the oldest is dropped, as the newest is the
present state. A busy machine may leave the bridge without a core for a second, at 1000 samples a second."""
LARGEST = 65_536
"""Bytes of the largest payload that is accepted."""
ROOM = 256 * LARGEST
"""Bytes of all payloads that may wait."""
QUERY_AT_MOST = 3600.0
"""Wall seconds after which Zenoh ends a query; the asker has a shorter bound of its own."""
REPLIES = 16
"""Replies to one query that may wait for the caller."""
log = logging.getLogger("bus")


@dataclass(frozen=True, slots=True)
class Sample:
    """A payload that was put, asked or replied on a key."""

    key: str
    payload: bytes
    encoding: str
    """Such as `application/json`; Zenoh's default is `zenoh/bytes`."""
    deleted: bool = False
    """The key was deleted; there is no payload."""
    error: bool = False
    """An error reply; the payload is its text."""


class Subscription(Declaration):
    """A subscriber to samples of others, which wait here between Zenoh's threads and the event loop."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        dispatch: LoopDispatch,
        handler: Callable[[Sample], None],
        declare: Callable[[str, str], Callable[[], None]],
    ) -> None:
        """`declare` as in `RawBus`."""
        self.dropped = 0
        """Samples dropped because too many waited for the event loop."""
        self.too_large = 0
        """Samples refused because they had more than `LARGEST` bytes."""
        self._dispatch, self._handler = dispatch, handler
        self._waiting: deque[Sample] = deque()
        self._bytes = 0
        """Of all payloads that wait."""
        self._lock = Lock()
        self._calls = 0
        """How often the event loop is going to call `_next`: as often as samples wait at least, `BACKLOG` at most."""
        self._closed = False
        callback = zenoh.handlers.Callback(self._push, indirect=False)
        subscriber = session.declare_subscriber(key, callback, allowed_origin=zenoh.Locality.REMOTE)
        super().__init__(subscriber, declare("subscriber", key))

    def _push(self, sample: zenoh.Sample) -> None:
        """Accept a sample, on a thread of Zenoh's."""
        counters = self._dispatch.counters
        if len(sample.payload) > LARGEST:
            self.too_large += 1
            counters["bad_input"] += 1
            return
        read = _read_sample(sample)
        with self._lock:
            self._bytes += len(read.payload)
            while len(self._waiting) >= BACKLOG or (self._waiting and self._bytes > ROOM):
                self._bytes -= len(self._waiting.popleft().payload)
                self.dropped += 1
                counters["dropped"] += 1
            self._waiting.append(read)
            if self._calls >= len(self._waiting):
                return
            self._calls += 1
        self._dispatch.put(self._next, None)

    def _next(self, _: None) -> None:
        with self._lock:
            self._calls -= 1
            if self._closed or not self._waiting:
                return
            sample = self._waiting.popleft()
            self._bytes -= len(sample.payload)
        self._handler(sample)

    def close(self) -> None:
        """End it; samples that wait are not handed over."""
        self._closed = True
        super().close()


class Matched(Declaration):
    """A publisher or querier."""

    def __init__(self, declared: zenoh.Publisher | zenoh.Querier) -> None:
        super().__init__(declared)
        self._matched = declared

    @property
    def matching(self) -> bool:
        """Whether somebody subscribes to, or serves, the key now."""
        try:
            status: Any = self._matched.matching_status  # an object that is always true, whatever its stub says
            return bool(status.matching)
        except zenoh.ZError:
            return False


class Publisher(Matched):
    """Publishes on one key, for other processes."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        super().__init__(publisher)
        self._publisher = publisher

    def put(self, payload: bytes, encoding: str) -> None:
        """Publish; dropped if the route is congested. Raises OSError if the session is closed."""
        try:
            self._publisher.put(payload, encoding=encoding)
        except zenoh.ZError as error:
            raise OSError(f"cannot put: {error}") from None


class Querier(Matched):
    """Queries one key, in other processes."""

    def __init__(self, session: zenoh.Session, querier: zenoh.Querier, dispatch: LoopDispatch) -> None:
        super().__init__(querier)
        self._session, self._querier, self._dispatch = session, querier, dispatch

    async def ask(self, payload: bytes, encoding: str) -> AsyncGenerator[Sample, None]:
        """Query all that serve the key and yield each reply on arrival until all have ended, even if this is closed.

        Leaving the loop early cancels the query. Raises OSError if the session is closed.
        """
        replies: asyncio.Queue[zenoh.Reply | None] = asyncio.Queue()
        token = zenoh.CancellationToken()

        def arrived(reply: zenoh.Reply | None) -> None:
            if reply is None or replies.qsize() < REPLIES:
                replies.put_nowait(reply)
            else:
                self._dispatch.counters["dropped"] += 1

        try:
            self._session.get(  # the querier's own `get` would end when it is closed
                self._querier.key_expr,
                self._dispatch.replies(arrived),
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
                    yield _read_reply(reply)
        finally:
            token.cancel()  # type: ignore[no-untyped-call]


class RawBus:
    """The part of a session that carries bytes. Made by `commd.bus.bus.Bus`."""

    def __init__(
        self, session: zenoh.Session, dispatch: LoopDispatch, declare: Callable[[str, str], Callable[[], None]]
    ) -> None:
        """`declare(kind, key)` notes a declaration and returns what notes its end."""
        self._session, self._dispatch, self._declare = session, dispatch, declare

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Subscription:
        """Call `handler` on the event loop for each sample of others on a matching key, in order."""
        return Subscription(self._session, key, self._dispatch, handler, self._declare)

    def tap(self, key: str, take: Callable[[zenoh.Sample], None]) -> Declaration:
        """Call `take` on a thread of Zenoh's for each sample on a matching key, this process's own too, of any size.

        For a recorder: `take` must return quickly and bound what it keeps.
        """
        declared = self._session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))
        return Declaration(declared, self._declare("subscriber", key))

    def publisher(self, key: str) -> Publisher:
        """Declare a publisher on a key."""
        return Publisher(
            self._session.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        )

    def querier(self, key: str) -> Querier:
        """Declare a querier on a key."""
        querier = self._session.declare_querier(
            key, target=zenoh.QueryTarget.ALL, allowed_destination=zenoh.Locality.REMOTE
        )
        return Querier(self._session, querier, self._dispatch)

    def serve(self, key: str, answer: Callable[[Sample], Sample | None]) -> Declaration:
        """Reply to queries of others with `answer(query)`, called on the event loop; None = no reply."""

        def reply(query: zenoh.Query) -> None:
            with query:
                payload = b"" if query.payload is None or len(query.payload) > LARGEST else query.payload.to_bytes()
                sample = answer(Sample(str(query.key_expr), payload, str(query.encoding or "")))
                try:
                    if sample is not None and sample.error:
                        query.reply_err(sample.payload, encoding=sample.encoding)
                    elif sample is not None:
                        query.reply(sample.key, sample.payload, encoding=sample.encoding)
                except zenoh.ZError as error:
                    self._dispatch.counters["replies_lost"] += 1
                    log.debug("reply_lost key=%s why=%s", key, error)

        queryable = self._session.declare_queryable(
            key, self._dispatch.callback(reply, refuse_busy), allowed_origin=zenoh.Locality.REMOTE
        )
        return Declaration(queryable, self._declare("queryable", key))

    async def look_up(self, key: str, seconds: float) -> list[Sample]:
        """Query all that serve a key, the router's admin space too. Returns the replies within `seconds` (wall)."""
        return [reply for reply in await self._look_up(key, seconds) if not reply.error]

    async def answers(self, key: str, seconds: float) -> bool:
        """Query all that serve a key. Returns whether anybody replied within `seconds` (wall), if only with an
        error."""
        return any(reply.payload != b"Timeout" for reply in await self._look_up(key, seconds))  # that is Zenoh's own

    async def _look_up(self, key: str, seconds: float) -> list[Sample]:
        def ask(callback: zenoh.handlers.Callback[Any]) -> None:
            self._session.get(
                key,
                callback,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=seconds,
            )

        try:
            replies, _ = await self._dispatch.collect(ask, seconds)
        except zenoh.ZError as error:
            log.debug("not_asked key=%s why=%s", key, error)
            return []
        return [_read_reply(reply) for reply in replies]


def refuse_busy(query: zenoh.Query) -> None:
    """Reply to a query that has no room to wait for the event loop."""
    with query:
        query.reply_err(b"busy: too many queries wait", encoding=zenoh.Encoding.TEXT_PLAIN)


def _read_sample(sample: zenoh.Sample) -> Sample:
    deleted = sample.kind == zenoh.SampleKind.DELETE
    return Sample(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding), deleted)


def _read_reply(reply: zenoh.Reply) -> Sample:
    if reply.ok is not None and len(reply.ok.payload) > LARGEST:
        problem = f"a reply of {len(reply.ok.payload)} bytes, {LARGEST} at most are read"
        return Sample("", problem.encode(), "text/plain", error=True)
    if reply.ok is not None:
        return _read_sample(reply.ok)
    payload = b"" if reply.err is None else reply.err.payload.to_bytes()
    return Sample("", payload, "text/plain", error=True)
