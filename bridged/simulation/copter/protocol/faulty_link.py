"""A link of a simulated vehicle on which bytes are lost, doubled, late and garbled, as asked for."""

from collections.abc import Callable

from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.link import Link, MakeGate, OnPacket
from bridged.drivers.mavlink.transport.link_peers import Ids, Peer
from bridged.simulation.copter.fault_injection import Air, Faults


class FaultyLink(Link):
    """A link with faults in both directions. The other ends have their own dice, in the order in which they come."""

    def __init__(
        self,
        address: LinkAddress,
        on_packet: OnPacket,
        ids: Ids,
        make_gate: MakeGate | None,
        faults: Faults,
        now: Callable[[], float],
    ) -> None:
        """`now` tells vehicle seconds since the start of the simulation."""
        super().__init__(address, on_packet, ids, None, None, make_gate)
        self._faults = faults
        self._now = now
        self._count = 0
        self._down: list[tuple[Air, Callable[[bytes], bool]]] = []
        self._up: dict[Peer, tuple[Air, bool]] = {}

    def add_peer(self, key: object, label: str, write: Callable[[bytes], bool]) -> Peer:
        """For endpoints: what is written to the other end goes through the air."""
        self._count += 1
        air = Air(self._faults, f"down {self._count}")
        self._down.append((air, write))

        def through_air(packet: bytes) -> bool:
            written = [write(piece) for piece in air.carry(packet, self._now())]
            return all(written)

        peer = super().add_peer(key, label, through_air)
        self._up[peer] = (Air(self._faults, f"up {self._count}"), True)
        return peer

    def report(self) -> str:
        """What was refused and what went wrong on this link since it was opened, in words; empty if nothing."""
        airs = [air for air, _ in self._down] + [air for air, _ in self._up.values()]
        counts = {
            "refused for want of a right signature": self.counters.refused,
            "lost": sum(air.counters.lost for air in airs),
            "doubled": sum(air.counters.duplicated for air in airs),
            "late": sum(air.counters.reordered for air in airs),
            "bursts of garbage": sum(air.counters.garbage for air in airs),
        }
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count)

    def drop_peer(self, key: object) -> None:
        """For endpoints: another end went away."""
        peer = self.find_peer(key)
        super().drop_peer(key)
        if peer is not None:
            at = list(self._up).index(peer)
            del self._up[peer], self._down[at]

    def received(self, peer: Peer, data: bytes, *, datagram: bool) -> None:
        """For endpoints: what comes from the other end has gone through the air."""
        air, _ = self._up[peer]
        self._up[peer] = (air, datagram)
        for piece in air.carry(data, self._now()):
            super().received(peer, piece, datagram=datagram)

    def deliver_late(self) -> None:
        """Passes on what was held back, if it is time; to be called now and then."""
        now = self._now()
        for air, write in self._down:
            for packet in air.due(now):
                write(packet)
        for peer, (air, datagram) in list(self._up.items()):
            for piece in air.due(now):
                super().received(peer, piece, datagram=datagram)
