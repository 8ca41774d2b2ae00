"""The bus: a Zenoh session with typed records, for asyncio.

Zenoh's threads only hand over to the event loop, by bounded queues that count what they drop. Nothing here blocks the
loop: puts are DROP, and what must not be lost is repaired (percepts) or acknowledged (actions, mail).
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, Literal, TypeAlias, TypeVar

import zenoh

from commd.bus import access_probe
from commd.bus.errors import AccessDenied, AlreadyRunning, BusClosed
from commd.bus.queries import ROUTER_LOST, Query, QuerySession, Reply
from commd.bus.raw import Matched, Publisher, RawBus
from commd.bus.router_endpoints import missing_addresses
from commd.bus.session import Declaration, close_session, open_client, open_session, session_config, set_id
from commd.bus.tls import Tls
from commd.common.repeated_log import RepeatedLog
from schemas.wire import keys
from schemas.wire.codec import BadRecord, Wire, codec
from schemas.wire.records import Header, Record

__all__ = ["Bus", "Query", "Reply", "Token", "boot_id", "open_bus"]

Token: TypeAlias = zenoh.LivelinessToken
"""Shows on the bus that a daemon is alive."""
log = logging.getLogger("bus")
R = TypeVar("R", bound=Record)

CLAIM_PATIENCE = 3.0
"""Wall seconds to wait for the token of a dead predecessor to end (the lease of a hung one) before refusing to
start."""


class Bus(QuerySession):
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
        mode: Literal["client", "router"],
        endpoint: str,
        tls: Tls | None = None,
    ) -> None:
        super().__init__(session, wire, daemon)
        self.fleet, self.name, self.boot = fleet, name, boot
        self.mode, self.endpoint, self.tls = mode, endpoint, tls
        self.guarded = mode == "client" and not endpoint.startswith("tcp/")
        """Whether the router may deny what this session does: it is identified by its certificate or its board."""
        self.access = access_probe.Watch(self)
        """What the router denies."""
        self.afterwards = self._dispatch.afterwards
        """Calls a function behind all that is handed over in this pass of the loop (`LoopDispatch.afterwards`)."""
        self.raw = RawBus(session, self._dispatch, self._declare)
        """Bytes on keys that are not Argosy's."""
        self.restarts: int | None = None
        """Starts of this daemon after a failure; None while unknown (`commd.process.restart_counter`)."""
        self.former_failure = ""
        """How the process before this one ended, if it failed."""
        self._seq: Counter[tuple[str, str]] = Counter()
        self._held: dict[Token, str] = {}
        self._handlers: dict[tuple[str, type[Record]], list[Callable[[str, Any], None]]] = {}
        """What is called with each record of a subscription, by its key and type."""
        self._listened: list[Declaration] = []
        """Publishers with their matching listeners, which end when nothing refers to them."""
        self._had_router = False
        """From then on queries end when it is lost or back; its first appearance ends none."""
        self._routers: set[str] = set()
        self._on_router: list[Callable[[bool], None]] = []
        self._away = RepeatedLog(lambda seconds: log.warning("router lost for=%.0fs: is commd running?", seconds))
        self._watching = self._loop.create_task(self.access.run()) if self.guarded else None
        if mode == "client":
            events = self._dispatch.callback(self._router_event)
            session.info.declare_transport_events_listener(events, history=True)
        else:
            self._routers.add("this one")

    @property
    def router_up(self) -> bool:
        """Whether a router is connected now."""
        return bool(self._routers)

    def on_router(self, handler: Callable[[bool], None]) -> None:
        """Call `handler(up)` whenever the connection to the router is made or lost."""
        self._on_router.append(handler)

    def header(self, stream: str, source: str = "") -> Header:
        """Return the next header of one stream of records of `source` (this daemon by default), counted from 1."""
        source = source or self.name
        self._seq[source, stream] += 1
        return Header(seq=self._seq[source, stream], stamp=time.time_ns(), source=source, boot=self.boot)

    def put(self, key: str, record: Record, *, urgent: bool = False, publisher: Publisher | None = None) -> None:
        """Publish a record. It is lost silently while the router is away: only for what is repaired or repeated.

        A record that cannot be encoded is logged and counted. An `urgent` one neither waits behind all others on a slow
        link nor is dropped with them. `publisher` is one of `raw` on this key, for records that are put often.
        """
        made, wire = codec(type(record)), self.wire
        try:
            payload, encoding = made.encode(record, wire), made.encodings[wire]
            if publisher is not None:
                publisher.put(payload, encoding)
                return
            self._session.put(
                self._known.of(key),
                payload,
                encoding=encoding,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.INTERACTIVE_HIGH if urgent else zenoh.Priority.DATA,
            )
        except BadRecord as bad:
            self.counters["unsendable"] += 1
            log.error("unsendable key=%s count=%d %s", key, self.counters["unsendable"], bad)
        except (zenoh.ZError, OSError) as error:
            self.counters["puts_lost"] += 1
            log.debug("put_lost key=%s why=%s", key, error)

    def subscribe(self, key: str, record: type[R], handler: Callable[[str, R], None]) -> None:
        """Call `handler(key, record)` on the event loop for every record put on a matching key, in order.

        Subscriptions to one key share a record, which is decoded once: a bridge of many robots hears one agentd.
        """
        handlers = self._handlers.setdefault((key, record), [])
        handlers.append(handler)
        if len(handlers) > 1:
            return

        def deliver(sample: zenoh.Sample) -> None:
            name = str(sample.key_expr)
            self._known.used(name)
            try:
                found = self._decode(record, name, sample.payload.to_bytes(), str(sample.encoding))
            except BadRecord:
                return
            for each in handlers:
                self._dispatch.call(each, name, found)

        self._session.declare_subscriber(key, self._dispatch.callback(deliver))
        self._declare("subscriber", key)

    def listened(self, key: str, handler: Callable[[bool], None]) -> Callable[[], None]:
        """Call `handler(somebody)` on the event loop when the first subscriber to a key appears or the last one ends.

        It is called here if there is one already. Returns what ends that; without it, it lasts as long as the session.
        """
        publisher = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        last = ended = False

        def changed(somebody: bool) -> None:
            nonlocal last
            if somebody != last and not ended:
                last = somebody
                handler(somebody)

        listener = publisher.declare_matching_listener(self._dispatch.callback(lambda status: changed(status.matching)))
        declared: list[Declaration] = [Declaration(listener), matched := Matched(publisher)]
        if matched.matching:
            changed(True)
        self._listened += declared

        def withdraw() -> None:
            nonlocal ended
            ended = True
            for each in declared:
                self._listened.remove(each)
                each.close()

        return withdraw

    def second_session(self, patience: float) -> AbstractAsyncContextManager[Bus]:
        """Open another session at the same router, to see from there what the router lets through of this one.

        Raises BusClosed if the router does not let it in within `patience` wall seconds.
        """
        return open_bus(
            self.endpoint,
            fleet=self.fleet,
            name=self.name,
            daemon="access",
            tls=self.tls,
            patience=patience,
        )

    async def permitted(self, puts: Collection[str] = ()) -> None:
        """Check that the router lets through what was declared, and puts on these keys. Raises AccessDenied."""
        if self.guarded and (denied := await access_probe.find_denials(self, puts)):
            raise AccessDenied(denied)

    @property
    def zid(self) -> str:
        """Zenoh's id of this session."""
        return str(self._session.info.zid())

    def linked(self) -> set[str]:
        """Return the names in the certificates of all links."""
        return {name for name in self.links() if name}

    def links(self) -> Counter[str]:
        """Return the number of links by the name in the other side's certificate; "" = it shows none."""
        return Counter(str(link.auth_identifier or "") for link in self._session.info.links())

    def link_ends(self) -> list[tuple[str, str, str]]:
        """Return the links of this session: the id of the other end, and the endpoints of both, ours first."""
        return [(str(link.zid), str(link.src), str(link.dst)) for link in self._session.info.links()]

    def on_link(self, handler: Callable[[str, str, str, bool], None]) -> None:
        """Call `handler(id, address, name, up)` on a thread of Zenoh's for each link that exists, appears or ends.

        The id, the address and the name in the certificate ("" = it shows none) are those of the other end.
        """

        def changed(event: zenoh.LinkEvent) -> None:
            link = event.link
            up = event.kind == zenoh.SampleKind.PUT
            handler(str(link.zid), str(link.dst), str(link.auth_identifier or ""), up)

        listener = zenoh.handlers.Callback(changed, indirect=False)
        self._session.info.declare_link_events_listener(listener, history=True)

    async def round_trip(self, timeout: float) -> bool:
        """Query the router itself. Returns whether it answered within `timeout` wall seconds, if only with nothing."""
        info = self._session.info
        routers = info.routers_zid() if self.mode == "client" else [info.zid()]
        if not routers:
            return False
        selector = f"@/{routers[0]}/router"
        replies, ended = await self._dispatch.collect(
            lambda callback: self._session.get(selector, callback, timeout=timeout), timeout
        )
        return any(reply.ok is not None for reply in replies) if replies else ended  # an error: Zenoh's own timeout

    def token(self, key: str) -> Token:
        """Declare a liveliness token; it ends when it is withdrawn or when this process ends."""
        token = self._session.liveliness().declare_token(key)
        self._held[token] = key  # a token ends when nothing refers to it
        self._declare("token", key)
        return token

    def withdraw(self, token: Token) -> None:
        """Withdraw a token."""
        self._withdrawn("token", self._held.pop(token))
        token.undeclare()  # type: ignore[no-untyped-call]

    def watch(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Call `handler(key, alive)` for every liveliness token that matches, the present ones first."""

        def deliver(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._session.liveliness().declare_subscriber(key, self._dispatch.callback(deliver), history=True)

    async def tokens(self, key: str, timeout: float = 2.0) -> list[str]:
        """Return the keys of the liveliness tokens that match now, sorted; waits at most `timeout` wall seconds."""
        replies, ended = await self._dispatch.collect(
            lambda callback: self._session.liveliness().get(key, callback, timeout=timeout), timeout
        )
        self.counters["queries_unended"] += not ended
        return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})

    async def claim(self, name: str) -> Token:
        """Declare that this daemon serves `name`. Raises AlreadyRunning if another live instance does.

        Waits `CLAIM_PATIENCE` for the token of a predecessor to end. Claim before a `watch` that covers the name
        begins: Zenoh answers from what the watch has seen, at first nothing.
        """
        return (await self.claim_all([name]))[name]

    async def claim_all(self, names: Sequence[str]) -> dict[str, Token]:
        """Claim several names together, all or none: two hundred take no longer than one.

        Whoever sees no other token beside its own has the name. Of two that come at the same moment the first in order
        waits, as the other may have it already or will give way.
        """
        until = self._loop.time() + CLAIM_PATIENCE
        while others := await self._claimed(names):
            if self._loop.time() >= until:
                name, lives = next(iter(others.items()))
                raise self.taken(name, lives)
            await asyncio.sleep(0.2)
        tokens = {name: self.token(self._own(name)) for name in names}
        try:
            await self._alone(names, until)
        except BaseException:
            for token in tokens.values():
                self.withdraw(token)
            raise
        return tokens

    async def _alone(self, names: Sequence[str], until: float) -> None:
        """Wait until the router shows no tokens of these names but our own. Raises what a claim does."""
        while True:
            there, late = await self._claimed(names), self._loop.time() >= until
            if not (waiting := [name for name in names if there.get(name) != [self._own(name)]]):
                return
            for name in waiting:
                others = [token for token in there.get(name, ()) if token != self._own(name)]
                if others and (late or others[0] < self._own(name)):
                    raise self.taken(name, others)
            if late:
                what = [f"{access_probe.KINDS['token']} {self._own(name)}" for name in waiting]
                if self.router_up and self.guarded:
                    raise AccessDenied(await access_probe.denial_text(self, what))
                raise BusClosed(f"the router does not show the token of `{waiting[0]}` within {CLAIM_PATIENCE:g} s")
            await asyncio.sleep(0.02)

    def _own(self, name: str) -> str:
        return keys.alive(self.fleet, name, self.daemon, self.boot)

    async def _claimed(self, names: Sequence[str]) -> dict[str, list[str]]:
        """Return the present tokens of each of these names, sorted."""
        found = await self.tokens(keys.alive(self.fleet, names[0] if len(names) == 1 else "*", self.daemon, "*"))
        wanted, claimed = set(names), dict[str, list[str]]()
        for key in found:
            if (parsed := keys.parse(key)) is not None and parsed[1] in wanted:
                claimed.setdefault(parsed[1], []).append(key)
        return claimed

    def taken(self, name: str, tokens: list[str]) -> AlreadyRunning:
        """Return the error that others, by their tokens, serve a name."""
        boot = tokens[0].rsplit("/", 1)[-1]
        return AlreadyRunning(f"another {self.daemon} serves `{name}` of fleet `{self.fleet}` already (boot {boot})")

    def _router_event(self, event: zenoh.TransportEvent) -> None:
        was, zid = self.router_up, str(event.transport.zid)
        if event.kind == zenoh.SampleKind.PUT:
            self._routers.add(zid)
            self.declarations_changed.set()  # it may have come back with other rules
        else:
            self._routers.discard(zid)
        if was == self.router_up:
            return
        if self._had_router:
            for asked in self._asked:
                self._loop.call_soon(asked.end, ROUTER_LOST)  # behind the handlers, which note when the router was lost
        self._had_router = True
        away = self._away.end()
        if not self.router_up:
            log.warning("router lost: requests wait until it is back")
            self._away.begin()
        elif away is None:
            log.info("router up")
        else:
            log.info("router back after=%.1fs", away)
        for handler in self._on_router:
            handler(self.router_up)

    async def close(self) -> None:
        """End what is being served, then leave the bus."""
        if self._watching is not None:
            self._watching.cancel()
        self._away.end()
        await self._tasks.end()
        await self._observer_tasks.end()
        self._threads.shutdown(wait=False, cancel_futures=True)
        if not await close_session(self._session):
            log.warning("the router hangs: this session ends without notice to it")


def boot_id() -> str:
    """Return a new id of one process's life on the bus."""
    return os.urandom(4).hex()


@asynccontextmanager
async def open_bus(
    endpoint: str,
    *,
    fleet: str,
    name: str,
    daemon: str,
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
    """Open the bus, and close it at the end. A client waits for its router until `stop`, or `patience` wall seconds.

    A router listens at `listen` besides its endpoint, as soon as this machine has the addresses, and dials the routers
    at `connect` for ever; it waits for neither. `tls` has the keys for `tls/...`. With a `config` a router takes all
    of this from there. Raises BusClosed if the router is not reached, or if a router cannot listen.
    """
    missing = await missing_addresses(endpoint, listen) if listen else []
    if config is None:
        config = session_config(
            mode, endpoint, f"{daemon}/{name}", listen=listen, connect=connect, listen_late=bool(missing), tls=tls
        )
    if mode == "router":
        set_id(config, name)
        try:
            session = await open_session(config, endpoint, stop)
        except zenoh.ZError as error:
            where = " or ".join((endpoint, *listen))
            why = str(error).partition(" at /")[0]  # paths of Zenoh's sources follow
            raise BusClosed(f"cannot listen at {where}: is another router running there? ({why})") from None
    else:
        session = await open_client(config, endpoint, tls, stop, patience)
    bus = make(
        session,
        fleet=fleet,
        name=name,
        daemon=daemon,
        boot=boot_id(),
        wire=wire,
        mode=mode,
        endpoint=endpoint,
        tls=tls,
    )
    try:
        yield bus
    finally:
        await bus.close()
