"""Connections of other machines, passed on to a listener of the router on loopback (`commd.router.admission` judges
them).

A connection is passed on, unread, when its TLS ClientHello is complete.
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import time
from dataclasses import dataclass
from ipaddress import IPv6Address, IPv6Network
from typing import TYPE_CHECKING

from commd.bus.router_endpoints import LOOK_UP_PATIENCE, open_listener

if TYPE_CHECKING:
    from commd.router.admission import Admission, Allowance

WAITING = 262_144
"""Bytes of a session that may wait here; then the router's own queue fills, and drops."""
BACKLOG = 4096
"""Connections that the kernel keeps until they are accepted; its own bound is `net.core.somaxconn`."""
_RECORD, _HANDSHAKE, _CLIENT_HELLO, _LONGEST = 5, 22, 1, 16_384
"""TLS (RFC 8446, 5.1): bytes of a record's header, its type, the message in it, and the most bytes of a record."""
log = logging.getLogger("admission")


@dataclass
class Listener:
    """A listener of the router on loopback."""

    host: str
    port: int
    under_way: int = 0
    """Handshakes."""
    failed_at: float = 0.0
    """When one failed last, monotonic seconds: the listener pauses after that."""


class End(asyncio.Protocol):
    """One end of a connection: the other machine's, or the router's."""

    transport: asyncio.Transport
    other: End | None = None

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self.took_at = 0.0
        """When it last took something, or had nothing to take, monotonic seconds."""
        self.left = 0
        """Bytes that waited for it then."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to relay."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        transport.set_write_buffer_limits(WAITING)
        self._connection.made(self)

    def data_received(self, data: bytes) -> None:
        """Pass data to the other end, or look for the ClientHello in it."""
        if self.other is not None:
            self.other.transport.write(data)
        else:
            self._connection.heard(data)

    def pause_writing(self) -> None:
        """Stop to read at the other end: this one is slow."""
        if self.other is not None:
            self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        """Read at the other end again: this one has room."""
        if self.other is not None:
            self.other.transport.resume_reading()

    def connection_lost(self, error: Exception | None) -> None:
        """End the connection."""
        self._connection.lost()


class Connection:
    """A connection of another machine, and its continuation to the router."""

    def __init__(self, admission: Admission) -> None:
        self._admission = admission
        self.outside, self.inside = End(self), End(self)
        self.address = ""
        self.since = time.monotonic()
        self.hello = b""
        self.port = 0
        """Our port of the connection to the router, which identifies the link; 0 = not passed on."""
        self.listener: Listener | None = None
        """Where its handshake is under way."""
        self.allowance: Allowance | None = None
        """That paid for the handshake."""
        self.name: str | None = None
        """The name in its certificate; None = the router has no session of it (yet)."""
        self.ended = False

    def made(self, end: End) -> None:
        """Take an end that is connected; the outer one waits for its ClientHello."""
        if end is self.outside:
            self.address = counted_as(end.transport.get_extra_info("peername"))
            self._admission.came(self)

    def heard(self, data: bytes) -> None:
        """Collect the ClientHello."""
        self.hello += data
        head = self.hello[: _RECORD + 1]
        if head[:1] != bytes((_HANDSHAKE,)) or (len(head) > _RECORD and head[_RECORD] != _CLIENT_HELLO):
            return self._admission.refuse(self, "it speaks no TLS")
        length = int.from_bytes(head[3:5], "big") if len(head) >= _RECORD else 0
        if length > _LONGEST:
            return self._admission.refuse(self, "it speaks no TLS")
        if len(head) > _RECORD and len(self.hello) >= _RECORD + length:
            self.outside.transport.pause_reading()
            self._admission.hello_received(self)
        return None

    async def pass_on(self, listener: Listener) -> None:
        """Connect to the router, and pass on bytes in both directions."""
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
        """Close the other end too, after it took what waits for it."""
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
        """Abort both ends."""
        if not self.ended:
            self.end()
        for end in (self.outside, self.inside):
            if hasattr(end, "transport"):
                end.transport.abort()

    @property
    def gone(self) -> bool:
        """Whether it has ended and nothing waits to be sent."""
        transport = self.outside.transport
        return self.ended and transport.is_closing() and not transport.get_write_buffer_size()

    def stalls_for(self, now: float) -> float:
        """Return the seconds for which the other machine has taken nothing although something waits for it; `now` in
        monotonic seconds."""
        end = self.outside
        left = end.transport.get_write_buffer_size()
        if not left or left != end.left:
            end.left, end.took_at = left, now
        return now - end.took_at


def counted_as(peer: tuple[str, int] | None) -> str:
    """Return the address that a connection counts for; of IPv6 the network, as one machine has a whole /64."""
    if peer is None:  # it is closed already
        return "?"
    if ":" not in peer[0]:
        return peer[0]
    address = IPv6Address(peer[0].partition("%")[0])
    mapped = address.ipv4_mapped
    return str(mapped) if mapped is not None else str(IPv6Network((int(address), 64), strict=False))


def free_listener() -> Listener:
    """Return a free address on loopback, anywhere in 127/8, so that no other program uses it by accident."""
    while True:
        host = "127.{}.{}.{}".format(*(1 + byte % 254 for byte in os.urandom(3)))
        with socket.socket() as probe:
            probe.bind((host, 0))
            return Listener(host, probe.getsockname()[1])


async def bound_socket(endpoint: str) -> socket.socket | None:
    """Return a socket that listens at an endpoint; None if this machine does not have the address (yet), or the name
    service does not answer. Raises BusClosed if another program listens there."""
    try:
        return await asyncio.wait_for(asyncio.to_thread(open_listener, endpoint, BACKLOG), LOOK_UP_PATIENCE)
    except TimeoutError:
        return None
