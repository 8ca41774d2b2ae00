"""The other ends of a MAVLink link, and what is counted about them."""

from collections.abc import Callable
from dataclasses import dataclass

from bridged.drivers.mavlink.wire import Encoder, Framer, WireCounters


class LinkError(OSError):
    """A link that cannot be opened: the address is taken, the device is missing, and so on; in words."""


@dataclass(slots=True)
class LinkCounters(WireCounters):
    """What passed over one link since it was opened."""

    sent: int = 0
    dropped: int = 0  # packets of ours that a full buffer or a link that was down swallowed
    unroutable: int = 0  # packets of ours to a system that was never heard
    moves: int = 0  # times that a system id began to speak from another address
    reopened: int = 0  # times that a TCP or serial link was lost
    errors: int = 0  # errors that the operating system reported on the way (nobody listens at the other end, ...)


@dataclass(eq=False, slots=True)
class Peer:
    """One other end of a link: an address, a connection, a serial line."""

    label: str
    write: Callable[[bytes], bool]
    encoder: Encoder
    framer: Framer
    heard_at: float = 0.0  # event loop time of its last valid packet
    heard: bool = False

    def __str__(self) -> str:
        return self.label
