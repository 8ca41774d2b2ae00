"""UDP and TCP under a MAVLink link."""

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import cast

from bridged.drivers.mavlink.endpoint import MAX_QUEUED_BYTES, Connection, Endpoint, Switchboard, in_words
from bridged.drivers.mavlink.peer import LinkError, Peer

CONNECT_TIMEOUT_S = 5.0
"""How long a TCP peer may take to answer a call."""

UNANSWERED_TIMEOUT_MS = 10_000
"""How long TCP data may stay unacknowledged before the connection counts as lost (Linux TCP_USER_TIMEOUT)."""


class UdpEndpoint(Endpoint, asyncio.DatagramProtocol):
    def __init__(self, link: Switchboard) -> None:
        self._link = link
        self._transport: asyncio.DatagramTransport | None = None
        self._queued: Callable[[], int] = lambda: 0

    @classmethod
    async def open(cls, link: Switchboard) -> "UdpEndpoint":
        where = (link.address.host, link.address.port)
        ends = {"local_addr": where} if link.address.kind == "udpin" else {"remote_addr": where}
        loop = asyncio.get_running_loop()
        try:
            _, endpoint = await loop.create_datagram_endpoint(lambda: cls(link), **ends)  # type: ignore[arg-type]
        except OSError as error:
            raise LinkError(f"link {link.address} cannot be opened: {in_words(error)}") from error
        link.set_state(True, "open")
        return endpoint

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        self._transport = transport
        self._queued = cast(asyncio.WriteTransport, transport).get_write_buffer_size
        if self._link.address.kind == "udpout":
            # The socket is connected: the kernel passes only what comes from there.
            self._link.add_peer("remote", str(self._link.address), lambda data: self._write(data, None))

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        key: object = "remote" if self._link.address.kind == "udpout" else addr
        peer = self._link.find_peer(key)
        if peer is None:
            label = f"udp:{addr[0]}:{addr[1]}"
            peer = self._link.add_peer(key, label, lambda data: self._write(data, addr))
        self._link.received(peer, data, datagram=True)

    def error_received(self, exc: Exception) -> None:
        # Nobody listens at the other end yet, or no longer: it may come back.
        self._link.counters.errors += 1

    def _write(self, data: bytes, addr: tuple[str, int] | None) -> bool:
        transport = self._transport
        if transport is None or transport.is_closing() or self._queued() > MAX_QUEUED_BYTES:
            return False
        transport.sendto(data, addr)
        return True

    async def close(self) -> None:
        if self._transport is not None:
            self._transport.abort()
            self._transport = None


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
        remote = transport.get_extra_info("peername") or ("?", 0)
        self._peer = self._link.add_peer(self, f"tcp:{remote[0]}:{remote[1]}", self._write)

    def data_received(self, data: bytes) -> None:
        if self._peer is not None:
            self._link.received(self._peer, data, datagram=False)

    def connection_lost(self, exc: Exception | None) -> None:
        self._link.drop_peer(self)
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
        try:
            server = await loop.create_server(accept, link.address.host, link.address.port, reuse_address=True)
        except OSError as error:
            raise LinkError(f"link {link.address} cannot be opened: {in_words(error)}") from error
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
