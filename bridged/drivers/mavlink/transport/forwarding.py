"""Ground stations that watch a vehicle and speak to it through the bridge: packets pass as they are, both ways.

What a vehicle sends goes to its stations, whatever anybody here reads of it. What a station sends goes to the vehicles
that it is meant for. A station that is absent or slow costs nothing but dropped packets, which are counted.
"""

from __future__ import annotations

import asyncio
import logging
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from math import inf

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.framing import AUTOPILOT, HEADER_1, HEADER_2, MAGIC_1, UNWANTED, Gate, ids_of
from bridged.drivers.mavlink.transport.link import Link, LinkError, Peer, open_link
from schemas.wire.records import Note

TRY_AGAIN = 5.0
"""Wall seconds between attempts to open a link to a ground station: in flight a free port is waited for, not needed."""
LISTENS_FOR = 30.0
"""Wall seconds for which a silent peer of a listening port is still sent packets."""
ECHO_FOR = 10.0
"""Wall seconds for which a part of a vehicle that spoke on its link is no part of it that speaks from a station."""
NEVER_SENT = (255, 190)
"""Ids of a link on which nothing of our own is sent."""
log = logging.getLogger("mavlink")

PassOn = Callable[[bytes], bool]
"""Sends a packet to the vehicle as it is; False if it was dropped."""


@dataclass(slots=True)
class ForwardCounters:
    """Traffic between vehicles and one ground station."""

    to_station: int = 0
    to_vehicle: int = 0
    dropped: int = 0  # a full buffer or a link that was down, either way
    astray: int = 0  # packets of the station for systems that it does not see here
    echoes: int = 0  # packets of a vehicle that came from the station: passed on they would go round for ever


class GroundStation:
    """One ground station and the vehicles that it sees, by system id."""

    def __init__(self, address: LinkAddress) -> None:
        self.address = address
        self.counters = ForwardCounters()
        self.speaks_as: tuple[int, int] | None = None
        """Ids of its last HEARTBEAT."""
        self._vehicles: dict[int, PassOn] = {}
        self._parts: dict[tuple[int, int], float] = {}
        """When each system and component was heard last on the links of the vehicles."""
        self._echo: tuple[int, float] | None = None
        """Of which vehicle a packet came from the station, as if it were its autopilot, and when last."""
        self._link: Link | None = None
        self._why = ""
        self._opening: asyncio.Task[None] | None = None

    @property
    def vehicles(self) -> list[int]:
        """The systems that it sees."""
        return list(self._vehicles)

    def attach(self, vehicle: int, pass_on: PassOn) -> None:
        """Add a vehicle; the first one opens the link. Raises LinkError for a second one of an id."""
        if vehicle in self._vehicles:
            raise LinkError(f"forward {self.address}: system {vehicle} of another link is forwarded there already")
        self._vehicles[vehicle] = pass_on
        if self._opening is None:
            self._opening = asyncio.create_task(self._open(), name=f"forward {self.address}")

    async def detach(self, vehicle: int) -> None:
        """Remove a vehicle, by its system id; the last one closes the link."""
        self._vehicles.pop(vehicle, None)
        if not self._vehicles and self._opening is not None:
            opening, self._opening = self._opening, None
            opening.cancel()
            with suppress(asyncio.CancelledError):
                await opening
            link, self._link = self._link, None
            if link is not None:
                await link.close()

    def copy(self, packet: bytes) -> None:
        """Send a vehicle's packet to the station."""
        if self._link is not None:
            now = asyncio.get_running_loop().time()
            system, component, _ = ids_of(packet)
            self._parts[system, component] = now
            since = now - LISTENS_FOR
            peers = (peer for peer in self._link.peers if not peer.heard or peer.heard_at > since)
            sent = self._link.pass_on(peers, packet)
            self.counters.to_station += sent
            self.counters.dropped += not sent

    def notes(self) -> list[Note]:
        """Return the warnings that hold now."""
        notes = [Note("station_unreached", self._why, str(self.address))] if self._why else []
        if self._echo is not None and asyncio.get_running_loop().time() - self._echo[1] < ECHO_FOR:
            text = (
                f"packets of {self._echo[0]}/{AUTOPILOT}, the vehicle itself, come from the ground station at "
                f"{self.address}: they are dropped"
            )
            notes.append(Note("station_echoes", text, str(self.address)))
        return notes

    async def _open(self) -> None:
        while self._link is None:
            try:
                self._link = await open_link(
                    self.address,
                    lambda message, peer: None,
                    system=NEVER_SENT[0],
                    component=NEVER_SENT[1],
                    make_gate=lambda peer: _StationGate(self, peer),
                )
            except LinkError as error:
                if not self._why:
                    log.error("forward: %s", error)
                self._why = f"forward: {error}"
                await asyncio.sleep(TRY_AGAIN)
            else:
                self._why = ""
                log.info("forwarding to %s", self.address)

    def take(self, packet: bytes, system: int, number: int) -> None:
        """Send a packet of the station to the vehicles.

        `system` is its sender's id (1..255), `number` its message id.
        """
        (_, part, _), now = ids_of(packet), asyncio.get_running_loop().time()
        if system in self._vehicles and (part == AUTOPILOT or now - self._parts.get((system, part), -inf) < ECHO_FOR):
            self.counters.echoes += 1
            if part == AUTOPILOT:
                self._echo = (system, now)
            return
        if number == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            self.speaks_as = (system, part)
        target = target_of(packet, number)
        chosen = self._vehicles.values() if not target else [self._vehicles[target]] if target in self._vehicles else []
        self.counters.astray += not chosen
        for pass_on in chosen:
            passed = pass_on(packet)
            self.counters.to_vehicle += passed
            self.counters.dropped += not passed


class _StationGate(Gate):
    """Reads nothing of what a station sends, but passes it on."""

    def __init__(self, station: GroundStation, peer: Peer) -> None:
        self._station, self._peer = station, peer

    def refusal(self, packet: bytearray, system: int, message_id: int) -> str:
        return UNWANTED

    def copy(self, packet: bytearray, system: int, message_id: int) -> None:
        self._peer.heard, self._peer.heard_at = True, asyncio.get_running_loop().time()
        self._station.take(bytes(packet), system, message_id)


def target_of(packet: bytes, number: int) -> int:
    """Return the id of the system that a packet of message `number` is meant for; 0 = all, or it names none."""
    place = _target_place(number)
    header, payload = (HEADER_1 if packet[0] == MAGIC_1 else HEADER_2), packet[1]
    return packet[header + place] if place is not None and place < payload else 0


@cache
def _target_place(number: int) -> int | None:
    """Return the offset in the payload of a message's target system, None if it has none."""
    kind = dialect.mavlink_map.get(number)
    if kind is None or "target_system" not in kind.ordered_fieldnames:
        return None
    before = kind.ordered_fieldnames.index("target_system")
    layout = zip(kind.array_lengths[:before], kind.native_format.decode()[1:], strict=False)
    return sum(struct.calcsize(f"<{max(1, count)}{letter}") for count, letter in layout)
