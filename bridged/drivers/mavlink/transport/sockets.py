"""UDP and TCP under a MAVLink link."""

import asyncio
import errno
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import cast

from bridged.drivers.mavlink.transport.endpoint import (
    MAX_FOREIGN_BYTES,
    MAX_QUEUED_BYTES,
    Connection,
    Endpoint,
    Switchboard,
    in_words,
)
from bridged.drivers.mavlink.transport.link_peers import LinkError, Peer

CONNECT_TIMEOUT_S = 5.0
"""How long a TCP peer may take to answer a call."""

LOOKUP_TIMEOUT_S = 10.0
"""How long the name service may take to say where the host of a link is."""

ROOM_EACH, ROOM_STEP = 10 * 1024, 16
"""Bytes that the system is asked to keep of what waits to be read, for each address that speaks: about what a vehicle
sends in a second, for more would only be old when it is read. It is asked at every so many addresses; what it keeps
unasked is room for the first of them. It may give less (Linux: net.core.rmem_max)."""

MAX_REMEMBERED = 1024
"""Addresses that a socket remembers before it forgets those that the link has forgotten."""

UNANSWERED_TIMEOUT_MS = 10_000
"""How long TCP data may stay unacknowledged before the connection counts as lost (Linux TCP_USER_TIMEOUT)."""


NOBODY_THERE = frozenset({errno.ECONNREFUSED, errno.EMSGSIZE, errno.ENOBUFS, errno.EAGAIN, errno.EPERM})
"""Errors that a new socket would meet as well: nobody listens yet, a buffer is full, a rule forbids it."""
NO_WAY = frozenset({errno.ENETUNREACH, errno.EHOSTUNREACH, errno.EHOSTDOWN})
"""Errors of one way out: the other addresses of a listening socket may be reached all the same."""


class UdpSocket(asyncio.DatagramProtocol):
    """One UDP socket, listening or connected to one address."""

    def __init__(self, link: Switchboard) -> None:
        self._link = link
        self._listens = link.address.kind == "udpin"
        self._transport: asyncio.DatagramTransport | None = None
        self._queued: Callable[[], int] = lambda: 0
        self._peers: set[object] = set()
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        self._transport = transport
        self._queued = cast(asyncio.WriteTransport, transport).get_write_buffer_size
        if not self._listens:
            # The socket is connected: the kernel passes only what comes from there.
            self._add_peer("remote", str(self._link.address), None)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        key: object = addr if self._listens else "remote"
        peer = self._link.find_peer(key) or self._add_peer(key, f"udp:{addr[0]}:{addr[1]}", addr)
        self._link.received(peer, data, datagram=True)

    def error_received(self, exc: Exception) -> None:
        self._link.counters.errors += 1
        number = exc.errno if isinstance(exc, OSError) else None
        if number not in NOBODY_THERE and not (self._listens and number in NO_WAY):
            self._lose(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        self._lose(exc)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.abort()
            self._transport = None
            for key in self._peers:
                self._link.drop_peer(key)

    def _lose(self, exc: Exception | None) -> None:
        self.close()
        if not self.lost.done():
            self.lost.set_result(in_words(exc) if isinstance(exc, OSError) else "closed")

    def _add_peer(self, key: object, label: str, addr: tuple[str, int] | None) -> Peer:
        if len(self._peers) > MAX_REMEMBERED:
            self._peers = {key for key in self._peers if self._link.find_peer(key) is not None}
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
def _in_words(link: Switchboard) -> Iterator[None]:
    """Raise LinkError for what keeps a socket of a link from being opened."""
    try:
        yield
    except TimeoutError as error:
        said = socket.gaierror(socket.EAI_AGAIN, f"no answer within {LOOKUP_TIMEOUT_S:g} s")
        said.__cause__ = error
        raise LinkError(f"link {link.address} cannot be opened: the name service does not answer") from said
    except OSError as error:
        raise LinkError(f"link {link.address} cannot be opened: {in_words(error)}") from error


async def open_udp(link: Switchboard) -> Connection:
    """Binds or connects a socket as the link's address says. Raises LinkError."""
    where = (link.address.host, link.address.port)
    ends = {"local_addr": where} if link.address.kind == "udpin" else {"remote_addr": where}
    loop = asyncio.get_running_loop()
    with _in_words(link):
        async with asyncio.timeout(LOOKUP_TIMEOUT_S):
            _, opened = await loop.create_datagram_endpoint(lambda: UdpSocket(link), **ends)  # type: ignore[arg-type]
    link.set_state(True, "open")
    return Connection(opened.lost, opened.close)


class _TcpConnection(asyncio.Protocol):
    """One TCP connection, ours or a client's."""

    def __init__(self, link: Switchboard) -> None:
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
        self._peer.waiting = transport.get_write_buffer_size

    def data_received(self, data: bytes) -> None:
        if self._peer is not None:
            self._link.received(self._peer, data, datagram=False)

    def connection_lost(self, exc: Exception | None) -> None:
        self._link.drop_peer(self)
        if self._peer is not None:
            self._peer.closed = True
        if not self.lost.done():
            why = in_words(exc) if isinstance(exc, OSError) else "the other end closed the connection"
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


class TcpListener(Endpoint):
    def __init__(self, server: asyncio.Server, connections: list[_TcpConnection]) -> None:
        self._server = server
        self._connections = connections

    @classmethod
    async def open(cls, link: Switchboard) -> "TcpListener":
        connections: list[_TcpConnection] = []

        def accept() -> _TcpConnection:
            connection = _TcpConnection(link)
            connections[:] = [other for other in connections if not other.lost.done()]
            connections.append(connection)
            return connection

        loop = asyncio.get_running_loop()
        with _in_words(link):
            async with asyncio.timeout(LOOKUP_TIMEOUT_S):
                server = await loop.create_server(accept, link.address.host, link.address.port, reuse_address=True)
        link.set_state(True, "open")
        return cls(server, connections)

    async def close(self) -> None:
        self._server.close()
        for connection in self._connections:
            connection.abort()


async def call_tcp(link: Switchboard) -> Connection:
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        _, connection = await loop.create_connection(lambda: _TcpConnection(link), link.address.host, link.address.port)
    return Connection(connection.lost, connection.abort)
