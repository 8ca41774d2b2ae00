"""Zenoh within one process: sessions at routers, with its key expressions, queries, liveliness and their ends.

`Network.open` replaces `zenoh.open`: the session has the part of `zenoh.Session` that `commd.bus` uses. Messages
between two sessions keep their order; each takes the network's delay.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Collection
from contextvars import copy_context
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import count
from typing import Any, Final

import msgspec
import zenoh

from argosy.trial.event_loop import WIRE, VirtualLoop
from commd.bus.session import LEASE_MS

PUT, DELETE = zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE
HOP: Final = 0.0002
"""Virtual seconds of a message from session to session by a router of one board."""
LINK: Final = 0.002
"""Virtual seconds between two routers of a network without faults."""
LEASE: Final = LEASE_MS / 1000
"""Virtual seconds of silence after which two routers give up their link: tokens and queries over it end then. What is
sent in a shorter silence arrives late, in a longer one not at all (measured with a relay between two routers)."""
AGAIN: Final = 0.3
"""Virtual seconds after which a client notices that its router is back."""


@lru_cache(maxsize=65536)
def intersects(one: str, other: str) -> bool:
    """Return whether two key expressions have a key in common."""
    if "*" not in one and "*" not in other and "$" not in one + other:
        return one == other
    return zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other))


@lru_cache(maxsize=65536)
def checked(key: str) -> str:
    """Return a key expression. Raises ZError if it is none."""
    return str(zenoh.KeyExpr(key))


class Payload:
    """Bytes as Zenoh hands them out."""

    __slots__ = ("_bytes",)

    def __init__(self, data: Any) -> None:
        self._bytes = data.encode() if isinstance(data, str) else bytes(data)

    def to_bytes(self) -> bytes:
        """Return the bytes."""
        return self._bytes

    def __len__(self) -> int:
        return len(self._bytes)


class Sample(msgspec.Struct, frozen=True):
    """A put, a reply, or a change of a liveliness token."""

    key_expr: str
    payload: Payload
    encoding: str = "zenoh/bytes"
    kind: Any = PUT


class Reply(msgspec.Struct, frozen=True):
    """A reply: one of the two is None."""

    ok: Sample | None
    err: Sample | None = None


class _Asked:
    """A query on its way: it ends when each that serves it has dropped it, or by its timeout."""

    def __init__(self, asker: Session, callback: Callable[[Any], Any], drop: Callable[[], Any], timeout: float) -> None:
        self.asker, self._callback, self._drop = asker, callback, drop
        self.open: dict[int, Session] = {}
        """Those that have not answered to the end, by their numbers."""
        self.over = False
        self._timer = asker.network.loop.call_later(timeout, self._timed_out)

    def replied(self, reply: Reply) -> None:
        if not self.over and not self.asker.closed:
            self.asker.hand(self._callback, reply)

    def dropped(self, number: int) -> None:
        self.open.pop(number, None)
        if not self.open:
            self.end()

    def topology_changed(self) -> None:
        """End it for those that are out of reach: behind what they have sent."""
        network = self.asker.network
        for number, server in self.open.items():
            if not network.reaches(server, self.asker):
                due = network.last_arrival(server, self.asker, HOP)
                network.loop.call_at(due, self.dropped, number, context=WIRE)

    def _timed_out(self) -> None:
        if self.open:
            self.replied(Reply(None, Sample("", Payload(b"Timeout"))))
        self.end()

    def end(self) -> None:
        if not self.over:
            self.over = True
            self.asker.network.asked.pop(self, None)
            self._timer.cancel()
            if not self.asker.closed:
                self.asker.hand(self._drop)


class Query:
    """A query as it reaches one that serves it."""

    def __init__(
        self, key: str, parameters: str, payload: Any, encoding: Any, server: Session, asked: _Asked, number: int
    ):
        self.key_expr, self.parameters = key, parameters
        self.payload = None if payload is None else Payload(payload)
        self.encoding = None if encoding is None else str(encoding)
        self.server, self._asked, self._number, self._dropped = server, asked, number, False

    def _send(self, send: Callable[[], None]) -> None:
        self.server.network.send(self.server, self._asked.asker, send)

    def reply(self, key: Any, payload: Any, *, encoding: Any = None) -> None:
        """Send a reply. Raises ZError for a key that was not asked."""
        if not intersects(str(key), self.key_expr):
            raise zenoh.ZError(f"{key} was not asked")
        sample = Sample(str(key), Payload(payload), str(encoding or "zenoh/bytes"))
        for listener in self.server.network.on_query:
            listener(self, sample)
        self._send(lambda: self._asked.replied(Reply(sample)))

    def reply_err(self, payload: Any, *, encoding: Any = None) -> None:
        """Send an error."""
        sample = Sample("", Payload(payload), str(encoding or "zenoh/bytes"))
        self._send(lambda: self._asked.replied(Reply(None, sample)))

    def drop(self) -> None:
        """End it: there are no more replies."""
        if not self._dropped:
            self._dropped = True
            self._send(lambda: self._asked.dropped(self._number))

    def __enter__(self) -> Query:
        return self

    def __exit__(self, *_: object) -> None:
        self.drop()


@dataclass(eq=False)
class _Declared:
    """A subscriber, queryable, publisher, querier or token."""

    session: Session
    kind: str
    key_expr: str
    callback: Callable[[Any], Any] | None = None
    remote_only: bool = False
    matched: Callable[[Any], Any] | None = None

    def undeclare(self) -> None:
        self.session.withdraw(self)

    def take(self, item: Any) -> None:
        """Hand over a sample or a query."""
        if self in self.session.declared and self.callback is not None and not self.session.closed:
            self.session.hand(self.callback, item)
        elif isinstance(item, Query):
            item.drop()

    def tell_matching(self) -> None:
        if self.matched is not None and not self.session.closed:
            self.session.hand(self.matched, self.matching_status)

    def put(self, payload: Any, *, encoding: Any = None, **_: Any) -> None:
        self.session.put(self.key_expr, payload, encoding=encoding, remote_only=self.remote_only)

    @property
    def matching_status(self) -> Any:
        wanted = "subscriber" if self.kind == "publisher" else "queryable"
        return _Matching(self.session.network.somebody(self, wanted))

    def declare_matching_listener(self, callback: Any) -> Any:
        self.matched = callback.callback
        return _Listener(self)


@dataclass
class _Matching:
    matching: bool


@dataclass
class _Listener:
    of: _Declared

    def undeclare(self) -> None:
        self.of.matched = None


@dataclass
class _Transport:
    zid: str


@dataclass
class _Event:
    kind: Any
    transport: _Transport


class _Table:
    """The declarations of one kind."""

    def __init__(self) -> None:
        self._plain: dict[str, dict[_Declared, None]] = {}
        """Those of one key, by it."""
        self._patterns: dict[_Declared, None] = {}
        """Those of a key expression of several keys."""
        self._found: dict[str, tuple[_Declared, ...]] = {}
        """What was found for a key, until it changes."""
        self._asked_patterns: dict[str, None] = {}
        """The key expressions of several keys among these."""

    def add(self, one: _Declared) -> None:
        """Add a declaration."""
        group = self._patterns if "*" in one.key_expr else self._plain.setdefault(one.key_expr, {})
        group[one] = None
        self._forget(one.key_expr)

    def remove(self, one: _Declared) -> None:
        """Remove a declaration."""
        group = self._patterns if "*" in one.key_expr else self._plain[one.key_expr]
        del group[one]
        self._forget(one.key_expr)

    def matching(self, key: str) -> tuple[_Declared, ...]:
        """Return the declarations that have a key in common with a key expression."""
        found = self._found.get(key)
        if found is None:
            if "*" in key:
                self._asked_patterns[key] = None
                plain = [one for other, them in self._plain.items() if intersects(other, key) for one in them]
            else:
                plain = [*self._plain.get(key, ())]
            found = (*plain, *(one for one in self._patterns if intersects(one.key_expr, key)))
            self._found[key] = found
        return found

    def _forget(self, key: str) -> None:
        """Forget what was found for a key expression."""
        self._found.pop(key, None)
        for asked in [
            asked for asked in (self._found if "*" in key else self._asked_patterns) if intersects(asked, key)
        ]:
            self._found.pop(asked, None)


class Session:
    """A session of one process, at the router of its board."""

    def __init__(self, network: Network, number: int, router: str, name: str, owner: object) -> None:
        self.network, self.number, self.router, self.name, self.owner = network, number, router, name, owner
        self.declared: dict[_Declared, None] = {}
        self.closed = False
        self.gone = False
        """Whether others know that it is closed."""
        self.attached = True
        """Whether its router is there, and it has noticed."""
        self._context = copy_context()
        self.events: Callable[[Any], Any] | None = None

    def hand(self, callback: Callable[..., Any], *items: Any) -> None:
        """Call back the process of this session: what it begins then is its own, and ends with it."""
        self._context.copy().run(callback, *items)

    # --- what commd.bus calls ---

    def declare_keyexpr(self, key: str) -> str:
        """Return the key: here a declared one costs the same."""
        return key

    def put(self, key: Any, payload: Any, *, encoding: Any = None, remote_only: bool = False, **_: Any) -> None:
        """Publish."""
        self._check()
        name = checked(str(key))
        sample = Sample(name, Payload(payload), str(encoding or "zenoh/bytes"))
        self.network.publish(self, sample, remote_only)

    def declare_subscriber(self, key: Any, callback: Any, *, allowed_origin: Any = None) -> _Declared:
        """Subscribe."""
        return self._declare("subscriber", key, callback, allowed_origin)

    def declare_queryable(self, key: Any, callback: Any, *, allowed_origin: Any = None, **_: Any) -> _Declared:
        """Serve queries."""
        return self._declare("queryable", key, callback, allowed_origin)

    def declare_publisher(self, key: Any, *, allowed_destination: Any = None, **_: Any) -> _Declared:
        """Declare a publisher."""
        return self._declare("publisher", key, None, allowed_destination)

    def declare_querier(self, key: Any, *, allowed_destination: Any = None, **_: Any) -> _Declared:
        """Declare a querier."""
        return self._declare("querier", key, None, allowed_destination)

    def get(
        self,
        selector: Any,
        callback: Any,
        *,
        timeout: float = 10.0,
        payload: Any = None,
        encoding: Any = None,
        allowed_destination: Any = None,
        **_: Any,
    ) -> None:
        """Query."""
        self._check()
        key, _mark, parameters = str(selector).partition("?")
        checked(key)
        asked = _Asked(self, callback.callback, callback.drop or (lambda: None), timeout)
        remote = allowed_destination == zenoh.Locality.REMOTE
        self.network.ask(self, key, parameters, payload, encoding, asked, remote)

    def liveliness(self) -> Liveliness:
        """Return the liveliness of this session."""
        return Liveliness(self)

    @property
    def info(self) -> Info:
        """What is known of this session."""
        return Info(self)

    def close(self) -> None:
        """End it: tokens and queries end with it."""
        self.network.close(self)

    def withdraw(self, declared: _Declared) -> None:
        """End a declaration."""
        if declared in self.declared:
            del self.declared[declared]
            self.network.withdrawn(declared)

    def _declare(self, kind: str, key: Any, callback: Any, where: Any = None) -> _Declared:
        self._check()
        call = callback.callback if callback is not None else None
        declared = _Declared(self, kind, checked(str(key)), call, where == zenoh.Locality.REMOTE)
        self.declared[declared] = None
        self.network.declared(declared)
        return declared

    def _check(self) -> None:
        if self.closed:
            raise zenoh.ZError("session closed")


class Liveliness:
    """Tokens."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def declare_token(self, key: Any) -> _Declared:
        """Declare a token."""
        return self._session._declare("token", key, None)

    def declare_subscriber(self, key: Any, callback: Any, *, history: bool = False) -> _Declared:
        """Hear of tokens that appear and end, the present ones first."""
        assert history
        return self._session._declare("watcher", key, callback)

    def get(self, key: Any, callback: Any, *, timeout: float = 10.0) -> None:
        """Query the tokens that match."""
        network, session = self._session.network, self._session
        found = [token.key_expr for token in network.tokens(session, str(key))]

        def answer() -> None:
            for one in found:
                session.hand(callback.callback, Reply(Sample(one, Payload(b""))))
            if callback.drop is not None:
                session.hand(callback.drop)

        network.loop.call_later(2 * HOP, answer)


