"""Under a MAVLink link: its peers, and the UDP sockets, TCP connections and serial lines that carry its bytes."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import termios
import tty
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, NamedTuple, cast

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.drivers.mavlink.transport.signing import reason_of
from commd.common.wakeup_coalescing import postpone_input

if TYPE_CHECKING:
    from bridged.drivers.mavlink.transport.link import Link


class LinkError(OSError):
    """A link that cannot be opened: the address is taken, the device is missing, and so on."""


class Ids(NamedTuple):
    """MAVLink ids of a sender."""

    system: int
    component: int


@dataclass(slots=True)
class LinkCounters(WireCounters):
    """Traffic of one link since it was opened."""

    sent: int = 0
    dropped: int = 0  # packets of ours that a full buffer or a link that was down swallowed
    reopened: int = 0  # times that a link was lost and opened again
    errors: int = 0  # errors that the operating system reported on the way (nobody listens at the other end, ...)


@dataclass(eq=False, slots=True)
class Peer:
    """One other end of a link: an address, a connection, a serial line."""

    label: str
    write: Callable[[bytes], bool]
    framer: Framer = field(init=False)  # given by the link, whose choice of packets may depend on the peer
    waiting: Callable[[], int] = lambda: 0  # bytes that wait to be written
    end: Callable[[], None] = lambda: None  # closes its connection, if it has one
    heard_at: float = 0.0  # event loop time of its last valid packet
    heard: bool = False
    closed: bool = False  # a connection that ended; an address of UDP never does
    warned_at: float = -inf  # event loop time of the last message to it that its clock is behind
    systems: dict[int, float] = field(default_factory=dict)  # who spoke from here, and when last
    encoders: dict[Ids, Encoder] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.label


MAX_QUEUED_BYTES = 65536
"""Bytes that may wait for one peer; about 1500 packets, 11 s of a 57600 baud line."""

MAX_FOREIGN_BYTES = 4096
"""Bytes that may wait at a vehicle's link when a ground station's packet is accepted: our own packets have priority."""

BACKOFF_S = (0.2, 5.0)
"""First and longest pause between two attempts to open a link again, in wall seconds."""
STEADY_S = 5.0
"""Wall seconds that a link must have been open for the next attempt to come soon again."""


class Connection(NamedTuple):
    """A TCP connection or a serial line that is open now."""

    lost: asyncio.Future[str]  # done with the reason when it is lost
    close: Callable[[], None]


def error_text(error: OSError) -> str:
    """Return the reason of an error for people, without its number."""
    if isinstance(error, socket.gaierror):
        return "the host name is not known"
    return reason_of(error)


def _backoff() -> Iterator[float]:
    pause, longest = BACKOFF_S
    while True:
        yield pause
        pause = min(2 * pause, longest)


class Supervised:
    """Keeps one connection open: whenever it is lost it is opened again, with backoff."""

    def __init__(
        self, link: Link, connect: Callable[[], Awaitable[Connection]], opened: Connection | None = None
    ) -> None:
        """`opened` is the first connection if it is there already."""
        self._link = link
        self._connect = connect
        self._present = opened
        self._task = asyncio.create_task(self._keep_open(), name=f"link {link.address}")

    async def _keep_open(self) -> None:
        loop, pauses = asyncio.get_running_loop(), _backoff()
        while True:
            try:
                connection = self._present = self._present or await self._connect()
            except TimeoutError:
                self._link.set_state(False, "no answer")
            except OSError as error:
                self._link.set_state(False, error_text(error) if error.errno else str(error))
            else:
                opened_at = loop.time()
                self._link.set_state(True, "open")
                why = await connection.lost
                self._present = None
                if loop.time() - opened_at > STEADY_S:
                    pauses = _backoff()
                self._link.counters.reopened += 1
                self._link.set_state(False, why)
            await asyncio.sleep(next(pauses))

    async def close(self) -> None:
        """Close the connection, and open it no more."""
        self._task.cancel()
        if self._present is not None:
            self._present.close()
        with suppress(asyncio.CancelledError):
            await self._task


CONNECT_TIMEOUT_S = 5.0
"""Seconds that a TCP peer may take to accept a connection."""

LOOKUP_TIMEOUT_S = 10.0
"""Seconds that the name service may take to resolve the host of a link."""

ROOM_EACH, ROOM_STEP = 10 * 1024, 16
"""Bytes of the receive buffer that are requested for each sending address, and the number of addresses between two
requests. The bytes are about those that a vehicle sends in a second: more would be old when read. The default buffer
serves the first addresses. The system may give less (Linux: net.core.rmem_max)."""

BURST = 32
"""Datagrams that are read in one pass of the event loop at most: what has arrived together costs one wake-up, and other
work on the loop has its turn after some milliseconds."""

PASSES, PASSES_IN_A_ROW = 100.0, 10.0
"""Passes a second in which a busy socket is read, and how many may come sooner after a pause: the link of a vehicle or
two is read as it sends, that of a hundred in passes that find some 25 datagrams each."""

MAX_DATAGRAM = 65_536
"""Bytes."""

MAX_REMEMBERED = 1024
"""Addresses that a socket remembers before it forgets those that the link has forgotten."""

UNANSWERED_TIMEOUT_MS = 10_000
"""Milliseconds for which TCP data may stay unacknowledged until the connection is lost (Linux TCP_USER_TIMEOUT)."""


NOBODY_THERE = frozenset({errno.ECONNREFUSED, errno.EMSGSIZE, errno.ENOBUFS, errno.EAGAIN, errno.EPERM})
"""Errors that a new socket would meet as well: nobody listens yet, a buffer is full, a rule forbids it."""
NO_WAY = frozenset({errno.ENETUNREACH, errno.EHOSTUNREACH, errno.EHOSTDOWN})
"""Errors of one way out: the other addresses of a listening socket may be reached all the same."""


class UdpSocket(asyncio.DatagramProtocol):
    """One UDP socket, listening or connected to one address."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._transport: asyncio.DatagramTransport | None = None
        self._socket: socket.socket | None = None
        """The transport's: it reads one datagram in a pass of the event loop."""
        self._queued: Callable[[], int] = lambda: 0
        self._peers: set[object] = set()
        self._passes_left = PASSES_IN_A_ROW
        self._passed_at = 0.0
        """Event loop time of the last pass."""
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        """Take the socket; one that calls has its only peer from now on."""
        self._transport = transport
        self._socket = transport.get_extra_info("socket").dup()
        self._queued = cast(asyncio.WriteTransport, transport).get_write_buffer_size
        if not self._link.listens:
            self._add_peer("remote", str(self._link.address), None)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Read a datagram, and all others that have arrived, up to `BURST`."""
        for left in range(BURST - 1, -1, -1):
            key: object = addr if self._link.listens else "remote"
            peer = self._link.peers_by_key.get(key) or self._add_peer(key, f"udp:{addr[0]}:{addr[1]}", addr)
            self._link.received(peer, data, datagram=True)
            if self._socket is None or not left:
                return
            try:
                data, addr = self._socket.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                break
            except OSError as error:
                self.error_received(error)
                return
        now = asyncio.get_running_loop().time()  # all are read: others gather if there were many passes lately
        passes = min(PASSES_IN_A_ROW, self._passes_left + (now - self._passed_at) * PASSES) - 1
        self._passes_left, self._passed_at = passes, now
        if passes < 0:
            postpone_input(-passes / PASSES)

    def error_received(self, exc: Exception) -> None:
        """Count an error; one that a new socket would not meet as well ends this one."""
        self._link.counters.errors += 1
        number = exc.errno if isinstance(exc, OSError) else None
        if number not in NOBODY_THERE and not (self._link.listens and number in NO_WAY):
            self._lose(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that the socket is closed."""
        self._lose(exc)

    def close(self) -> None:
        """Free the socket, and forget its peers."""
        if self._transport is not None:
            self._transport.abort()
            self._transport = None
            if self._socket is not None:
                self._socket.close()
                self._socket = None
            for key in self._peers:
                self._link.drop_peer(key)

    def _lose(self, exc: Exception | None) -> None:
        self.close()
        if not self.lost.done():
            self.lost.set_result(error_text(exc) if isinstance(exc, OSError) else "closed")

    def _add_peer(self, key: object, label: str, addr: tuple[str, int] | None) -> Peer:
        if len(self._peers) > MAX_REMEMBERED:
            self._peers = self._peers & self._link.peers_by_key.keys()
        self._peers.add(key)
        if len(self._peers) % ROOM_STEP == 0 and self._transport is not None:
            wire: socket.socket = self._transport.get_extra_info("socket")
            with suppress(OSError):  # what the system gives will do
                wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM_EACH * (len(self._peers) + ROOM_STEP))
        peer = self._link.add_peer(key, label, lambda data: self._write(data, addr))
        peer.waiting = self._queued
        return peer

    def _write(self, data: bytes, addr: tuple[str, int] | None) -> bool:
        transport = self._transport
        if transport is None or transport.is_closing() or self._queued() > MAX_QUEUED_BYTES:
            return False
        transport.sendto(data, addr)
        return True


