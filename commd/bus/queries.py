"""Query and serve records on a Zenoh session: the lower half of `commd.bus.bus.Bus`.

A query may never end after its route broke, so each ends with its router here, and at its timeout at the latest.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import AsyncGenerator, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

import zenoh

from commd.bus.errors import BusClosed, CannotServe, QueryFailed, QueryTimeout
from commd.bus.loop_dispatch import BACKLOG, LAST_WORD, LoopDispatch
from commd.bus.raw import refuse_busy
from commd.bus.session import Declaration, KeyCache
from commd.common.repeated_log import is_logged
from commd.common.tasks import Tasks
from schemas.wire import keys
from schemas.wire.codec import MAX_BYTES, BadRecord, OtherVersion, Wire, codec
from schemas.wire.records import VERSION, Note, Record

log = logging.getLogger("bus")
R = TypeVar("R", bound=Record)

QUERIES = 256
"""Queries that may be served at the same time."""
OBSERVER_QUERIES = 64
"""Queries of observers, such as for minds, that may be served at the same time, besides all others."""
REPLY_THREADS = 2
"""Threads that send replies which may have to wait for their receiver."""
ZENOH_TIMEOUT = b"Timeout"
"""The payload of Zenoh's own error reply to a query that was not answered in time."""
ROUTER_LOST = "the router was lost before all had answered"
"""The error of the last reply to a query whose router was lost."""
STRANGER_FOR = 60.0
"""Wall seconds after its last record for which a daemon of another major version is noted."""
MOST_STRANGERS = 20


@dataclass(eq=False, slots=True)
class Reply(Generic[R]):
    """One reply to a query: a record on its key, or an error."""

    key: str
    record: R | None
    error: str = ""
    """For people."""
    other_version: str = ""
    """The major version of the replying program's records, if it is not ours."""
    code: str = ""
    """The error's code, if the replying program sends one."""
    timed_out: bool = False
    """Whether it stands for a reply that did not arrive in time."""

    def failure(self, timeout: float) -> QueryFailed:
        """Return the error of a reply without a record to a query with this timeout, in wall seconds."""
        if self.timed_out:
            return QueryTimeout(self.key, timeout)
        return QueryFailed(self.key, self.error, self.other_version, code=self.code)


class Query(Generic[R]):
    """A query that this session serves. `record` is its payload; None without one, or with a bad one (see `error`)."""

    def __init__(
        self, session: QuerySession, query: zenoh.Query, record: R | None, error: str = "", code: str = ""
    ) -> None:
        """`code`: of `BadRecord`, for a bad payload."""
        self._session, self._query, self._code = session, query, code
        self.key = str(query.key_expr)
        self.concrete = "*" not in self.key
        """Whether the key has no wildcard: only then may the query have an effect."""
        self.record, self.error = record, error
        self.on_thread = False
        """Whether a thread has sent a reply, and must also send the end of all replies."""

    @property
    def parameters(self) -> dict[str, str]:
        """The selector's parameters, `a=b;c=d` behind its `?`; one without `=` has an empty value."""
        text = str(self._query.parameters)
        pairs = (part.partition("=") for part in text.split(";") if part)
        return {name: value for name, _, value in pairs}

    def required(self, expected: str) -> R:
        """Return the payload of a query on a concrete key. Raises CannotServe: its error, or what was `expected`."""
        if self.record is None or not self.concrete:
            raise CannotServe(self.error or expected)
        return self.record

    def reply(self, record: Record, key: str | None = None) -> None:
        """Send one reply on `key` (the query's own by default). Raises BadRecord if it cannot be encoded."""
        made, wire = codec(type(record)), self._session.wire
        try:
            self._query.reply(key or self.key, made.encode(record, wire), encoding=made.encodings[wire])
        except zenoh.ZError as error:
            self._lost(error)

    async def answer(self, record: Record, key: str | None = None) -> None:
        """Send one reply as `reply` does, on a thread, where Zenoh waits while the route to the asker is full.

        For large records and for observers: an asker that does not read delays only its own replies.
        """
        self.on_thread = True
        await self._session.on_thread(partial(self.reply, record, key))

    def reply_error(self, text: str) -> None:
        """Send an error text for people; its Encoding carries the code of a bad payload."""
        encoding = zenoh.Encoding.TEXT_PLAIN
        try:
            self._query.reply_err(text.encode(), encoding=encoding.with_schema(self._code) if self._code else encoding)
        except zenoh.ZError as error:
            self._lost(error)

    def _lost(self, error: zenoh.ZError) -> None:
        self._session.counters["replies_lost"] += 1
        log.debug("reply_lost key=%s why=%s", self.key, error)


