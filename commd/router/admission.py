"""Admission control in front of a router's TLS listener: who may begin a handshake, and which session may stay.

Zenoh's listener stops for 0.1 s after each handshake that fails, whoever failed it: 100 dead connections keep everybody
out for 10 s. So other machines connect here, and what they send is passed on, unread, to a listener of the router on
loopback:

- A connection is passed on when its ClientHello is complete. Until then it costs the router nothing, and when too many
  wait, the oldest of the address that has the most goes: who means to come in says hello at once.
- Each address has an allowance of handshakes. One that becomes a session is given back, one that fails is not.
- Addresses of the mission's boards, and those from which a session came, have listeners that strangers cannot delay, so
  many that an attacker at such an address (the operator's own machine, or one behind the same NAT) does not block them
  all. What such addresses fail beyond their allowance comes from one that they share.
- A session that carries the Zenoh id of another machine (`commd.bus.session.session_id`) is cut off: ids are public,
  and a router refuses the second of two with the same one.
- One certificate has at most `MOST_SESSIONS`, and a person who takes nothing for `STALLED` seconds while something
  waits for him loses his session, an observer for `BARRED` seconds: the router waits for each such session in turn, and
  whoever answers it is not served meanwhile.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import re
import resource
import socket
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from ipaddress import IPv6Address, IPv6Network
from threading import Thread
from typing import Any

from commd.bus.bus import LOOK_UP_PATIENCE, Bus
from commd.bus.errors import BusClosed
from commd.bus.session import owner_of
from commd.router import tls_rejections
from schemas.files.units import host_and_port
from schemas.mission.model import DEFAULT_PORT, Mission
from schemas.wire.records import Health, Note

HELLO = 5.0
"""Wall seconds that a connection has to say its ClientHello; on a bad radio it is sent more than once."""
HANDSHAKE = 10.0
"""Wall seconds from there until the router has a session, as Zenoh has it."""
UNHEARD = 512
"""Connections that may wait for their ClientHello at once."""
ALLOWANCE, REFILL = 10.0, 2.0
"""Failed handshakes that an address may have at once, and how many more each second."""
KNOWN_ALLOWANCE, KNOWN_REFILL = 100.0, 100.0
"""The same for all known addresses together, beyond what each has."""
KNOWN_LISTENERS = 16
"""Listeners for known addresses. Each takes 10 failing handshakes a second: more than are let through."""
AT_ONCE = 48
"""Handshakes under way at one listener: Zenoh takes 100."""
MOST_SESSIONS = 64
"""Of one certificate."""
STALLED = 0.5
"""Wall seconds for which a person's machine may take nothing although something waits for it: less than a lease."""
BARRED = 10.0
"""Wall seconds for which an observer that did not read gets no new session, and an address from which another machine's
id came no share of what known addresses have together."""
LEAVING = 2.0
"""Wall seconds that the last bytes of a connection have to be taken."""
WAITING = 262_144
"""Bytes of a session that wait here at most; then the router's own queue fills, and drops."""
BACKLOG = 4096
"""Connections that the kernel keeps until they are taken; its own bound is `net.core.somaxconn`."""
ADDRESSES = 4096
"""Addresses that are remembered."""
LOOK = 0.25
"""Wall seconds between two looks for what has taken too long."""
BIND_AGAIN = 1.0
"""Wall seconds until it is tried again to listen at an address that this machine does not have yet."""
REMEMBERED = 600.0
"""Wall seconds for which health tells of a forged id."""
FILES = 8192
"""Descriptors: three for each session of another machine."""
FORGED = "session_id_forged"
"""Code of the note about a session that carried another machine's id."""
_RECORD, _HANDSHAKE, _CLIENT_HELLO, _LONGEST = 5, 22, 1, 16_384
"""TLS (RFC 8446, 5.1): bytes of a record's head, its type, the message in it, and bytes of a record at most."""
_TRY_LATER = bytes((21, 3, 3, 0, 2, 2, 80))
"""A TLS alert, internal_error: `commd.bus.connect_diagnosis` knows what it means here."""
_TLS = re.compile(r"tls/(.+)")
log = logging.getLogger("admission")


