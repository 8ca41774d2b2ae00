"""A MAVLink link: packets in, packets out, over UDP, TCP or a serial line.

The driver of a real vehicle and the simulated one share this transport. It owns no thread and no queue of its own on
the way in (`on_packet` is called from the event loop); on the way out each peer has a bounded buffer, and what does
not fit is dropped and counted: late telemetry is worth less than fresh telemetry.
"""

import asyncio
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.address import LinkAddress
from bridged.drivers.mavlink.endpoint import Endpoint, Supervised
from bridged.drivers.mavlink.peer import LinkCounters, LinkError, Peer
from bridged.drivers.mavlink.serial_line import open_serial
from bridged.drivers.mavlink.sockets import TcpListener, UdpEndpoint, call_tcp
from bridged.drivers.mavlink.wire import Encoder, Framer

__all__ = ["Link", "LinkAddress", "LinkCounters", "LinkError", "OnPacket", "OnState", "Peer", "open_link"]

MAX_PEERS = 64
"""Addresses that a listening link remembers; the one silent longest goes first."""

OnPacket = Callable[[dialect.MAVLink_message, Peer], None]
"""Called with every valid packet and the peer that sent it."""

OnState = Callable[[bool, str], None]
"""Called with True when packets can pass and False when they cannot, and why in words."""


class Link:
    """An open link. Made by `open_link`; closed by `close`."""

    def __init__(
        self, address: LinkAddress, on_packet: OnPacket, system: int, component: int, on_state: OnState | None
    ) -> None:
        self.address = address
        self.counters = LinkCounters()
        self.up = False
        self.why = "not open yet"
        self._system, self._component = system, component
        self._on_packet = on_packet
        self._on_state = on_state
        self._peers: dict[object, Peer] = {}
        self._routes: dict[int, Peer] = {}
        self._endpoint: Endpoint | None = None
        Encoder(system, component)  # ids that cannot be are an error now, not at the first peer

    @property
    def peers(self) -> list[Peer]:
        """The other ends that packets can be sent to now."""
        return [peer for peer in self._peers.values() if peer.heard or not self.address.kind.endswith("in")]

    def peer_of(self, sysid: int) -> Peer | None:
        """Where the system was heard last."""
        return self._routes.get(sysid)

    def send(self, message: dialect.MAVLink_message, sysid: int | None = None) -> bool:
        """Sends to where `sysid` was heard last, or to every peer if it is None or 0.

        True if the packet is on its way to at least one peer. A link with one other end (udpout, tcp, serial) sends
        there in any case. Raises ValueError if a field of the message does not fit into its type.
        """
        targets = self.peers
        if sysid and self.address.kind in ("udpin", "tcpin"):
            route = self._routes.get(sysid)
            if route is None:
                self.counters.unroutable += 1
                return False
            targets = [route]
        elif not targets:
            self.counters.dropped += 1
        return sum(self.send_to(peer, message) for peer in targets) > 0

    def send_to(self, peer: Peer, message: dialect.MAVLink_message) -> bool:
        """Sends to one peer, False if it was dropped."""
        if peer.write(peer.encoder.pack(message)):
            self.counters.sent += 1
            return True
        self.counters.dropped += 1
        return False

    def attach(self, endpoint: Endpoint) -> None:
        """For `open_link`: what carries the bytes from now on."""
        self._endpoint = endpoint

    async def close(self) -> None:
        """Leaves at once; packets still waiting to be written are lost. May be called twice."""
        endpoint, self._endpoint = self._endpoint, None
        if endpoint is not None:
            await endpoint.close()
            self.set_state(False, "closed")
        self._peers.clear()
        self._routes.clear()

    def add_peer(self, key: object, label: str, write: Callable[[bytes], bool]) -> Peer:
        """For endpoints: another end came up, or its first bytes came in."""
        while len(self._peers) >= MAX_PEERS:
            self.drop_peer(min(self._peers, key=lambda other: self._peers[other].heard_at))
        peer = Peer(label, write, Encoder(self._system, self._component), Framer(self.counters))
        self._peers[key] = peer
        return peer

    def find_peer(self, key: object) -> Peer | None:
        """For endpoints: the peer that `add_peer` made under this key."""
        return self._peers.get(key)

    def drop_peer(self, key: object) -> None:
        """For endpoints: another end went away."""
        peer = self._peers.pop(key, None)
        if peer is not None:
            self._routes = {sysid: route for sysid, route in self._routes.items() if route is not peer}

    def received(self, peer: Peer, data: bytes, *, datagram: bool) -> None:
        """For endpoints: bytes came in. An error of the callback is reported to the event loop; the link goes on."""
        loop = asyncio.get_running_loop()
        for message in peer.framer.feed_datagram(data) if datagram else peer.framer.feed(data):
            peer.heard, peer.heard_at = True, loop.time()
            sysid = message.get_srcSystem()
            route = self._routes.get(sysid)
            if route is not peer:
                if route is not None:
                    self.counters.moves += 1
                self._routes[sysid] = peer
            try:
                self._on_packet(message, peer)
            except Exception as error:
                loop.call_exception_handler(
                    {"message": f"{self.address}: handling {message.get_type()} failed", "exception": error}
                )

    def set_state(self, up: bool, why: str) -> None:
        """For endpoints: packets can pass, or they cannot."""
        self.why = why
        if up != self.up:
            self.up = up
            if self._on_state is not None:
                self._on_state(up, why)


async def open_link(
    address: LinkAddress,
    on_packet: OnPacket,
    *,
    system: int,
    component: int,
    on_state: OnState | None = None,
) -> Link:
    """Opens a link and keeps it open.

    `system` and `component` are our own MAVLink ids. Raises LinkError if a port cannot be bound or a device cannot be
    opened. A TCP peer that does not answer yet, and a TCP or serial link that is lost later, are tried again with
    backoff until `close`; `on_state` tells.
    """
    link = Link(address, on_packet, system, component, on_state)
    link.attach(await _open_endpoint(link))
    return link


async def _open_endpoint(link: Link) -> Endpoint:
    match link.address.kind:
        case "udpin" | "udpout":
            return await UdpEndpoint.open(link)
        case "tcpin":
            return await TcpListener.open(link)
        case "tcp":
            return Supervised(link, lambda: call_tcp(link))
        case "serial":
            # A device that is missing now is an error now; one that is lost later is waited for.
            return Supervised(link, lambda: open_serial(link), opened=await open_serial(link))