class QuerySession:
    """Asks and serves records on a Zenoh session."""

    def __init__(self, session: zenoh.Session, wire: Wire, daemon: str) -> None:
        self.wire, self.daemon = wire, daemon
        self.counters: Counter[str] = Counter()
        """dropped, bad_input, unknown_fields, unsendable, replies_lost, puts_lost, queries_unended: totals."""
        self.declared: Counter[tuple[str, str]] = Counter()
        """Present declarations: kind as in Zenoh's admin space, and key."""
        self.declarations_changed = asyncio.Event()
        """Set with each change of `declared`."""
        self._session = session
        self._loop = asyncio.get_running_loop()
        self.strangers = Strangers(self._loop.time)
        """Daemons of another major version."""
        self._known = KeyCache(session)
        self._dispatch = LoopDispatch(self._loop, self.counters)
        self._tasks = Tasks("serving a query")
        self._observer_tasks = Tasks("answering an observer")
        self._threads = ThreadPoolExecutor(REPLY_THREADS, "answering")
        self._checked_keys: set[str] = set()
        """Keys whose first record was searched for fields that this version does not know."""
        self._asked: set[_Asked[Any]] = set()
        """The queries that wait for replies."""

    def serve(
        self,
        key: str,
        record: type[R],
        handler: Callable[[Query[R]], Coroutine[Any, Any, None] | None],
        *,
        at_most: int = MAX_BYTES,
        urgent: bool = False,
        observers: bool = False,
    ) -> Callable[[], None]:
        """Call `handler(query)` on the event loop for each query, in order of arrival. Returns what ends the serving.

        The query ends when the handler returns; what a coroutine function returns runs as a task, and the query ends
        with it. A payload of more than `at_most` bytes is refused unread. `urgent` queries have room of their own
        besides all others; queries of `observers` have `OBSERVER_QUERIES`, and take no room from others.
        """
        tasks = self._observer_tasks if observers else self._tasks
        room = OBSERVER_QUERIES if observers else 2 * QUERIES if urgent else QUERIES

        def deliver(query: zenoh.Query) -> None:
            payload = query.payload
            size = 0 if payload is None else len(payload)
            if size > at_most:
                self._refuse(query, "bad_input", f"{record.__name__}: {size} bytes, expected at most {at_most}")
                return
            if len(tasks) >= room:
                self._refuse(query, "dropped", "busy: too many queries at once")
                return
            found, error, code, rest = None, "", "", None
            if payload is not None and size:
                try:
                    found = self._decode(record, str(query.key_expr), payload.to_bytes(), str(query.encoding or ""))
                except BadRecord as bad:
                    error, code = str(bad), bad.code
            ours = Query(self, query, found, error, code)
            try:
                rest = handler(ours)
            except Exception as error:
                self._failed(ours, error)
            if rest is None:
                query.drop()  # type: ignore[no-untyped-call]
            else:
                tasks.spawn(self._serve(query, ours, rest)).add_done_callback(
                    lambda _: rest.close()  # the task may be cancelled before it begins
                )

        queryable = self._session.declare_queryable(key, self._dispatch.callback(deliver, refuse_busy))
        return Declaration(queryable, self._declare("queryable", key)).close

    async def _serve(self, query: zenoh.Query, ours: Query[Any], rest: Coroutine[Any, Any, None]) -> None:
        try:
            await rest
        except Exception as error:
            self._failed(ours, error)
        finally:
            if not ours.on_thread:
                query.drop()  # type: ignore[no-untyped-call]
        # after a cancellation a thread may still reply: the query then ends when that thread lets it go
        if ours.on_thread:
            await self.on_thread(query.drop)

    async def on_thread(self, work: Callable[[], object]) -> None:
        """Run something that may block in Zenoh on one of `REPLY_THREADS`."""
        await self._loop.run_in_executor(self._threads, work)

    def _refuse(self, query: zenoh.Query, counter: str, why: str) -> None:
        self.counters[counter] += 1
        with query:
            Query[Any](self, query, None).reply_error(why)

    def _failed(self, ours: Query[Any], error: Exception) -> None:
        """Reply why a query cannot be served, a record that cannot be encoded, or a defect, which is reported too."""
        if isinstance(error, CannotServe | BadRecord):
            ours.reply_error(str(error))
        else:
            ours.reply_error(f"defect in {self.daemon}: {type(error).__name__}: {error}")
            self._loop.call_exception_handler({"message": "serving a query", "exception": error})

    async def ask_one(self, key: str, ask: Record | None, answer: type[R], timeout: float) -> R:
        """Query `key` and return the first record of a reply, within `timeout` wall seconds.

        Raises QueryTimeout if there was no reply, QueryFailed if there were only errors, BusClosed if the query could
        not be sent, BadRecord if `ask` cannot be encoded.
        """
        answered: asyncio.Future[R] = self._loop.create_future()
        failed: QueryFailed | None = None

        def heard(reply: Reply[R] | None) -> None:
            nonlocal failed
            if answered.done():
                return
            if reply is None:
                answered.set_exception(failed or QueryTimeout(key, timeout, nobody=True))
            elif reply.record is not None:
                answered.set_result(reply.record)
            else:
                failed = reply.failure(timeout)

        close = self.ask(key, ask, answer, timeout, heard)
        try:
            return await answered  # the query ends by itself then: to cancel it costs more
        except asyncio.CancelledError:
            close()
            raise

    async def ask_all(
        self, key: str, answer: type[R], timeout: float, handler: Callable[[str, R], object], *, limit: int = BACKLOG
    ) -> dict[str, str]:
        """Query all that serve `key`, without a payload, and call `handler(key, record)` for each record on arrival.

        Lasts at most `timeout` wall seconds; at most `limit` replies wait, further ones are dropped and counted.
        Returns the errors of replies without a record, by their keys. Raises BusClosed if the query could not be sent.
        """
        errors: dict[str, str] = {}
        async with aclosing(self.query(key, None, answer, timeout, limit=limit)) as replies:
            async for reply in replies:
                if reply.record is not None:
                    handler(reply.key, reply.record)
                else:
                    errors[reply.key] = reply.error
        return errors

    async def query(
        self, key: str, ask: Record | None, answer: type[R], timeout: float, *, limit: int = BACKLOG
    ) -> AsyncGenerator[Reply[R], None]:
        """Query as `ask` does and yield each reply on arrival. No reply at all: nobody serves the key.

        For a stream of replies; `ask_one` and `ask_all` are for the rest. Close it (`aclosing`) if it is not exhausted.
        The query ends after `timeout` wall seconds at the latest; the caller must notice a missing final reply. At most
        `limit` replies wait; further ones are dropped and counted.
        """
        replies: asyncio.Queue[Reply[R] | None] = asyncio.Queue()

        def heard(reply: Reply[R] | None) -> None:
            if reply is not None and replies.qsize() >= limit:
                self.counters["dropped"] += 1
            else:
                replies.put_nowait(reply)

        close = self.ask(key, ask, answer, timeout, heard)
        try:
            while (reply := await replies.get()) is not None:
                yield reply
        finally:
            close()

    def ask(
        self,
        key: str,
        ask: Record | None,
        answer: type[R],
        timeout: float,
        heard: Callable[[Reply[R] | None], None],
    ) -> Callable[[], object]:
        """Query all that serve `key`; call `heard(reply)` on the event loop on arrival, and at the end `heard(None)`.

        The key may have parameters, `key?a=b;c=d`. Ends when all have answered, when Zenoh ends it after `timeout` wall
        seconds, or soon after that without Zenoh, or when the router is lost or back (the last reply says so: Zenoh may
        never end such a query). Returns what ends it before, after which nothing is heard. Raises BusClosed if it
        cannot be sent, BadRecord if `ask` cannot be encoded.
        """
        bare = key.partition("?")[0]
        asked = _Asked(self, bare, answer, timeout, heard)
        options: dict[str, Any] = {}
        if ask is not None:
            made = codec(type(ask))
            options = {"payload": made.encode(ask, self.wire), "encoding": made.encodings[self.wire]}
        try:
            self._session.get(
                key if bare != key else self._known.of(key),
                self._dispatch.replies(asked.arrived),
                consolidation=zenoh.ConsolidationMode.NONE,
                target=zenoh.QueryTarget.ALL,
                timeout=timeout,
                cancellation_token=asked.token,
                **options,
            )
        except zenoh.ZError as error:
            asked.over = True  # Zenoh drops the handler: that is no end of a query
            raise BusClosed(f"cannot ask {key}: {error}") from None
        self._asked.add(asked)
        asked.late = self._loop.call_later(timeout + LAST_WORD, asked.unended)
        return asked.close

    def _declare(self, kind: str, key: str) -> Callable[[], None]:
        """Note a declaration. Returns what notes its end."""
        self.declared[kind, key] += 1
        self.declarations_changed.set()
        return partial(self._withdrawn, kind, key)

    def _withdrawn(self, kind: str, key: str) -> None:
        self.declared[kind, key] -= 1
        if not self.declared[kind, key]:
            del self.declared[kind, key]
        self.declarations_changed.set()

    def _decode(self, record: type[R], key: str, payload: bytes, encoding: str) -> R:
        """Return a record that arrived. Raises BadRecord, which is counted and logged here."""
        made = codec(record)
        encoding = "" if encoding == "zenoh/bytes" else encoding
        try:
            found = made.decode(payload, encoding)
            if key not in self._checked_keys and len(self._checked_keys) < BACKLOG:
                self._checked_keys.add(key)
                if unknown := made.unknown_fields(payload, encoding):
                    self.counters["unknown_fields"] += len(unknown)
                    log.warning("unknown_fields key=%s ignored=%s: a newer sender?", key, ",".join(unknown))
            return found
        except BadRecord as bad:
            self.counters["bad_input"] += 1
            if isinstance(bad, OtherVersion):
                self.strangers.heard(key, bad.version)
            elif is_logged(self.counters["bad_input"]):
                log.warning("bad_input key=%s count=%d %s", key, self.counters["bad_input"], bad)
            raise