@contextmanager
def _link_errors(link: Link) -> Iterator[None]:
    """Raise LinkError for what keeps a socket of a link from being opened."""
    try:
        yield
    except TimeoutError as error:
        timed_out = socket.gaierror(socket.EAI_AGAIN, f"no answer within {LOOKUP_TIMEOUT_S:g} s")
        timed_out.__cause__ = error
        raise LinkError(f"link {link.address} cannot be opened: the name service does not answer") from timed_out
    except OSError as error:
        raise LinkError(f"link {link.address} cannot be opened: {error_text(error)}") from error


async def open_udp(link: Link) -> Connection:
    """Bind or connect a socket as the link's address says. Raises LinkError."""
    where = (link.address.host, link.address.port)
    ends = {"local_addr": where} if link.address.kind == "udpin" else {"remote_addr": where}
    loop = asyncio.get_running_loop()
    with _link_errors(link):
        async with asyncio.timeout(LOOKUP_TIMEOUT_S):
            _, opened = await loop.create_datagram_endpoint(lambda: UdpSocket(link), **ends)  # type: ignore[arg-type]
    link.set_state(True, "open")
    return Connection(opened.lost, opened.close)


class _TcpConnection(asyncio.Protocol):
    """One TCP connection, ours or a client's."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._peer: Peer | None = None
        self.transport: asyncio.Transport | None = None
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self.transport = transport
        wire: socket.socket = transport.get_extra_info("socket")
        with suppress(OSError, AttributeError):
            wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNANSWERED_TIMEOUT_MS)
            # Megabytes may wait in the system, for minutes: what waits is to be seen here, and bounded here.
            wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, MAX_FOREIGN_BYTES)
        remote = transport.get_extra_info("peername") or ("?", 0)
        self._peer = self._link.add_peer(self, f"tcp:{remote[0]}:{remote[1]}", self._write)
        self._peer.waiting, self._peer.end = transport.get_write_buffer_size, transport.abort

    def data_received(self, data: bytes) -> None:
        if self._peer is not None:
            self._link.received(self._peer, data, datagram=False)

    def connection_lost(self, exc: Exception | None) -> None:
        self._link.drop_peer(self)
        if self._peer is not None:
            self._peer.closed = True
        if not self.lost.done():
            why = error_text(exc) if isinstance(exc, OSError) else "the other end closed the connection"
            self.lost.set_result(why)

    def abort(self) -> None:
        if self.transport is not None:
            self.transport.abort()

    def _write(self, data: bytes) -> bool:
        transport = self.transport
        if transport is None or transport.is_closing() or transport.get_write_buffer_size() > MAX_QUEUED_BYTES:
            return False
        transport.write(data)
        return True


class TcpListener:
    """A listening TCP socket and the connections that it has accepted."""

    def __init__(self, server: asyncio.Server, connections: list[_TcpConnection]) -> None:
        self._server = server
        self._connections = connections

    @classmethod
    async def open(cls, link: Link) -> TcpListener:
        """Listen at the link's address. Raises LinkError."""
        connections: list[_TcpConnection] = []

        def accept() -> _TcpConnection:
            connection = _TcpConnection(link)
            connections[:] = [other for other in connections if not other.lost.done()]
            connections.append(connection)
            return connection

        loop = asyncio.get_running_loop()
        with _link_errors(link):
            async with asyncio.timeout(LOOKUP_TIMEOUT_S):
                server = await loop.create_server(accept, link.address.host, link.address.port, reuse_address=True)
        link.set_state(True, "open")
        return cls(server, connections)

    async def close(self) -> None:
        """Close the socket and all connections."""
        self._server.close()
        for connection in self._connections:
            connection.abort()