class _Allowance:
    """How many handshakes may fail now: a token bucket, full at first."""

    def __init__(self, most: float, refill: float) -> None:
        """`refill`: each second."""
        self.most, self.refill, self.left = most, refill, most
        self.at = time.monotonic()
        """When it was reckoned."""

    def now(self, at: float) -> float:
        """Return the allowance after its refill."""
        self.left, self.at = min(self.most, self.left + self.refill * (at - self.at)), at
        return self.left

    def give_back(self) -> None:
        """Return what was taken for a handshake that did not fail."""
        self.left = min(self.most, self.left + 1.0)


class _Source(_Allowance):
    """What is known of an address."""

    def __init__(self) -> None:
        super().__init__(ALLOWANCE, REFILL)
        self.unheard: deque[_Connection] = deque()
        self.forged_at = -BARRED
        """When a session from there carried another machine's id, monotonic seconds."""


class _End(asyncio.Protocol):
    """One end of a connection: the other machine's, or the router's."""

    transport: asyncio.Transport
    other: _End | None = None

    def __init__(self, connection: _Connection) -> None:
        self._connection = connection
        self.took_at = 0.0
        """When it was last seen to take something, or to have nothing to take."""
        self.left = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        transport.set_write_buffer_limits(WAITING)
        self._connection.made(self)

    def data_received(self, data: bytes) -> None:
        if self.other is not None:
            self.other.transport.write(data)
        else:
            self._connection.heard(data)

    def pause_writing(self) -> None:
        if self.other is not None:
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        if self.other is not None:
            self.other.transport.resume_reading()

    def connection_lost(self, error: Exception | None) -> None:
        self._connection.lost()


class _Connection:
    """A connection from another machine, and the way from there to the router."""

    def __init__(self, admission: Admission) -> None:
        self._admission = admission
        self.outside, self.inside = _End(self), _End(self)
        self.address = ""
        self.since = time.monotonic()
        self.hello = b""
        self.port = 0
        """Our port on the way to the router, by which it names the link; 0 = not passed on."""
        self.listener: _Listener | None = None
        """That of the handshake under way."""
        self.allowance: _Allowance | None = None
        """From which that was taken."""
        self.name: str | None = None
        """Whose certificate it showed; None = the router has no session of it (yet)."""
        self.ended = False

    def made(self, end: _End) -> None:
        if end is self.outside:
            self.address = _counted_as(end.transport.get_extra_info("peername"))
            self._admission.came(self)

    def heard(self, data: bytes) -> None:
        """Gather the ClientHello."""
        self.hello += data
        head = self.hello[: _RECORD + 1]
        if head[:1] != bytes((_HANDSHAKE,)) or (len(head) > _RECORD and head[_RECORD] != _CLIENT_HELLO):
            return self._admission.refuse(self, "it speaks no TLS")
        length = int.from_bytes(head[3:5], "big") if len(head) >= _RECORD else 0
        if length > _LONGEST:
            return self._admission.refuse(self, "it speaks no TLS")
        if len(head) > _RECORD and len(self.hello) >= _RECORD + length:
            self.outside.transport.pause_reading()
            self._admission.said_hello(self)
        return None

    async def pass_on(self, listener: _Listener) -> None:
        """Connect to the router, and from now on pass on what either says."""
        loop = asyncio.get_running_loop()
        try:
            await loop.create_connection(lambda: self.inside, listener.host, listener.port)
        except OSError as error:
            log.warning("the router does not listen at %s:%d: %s", listener.host, listener.port, error.strerror)
            self.end()
            return
        if self.ended:
            self.inside.transport.abort()
            return
        self.port = self.inside.transport.get_extra_info("sockname")[1]
        self._admission.passed_on(self)
        self.inside.other, self.outside.other = self.outside, self.inside
        self.inside.transport.write(self.hello)
        self.hello = b""
        self.outside.transport.resume_reading()

    def lost(self) -> None:
        """One end is closed: the other takes what waits for it, and is closed too."""
        if not self.ended:
            self.end()

    def end(self, last: bytes = b"") -> None:
        """Close both ends; the other machine may still take what waits for it, and `last`."""
        self.ended, self.since = True, time.monotonic()
        if last:
            self.outside.transport.write(last)
        for end in (self.outside, self.inside):
            if hasattr(end, "transport"):
                end.transport.close()
        self._admission.ended(self)

    def cut(self) -> None:
        """Close both ends at once."""
        if not self.ended:
            self.end()
        for end in (self.outside, self.inside):
            if hasattr(end, "transport"):
                end.transport.abort()

    @property
    def gone(self) -> bool:
        """Whether nothing is left of it."""
        transport = self.outside.transport
        return self.ended and transport.is_closing() and not transport.get_write_buffer_size()

    def stalls_for(self, now: float) -> float:
        """Return for how many seconds the other machine has taken nothing although something waits for it."""
        end = self.outside
        left = end.transport.get_write_buffer_size()
        if not left or left != end.left:
            end.left, end.took_at = left, now
        return now - end.took_at


