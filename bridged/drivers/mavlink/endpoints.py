"""Sockets and serial lines under a MAVLink link."""

import asyncio
import errno
import os
import socket
import termios
import tty
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from typing import NamedTuple, Protocol, cast

from bridged.drivers.mavlink.address import LinkAddress
from bridged.drivers.mavlink.peer import LinkCounters, LinkError, Peer

MAX_QUEUED_BYTES = 65536
"""Bytes that may wait for one peer; about 1500 packets, 11 s of a 57600 baud line."""

BACKOFF_S = (0.2, 5.0)
"""First and longest pause between two attempts to open a link again, in wall seconds."""

CONNECT_TIMEOUT_S = 5.0
"""How long a TCP peer may take to answer a call."""

UNANSWERED_TIMEOUT_MS = 10_000
"""How long TCP data may stay unacknowledged before the connection counts as lost (Linux TCP_USER_TIMEOUT)."""

_READ_BYTES = 4096


class Switchboard(Protocol):
    """What an endpoint needs of its link."""

    address: LinkAddress
    counters: LinkCounters

    def add_peer(self, key: object, label: str, write: Callable[[bytes], bool]) -> Peer: ...
    def find_peer(self, key: object) -> Peer | None: ...
    def drop_peer(self, key: object) -> None: ...
    def received(self, peer: Peer, data: bytes, *, datagram: bool) -> None: ...
    def set_state(self, up: bool, why: str) -> None: ...


class Endpoint:
    """What carries a link's bytes."""

    async def close(self) -> None:
        """Frees the socket or the device."""
        raise NotImplementedError


class Connection(NamedTuple):
    """A TCP connection or a serial line that is open now."""

    lost: asyncio.Future[str]  # done when it is gone, with the reason in words
    close: Callable[[], None]


async def open_endpoint(link: Switchboard) -> Endpoint:
    """Binds, calls or opens what the link's address names. Raises LinkError."""
    match link.address.kind:
        case "udpin" | "udpout":
            return await _UdpEndpoint.open(link)
        case "tcpin":
            return await _TcpListener.open(link)
        case "tcp":
            return _Supervised(link, lambda: _call_tcp(link))
        case "serial":
            opened = [_SerialLine(link)]  # a device that is missing now is an error now
            return _Supervised(link, lambda: _open_serial(link, opened))


def _in_words(error: OSError) -> str:
    """The reason without its number, which says nothing to people."""
    if isinstance(error, socket.gaierror):
        return "the host name is not known"
    return (os.strerror(error.errno) if error.errno else str(error)).lower()


def _backoff() -> Iterator[float]:
    pause, longest = BACKOFF_S
    while True:
        yield pause
        pause = min(2 * pause, longest)


class _UdpEndpoint(Endpoint, asyncio.DatagramProtocol):
    def __init__(self, link: Switchboard) -> None:
        self._link = link
        self._transport: asyncio.DatagramTransport | None = None
        self._queued: Callable[[], int] = lambda: 0

    @classmethod
    async def open(cls, link: Switchboard) -> "_UdpEndpoint":
        where = (link.address.host, link.address.port)
        ends = {"local_addr": where} if link.address.kind == "udpin" else {"remote_addr": where}
        loop = asyncio.get_running_loop()
        try:
            _, endpoint = await loop.create_datagram_endpoint(lambda: cls(link), **ends)  # type: ignore[arg-type]
        except OSError as error:
            raise LinkError(f"link {link.address} cannot be opened: {_in_words(error)}") from error
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
            why = _in_words(exc) if isinstance(exc, OSError) else "the other end closed the connection"
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


class _TcpListener(Endpoint):
    def __init__(self, server: asyncio.Server, connections: list[_TcpConnection]) -> None:
        self._server = server
        self._connections = connections

    @classmethod
    async def open(cls, link: Switchboard) -> "_TcpListener":
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
            raise LinkError(f"link {link.address} cannot be opened: {_in_words(error)}") from error
        link.set_state(True, "open")
        return cls(server, connections)

    async def close(self) -> None:
        self._server.close()
        for connection in self._connections:
            connection.abort()


async def _call_tcp(link: Switchboard) -> Connection:
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        _, connection = await loop.create_connection(lambda: _TcpConnection(link), link.address.host, link.address.port)
    return Connection(connection.lost, connection.abort)


class _SerialLine:
    """A serial device in raw mode: 8 data bits, no parity, 1 stop bit, no flow control."""

    def __init__(self, link: Switchboard) -> None:
        """Opens the device. Raises LinkError."""
        self._link = link
        try:
            self._device = os.open(link.address.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise LinkError(f"link {link.address} cannot be opened: {_in_words(error)}") from error
        try:
            _make_raw(self._device, link.address.port)
        except (OSError, termios.error) as error:
            os.close(self._device)
            raise LinkError(f"link {link.address} cannot be opened: it is not a serial device") from error
        self._waiting = bytearray()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._device, self._read)
        self._open = True
        self._peer = link.add_peer(self, str(link.address), self._write)
        self.lost: asyncio.Future[str] = self._loop.create_future()

    def close(self, why: str = "closed") -> None:
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
            self.close(_in_words(error))
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
                self.close(_in_words(error))
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


async def _open_serial(link: Switchboard, opened: list[_SerialLine]) -> Connection:
    line = opened.pop() if opened else _SerialLine(link)
    return Connection(line.lost, line.close)


class _Supervised(Endpoint):
    """Opens a connection again, with backoff, whenever it is lost."""

    def __init__(self, link: Switchboard, connect: Callable[[], Awaitable[Connection]]) -> None:
        self._link = link
        self._connect = connect
        self._end: Callable[[], None] | None = None
        self._task = asyncio.create_task(self._keep_open(), name=f"link {link.address}")

    async def _keep_open(self) -> None:
        pauses = _backoff()
        while True:
            try:
                connection = await self._connect()
            except TimeoutError:
                self._link.set_state(False, "no answer")
            except OSError as error:
                self._link.set_state(False, _in_words(error) if error.errno else str(error))
            else:
                pauses = _backoff()
                self._end = connection.close
                self._link.set_state(True, "open")
                why = await connection.lost
                self._end = None
                self._link.counters.reopened += 1
                self._link.set_state(False, why)
            await asyncio.sleep(next(pauses))

    async def close(self) -> None:
        self._task.cancel()
        if self._end is not None:
            self._end()
        with suppress(asyncio.CancelledError):
            await self._task
