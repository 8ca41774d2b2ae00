"""Admission control in front of a router's TLS listener: which connections may begin a handshake, which sessions stay.

Zenoh's listener stops for 0.1 s after each failed handshake: 100 dead connections block everybody for 10 s. So other
machines connect here, and their bytes are passed on to a listener of the router on loopback (`commd.router.relay`):

- A connection is passed on when its ClientHello is complete. If too many wait for theirs, the oldest one of the address
  with the most is closed.
- Each address has an allowance of handshakes. A successful handshake is given back, a failed one is not.
- Addresses of the mission's boards, and those of earlier sessions, have listeners that strangers cannot delay. There
  are enough of them that an attacker at such an address (the operator's own machine, or one behind the same NAT) cannot
  block all. Handshakes beyond the allowance of such an address are taken from one that they share.
- A session with the Zenoh id of another machine (`commd.bus.session.session_id`) is disconnected: ids are public, and a
  router refuses the second of two sessions with one id.
- One certificate has at most `MOST_SESSIONS`. A person's session that takes nothing for `STALLED` seconds although
  something waits is closed, and an observer is refused for `BARRED` seconds: the router waits for each such session in
  turn, and whoever replies to it is not served meanwhile.
"""

from __future__ import annotations

import asyncio
import logging
import resource
import socket
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from threading import Thread
from typing import Any

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.bus.session import owner_of
from commd.router import tls_rejections
from commd.router.relay import BACKLOG, Connection, bound_socket, counted_as, free_listener
from schemas.mission.model import Mission
from schemas.wire.records import Health, Note

HELLO = 5.0
"""Wall seconds for the ClientHello of a connection, which a bad radio repeats."""
HANDSHAKE = 10.0
"""Wall seconds from there to the session, as in Zenoh."""
UNHEARD = 512
"""Connections that may wait for their ClientHello."""
ALLOWANCE, REFILL = 10.0, 2.0
"""Failed handshakes of an address: in a burst, and more per second."""
KNOWN_ALLOWANCE, KNOWN_REFILL = 100.0, 100.0
"""The same for all known addresses together, beyond their own allowances."""
KNOWN_LISTENERS = 16
"""Listeners for known addresses. Together they take 160 failing handshakes a second, more than are admitted."""
AT_ONCE = 48
"""Handshakes under way at one listener; Zenoh's own limit is 100."""
MOST_SESSIONS = 64
"""Of one certificate."""
STALLED = 0.5
"""Wall seconds for which a person's machine may take nothing although something waits: less than a lease."""
BARRED = 10.0
"""Wall seconds for which an observer that did not read is refused, and for which an address that sent another machine's
id has no share of the allowance of known addresses."""
LEAVING = 2.0
"""Wall seconds for the last bytes of a connection."""
ADDRESSES = 4096
"""Addresses that are remembered."""
LOOK = 0.25
"""Wall seconds between two checks of timeouts."""
BIND_AGAIN = 1.0
"""Wall seconds between two attempts to listen at an address that this machine does not have yet."""
REMEMBERED = 600.0
"""Wall seconds for which health has a note of a forged id."""
FILES = 8192
"""File descriptors: three for each session of another machine."""
FORGED = "session_id_forged"
"""Code of the note about a session that carried another machine's id."""
_TRY_LATER = bytes((21, 3, 3, 0, 2, 2, 80))
"""A TLS alert, internal_error, which `commd.bus.connect_diagnosis` explains."""
log = logging.getLogger("admission")


class Allowance:
    """A token bucket of failed handshakes, full at first."""

    def __init__(self, most: float, refill: float) -> None:
        """`most`: tokens at most, and at first; `refill`: tokens per second."""
        self.most, self.refill, self.left = most, refill, most
        self.at = time.monotonic()
        """When `left` was computed, monotonic seconds."""

    def now(self, at: float) -> float:
        """Refill up to a time in wall seconds, and return the rest."""
        self.left, self.at = min(self.most, self.left + self.refill * (at - self.at)), at
        return self.left

    def give_back(self) -> None:
        """Return the token of a handshake that did not fail."""
        self.left = min(self.most, self.left + 1.0)


