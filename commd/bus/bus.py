"""The bus: a Zenoh session with typed records, for asyncio.

Zenoh's callbacks run on its own threads and only hand over to the event loop; what waits there is bounded and what does
not fit is counted. Nothing here ever blocks the loop: puts are DROP, and what must not be lost is repaired (percepts)
or acknowledged (actions, mail).
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections import Counter, deque
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, aclosing, asynccontextmanager, contextmanager, suppress
from functools import partial
from threading import Thread
from typing import Any, Generic, Literal, TypeAlias, TypeVar

import zenoh

from commd.bus import access_probe
from commd.bus.connect_diagnosis import why_not
from commd.bus.errors import AccessDenied, AlreadyRunning, BusClosed, QueryFailed, QueryTimeout
from commd.bus.key_cache import KeyCache
from commd.bus.loop_dispatch import LoopDispatch
from commd.bus.raw import RawBus, matching
from commd.bus.router_endpoints import addresses_to_come
from commd.bus.session import LEAVING, OPENING, session_config, set_id
from commd.bus.tls import Tls
from commd.bus.version_check import Strangers
from commd.common.repeated_log import RepeatedLog
from commd.common.tasks import Tasks
from schemas.wire import keys
from schemas.wire.codec import MAX_BYTES, BadRecord, OtherVersion, Wire, codec
from schemas.wire.records import Header, Record

Token: TypeAlias = zenoh.LivelinessToken
"""What says on the bus that somebody is here."""
log = logging.getLogger("bus")
R = TypeVar("R", bound=Record)

BACKLOG = 10_000
"""Samples and queries that may wait for the event loop before further ones are dropped and counted."""
LOOKS = 64
"""Queries of those who look on, such as for minds, that may be served at the same time, beside all others."""
ANSWERING = 2
"""Threads that send what may have to wait for its receiver."""
QUERIES = 256
"""Queries that may be served at the same time."""
CLOSE_PATIENCE = 2.0
"""Wall seconds for the last words of a session; with a router that hangs Zenoh would take 10 s, and then fail."""
ASK_WHY = 10.0
"""Wall seconds after which it is looked into again why the router is not reached."""
UNKNOWN = "is commd running? If it is, it takes no more links: its log and its health say so"
"""Why a router that can be reached lets nobody in."""
OPEN_PATIENCE = 15.0
"""Wall seconds that Zenoh has to open a session or to say why not; an attempt to reach a router takes 1 s."""
LAST_WORD = 1.0
"""Wall seconds that Zenoh has after the end of a query to tell of it."""
STOP_PATIENCE = 1.5
"""Wall seconds that it has when we are told to stop."""
LOOK_UP_PATIENCE = 3.0
"""Seconds that the name service has to find the address of this board."""
ZENOH_TIMEOUT = b"Timeout"
"""The payload of Zenoh's own error reply to a query that was not answered in time."""
ROUTER_LOST = "the router was lost before all had answered"
"""What the last reply to a query says whose replies came by a router that is gone."""
CLAIM_PATIENCE = 3.0
"""Seconds to wait for the token of a dead predecessor to go (the lease of a hung one) before refusing to start."""


class Reply(Generic[R]):
    """One reply to a query: a record on its key, or what was wrong with it."""

    __slots__ = ("code", "error", "key", "other_version", "record", "timed_out")

    def __init__(
        self,
        key: str,
        record: R | None,
        error: str = "",
        other_version: str = "",
        *,
        code: str = "",
        timed_out: bool = False,
    ) -> None:
        self.key, self.record, self.error = key, record, error
        self.code = code
        """What programs know the error by, if the replying program gives it one; `error` is for people."""
        self.other_version = other_version
        """Another major version than ours, which whoever answered speaks."""
        self.timed_out = timed_out
        """Whether it stands for a reply that did not arrive in time."""


