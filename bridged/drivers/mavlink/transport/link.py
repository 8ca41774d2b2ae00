"""A MAVLink link: packets in, packets out, over UDP, TCP or a serial line.

The driver of a real vehicle and the simulated one share this transport. It owns no thread and no queue of its own on
the way in (`on_packet` is called from the event loop); on the way out each peer has a bounded buffer, and what does
not fit is dropped and counted: late telemetry is worth less than fresh telemetry.
"""

import asyncio
from collections.abc import Callable, Iterable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.endpoint import (
    MAX_QUEUED_BYTES,
    Ids,
    LinkCounters,
    LinkError,
    Peer,
    Supervised,
    TcpListener,
    call_tcp,
    open_serial,
    open_udp,
)
from bridged.drivers.mavlink.transport.framing import Encoder, Framer, Gate, SignedGate, check_ids
from bridged.drivers.mavlink.transport.signing import Signing

__all__ = ["Ids", "Link", "LinkAddress", "LinkCounters", "LinkError", "OnPacket", "OnState", "Peer", "open_link"]

MAX_PEERS = 512
"""Addresses that a listening link remembers, and connections that it holds; the one silent longest goes first. A link
may have 255 vehicles, each at an address of its own, and their cameras and ground stations."""
STILL_THERE = 5.0
"""Wall seconds for which a system that was heard from an address counts as there."""

OnPacket = Callable[[dialect.MAVLink_message, Peer], None]
"""Called with every valid packet and the peer that sent it."""

OnState = Callable[[bool, str], None]
"""Called with True when packets can pass and False when they cannot, and with the reason."""

MakeGate = Callable[[Peer], Gate]
"""Makes the gate of one peer's packets."""


class Link:
    """An open link. Made by `open_link`; closed by `close`."""

    def __init__(
        self,
        address: LinkAddress,
        on_packet: OnPacket,
        ids: Ids,
        on_state: OnState | None,
        signing: Signing | None,
        make_gate: MakeGate | None,
    ) -> None:
        check_ids(*ids)
        self.address = address
        self.listens = address.kind.endswith("in")
        """Whether anybody may call; other links have one other end."""
        self.counters = LinkCounters()
        self.up = False
        self.why = "not open yet"
        self.signing = signing
        """By what packets are signed and checked; may be changed at any time."""
        self._ids = ids
        self._on_packet = on_packet
        self._on_state = on_state
        self._make_gate = make_gate or (lambda peer: SignedGate(lambda: self.signing))
        self.peers_by_key: dict[object, Peer] = {}
        """For endpoints: the other ends by the key under which they were added."""
        self._endpoint: Supervised | TcpListener | None = None

    @property
    def peers(self) -> list[Peer]:
        """The other ends that packets can be sent to now."""
        return [peer for peer in self.peers_by_key.values() if peer.heard or not self.listens]

    def send(
        self,
        message: dialect.MAVLink_message,
        peers: Sequence[Peer] | None = None,
        *,
        ids: Ids | None = None,
        signing: Signing | None = None,
    ) -> bool:
        """Send to some peers, by default to every one. Returns False if it was dropped for all of them.

        `ids` and `signing` are the link's own if they are not given. Raises ValueError if a field of the message does
        not fit into its type.
        """
        ids, signing, packed = ids or self._ids, signing or self.signing, []
        for peer in self.peers if peers is None else peers:
            if ids not in peer.encoders:  # each has its own sequence numbers
                peer.encoders[ids] = Encoder(*ids)
            packed.append((peer, peer.encoders[ids].pack(message, signing)))
        sent = sum(peer.write(packet) for peer, packet in packed)
        self.counters.sent += sent
        self.counters.dropped += len(packed) - sent if packed or self.listens else 1
        return sent > 0

    def pass_on(self, peers: Iterable[Peer], packet: bytes, most: int = MAX_QUEUED_BYTES) -> bool:
        """Send somebody else's packet unchanged to some peers. Returns False if it was dropped for all of them.

        It is dropped for a peer for which more than `most` bytes wait; that is for its sender to count.
        """
        sent = sum(peer.waiting() <= most and peer.write(packet) for peer in list(peers))
        self.counters.sent += sent
        return sent > 0

    def peers_of(self, sysid: int) -> list[Peer]:
        """Return every address where the system was heard lately: more than one if two vehicles have one id.

        A link with one other end sends there in any case.
        """
        if not self.listens:
            return self.peers
        since = asyncio.get_running_loop().time() - STILL_THERE
        return [peer for peer in self.peers if peer.systems.get(sysid, since) > since]

    async def open(self) -> None:
        """For `open_link` and for links that do more: begin to carry bytes. Raises LinkError."""
        match self.address.kind:
            case "udpin" | "udpout":
                self._endpoint = Supervised(self, lambda: open_udp(self), opened=await open_udp(self))
            case "tcpin":
                self._endpoint = await TcpListener.open(self)
            case "tcp":
                self._endpoint = Supervised(self, lambda: call_tcp(self))
            case "serial":  # a device that is missing now is an error; one that is lost later is waited for
                self._endpoint = Supervised(self, lambda: open_serial(self), opened=await open_serial(self))

    async def close(self) -> None:
        """Close the link without waiting: packets not yet written are lost. May be called twice."""
        endpoint, self._endpoint = self._endpoint, None
        if endpoint is not None:
            await endpoint.close()
            self.set_state(False, "closed")
        self.peers_by_key.clear()

    def add_peer(self, key: object, label: str, write: Callable[[bytes], bool]) -> Peer:
        """For endpoints: another end came up, or its first bytes came in."""
        while len(self.peers_by_key) >= MAX_PEERS:
            gone = min(self.peers_by_key, key=lambda other: self.peers_by_key[other].heard_at)
            self.peers_by_key.pop(gone).end()
        peer = Peer(label, write)
        peer.framer = Framer(self.counters, self._make_gate(peer))
        self.peers_by_key[key] = peer
        return peer

    def drop_peer(self, key: object) -> None:
        """For endpoints: another end went away."""
        self.peers_by_key.pop(key, None)

    def received(self, peer: Peer, data: bytes, *, datagram: bool) -> None:
        """For endpoints: bytes came in. An error of the callback is reported to the event loop; the link stays up."""
        loop = asyncio.get_running_loop()
        for message in peer.framer.feed(data, datagram=datagram):
            peer.heard, peer.heard_at = True, loop.time()
            peer.systems[message.get_srcSystem()] = peer.heard_at
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
    signing: Signing | None = None,
    make_gate: MakeGate | None = None,
) -> Link:
    """Open a link and keep it open.

    `system` and `component` are our own MAVLink ids. `signing` signs what is sent and checks what arrives; `make_gate`
    chooses and checks what arrives instead. Raises LinkError if a port cannot be bound or a device cannot be opened. A
    TCP peer that does not answer yet, and a link that is lost later, are tried again with backoff until `close`;
    `on_state` is called at each change.
    """
    link = Link(address, on_packet, Ids(system, component), on_state, signing, make_gate)
    await link.open()
    return link