@dataclass(eq=False)
class _Asked(Generic[R]):
    """A query that waits for replies; `heard` and `timeout` as in `QuerySession.ask`."""

    _session: QuerySession
    _key: str
    _answer: type[R]
    _timeout: float
    _heard: Callable[[Reply[R] | None], None]
    token: zenoh.CancellationToken = field(default_factory=zenoh.CancellationToken)
    late: asyncio.TimerHandle = field(init=False)
    """Ends it without Zenoh."""
    over: bool = False

    def arrived(self, reply: zenoh.Reply | None) -> None:
        """Take a reply, None: the end."""
        if self.over:
            return
        if reply is None:
            self.over = True
            self.late.cancel()
            self._session._asked.discard(self)
            self._heard(None)
        else:
            self._heard(self._read(reply))

    def close(self) -> None:
        """End it; nothing is heard any more."""
        if not self.over:
            self.over = True
            self.late.cancel()
            self._session._asked.discard(self)
            self._session._dispatch.afterwards(self.token.cancel)  # the caller does not wait for it

    def end(self, error: str = "") -> None:
        """End it with an error as the last reply, by default that it is late: Zenoh may never end it."""
        if not self.over:  # the router may be lost and back at the same moment
            self.close()
            self._heard(Reply(self._key, None, error) if error else self._late())
            self._heard(None)

    def unended(self) -> None:
        """End it because Zenoh has not."""
        self._session.counters["queries_unended"] += 1
        self.end()

    def _late(self) -> Reply[R]:
        return Reply(self._key, None, f"no answer within {self._timeout:g} s", timed_out=True)

    def _read(self, reply: zenoh.Reply) -> Reply[R]:
        if reply.ok is None:
            error = reply.err.payload.to_bytes() if reply.err else ZENOH_TIMEOUT
            if error == ZENOH_TIMEOUT:
                return self._late()
            code = str(reply.err.encoding).partition(";")[2] if reply.err else ""
            return Reply(self._key, None, error.decode(errors="replace"), code=code)
        sample = reply.ok
        name = str(sample.key_expr)
        try:
            record = self._session._decode(self._answer, name, sample.payload.to_bytes(), str(sample.encoding))
            return Reply(name, record)
        except OtherVersion as other:
            return Reply(name, None, str(other), other.version or "?")
        except BadRecord as bad:
            return Reply(name, None, str(bad))


class Strangers:
    """Daemons of another major version of the records: logged once, noted while they are heard."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._heard: dict[str, tuple[str, float]] = {}

    def heard(self, key: str, version: str) -> None:
        """Note a record of another version."""
        parsed = keys.parse(key)
        who = "/".join((parsed[1], *parsed[2][:1])) if parsed is not None else key
        self._forget()
        if who not in self._heard:
            if len(self._heard) >= MOST_STRANGERS:
                return
            log.error("other_version %s", _stranger_text(who, version))
        self._heard[who] = (version, self._now())

    def notes(self) -> tuple[Note, ...]:
        """Return a note for each sender heard in the last `STRANGER_FOR` seconds."""
        self._forget()
        return tuple(
            Note("other_version", _stranger_text(who, version), who) for who, (version, _) in self._heard.items()
        )

    def _forget(self) -> None:
        since = self._now() - STRANGER_FOR
        self._heard = {who: met for who, met in self._heard.items() if met[1] >= since}


def _stranger_text(who: str, version: str) -> str:
    return (
        f"{who}: records of version {version or '?'}, this daemon speaks version {VERSION}: they are ignored; "
        "install matching releases of Argosy (docs/guides/operations.md)"
    )