class Query(Generic[R]):
    """A query that we serve. `record` is its payload, None if it has none or a bad one (then `error` says why)."""

    def __init__(self, bus: Bus, query: zenoh.Query, record: R | None, error: str, code: str = "") -> None:
        """`code`: of `BadRecord`, for a bad payload."""
        self._bus, self._query, self._code = bus, query, code
        self.key = str(query.key_expr)
        self.record, self.error = record, error
        self.aside = False
        """Whether a thread has sent a reply, and is to send the end of all replies, too."""

    @property
    def parameters(self) -> dict[str, str]:
        """What stands behind the `?` of the selector, `a=b;c=d`; one without `=` has an empty value."""
        text = str(self._query.parameters)
        pairs = (part.partition("=") for part in text.split(";") if part)
        return {name: value for name, _, value in pairs}

    @property
    def concrete(self) -> bool:
        """Whether the key has no wildcard: only then may it have an effect."""
        return "*" not in self.key

    def reply(self, record: Record, key: str | None = None) -> None:
        """Send one reply, on `key` (the query's own by default). Raises BadRecord for what cannot be encoded."""
        self._bus._reply(self._query, key or self.key, record)

    async def answer(self, record: Record, key: str | None = None) -> None:
        """Send one reply as `reply` does, on a thread: Zenoh waits there while the way to the asker is full.

        For what is large and for whoever looks on: an asker that does not read keeps its own answers waiting.
        """
        self.aside = True
        await self._bus.aside(partial(self._bus._reply, self._query, key or self.key, record))

    def reply_error(self, text: str) -> None:
        """Send an error for people to read; for programs its Encoding carries the code of a bad payload."""
        encoding = zenoh.Encoding.TEXT_PLAIN
        try:
            self._query.reply_err(text.encode(), encoding=encoding.with_schema(self._code) if self._code else encoding)
        except zenoh.ZError as error:
            self._bus.counters["replies_lost"] += 1
            log.debug("reply_lost key=%s why=%s", self.key, error)


