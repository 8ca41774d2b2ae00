"""The other ends of a MAVLink link, and what is counted about them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters


class LinkError(OSError):
    """A link that cannot be opened: the address is taken, the device is missing, and so on; in words."""


class Ids(NamedTuple):
    """MAVLink ids under which somebody speaks."""

    system: int
    component: int


@dataclass(slots=True)
class LinkCounters(WireCounters):
    """What passed over one link since it was opened."""

    sent: int = 0
    dropped: int = 0  # packets of ours that a full buffer or a link that was down swallowed
    unroutable: int = 0  # packets of ours to a system that was never heard
    moves: int = 0  # times that a system id began to speak from another address
    reopened: int = 0  # times that a link was lost and opened again
    errors: int = 0  # errors that the operating system reported on the way (nobody listens at the other end, ...)


@dataclass(eq=False, slots=True)
class Peer:
    """One other end of a link: an address, a connection, a serial line."""

    label: str
    write: Callable[[bytes], bool]
    framer: Framer = field(init=False)  # given by the link, whose choice of packets may depend on the peer
    waiting: Callable[[], int] = lambda: 0  # bytes that wait to be written
    heard_at: float = 0.0  # event loop time of its last valid packet
    heard: bool = False
    closed: bool = False  # a connection that ended; an address of UDP never does
    told_at: float = -inf  # event loop time at which its clock was told last that it is behind
    systems: dict[int, float] = field(default_factory=dict)  # who spoke from here, and when last
    encoders: dict[Ids, Encoder] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.label

    def encoder(self, ids: Ids) -> Encoder:
        """What packs for this peer under these ids: each has its own sequence numbers."""
        encoder = self.encoders.get(ids)
        if encoder is None:
            encoder = self.encoders[ids] = Encoder(*ids)
        return encoder
