"""The address of one vehicle: a vehicle is a system id *and* the address that its HEARTBEATs come from.

This decides whose packets count as the vehicle's, where ours go, and whether two vehicles have one system id.
Pure: packets' senders and the time in wall seconds go in.

The address that is known keeps counting while HEARTBEATs come from there. Another one takes its place once the known
one has been silent for the time of a link loss: the vehicle was restarted, or has a new address. An address that was
left because its connection was closed is replaced by the next one immediately.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from bridged.drivers.mavlink.transport.endpoint import Peer
from bridged.drivers.mavlink.transport.framing import AUTOPILOT
from schemas.wire.records import Note

BACK_WITHIN = 5.0
"""Seconds within which a former address is heard again if there are two vehicles, of 1 Hz each."""
HEARD_FOR = 0.5
"""Seconds for which a new address must be heard alone. After this process stood still, packets of before are read in a
row: the known address then has its turn before a new one counts."""
FIRST_HEARTBEAT = 3.0
"""Seconds of packets without a HEARTBEAT after which they are a warning: a vehicle sends one each second."""
NOTED_FOR = 10.0
"""Seconds for which a packet that did not count, or a change of address, is a warning."""
PART_MOVED = 3.0
"""Seconds of silence of a camera or companion after which its packets may come from another address."""
MAX_ADDRESSES = 8
"""Addresses that are remembered; the one silent longest goes first."""
log = logging.getLogger("mavlink")


@dataclass(slots=True)
class _Heard:
    """HEARTBEATs of one address."""

    first: float
    """The first since the known address was heard."""
    last: float


class VehicleAddress:
    """Address of one vehicle's autopilot: `system` is its id (1..255), `link_loss` and `now` are in wall seconds."""

    def __init__(self, system: int, link_loss: float = 5.0) -> None:
        self.link_loss = link_loss
        """Seconds of silence after which another address may take the place of the known one."""
        self.peer: Peer | None = None
        """The known address; None before the first HEARTBEAT."""
        self.foreign = 0
        """Packets of the vehicle's system id from elsewhere so far, which did not count."""
        self.parts: dict[int, tuple[Peer, float]] = {}
        """Where each other part of the vehicle, by component, spoke last, and when."""
        self._system = system
        self._heard: dict[str, _Heard] = {}
        self._last = ""
        self._two, self._two_until = "", -math.inf
        self._foreign, self._foreign_until = "", -math.inf
        self._unknown_since = math.inf
        """Since when packets have come although no HEARTBEAT has."""
        self._moved, self._moved_until = "", -math.inf

    def counts(self, peer: Peer, now: float, *, heartbeat: bool) -> bool:
        """Whether a packet of the autopilot counts: it came from the vehicle's address."""
        if heartbeat:
            self._heartbeat(peer, now)
        if _same(peer, self.peer):
            self.peer = peer
            return True
        if self.peer is not None:
            return self._refuse(f"system {self._system}", peer, f"its HEARTBEATs come from {self.peer}", now)
        self._unknown_since = min(self._unknown_since, now)
        if now - self._unknown_since >= FIRST_HEARTBEAT:
            return self._refuse(f"system {self._system}", peer, "no HEARTBEAT was heard yet", now)
        self.foreign += 1
        return False

    def counts_of_part(self, component: int, peer: Peer, now: float) -> bool:
        """Whether a packet of another `component` of the vehicle, such as a camera, counts.

        Such a part may be anywhere, but at one address at a time: where it was heard last, until it has been silent for
        `PART_MOVED`; the vehicle's own address always counts.
        """
        if not self.is_home(component, peer, now):
            home, _ = self.parts[component]
            return self._refuse(f"component {component} of system {self._system}", peer, f"it is at {home}", now)
        self.parts[component] = (peer, now)
        return True

    def is_home(self, component: int, peer: Peer, now: float) -> bool:
        """Whether a `component` of the vehicle may be at an address, without a change of what is known."""
        if component == AUTOPILOT:
            return self.peer is None or _same(peer, self.peer)
        home, at = self.parts.get(component, (peer, now))
        return _same(peer, home) or _same(peer, self.peer) or home.closed or now - at >= PART_MOVED

    def _refuse(self, who: str, peer: Peer, known: str, now: float) -> Literal[False]:
        self.foreign += 1
        warning = f"packets of {who} from {peer} are refused: {known}"
        if now >= self._foreign_until:  # a sender at ever new ports does not fill the log
            log.warning("%s", warning)
        self._foreign, self._foreign_until = warning, now + NOTED_FOR
        return False

    def two_vehicles(self, now: float) -> str:
        """Return the warning that two vehicles have this system id, while both are heard; empty if there is one."""
        return self._two if now < self._two_until else ""

    def notes(self, now: float) -> Sequence[Note]:
        """Return the warnings in force at a time, in wall seconds."""
        two, system = self.two_vehicles(now), str(self._system)
        notes = [Note("two_vehicles", two, system)] if two else []
        if now < self._foreign_until:
            notes.append(Note("foreign_packets", self._foreign, system, self.foreign))
        if now < self._moved_until:
            notes.append(Note("vehicle_moved", self._moved, system))
        return notes

    def _heartbeat(self, peer: Peer, now: float) -> None:
        address = str(peer)
        before = self._heard.pop(address, None)
        came_back = address != self._last and before is not None and now - before.last < BACK_WITHIN
        if came_back:
            if not self.two_vehicles(now):
                both = " and ".join(sorted((address, self._last)))
                self._two = f"two vehicles are system {self._system}, at {both}: give each its own MAV_SYSID"
                log.warning("%s", self._two)
            self._two_until = now + BACK_WITHIN
        self._last = address
        self._heard[address] = heard = _Heard(now if before is None else before.first, now)
        if len(self._heard) > MAX_ADDRESSES:
            del self._heard[next(one for one in self._heard if self.peer is None or one != str(self.peer))]
        if self.peer is None:
            self.peer = peer
            self._foreign_until = -math.inf
        elif address == str(self.peer):
            for other in self._heard.values():
                other.first = math.inf
        else:
            heard.first = min(heard.first, now)
            self._consider(peer, heard, now)

    def _consider(self, peer: Peer, heard: _Heard, now: float) -> None:
        """Let another address take the place of the known one if that one is silent, or closed."""
        assert self.peer is not None
        known = self._heard.get(str(self.peer))
        silence = math.inf if known is None else now - known.last
        if self.peer.closed or (silence > self.link_loss and now - heard.first >= HEARD_FOR):
            why = "its connection ended" if self.peer.closed else f"no HEARTBEAT came from there for {silence:.1f} s"
            self._moved = f"system {self._system} is at {peer} now, no longer at {self.peer}: {why}"
            self._moved_until = now + NOTED_FOR
            log.warning("%s", self._moved)
            self.peer = peer
            self._foreign_until = -math.inf


def _same(peer: Peer, other: Peer | None) -> bool:
    """Whether two are one address: a peer that was dropped for others is made again."""
    return peer is other or (other is not None and str(peer) == str(other))