class Source(Allowance):
    """An address: its allowance and its connections without ClientHello."""

    def __init__(self) -> None:
        super().__init__(ALLOWANCE, REFILL)
        self.unheard: deque[Connection] = deque()
        self.forged_at = -BARRED
        """When it last sent another machine's id, monotonic seconds."""


class Admission:
    """The listeners for other machines, in a thread and event loop of their own, so that mail cannot delay them."""

    def __init__(self, public: Sequence[str], mission: Mission) -> None:
        """Choose the router's own listeners; `public`: where other machines connect, `tls/HOST:PORT`."""
        self._public = tuple(public)
        self._known = {counted_as((one.host, 0)) for one in mission.boards.values() if one.address}
        """Known addresses; that of a board with a host name is added with its first session."""
        self._names = frozenset((*mission.board_names, *mission.security.operators, *mission.security.observers))
        self._people = frozenset((*mission.security.operators, *mission.security.observers))
        self._barred = dict.fromkeys(mission.security.observers, -BARRED)
        """When each observer last did not read, monotonic seconds."""
        self._for_known, self._for_strangers = [free_listener() for _ in range(KNOWN_LISTENERS)], [free_listener()]
        self.inner = tuple(f"tls/{one.host}:{one.port}" for one in (*self._for_known, *self._for_strangers))
        """Where the router must listen instead."""
        self._of_known = Allowance(KNOWN_ALLOWANCE, KNOWN_REFILL)
        self._sources: dict[str, Source] = {}
        self._unheard = 0
        self._passed: dict[int, Connection] = {}
        self._sessions: Counter[str] = Counter()
        self._all: set[Connection] = set()
        self.counters: Counter[str] = Counter()
        self._forged: dict[str, tuple[float, Note]] = {}
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._thread = Thread(target=self._run, name="admission", daemon=True)

    # Called from other threads.

    async def begin(self) -> None:
        """Listen, as soon as this machine has the addresses. Raises BusClosed if another program listens there."""
        raise_file_limit()
        bound = {endpoint: await bound_socket(endpoint) for endpoint in self._public}
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
        """Note a link that Zenoh reports: the other end's id, our endpoint, and the name in its certificate."""
        port = place.rpartition(":")[2]
        if up and port.isdecimal() and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._session, int(port), zid, name)

    def health(self) -> Health:
        """Return the counts of refused connections and closed sessions, and notes of forged ids."""
        now = time.monotonic()
        notes = tuple(note for at, note in list(self._forged.values()) if now - at < REMEMBERED)
        return Health(notes=notes, counters={name: float(count) for name, count in dict(self.counters).items()})

    # Called on its own loop.

    def came(self, connection: Connection) -> None:
        """Add a connection that waits for its ClientHello; without room, close an older one."""
        self._all.add(connection)
        source = self._source(connection.address)
        source.unheard.append(connection)
        self._unheard += 1
        if self._unheard > UNHEARD:
            most = max(self._sources.values(), key=lambda one: len(one.unheard))
            self.counters["unheard"] += 1
            most.unheard[0].cut()

    def hello_received(self, connection: Connection) -> None:
        """Pass a connection on to the router, if its address has an allowance left."""
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

    def passed_on(self, connection: Connection) -> None:
        """Note a connection that is passed on; `linked` follows if its handshake succeeds."""
        self._passed[connection.port] = connection

    def refuse(self, connection: Connection, why: str, last: bytes = b"") -> None:
        """Close a connection that is not passed on, and log why."""
        tls_rejections.count_rejection(why, connection.address)
        self._forget(connection)
        connection.end(last)

    def ended(self, connection: Connection) -> None:
        """Release what a connection held."""
        self._forget(connection)
        self._passed.pop(connection.port, None)
        if connection.listener is not None:
            connection.listener.failed_at = time.monotonic()
        self._settle(connection)
        if connection.name is not None:
            self._sessions[connection.name] -= 1

    def _session(self, port: int, zid: str, name: str) -> None:
        """Check a new session of the router."""
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
            self._report_forged(name, owner, connection.address)
            source = self._source(connection.address)
            source.left, source.forged_at = 0.0, time.monotonic()
            connection.cut()
            return
        if len(self._known) < ADDRESSES:
            self._known.add(connection.address)
        if self._sessions[name] > MOST_SESSIONS:
            tls_rejections.count_rejection(f"`{name}` has {MOST_SESSIONS} sessions already", connection.address)
            connection.cut()
            return
        if time.monotonic() - self._barred.get(name, -BARRED) < BARRED:
            tls_rejections.count_rejection(
                f"`{name}` did not read what it asked for within the last {BARRED:g} s", connection.address
            )
            connection.cut()

    def _report_forged(self, name: str, owner: str, address: str) -> None:
        whose = f"of `{owner}`" if owner else "of this board's daemons"
        text = (
            f"`{name}` at {address} used the session id {whose} and was disconnected: revoke its keys if it continues"
        )
        self.counters[FORGED] += 1
        about = f"{name} {address} {owner or 'board'}"
        if about not in self._forged or time.monotonic() - self._forged[about][0] >= tls_rejections.LOG_EVERY:
            log.error("security event=%s certificate=%s id_of=%s address=%s", FORGED, name, owner or "board", address)
        if len(self._forged) >= tls_rejections.REASONS:
            self._forged.clear()
        self._forged[about] = time.monotonic(), Note(FORGED, text, about)

    def _settle(self, connection: Connection) -> None:
        """End its handshake."""
        if connection.listener is not None:
            connection.listener.under_way -= 1
            connection.listener = None

    def _forget(self, connection: Connection) -> None:
        """Remove it from those that wait for a ClientHello."""
        source = self._sources.get(connection.address)
        if source is not None and connection in source.unheard:
            source.unheard.remove(connection)
            self._unheard -= 1

    def _source(self, address: str) -> Source:
        now = time.monotonic()
        if (found := self._sources.get(address)) is None:
            if len(self._sources) >= ADDRESSES:  # an address with its full allowance can be forgotten
                idle = [
                    name
                    for name, one in self._sources.items()
                    if not one.unheard and one.now(now) >= ALLOWANCE and now - one.forged_at >= BARRED
                ]
                for name in idle or [next(name for name, one in self._sources.items() if not one.unheard)]:
                    del self._sources[name]
            found = self._sources[address] = Source()
        return found

    async def _watch(self) -> None:
        """Close what exceeds its timeout, for ever."""
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
                        tls_rejections.count_rejection("it did not end its handshake", connection.address)
                        connection.cut()
                elif connection.name is None:
                    if now - connection.since > HELLO:
                        self.counters["unheard"] += 1
                        connection.cut()
                elif connection.name in self._people and connection.stalls_for(now) > STALLED:
                    self._report_stalled(connection)
                    connection.cut()

    def _report_stalled(self, connection: Connection) -> None:
        self.counters["stalled"] += 1
        if connection.name in self._barred:
            self._barred[connection.name] = time.monotonic()
        tls_rejections.count_rejection(
            f"`{connection.name}` does not read what it asked for, and loses its session", connection.address
        )

    async def _listen(self, endpoint: str, bound: socket.socket | None) -> None:
        if bound is None:
            log.warning("%s is no address of this machine yet: no other board reaches this one until it is", endpoint)
        while bound is None:
            await asyncio.sleep(BIND_AGAIN)
            with suppress(BusClosed):
                bound = await bound_socket(endpoint)
        # 64: accepted in one pass of the loop
        await self._loop.create_server(lambda: Connection(self).outside, sock=bound, backlog=64)
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
    """Admit other machines until the end; `bus` is the router's session."""
    bus.on_link(admission.linked)
    await admission.begin()
    try:
        yield admission
    finally:
        await asyncio.to_thread(admission.close)


def raise_file_limit() -> None:
    """Raise the limit of file descriptors to what sessions of other machines need, as far as allowed."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = FILES if hard == resource.RLIM_INFINITY else min(FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(OSError, ValueError):  # a unit may forbid it, and has a limit of its own
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