class Bus:
    """A daemon's session on the bus. Make it with `open_bus`."""

    def __init__(
        self,
        session: zenoh.Session,
        *,
        fleet: str,
        name: str,
        daemon: str,
        boot: str,
        wire: Wire,
        stamp: Callable[[], int],
        mode: Literal["client", "router"],
        endpoint: str,
        tls: Tls | None = None,
    ) -> None:
        self.fleet, self.name, self.daemon, self.boot, self.wire = fleet, name, daemon, boot, wire
        self.mode, self.endpoint, self.tls = mode, endpoint, tls
        self.guarded = mode == "client" and not endpoint.startswith("tcp/")
        """Whether the router may deny what this session does: it says who it is, by its certificate or its board."""
        self.declared: Counter[tuple[str, str]] = Counter()
        """What this session serves, subscribes to and holds now: kinds as Zenoh's admin space calls them, and keys."""
        self.access = access_probe.Watch(self)
        """What the router denies."""
        self.counters: Counter[str] = Counter()
        """dropped, bad_input, unknown_fields, unsendable, replies_lost, puts_lost: what did not get through so far."""
        self._session = session
        self._known = KeyCache(session)
        self._stamp = stamp
        self._loop = asyncio.get_running_loop()
        self._handover = LoopDispatch(self._loop, self.counters)
        self._seq: Counter[tuple[str, str]] = Counter()
        self._tasks = Tasks("serving a query")
        self._aside = Tasks("answering who looks on")
        self._threads = ThreadPoolExecutor(ANSWERING, "answering")
        self._held: dict[Token, str] = {}
        self._listened: list[tuple[Any, Any]] = []
        """Publishers and their matching listeners, which are gone when nobody holds them."""
        self.strangers = Strangers(self._loop.time)
        """Who speaks another major version."""
        self._seen_keys: set[str] = set()
        """Keys whose first record has been looked through for fields that this version does not know."""
        drop = partial(self._hand_over, refuse=_drop_query)
        self.raw = RawBus(session, self._loop, self.counters, drop, self._declare)
        """Bytes on keys that are not Argosy's."""
        self.restarts: int | None = None
        """How often this daemon was started again after a failure, once that is known
        (`commd.process.restart_counter`)."""
        self.former_failure = ""
        """How the life before this one ended, if it failed."""
        self._asked: set[asyncio.Queue[zenoh.Reply | str | float | None]] = set()
        """Of the queries that wait for replies."""
        self._had_router = False
        """Since then queries end when it is lost or back; its first sight ends none."""
        self._routers: set[str] = set()
        self._on_router: list[Callable[[bool], None]] = []
        self._away = RepeatedLog(lambda seconds: log.warning("router lost for=%.0fs: is commd running?", seconds))
        self._watching = self._loop.create_task(self.access.run()) if self.guarded else None
        if mode == "client":
            self._watch_router()
        else:
            self._routers.add("this one")

    @property
    def router_up(self) -> bool:
        """Whether a router is connected now."""
        return bool(self._routers)

    def on_router(self, handler: Callable[[bool], None]) -> None:
        """Call `handler(up)` whenever the connection to the router comes or goes."""
        self._on_router.append(handler)

    def afterwards(self, handler: Callable[[], None]) -> bool:
        """Call `handler()` in this pass of the loop, behind what is told in it; False if nothing is being told.

        Of a flood a pass tells what fits into 20 ms, and at least 64 things; the rest comes in the next ones.
        For those who are told of several things and want to act on them together.
        """
        return self._handover.afterwards(handler)

    def stamp(self) -> int:
        """Return the time of this board as headers have it, Unix nanoseconds."""
        return self._stamp()

    def header(self, stream: str, source: str = "") -> Header:
        """Return the next header of one stream of records of `source` (this daemon by default), counted from 1."""
        source = source or self.name
        self._seq[source, stream] += 1
        return Header(seq=self._seq[source, stream], stamp=self._stamp(), source=source, boot=self.boot)

    def put(self, key: str, record: Record, *, urgent: bool = False) -> None:
        """Publish a record; lost without a word if the router is away, so only for what is repaired or repeated.

        What cannot be encoded is told in the log and counted. What is `urgent` does not wait behind all other records
        on a slow link, nor is it dropped with them.
        """
        made = codec(type(record))
        try:
            payload = made.encode(record, self.wire)
        except BadRecord as bad:
            self.counters["unsendable"] += 1
            log.error("unsendable key=%s count=%d %s", key, self.counters["unsendable"], bad)
            return
        try:
            self._session.put(
                self._known.of(key),
                payload,
                encoding=made.encoding(self.wire),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.INTERACTIVE_HIGH if urgent else zenoh.Priority.DATA,
            )
        except zenoh.ZError as error:
            self.counters["puts_lost"] += 1
            log.debug("put_lost key=%s why=%s", key, error)

    def subscribe(self, key: str, record: type[R], handler: Callable[[str, R], None]) -> None:
        """Call `handler(key, record)` on the event loop for every record put on a matching key, in order."""

        def deliver(sample: zenoh.Sample) -> None:
            name = str(sample.key_expr)
            self._known.used(name)
            try:
                found = self._decode(record, name, sample.payload.to_bytes(), str(sample.encoding))
            except BadRecord:
                return
            handler(name, found)

        self._session.declare_subscriber(key, self._hand_over(deliver))
        self._declare("subscriber", key)

    def listened(self, key: str, handler: Callable[[bool], None]) -> Callable[[], None]:
        """Call `handler(somebody)` on the event loop when the first subscriber to a key comes, or the last one goes.

        It is called soon if there is one already. Returns what ends that; without it, it lasts as long as the session.
        """
        publisher = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        last = False

        def changed(somebody: bool) -> None:
            nonlocal last
            if somebody != last:
                last = somebody
                handler(somebody)

        listener = publisher.declare_matching_listener(self._hand_over(lambda status: changed(status.matching)))
        if matching(publisher):
            self._soon(changed)(True)
        declared = listener, publisher
        self._listened.append(declared)

        def withdraw() -> None:
            self._listened.remove(declared)
            for each in declared:
                try:
                    each.undeclare()  # type: ignore[no-untyped-call]
                except zenoh.ZError as error:  # the session is closed already, and with it what it declared
                    log.debug("not_withdrawn key=%s why=%s", key, error)

        return withdraw

    def serve(
        self,
        key: str,
        record: type[R],
        handler: Callable[[Query[R]], Awaitable[None] | None],
        *,
        at_most: int = MAX_BYTES,
        urgent: bool = False,
        at_once: bool = False,
        aside: bool = False,
    ) -> Callable[[], None]:
        """Serve queries: `handler(query)` runs as a task of its own and the query ends when it returns.

        With `at_once` it is a plain function, called when the query comes; if it returns something to be awaited, that
        is the task, and else the query has ended. A payload of more than `at_most` bytes is refused unread. What is
        `urgent` has room of its own beside all other queries; what is served `aside`, to those who look on, has `LOOKS`
        and takes nobody else's. Returns what ends the serving; without it, it lasts as long as the session.
        """
        tasks, room = (self._aside, LOOKS) if aside else (self._tasks, 2 * QUERIES if urgent else QUERIES)

        def deliver(query: zenoh.Query) -> None:
            size = 0 if query.payload is None else len(query.payload)
            if size > at_most:
                self._refuse(query, "bad_input", f"{record.__name__}: {size} bytes, expected at most {at_most}")
                return
            if len(tasks) >= room:
                self._refuse(query, "dropped", "busy: too many queries at once")
                return
            if at_once:
                self._serve_at_once(query, record, handler)
            else:
                tasks.spawn(self._serve(query, record, handler))

        queryable = self._session.declare_queryable(key, self._hand_over(deliver, refuse=_drop_query))
        forget = self._declare("queryable", key)

        def withdraw() -> None:
            forget()
            try:
                queryable.undeclare()  # type: ignore[no-untyped-call]
            except zenoh.ZError as error:  # the session is closed already, and with it what it served
                log.debug("not_withdrawn key=%s why=%s", key, error)

        return withdraw

    def _refuse(self, query: zenoh.Query, counter: str, why: str) -> None:
        """Tell an asker why its query is not served, and count it."""
        self.counters[counter] += 1
        with query:
            Query(self, query, None, why).reply_error(why)

    async def _serve(
        self, query: zenoh.Query, record: type[R], handler: Callable[[Query[R]], Awaitable[None] | None]
    ) -> None:
        with query:
            ours = self._read_query(query, record)
            with self._told(ours):
                if (rest := handler(ours)) is not None:
                    await rest
            if ours.aside:
                await self.aside(query.drop)

    async def aside(self, work: Callable[[], object]) -> None:
        """Do what Zenoh may be long about on one of the threads for that."""
        await self._loop.run_in_executor(self._threads, work)

    def _serve_at_once(
        self, query: zenoh.Query, record: type[R], handler: Callable[[Query[R]], Awaitable[None] | None]
    ) -> None:
        rest, ours = None, self._read_query(query, record)
        try:
            with self._told(ours):
                rest = handler(ours)
        except Exception as error:  # as of a task that fails
            self._loop.call_exception_handler({"message": "serving a query", "exception": error})
        if rest is None:
            query.drop()  # type: ignore[no-untyped-call]
        else:
            self._tasks.spawn(self._serve_on(query, ours, rest))

    async def _serve_on(self, query: zenoh.Query, ours: Query[Any], rest: Awaitable[None]) -> None:
        with query, self._told(ours):
            await rest

    def _read_query(self, query: zenoh.Query, record: type[R]) -> Query[R]:
        found, error, code = None, "", ""
        if query.payload is not None and len(query.payload):
            try:
                found = self._decode(record, str(query.key_expr), query.payload.to_bytes(), str(query.encoding or ""))
            except BadRecord as bad:
                error, code = str(bad), bad.code
        return Query(self, query, found, error, code)

    @contextmanager
    def _told(self, ours: Query[Any]) -> Iterator[None]:
        """Tell the asker what is wrong with what is to be sent, and of a defect, which is raised."""
        try:
            yield
        except BadRecord as bad:
            ours.reply_error(str(bad))
        except Exception as error:
            ours.reply_error(f"defect in {self.daemon}: {type(error).__name__}: {error}")
            raise

    async def ask_one(self, key: str, ask: Record | None, answer: type[R], timeout: float) -> R:
        """Query `key` and return the first record of a reply, within `timeout` wall seconds.

        Raises QueryTimeout if there was no reply, QueryFailed if there were only errors, BusClosed if the query could
        not be sent, BadRecord if `ask` cannot be encoded.
        """
        failed: QueryFailed = QueryTimeout(key, timeout, nobody=True)
        async with aclosing(self.query(key, ask, answer, timeout)) as replies:
            async for reply in replies:
                if reply.record is not None:
                    return reply.record
                error = QueryFailed(reply.key, reply.error, reply.other_version, code=reply.code)
                failed = QueryTimeout(key, timeout) if reply.timed_out else error
        raise failed

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
        self,
        key: str,
        ask: Record | None,
        answer: type[R],
        timeout: float,
        *,
        limit: int = BACKLOG,
        ready: Callable[[], Awaitable[bool]] | None = None,
    ) -> AsyncGenerator[Reply[R], None]:
        """Ask all that serve `key` and yield each reply as it is made. No reply at all = nobody serves it.

        For a stream of replies; `ask_one` and `ask_all` are for the rest. Close it (`aclosing`) if it is not exhausted.
        The key may have parameters, `key?a=b;c=d`, for those who serve it to read.
        Ends when all have answered, when the router is lost or back (the last reply says so: Zenoh may never end such a
        query), or after `timeout` wall seconds; a final reply that did not come is for the caller to notice. At most
        `limit` replies wait to be taken; further ones are dropped and counted. `ready` is waited for when all is
        prepared, for as long as it takes: `timeout` begins behind it. If it says no, nothing is asked.
        """
        replies: asyncio.Queue[zenoh.Reply | str | float | None] = asyncio.Queue()
        token = zenoh.CancellationToken()

        def arrived(reply: zenoh.Reply | None) -> None:
            if reply is not None and replies.qsize() >= limit:
                self.counters["dropped"] += 1
            else:
                replies.put_nowait(reply)

        soon = self._soon(arrived)
        handler = zenoh.handlers.Callback(soon, partial(soon, None), indirect=False)
        options: dict[str, Any] = {}
        if ask is not None:
            made = codec(type(ask))
            options = {"payload": made.encode(ask, self.wire), "encoding": made.encoding(self.wire)}
        place = key if "?" in key else self._known.of(key)
        if ready is not None and not await ready():
            return
        try:
            self._session.get(
                place,
                handler,
                consolidation=zenoh.ConsolidationMode.NONE,
                target=zenoh.QueryTarget.ALL,
                timeout=timeout,
                cancellation_token=token,
                **options,
            )
        except zenoh.ZError as error:
            raise BusClosed(f"cannot ask {key}: {error}") from None
        late = self._loop.call_later(timeout + LAST_WORD, replies.put_nowait, float(timeout))
        self._asked.add(replies)
        try:
            while (reply := await replies.get()) is not None:
                match reply:
                    case float():
                        self.counters["queries_unended"] += 1
                        yield _timed_out(key, timeout)
                        return
                    case str():
                        yield Reply(key.partition("?")[0], None, reply)
                        return
                yield self._read_reply(key.partition("?")[0], reply, answer, timeout)
        finally:
            self._asked.discard(replies)
            late.cancel()
            self._loop.call_soon(token.cancel)  # who has what he wanted does not wait for that

    def _read_reply(self, key: str, reply: zenoh.Reply, answer: type[R], timeout: float) -> Reply[R]:
        if reply.ok is None:
            error = reply.err.payload.to_bytes() if reply.err else ZENOH_TIMEOUT
            if error == ZENOH_TIMEOUT:
                return _timed_out(key, timeout)
            code = str(reply.err.encoding).partition(";")[2] if reply.err else ""
            return Reply(key, None, error.decode(errors="replace"), code=code)
        sample = reply.ok
        name = str(sample.key_expr)
        try:
            return Reply(name, self._decode(answer, name, sample.payload.to_bytes(), str(sample.encoding)))
        except OtherVersion as other:
            return Reply(name, None, str(other), other.said or "?")
        except BadRecord as bad:
            return Reply(name, None, str(bad))

    def second_session(self, patience: float) -> AbstractAsyncContextManager[Bus]:
        """Open another session at the same router, to look from there at what the router lets through of this one.

        Raises BusClosed if the router does not let it in within `patience` wall seconds.
        """
        return open_bus(
            self.endpoint,
            fleet=self.fleet,
            name=self.name,
            daemon="access",
            stamp=lambda: 0,
            tls=self.tls,
            patience=patience,
        )

    def linked(self) -> set[str]:
        """Return whom this session is linked to, by the names in their certificates."""
        return {name for name in self.links() if name}

    def links(self) -> Counter[str]:
        """Return how many links this session has to whom, by the names in their certificates; "" = who shows none."""
        return Counter(str(link.auth_identifier or "") for link in self._session.info.links())

    def link_ends(self) -> list[tuple[str, str, str]]:
        """Return the links of this session: the id of the other end, and the endpoints of both, ours first."""
        return [(str(link.zid), str(link.src), str(link.dst)) for link in self._session.info.links()]

    def on_link(self, handler: Callable[[str, str, str, bool], None]) -> None:
        """Call `handler(id, address, name, up)` on a thread of Zenoh's for each link that is there, comes or goes.

        The id and the name in the certificate ("" = it shows none) are those of the other end; so is the address.
        """

        def changed(event: zenoh.LinkEvent) -> None:
            link = event.link
            up = event.kind == zenoh.SampleKind.PUT
            handler(str(link.zid), str(link.dst), str(link.auth_identifier or ""), up)

        listener = zenoh.handlers.Callback(changed, indirect=False)
        self._session.info.declare_link_events_listener(listener, history=True)

    async def round_trip(self, timeout: float) -> bool:
        """Ask the router for itself. Returns whether it said anything, if only that nobody answers, in wall seconds."""
        info = self._session.info
        routers = info.routers_zid() if self.mode == "client" else [info.zid()]
        if not routers:
            return False
        said: asyncio.Future[bool] = self._loop.create_future()

        def arrived(reply: zenoh.Reply | None) -> None:
            if not said.done():
                said.set_result(reply is None or reply.ok is not None)  # the error is Zenoh's own: it timed out

        push = self._soon(arrived)
        handler = zenoh.handlers.Callback(push, lambda: push(None), indirect=False)
        self._session.get(f"@/{routers[0]}/router", handler, timeout=timeout)
        try:
            return await asyncio.wait_for(said, timeout + 1.0)
        except TimeoutError:
            return False

    def token(self, key: str) -> Token:
        """Declare a liveliness token; it goes when it is undeclared or when this process ends."""
        token = self._session.liveliness().declare_token(key)
        self._held[token] = key  # a token that nobody holds is gone
        self._declare("token", key)
        return token

    def withdraw(self, token: Token) -> None:
        """Take a token back: what it stood for is here no longer."""
        self._forget("token", self._held.pop(token))
        token.undeclare()  # type: ignore[no-untyped-call]

    def watch(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Call `handler(key, alive)` for every liveliness token that matches, those already there first."""

        def deliver(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._session.liveliness().declare_subscriber(key, self._hand_over(deliver), history=True)

    async def tokens(self, key: str, timeout: float = 2.0) -> list[str]:
        """Return the keys of the liveliness tokens that match now."""
        found: asyncio.Queue[zenoh.Reply | None] = asyncio.Queue()
        push = self._soon(found.put_nowait)
        self._session.liveliness().get(
            key, zenoh.handlers.Callback(push, lambda: push(None), indirect=False), timeout=timeout
        )
        names: list[str] = []
        try:
            async with asyncio.timeout(timeout + 1.0):
                while (reply := await found.get()) is not None:
                    if reply.ok is not None:
                        names.append(str(reply.ok.key_expr))
        except TimeoutError:
            self.counters["queries_unended"] += 1
        return sorted(set(names))

    async def claim(self, name: str) -> Token:
        """Declare that this daemon serves `name`. Raises AlreadyRunning if another live instance does.

        A predecessor that just died may still have a token for the time of its lease, so this waits that long. Claim
        before a `watch` that covers the name begins: Zenoh answers from what the watch has seen, at first nothing.
        """
        return (await self.claim_all([name]))[name]

    async def claim_all(self, names: Sequence[str]) -> dict[str, Token]:
        """Claim several names at once, all of them or none: two hundred take no longer than one."""
        until = self._loop.time() + CLAIM_PATIENCE
        while others := await self._claimed(names):
            if self._loop.time() >= until:
                name, lives = next(iter(others.items()))
                raise self._taken(name, lives)
            await asyncio.sleep(0.2)
        tokens = {name: self.token(self._own(name)) for name in names}
        try:
            there = await self._claimed(names)
            while missing := [name for name in names if self._own(name) not in there.get(name, ())]:
                if self._loop.time() >= until:
                    what = [f"{access_probe.KINDS['token']} {self._own(name)}" for name in missing]
                    if self.router_up and self.guarded:
                        raise AccessDenied(await access_probe.in_words(self, what))
                    raise BusClosed(f"the router does not show the token of `{missing[0]}` within {CLAIM_PATIENCE:g} s")
                await asyncio.sleep(0.02)
                there = await self._claimed(names)
            for name in names:
                if there[name][0] != self._own(name):  # both came at the same moment: the same one of the two goes
                    raise self._taken(name, there[name])
        except BaseException:
            for token in tokens.values():
                self.withdraw(token)
            raise
        return tokens

    @property
    def zid(self) -> str:
        """What routers call this session."""
        return str(self._session.info.zid())

    async def permitted(self, puts: Collection[str] = ()) -> None:
        """Ask the router whether it lets through what was declared, and puts on these keys. Raises AccessDenied."""
        if self.guarded and (words := await access_probe.refused(self, puts)):
            raise AccessDenied(words)

    def _declare(self, kind: str, key: str) -> Callable[[], None]:
        self.declared[kind, key] += 1
        self.access.changed()
        return partial(self._forget, kind, key)

    def _forget(self, kind: str, key: str) -> None:
        self.declared[kind, key] -= 1
        if not self.declared[kind, key]:
            del self.declared[kind, key]
        self.access.changed()

    def _own(self, name: str) -> str:
        return keys.alive(self.fleet, name, self.daemon, self.boot)

    async def _claimed(self, names: Sequence[str]) -> dict[str, list[str]]:
        """Return the tokens of these names that are there now, in their order."""
        found = await self.tokens(keys.alive(self.fleet, names[0] if len(names) == 1 else "*", self.daemon, "*"))
        wanted, claimed = set(names), dict[str, list[str]]()
        for key in found:
            if (parsed := keys.parse(key)) is not None and parsed[1] in wanted:
                claimed.setdefault(parsed[1], []).append(key)
        return claimed

    def _taken(self, name: str, tokens: list[str]) -> AlreadyRunning:
        life = tokens[0].rsplit("/", 1)[-1]
        return AlreadyRunning(f"another {self.daemon} serves `{name}` of fleet `{self.fleet}` already (boot {life})")

    def _decode(self, record: type[R], key: str, payload: bytes, encoding: str) -> R:
        made = codec(record)
        encoding = "" if encoding == "zenoh/bytes" else encoding
        try:
            found = made.decode(payload, encoding)
            if key not in self._seen_keys and len(self._seen_keys) < BACKLOG:
                self._seen_keys.add(key)
                if unknown := made.unknown_fields(payload, encoding):
                    self.counters["unknown_fields"] += len(unknown)
                    log.warning("unknown_fields key=%s ignored=%s: a newer sender?", key, ",".join(unknown))
            return found
        except BadRecord as bad:
            self.counters["bad_input"] += 1
            if isinstance(bad, OtherVersion):
                self.strangers.heard(key, bad.said)
            elif self.counters["bad_input"] <= 10 or self.counters["bad_input"] % 1000 == 0:
                log.warning("bad_input key=%s count=%d %s", key, self.counters["bad_input"], bad)
            raise

    def _reply(self, query: zenoh.Query, key: str, record: Record) -> None:
        made = codec(type(record))
        try:
            query.reply(key, made.encode(record, self.wire), encoding=made.encoding(self.wire))
        except zenoh.ZError as error:
            self.counters["replies_lost"] += 1
            log.debug("reply_lost key=%s why=%s", key, error)

    def _soon(self, function: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback for Zenoh's threads that runs `function` on the event loop while that runs."""
        return partial(self._handover.put, function)

    def _hand_over(
        self, deliver: Callable[[Any], None], refuse: Callable[[Any], None] | None = None
    ) -> zenoh.handlers.Callback[Any]:
        """Like `_soon`, with a bound on what may wait for the loop: the excess is refused and counted."""
        waiting: deque[Any] = deque()
        soon = self._soon(lambda _: deliver(waiting.popleft()))

        def callback(item: Any) -> None:
            if len(waiting) >= BACKLOG:
                self.counters["dropped"] += 1
                if refuse is not None:
                    refuse(item)
                return
            waiting.append(item)
            soon(None)

        return zenoh.handlers.Callback(callback, indirect=False)

    def _watch_router(self) -> None:
        def changed(event: zenoh.TransportEvent) -> None:
            was, zid = self.router_up, str(event.transport.zid)
            if event.kind == zenoh.SampleKind.PUT:
                self._routers.add(zid)
                self.access.changed()  # it may have come back with other rules
            else:
                self._routers.discard(zid)
            if was != self.router_up:
                if self._had_router:
                    for replies in self._asked:
                        replies.put_nowait(ROUTER_LOST)
                self._had_router = True
                self._tell_router()
                for handler in self._on_router:
                    handler(self.router_up)

        self._session.info.declare_transport_events_listener(self._hand_over(changed), history=True)

    def _tell_router(self) -> None:
        """Log that the router came or went; of one that stays away it is said again now and then."""
        away = self._away.end()
        if not self.router_up:
            log.warning("router lost: what needs it waits")
            self._away.begin()
        elif away is None:
            log.info("router up")
        else:
            log.info("router back after=%.1fs", away)

    async def close(self) -> None:
        """End what is being served, then leave the bus."""
        if self._watching is not None:
            self._watching.cancel()
        self._away.end()
        await self._tasks.end()
        await self._aside.end()
        self._threads.shutdown(wait=False, cancel_futures=True)
        closed = asyncio.Event()

        def close() -> None:
            _leave(self._session)
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(closed.set)  # not behind all that waits to be handed over

        Thread(target=close, name=LEAVING, daemon=True).start()
        try:
            await asyncio.wait_for(closed.wait(), CLOSE_PATIENCE)
        except TimeoutError:
            log.warning("the router hangs: this session ends without a word to it")


def _timed_out(key: str, timeout: float) -> Reply[Any]:
    return Reply(key.partition("?")[0], None, f"no answer within {timeout:g} s", timed_out=True)


def _leave(session: zenoh.Session) -> None:
    """Close a session, on a thread of its own; with a router that hangs it takes 10 s and fails."""
    try:
        session.close()  # type: ignore[no-untyped-call]
    except BaseException as error:  # a panic of Zenoh's is no Exception
        log.debug("not_closed why=%s", error)


def _drop_query(query: zenoh.Query) -> None:
    with query:
        query.reply_err(b"busy: too many queries wait", encoding=zenoh.Encoding.TEXT_PLAIN)


async def _open(config: zenoh.Config, stop: asyncio.Event | None) -> zenoh.Session:
    """Open a session, in a thread that the end of the process does not wait for: Zenoh may never come back from it.

    Raises TimeoutError, soon once `stop` is set.
    """
    loop = asyncio.get_running_loop()
    opened: asyncio.Future[zenoh.Session] = loop.create_future()

    def settle(session: zenoh.Session | None, error: BaseException | None) -> None:
        if session is not None and not opened.done():
            opened.set_result(session)
        elif session is not None:  # too late
            Thread(target=_leave, args=(session,), name=LEAVING, daemon=True).start()
        elif error is not None and not opened.done():
            opened.set_exception(error)

    def open_it() -> None:
        session, error = None, None
        try:
            session = zenoh.open(config)
        except BaseException as failure:  # a panic of Zenoh's is no Exception
            error = failure
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(settle, session, error)

    Thread(target=open_it, name=OPENING, daemon=True).start()
    told = asyncio.Event() if stop is None else stop
    stopping = asyncio.ensure_future(told.wait())
    try:
        either: set[asyncio.Future[Any]] = {opened, stopping}
        await asyncio.wait(either, timeout=OPEN_PATIENCE, return_when=asyncio.FIRST_COMPLETED)
        return await asyncio.wait_for(opened, STOP_PATIENCE)
    finally:
        stopping.cancel()
        opened.cancel()  # what comes of it now is nobody's: a session that opens late is closed


async def _absent(endpoint: str, listen: Sequence[str]) -> list[str]:
    """Return those of a router's further endpoints whose address this machine does not have, or not yet.

    Raises BusClosed if somebody else listens at one, or at its own endpoint: Zenoh, told to wait, would wait for them.
    """
    try:
        absent = await asyncio.wait_for(asyncio.to_thread(addresses_to_come, listen), LOOK_UP_PATIENCE)
        if absent and await asyncio.to_thread(addresses_to_come, [endpoint]):
            raise BusClosed(f"cannot listen at {endpoint}: no address of this machine")
    except TimeoutError:
        absent = list(listen)
    except OSError as error:
        raise BusClosed(f"{error.strerror}: is another router running there?") from None
    for one in absent:
        log.warning("%s is no address of this machine yet: no other board reaches this one until it is", one)
    return absent


def boot_id() -> str:
    """Return a name for this life of the process."""
    return os.urandom(4).hex()


@asynccontextmanager
async def open_bus(
    endpoint: str,
    *,
    fleet: str,
    name: str,
    daemon: str,
    stamp: Callable[[], int],
    wire: Wire = "json",
    mode: Literal["client", "router"] = "client",
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    stop: asyncio.Event | None = None,
    patience: float = float("inf"),
    tls: Tls | None = None,
    config: zenoh.Config | None = None,
    make: type[Bus] = Bus,
) -> AsyncIterator[Bus]:
    """Open the bus, and close it at the end. A client waits for its router until `stop`, or for `patience` seconds.

    A router listens at `listen` besides its endpoint, at once or when this machine has the address, and keeps dialling
    the routers at `connect`; it waits for neither. `tls` is for what is at `tls/...`. With a `config` a router takes
    all of this from there. Raises BusClosed when the router did not come, or when a router cannot listen.
    """
    loop = asyncio.get_running_loop()
    until = loop.time() + patience
    absent = await _absent(endpoint, listen) if listen else []
    if config is None:
        config = session_config(
            mode, endpoint, f"{daemon}/{name}", listen=listen, connect=connect, listen_late=bool(absent), tls=tls
        )
    if mode == "router":
        set_id(config, name)
    why, asked = "", -ASK_WHY

    def remind(seconds: float) -> None:
        log.warning("waiting for the router at %s for=%.0fs: %s", endpoint, seconds, why)

    waiting = RepeatedLog(remind)
    try:
        while True:
            try:
                session = await _open(config, stop)
                break
            except TimeoutError:
                raise BusClosed(f"Zenoh does not open a session for {endpoint}, and does not say why") from None
            except zenoh.ZError as error:
                if mode == "router":
                    where = " or ".join((endpoint, *listen))
                    why = str(error).partition(" at /")[0]  # what follows are paths of Zenoh's sources
                    raise BusClosed(f"cannot listen at {where}: is another router running there? ({why})") from None
                if loop.time() >= asked + ASK_WHY:
                    before, why = why, await why_not(endpoint, tls) or UNKNOWN
                    asked = loop.time()
                    if why != before:
                        log.warning("waiting for the router at %s: %s", endpoint, why)
                if loop.time() >= until or (stop is not None and stop.is_set()):
                    raise BusClosed(f"no router at {endpoint}: {why}") from None
                if not waiting.goes_on:
                    waiting.begin()
                await asyncio.sleep(0.1)
    finally:
        waiting.end()
    bus = make(
        session,
        fleet=fleet,
        name=name,
        daemon=daemon,
        boot=boot_id(),
        wire=wire,
        stamp=stamp,
        mode=mode,
        endpoint=endpoint,
        tls=tls,
    )
    try:
        yield bus
    finally:
        await bus.close()