async def call_tcp(link: Link) -> Connection:
    """Connect to the link's address. Raises OSError, and TimeoutError after `CONNECT_TIMEOUT_S`."""
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        _, connection = await loop.create_connection(lambda: _TcpConnection(link), link.address.host, link.address.port)
    return Connection(connection.lost, connection.abort)


_READ_BYTES = 4096


async def open_serial(link: Link) -> Connection:
    """Open the device of the link's address. Raises LinkError."""
    line = SerialLine(link)
    return Connection(line.lost, line.close)


class SerialLine:
    """A serial device in raw mode: 8 data bits, no parity, 1 stop bit, no flow control."""

    def __init__(self, link: Link) -> None:
        """Open the device. Raises LinkError."""
        self._link = link
        try:
            self._device = os.open(link.address.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise LinkError(f"link {link.address} cannot be opened: {error_text(error)}") from error
        try:
            _make_raw(self._device, link.address.port)
        except (OSError, termios.error) as error:
            os.close(self._device)
            raise LinkError(f"link {link.address} cannot be opened: it is not a serial device") from OSError(
                *error.args
            )
        self._waiting = bytearray()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._device, self._read)
        self._open = True
        self._peer = link.add_peer(self, str(link.address), self._write)
        self._peer.waiting = lambda: len(self._waiting)
        self.lost: asyncio.Future[str] = self._loop.create_future()

    def close(self, why: str = "closed") -> None:
        """Free the device; `why` is the reason for whoever waits for its loss."""
        if self._open:
            self._open = False
            self._loop.remove_reader(self._device)
            self._loop.remove_writer(self._device)
            os.close(self._device)
            self._link.drop_peer(self)
            if not self.lost.done():
                self.lost.set_result(why)

    def _read(self) -> None:
        try:
            data = os.read(self._device, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self.close(error_text(error))
            return
        if data:
            self._link.received(self._peer, data, datagram=False)
        else:
            self.close("the device was unplugged")

    def _write(self, data: bytes) -> bool:
        if not self._open or len(self._waiting) > MAX_QUEUED_BYTES:
            return False
        idle = not self._waiting
        self._waiting += data
        if idle:
            self._flush()
        return self._open

    def _flush(self) -> None:
        try:
            written = os.write(self._device, self._waiting)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EWOULDBLOCK):
                self.close(error_text(error))
                return
            written = 0
        del self._waiting[:written]
        if self._waiting:
            self._loop.add_writer(self._device, self._flush)
        else:
            self._loop.remove_writer(self._device)


def _make_raw(device: int, baud: int) -> None:
    tty.setraw(device)
    settings = termios.tcgetattr(device)
    speed = getattr(termios, f"B{baud}")
    settings[2] = settings[2] & ~termios.CRTSCTS & ~termios.CSTOPB & ~termios.PARENB | termios.CLOCAL | termios.CREAD
    settings[4] = settings[5] = speed
    termios.tcsetattr(device, termios.TCSANOW, settings)