@dataclass
class _Listener:
    """A listener of the router on loopback."""

    host: str
    port: int
    under_way: int = 0
    """Handshakes."""
    failed_at: float = 0.0
    """When one failed last, monotonic seconds: it stands still for a moment then."""


class Admission:
    """The listeners for other machines, on an event loop of their own: mail and minds are not to delay them."""

    def __init__(self, public: Sequence[str], mission: Mission) -> None:
        """Find room for the router's own listeners; `public`: where other machines connect, `tls/HOST:PORT`."""
        self._public = tuple(public)
        hosts = (
            host_and_port(one.address, DEFAULT_PORT)[0].strip("[]") for one in mission.boards.values() if one.address
        )
        self._known = {_counted_as((host, 0)) for host in hosts}
        """Addresses that strangers do not delay; of a board that is known by name, once it was here."""
        self._names = frozenset((*mission.board_names, *mission.security.operators, *mission.security.observers))
        self._people = frozenset((*mission.security.operators, *mission.security.observers))
        self._barred = dict.fromkeys(mission.security.observers, -BARRED)
        """Observers, and when they last did not read."""
        self._for_known, self._for_strangers = [_free() for _ in range(KNOWN_LISTENERS)], [_free()]
        self.inner = tuple(f"tls/{one.host}:{one.port}" for one in (*self._for_known, *self._for_strangers))
        """Where the router is to listen instead."""
        self._of_known = _Allowance(KNOWN_ALLOWANCE, KNOWN_REFILL)
        self._sources: dict[str, _Source] = {}
        self._unheard = 0
        self._passed: dict[int, _Connection] = {}
        self._sessions: Counter[str] = Counter()
        self._all: set[_Connection] = set()
        self.counters: Counter[str] = Counter()
        self._forged: dict[str, tuple[float, Note]] = {}
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._thread = Thread(target=self._run, name="admission", daemon=True)

    # from other threads

    async def begin(self) -> None:
        """Begin to listen, as far as this machine has the addresses. Raises BusClosed if another program is there."""
        raise_file_limit()
        bound = {endpoint: await _bound_soon(endpoint) for endpoint in self._public}
        self._thread.start()
        for endpoint, listening in bound.items():
            self._soon(self._listen(endpoint, listening))
        self._soon(self._watch())

    def close(self) -> None:
        """Close all connections and end."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(LEAVING)

    def linked(self, zid: str, place: str, name: str, up: bool) -> None:
        """Take from Zenoh that it has a link, or has it no longer: the other end's id, our end of it, its name."""
        port = place.rpartition(":")[2]
        if up and port.isdecimal() and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._session, int(port), zid, name)

    def health(self) -> Health:
        """Tell how many were kept out or cut off, and of forged ids."""
        now = time.monotonic()
        notes = tuple(note for at, note in list(self._forged.values()) if now - at < REMEMBERED)
        return Health(notes=notes, counters={name: float(count) for name, count in dict(self.counters).items()})

    # on the loop of its own

    def came(self, connection: _Connection) -> None:
        """Let a connection wait for its ClientHello, in the place of an older one if there is no more room."""
        self._all.add(connection)
        source = self._source(connection.address)
        source.unheard.append(connection)
        self._unheard += 1
        if self._unheard > UNHEARD:
            most = max(self._sources.values(), key=lambda one: len(one.unheard))
            self.counters["unheard"] += 1
            most.unheard[0].cut()

    def said_hello(self, connection: _Connection) -> None:
        """Pass a connection on to the router, if its address may have one more handshake."""
        self._forget(connection)
        now, source = time.monotonic(), self._source(connection.address)
        known = connection.address in self._known
        listeners = self._for_known if known else self._for_strangers
        listener = min(listeners, key=lambda one: (one.under_way, one.failed_at))
        shares = source.now(now) < 1.0 and known and now - source.forged_at >= BARRED
        allowance = self._of_known if shares else source
        if allowance.now(now) < 1.0:
            return self.refuse(connection, "too many handshakes with its address failed", _TRY_LATER)
        if listener.under_way >= AT_ONCE:
            return self.refuse(connection, "too many handshakes are under way", _TRY_LATER)
        allowance.left -= 1.0
        listener.under_way += 1
        connection.listener, connection.allowance, connection.since = listener, allowance, now
        self._spawn(connection.pass_on(listener))
        return None

    def passed_on(self, connection: _Connection) -> None:
        """Await the router's word on a connection."""
        self._passed[connection.port] = connection

    def refuse(self, connection: _Connection, why: str, last: bytes = b"") -> None:
        """Close a connection that the router does not hear of, and tell."""
        tls_rejections.tell(why, connection.address)
        self._forget(connection)
        connection.end(last)

    def ended(self, connection: _Connection) -> None:
        """Forget a connection, but for what it still has to take."""
        self._forget(connection)
        self._passed.pop(connection.port, None)
        if connection.listener is not None:
            connection.listener.failed_at = time.monotonic()
        self._settle(connection)
        if connection.name is not None:
            self._sessions[connection.name] -= 1

    def _session(self, port: int, zid: str, name: str) -> None:
        """Judge a session that the router has now."""
        connection = self._passed.get(port)
        if connection is None or connection.name is not None or connection.ended:
            return
        self._settle(connection)
        connection.name = name
        self._sessions[name] += 1
        if connection.allowance is not None:
            connection.allowance.give_back()
        owner = owner_of(zid, self._names)
        if owner is not None and owner != name:
            self._tell_forged(name, owner, connection.address)
            source = self._source(connection.address)
            source.left, source.forged_at = 0.0, time.monotonic()
            connection.cut()
            return
        if len(self._known) < ADDRESSES:
            self._known.add(connection.address)
        if self._sessions[name] > MOST_SESSIONS:
            tls_rejections.tell(f"`{name}` has {MOST_SESSIONS} sessions already", connection.address)
            connection.cut()
            return
        if time.monotonic() - self._barred.get(name, -BARRED) < BARRED:
            tls_rejections.tell(
                f"`{name}` did not read what it asked for within the last {BARRED:g} s", connection.address
            )
            connection.cut()

    def _tell_forged(self, name: str, owner: str, address: str) -> None:
        whose = f"of `{owner}`" if owner else "of this board's daemons"
        text = f"`{name}` at {address} came with the session id {whose}, and was cut off: revoke its keys if it goes on"
        self.counters[FORGED] += 1
        about = f"{name} {address} {owner or 'board'}"
        if about not in self._forged or time.monotonic() - self._forged[about][0] >= tls_rejections.TELL:
            log.error("security event=%s certificate=%s id_of=%s address=%s", FORGED, name, owner or "board", address)
        if len(self._forged) >= tls_rejections.REASONS:
            self._forged.clear()
        self._forged[about] = time.monotonic(), Note(FORGED, text, about)

    def _settle(self, connection: _Connection) -> None:
        """Its handshake is over."""
        if connection.listener is not None:
            connection.listener.under_way -= 1
            connection.listener = None

    def _forget(self, connection: _Connection) -> None:
        """It does not wait for its ClientHello any more."""
        source = self._sources.get(connection.address)
        if source is not None and connection in source.unheard:
            source.unheard.remove(connection)
            self._unheard -= 1

    def _source(self, address: str) -> _Source:
        now = time.monotonic()
        if (found := self._sources.get(address)) is None:
            if len(self._sources) >= ADDRESSES:  # those with all of their allowance are as good as new
                idle = [
                    name
                    for name, one in self._sources.items()
                    if not one.unheard and one.now(now) >= ALLOWANCE and now - one.forged_at >= BARRED
                ]
                for name in idle or [next(name for name, one in self._sources.items() if not one.unheard)]:
                    del self._sources[name]
            found = self._sources[address] = _Source()
        return found

    async def _watch(self) -> None:
        """End what has taken too long, for ever."""
        while True:
            await asyncio.sleep(LOOK)
            now = time.monotonic()
            for connection in list(self._all):
                if connection.gone:
                    self._all.discard(connection)
                elif connection.ended:
                    if now - connection.since > LEAVING:
                        connection.cut()
                elif connection.listener is not None:
                    if now - connection.since > HANDSHAKE:
                        tls_rejections.tell("it did not end its handshake", connection.address)
                        connection.cut()
                elif connection.name is None:
                    if now - connection.since > HELLO:
                        self.counters["unheard"] += 1
                        connection.cut()
                elif connection.name in self._people and connection.stalls_for(now) > STALLED:
                    self._tell_stalled(connection)
                    connection.cut()

    def _tell_stalled(self, connection: _Connection) -> None:
        self.counters["stalled"] += 1
        if connection.name in self._barred:
            self._barred[connection.name] = time.monotonic()
        tls_rejections.tell(
            f"`{connection.name}` does not read what it asked for, and loses its session", connection.address
        )

    async def _listen(self, endpoint: str, bound: socket.socket | None) -> None:
        if bound is None:
            log.warning("%s is no address of this machine yet: no other board reaches this one until it is", endpoint)
        while bound is None:
            await asyncio.sleep(BIND_AGAIN)
            with suppress(BusClosed):
                bound = await _bound_soon(endpoint)
        # 64: so many are taken before sessions have their turn again
        await self._loop.create_server(lambda: _Connection(self).outside, sock=bound, backlog=64)
        bound.listen(BACKLOG)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
        finally:
            for connection in list(self._all):
                connection.cut()
            for task in self._tasks:
                task.cancel()
            self._loop.run_until_complete(asyncio.sleep(0))
            self._loop.close()

    def _soon(self, work: Coroutine[Any, Any, None]) -> None:
        self._loop.call_soon_threadsafe(self._spawn, work)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