class Info:
    """The result of `Session.info`."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def zid(self) -> str:
        """Return the id of the session."""
        return f"{self._session.number:032x}"

    def routers_zid(self) -> list[str]:
        """Return the ids of the routers."""
        router = self._session.network.router_of(self._session)
        return [] if router is None or router is self._session else [router.info.zid()]

    def links(self) -> list[Any]:
        """Return none: nobody looks at links in a trial."""
        return []

    def declare_transport_events_listener(self, callback: Any, *, history: bool = False) -> None:
        """Hear of the router that is connected or lost."""
        session = self._session
        session.events = callback.callback
        router = session.network.router_of(session)
        if history and router is not None:
            session.network._tell(session, PUT, router)

    def declare_link_events_listener(self, callback: Any, *, history: bool = False) -> None:
        """Hear nothing: nobody looks at links in a trial."""


class Network:
    """All sessions of a trial."""

    def __init__(self, loop: VirtualLoop) -> None:
        self.loop = loop
        self.sessions: list[Session] = []
        self.numbers = count(1)
        self.asked: dict[_Asked, None] = {}
        """Queries that have not ended."""
        self.left: list[object] = []
        """What killed processes leave: kept to the end, as a task that is freed runs what it has to do finally."""
        self.sent = 0
        """Messages between sessions."""
        self._cuts: dict[tuple[str, str], tuple[float, float]] = {}
        """Since when and until when nothing passes from one router's endpoint to another's."""
        self.noise: dict[tuple[str, str], tuple[float, float]] = {}
        """Until when messages from one router's endpoint to another's need longer, and by how much on average."""
        self.dice = random.Random(0)
        self.on_put: list[Callable[[Session, Sample], None]] = []
        """Called with each sample that is published."""
        self.on_query: list[Callable[[Query, Sample], None]] = []
        """Called with each reply that is sent, and the query that it answers."""
        self._routers: dict[str, Session] = {}
        self._last: dict[tuple[int, int], float] = {}
        """When the last message between two sessions arrives."""
        self._tables: defaultdict[str, _Table] = defaultdict(_Table)
        """The declarations, by kind."""
        self._seen: dict[_Declared, set[str]] = {}
        """The tokens that each watcher has been shown."""

    def open(self, endpoint: str, name: str, router: bool, owner: object) -> Session:
        """Open a session at the router of an endpoint. Raises ZError if a client finds none there."""
        if router == (endpoint in self._routers):
            raise zenoh.ZError("another router is there" if router else "no router is there")
        session = Session(self, next(self.numbers), endpoint, name, owner)
        if router:
            for silent in [one for one in self.sessions if one.closed and one.router == endpoint]:
                self._bury(silent)
        self.sessions.append(session)
        if router:
            self._routers[endpoint] = session
            for client in self._clients(endpoint):  # those of its predecessor come back
                self.loop.call_later(AGAIN, self._back, client, session)
            self.topology_changed()
        return session

    def router_of(self, session: Session) -> Session | None:
        """Return the router at which a session is."""
        return self._routers.get(session.router)

    def close(self, *sessions: Session, lease: float = 0.0) -> None:
        """End sessions and all that they have declared; other boards notice after `lease` virtual seconds."""

        def notice(session: Session) -> None:
            self._bury(session)
            self.topology_changed()

        closing = [one for one in sessions if not one.closed]
        for one in closing:
            one.closed = True
            if lease:
                self.loop.call_later(lease, notice, one, context=WIRE)
            else:
                self._bury(one)
        for one in closing:
            if self._routers.get(one.router) is one:
                del self._routers[one.router]
                for client in self._clients(one.router):
                    client.attached = False
                    self._tell(client, DELETE, one)
        if closing:
            self.topology_changed()

    def _bury(self, session: Session) -> None:
        """Let everybody know that a session is closed."""
        if not session.gone:
            session.gone = True
            self.sessions.remove(session)
            for declared in session.declared:
                self._seen.pop(declared, None)
                self._tables[declared.kind].remove(declared)
            session.declared.clear()

    def _clients(self, endpoint: str) -> list[Session]:
        router = self._routers.get(endpoint)
        return [one for one in self.sessions if one.router == endpoint and one is not router and not one.closed]

    def _back(self, client: Session, router: Session) -> None:
        if not client.closed and not router.closed and not client.attached:
            client.attached = True
            self._tell(client, PUT, router)
            self.topology_changed()

    def _tell(self, client: Session, kind: Any, router: Session) -> None:
        if client.events is not None:
            client.hand(client.events, _Event(kind, _Transport(router.info.zid())))

    def cut(self, lines: Collection[tuple[str, str]], seconds: float) -> None:
        """Let nothing pass on these lines, each from one router's endpoint to another's, for virtual seconds."""
        now = self.loop.time()
        for line in lines:
            since, until = self._cuts.get(line, (now, now))
            self._cuts[line] = (since, max(until, now + seconds)) if until >= now else (now, now + seconds)
            for change in (self._cuts[line][0] + LEASE, self._cuts[line][1]):
                self.loop.call_at(max(now, change), self.topology_changed, context=WIRE)

    def _linked(self, one: str, other: str) -> bool:
        """Return whether two routers have a link: whether it is cut or not, until one has heard nothing for a lease."""
        now = self.loop.time()
        cuts = (self._cuts.get((one, other)), self._cuts.get((other, one)))
        return not any(cut is not None and cut[0] + LEASE <= now < cut[1] for cut in cuts)

    def _passes(self, sender: str, receiver: str) -> float | None:
        """Return the virtual seconds from one router to another now; None: it is lost."""
        now = self.loop.time()
        since, until = self._cuts.get((sender, receiver), (0.0, 0.0))
        noisy, mean = self.noise.get((sender, receiver), (0.0, 0.0))
        needs = LINK + (self.dice.expovariate(1 / mean) if now < noisy and mean > 0 else 0.0)
        if now >= until:
            return needs
        return until - now + needs if until - since < LEASE else None

    def reaches(self, sender: Session, receiver: Session) -> bool:
        """Return whether what one session has declared is known to the other."""
        if sender is receiver:
            return True
        if sender.gone or receiver.gone or not (sender.attached and receiver.attached):
            return False
        if sender.router == receiver.router:
            return not (sender.closed or receiver.closed)
        return self._linked(sender.router, receiver.router)

    def latency(self, sender: Session, receiver: Session) -> float | None:
        """Return the virtual seconds of a message; None: the one does not reach the other."""
        if sender is receiver:
            return 0.0
        if not self.reaches(sender, receiver):
            return None
        if sender.router == receiver.router:
            return HOP
        between = self._passes(sender.router, receiver.router)
        return None if between is None else HOP + between

    def send(self, sender: Session, receiver: Session, deliver: Callable[[], object]) -> None:
        """Deliver something after its delay, behind what was sent before it on the same way."""
        delay = self.latency(sender, receiver)
        if delay is None:
            return
        due = self.last_arrival(sender, receiver, delay)
        self._last[sender.number, receiver.number] = due
        self.sent += 1
        self.loop.call_at(due, self._arrive, sender, receiver, deliver, context=WIRE)

    def last_arrival(self, sender: Session, receiver: Session, delay: float) -> float:
        """Return when what is sent now arrives: not before what was sent earlier."""
        return max(self.loop.time() + delay, self._last.get((sender.number, receiver.number), 0.0))

    def _arrive(self, sender: Session, receiver: Session, deliver: Callable[[], object]) -> None:
        if not receiver.closed and (receiver.attached or receiver is sender):
            deliver()

    def _matching(self, sender: Session, kind: str, key: str, remote_only: bool) -> list[_Declared]:
        """Return what others have declared for a key, and reaches or is reached by a session."""
        return [
            one
            for one in self._tables[kind].matching(key)
            if self.reaches(sender, one.session) and not (one.session is sender and (remote_only or one.remote_only))
        ]

    def publish(self, sender: Session, sample: Sample, remote_only: bool) -> None:
        """Send a sample to all subscribers."""
        for listener in self.on_put:
            listener(sender, sample)
        for one in self._matching(sender, "subscriber", sample.key_expr, remote_only):
            self.send(sender, one.session, partial(one.take, sample))

    def ask(
        self, asker: Session, key: str, parameters: str, payload: Any, encoding: Any, asked: _Asked, remote_only: bool
    ) -> None:
        """Send a query to all that serve its key; it ends when they have answered."""
        if key.startswith("@/"):  # the admin space of the router, which answers that it is there
            if asker.attached:
                self.loop.call_later(2 * HOP, asked.replied, Reply(Sample(key, Payload(b"{}"))))
                self.loop.call_later(2 * HOP, asked.end)
            return
        served = self._matching(asker, "queryable", key, remote_only)
        asked.open = {number: one.session for number, one in enumerate(served)}
        self.asked[asked] = None
        if not served:
            self.loop.call_later(2 * HOP, asked.end)
        for number, one in enumerate(served):
            query = Query(key, parameters, payload, encoding, one.session, asked, number)
            self.send(asker, one.session, partial(one.take, query))

    def tokens(self, session: Session, key: str) -> list[_Declared]:
        """Return the tokens that a session finds."""
        return self._matching(session, "token", key, False)

    def somebody(self, declared: _Declared, kind: str) -> bool:
        """Return whether others have declared something for the key of a declaration."""
        return bool(self._matching(declared.session, kind, declared.key_expr, declared.remote_only))

    def declared(self, declared: _Declared) -> None:
        """Note a declaration that has begun."""
        self._tables[declared.kind].add(declared)
        if declared.kind == "watcher":
            self._show_tokens(declared)
        else:
            self._tell_of(declared)

    def withdrawn(self, declared: _Declared) -> None:
        """Note a declaration that has ended."""
        self._tables[declared.kind].remove(declared)
        self._seen.pop(declared, None)
        self._tell_of(declared)

    def _tell_of(self, declared: _Declared) -> None:
        """Tell watchers of a token, publishers of a subscriber and queriers of a queryable that has begun or ended."""
        match declared.kind:
            case "token":
                for watcher in self._tables["watcher"].matching(declared.key_expr):
                    self._show_tokens(watcher)
            case "subscriber" | "queryable" as kind:
                askers = "publisher" if kind == "subscriber" else "querier"
                for one in self._tables[askers].matching(declared.key_expr):
                    if one.matched is not None:
                        self.loop.call_later(HOP, one.tell_matching, context=WIRE)

    def topology_changed(self) -> None:
        """Tell watchers which tokens, and publishers whether subscribers, have appeared or ended; end queries."""
        for asked in self.asked:
            asked.topology_changed()
        for session in self.sessions:
            for declared in () if session.closed else session.declared:
                if declared.kind == "watcher":
                    self._show_tokens(declared)
                elif declared.matched is not None:
                    self.loop.call_later(HOP, declared.tell_matching, context=WIRE)

    def _show_tokens(self, watcher: _Declared) -> None:
        found = self.tokens(watcher.session, watcher.key_expr)
        if not watcher.session.attached:
            found = []  # Zenoh reports even those of the session itself as ended
        present = {token.key_expr: token for token in found}
        seen = self._seen.setdefault(watcher, set())
        for key in sorted(seen - present.keys()):
            self._show(watcher, key, DELETE, HOP)
        for key, token in present.items():
            if key not in seen:
                self._show(watcher, key, PUT, self.latency(token.session, watcher.session) or 0.0)
        self._seen[watcher] = set(present)

    def _show(self, watcher: _Declared, key: str, kind: Any, delay: float) -> None:
        self.loop.call_later(delay, watcher.take, Sample(key, Payload(b""), kind=kind), context=WIRE)