@asynccontextmanager
async def open_admission(admission: Admission, bus: Bus) -> AsyncIterator[Admission]:
    """Let other machines in until the end; `bus` is the router's session."""
    bus.on_link(admission.linked)
    await admission.begin()
    try:
        yield admission
    finally:
        await asyncio.to_thread(admission.close)


def raise_file_limit() -> None:
    """Take as many descriptors as the sessions of other machines may need and this process may have."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = FILES if hard == resource.RLIM_INFINITY else min(FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(OSError, ValueError):  # a unit may forbid it, and has a limit of its own
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def _counted_as(peer: tuple[str, int] | None) -> str:
    """Return the address that counts for a connection: of IPv6 its network, as one machine has all of a /64."""
    if peer is None:  # it has gone already
        return "?"
    if ":" not in peer[0]:
        return peer[0]
    address = IPv6Address(peer[0].partition("%")[0])
    mapped = address.ipv4_mapped
    return str(mapped) if mapped is not None else str(IPv6Network((int(address), 64), strict=False))


def _free() -> _Listener:
    """Find a place on loopback: in all of 127/8, so that nobody else is there by accident."""
    while True:
        host = "127.{}.{}.{}".format(*(1 + byte % 254 for byte in os.urandom(3)))
        with socket.socket() as probe:
            probe.bind((host, 0))
            return _Listener(host, probe.getsockname()[1])


async def _bound_soon(endpoint: str) -> socket.socket | None:
    """Return what `_bound` does; None, too, if the name service does not answer."""
    try:
        return await asyncio.wait_for(asyncio.to_thread(_bound, endpoint), LOOK_UP_PATIENCE)
    except TimeoutError:
        return None


def _bound(endpoint: str) -> socket.socket | None:
    """Return a socket bound to an endpoint; None if this machine does not have the address, or not yet.

    Raises BusClosed if another program listens there.
    """
    found = _TLS.fullmatch(endpoint)
    assert found is not None
    host, port = host_and_port(found[1])
    made: socket.socket | None = None
    try:
        family, kind, _, _, address = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_STREAM)[0]
        made = socket.socket(family, kind)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
        made.listen(BACKLOG)
        made.setblocking(False)
    except socket.gaierror:
        return None
    except OSError as error:
        if made is not None:
            made.close()
        if error.errno == errno.EADDRNOTAVAIL:
            return None
        raise BusClosed(f"cannot listen at {endpoint}: {error.strerror}: is another router running there?") from None
    return made
