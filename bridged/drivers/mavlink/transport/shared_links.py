"""The links that several robots share in one process: each opened once, its messages given to the robot they are of.

A robot's driver takes a seat at the link of its vehicle. The first one opens the link, the last one closes it.
"""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.endpoint import MAX_FOREIGN_BYTES
from bridged.drivers.mavlink.transport.forwarding import GroundStation
from bridged.drivers.mavlink.transport.framing import AUTOPILOT, SIGNED, Gate, component
from bridged.drivers.mavlink.transport.link import STILL_THERE, Ids, Link, LinkError, Peer, open_link
from bridged.drivers.mavlink.transport.signed_streams import OUTDATED, SignedStreams
from bridged.drivers.mavlink.transport.signing import Signing, SigningError, Timestamps
from bridged.drivers.mavlink.transport.vehicle_address import VehicleAddress
from schemas.wire.records import Note

STRANGE_FOR = 10.0
"""Wall seconds for which a vehicle that nobody claims, or a packet that was not taken, is a warning."""
MAX_NOTED = 8
"""Such vehicles, and such packets, that are remembered."""
HOME_AFTER = 3.0
"""Wall seconds of silence after which a camera or companion of a vehicle may speak to stations from another address."""
TELL_AGAIN = 1.0
"""Wall seconds between two packets that tell a sender how late it is."""
log = logging.getLogger("mavlink")


@dataclass(eq=False)
class LinkClient:
    """One robot at a link: who it is, what it reads and who is told."""

    robot: str
    vehicle: int
    """System id of its vehicle."""
    ids: Ids
    """Ours, under which we speak to it."""
    receive: Callable[[dialect.MAVLink_message, Peer], None]
    on_state: Callable[[bool], None] = lambda up: None
    """Told when packets can pass and when they cannot."""
    unread: frozenset[int] = frozenset()
    """Message ids that nobody reads: they are dropped before they are decoded."""
    key: bytes | None = None
    """By which its packets are signed."""
    forward: tuple[LinkAddress, ...] = ()
    state: Path | None = None
    """Folder in which timestamps of signatures outlive the process."""
    signing: Signing | None = None
    """Made of the key by the link."""
    signs: bool = False
    """Whether the last packet of its vehicle that was read bore a signature."""
    stations: list[GroundStation] = field(default_factory=list)
    problems: list[Note] = field(default_factory=list)
    address: VehicleAddress = field(init=False)
    """Where its vehicle is, on a link at which anybody may call."""

    def __post_init__(self) -> None:
        self.address = VehicleAddress(self.vehicle)


class Links:
    """The open links and ground stations of one process, by link string."""

    def __init__(self) -> None:
        self._links: dict[str, SharedLink] = {}
        self.stations: dict[str, GroundStation] = {}

    @classmethod
    def of(cls, shared: dict[str, Any]) -> Links:
        """Those that the drivers of this process share."""
        links = shared.setdefault("mavlink", cls())
        assert isinstance(links, cls)
        return links

    @asynccontextmanager
    async def seat(self, address: LinkAddress, rider: LinkClient) -> AsyncIterator[SharedLink]:
        """Sit at a link while the block lasts. Raises LinkError if it cannot be opened, or the place is taken."""
        link = self._links.setdefault(str(address), SharedLink(address, self.stations))
        await link.enter(rider)
        try:
            yield link
        finally:
            await link.leave(rider)


class SharedLink:
    """One link and the robots at it, by the system ids of their vehicles."""

    def __init__(self, address: LinkAddress, stations: dict[str, GroundStation]) -> None:
        """`stations` are those of the process."""
        self.address = address
        self.riders: dict[int, LinkClient] = {}
        self.strange = 0
        """HEARTBEATs so far of vehicles that no robot claims."""
        self.link: Link | None = None
        self._stations = stations
        self._lock = asyncio.Lock()
        self._timestamps: Timestamps | None = None
        self._signed = SignedStreams()
        self._by_key: dict[bytes, Signing] = {}
        self._strangers: dict[int, tuple[str, float]] = {}
        self._refused: dict[tuple[int, str, str], float] = {}
        self._homes: dict[tuple[int, int], tuple[Peer, float]] = {}
        """Where each part of each vehicle, by system and component, spoke last, and when."""

    @property
    def up(self) -> bool:
        """Whether packets can pass."""
        return self.link is not None and self.link.up

    async def enter(self, rider: LinkClient) -> None:
        """Take a robot in; the first one opens the link. Raises LinkError."""
        async with self._lock:
            if other := self.riders.get(rider.vehicle):
                raise LinkError(f"link {self.address}: system {rider.vehicle} is robot {other.robot} already")
            rider.signing = self._signing(rider)
            if self.link is None:
                self.link = await open_link(
                    self.address,
                    self._receive,
                    system=rider.ids.system,
                    component=rider.ids.component,
                    on_state=self._tell_state,
                    make_gate=lambda peer: _RiderGate(self, peer),
                )
            self.riders[rider.vehicle] = rider
            for address in rider.forward:
                self._attach(rider, address)

    async def leave(self, rider: LinkClient) -> None:
        """Let a robot go; the last one closes the link."""
        async with self._lock:
            if self.riders.get(rider.vehicle) is rider:
                del self.riders[rider.vehicle]
            rider.problems.clear()
            while rider.stations:
                await rider.stations.pop().detach(rider.vehicle)
            if not self.riders and self.link is not None:
                link, self.link = self.link, None
                await link.close()
                self._homes.clear()
                if self._timestamps is not None:
                    self._timestamps.close()
                    self._signed.close()
                    self._timestamps = None
                    self._by_key.clear()

    def send(self, rider: LinkClient, message: dialect.MAVLink_message) -> None:
        """Send to a robot's vehicle where it is. Raises ValueError if the message cannot be packed."""
        if self.link is None:
            return
        if (home := rider.address.peer) is not None and not home.closed:
            self.link.send_to([home], message, ids=rider.ids, signing=rider.signing)
        else:
            self.link.send(message, rider.vehicle, ids=rider.ids, signing=rider.signing)

    def send_everywhere(self, rider: LinkClient, message: dialect.MAVLink_message) -> None:
        """Send to every address where a robot's vehicle was heard lately. Raises ValueError as `send` does."""
        if self.link is not None:
            self.link.send_to(self.link.peers_of(rider.vehicle), message, ids=rider.ids, signing=rider.signing)

    def notes(self, rider: LinkClient) -> list[Note]:
        """Return the warnings of the link that hold now, and those of one robot's place at it."""
        notes, here = [*rider.address.notes(asyncio.get_running_loop().time())], str(self.address)
        if self.link is not None and not self.link.up:
            notes.append(Note("link_down", f"link {here} is down: {self.link.why}", here))
        since = asyncio.get_running_loop().time() - STRANGE_FOR
        for system, (where, at) in self._strangers.items():
            if at > since and system not in self.riders:
                ours = ", ".join(map(str, sorted(self.riders)))
                robots = f"robot is {ours}" if len(self.riders) == 1 else f"robots are {ours}"
                text = f"heard system {system} at {where}; this link's {robots}"
                notes.append(Note("other_system", text, str(system)))
        for (system, objection, where), at in self._refused.items():
            if at > since and system == rider.vehicle:
                text = f"{objection} packets of system {system} from {where} are not taken"
                notes.append(Note("packets_refused", text, f"{objection} {where}"))
        if rider.signs and rider.signing is None:
            text = (
                f"system {rider.vehicle} signs its packets, and will not listen to unsigned ones: "
                "the mission gives no `signing`"
            )
            notes.append(Note("signing_missing", text))
        timestamps = "" if self._timestamps is None else self._timestamps.problem
        for of, problem in (("sent", timestamps), ("received", self._signed.problem)):
            if problem:
                notes.append(Note("signatures_not_kept", f"timestamps of signatures are not kept: {problem}", of))
        if self._signed.damage:
            notes.append(Note("signatures_forgotten", self._signed.damage))
        for station in rider.stations:
            notes += station.notes()
            if station.speaks_as == rider.ids:
                ids = f"{rider.ids.system}/{rider.ids.component}"
                text = f"the ground station at {station.address} speaks as {ids}, as this bridge does: change `ids`"
                notes.append(Note("station_same_ids", text, str(station.address)))
        return notes + rider.problems

    def counters(self, rider: LinkClient) -> dict[str, float]:
        """Figures of the link, which the robots at it share, and of the robot's ground stations."""
        if self.link is None:
            return {}
        came = self.link.counters
        counters: dict[str, float] = {
            "bad_checksums": came.bad_checksums,
            "skipped_bytes": came.skipped_bytes,
            "unknown_packets": came.unknown_packets,
            "unreadable_packets": came.unreadable_packets,
            "unwanted_packets": came.unwanted,
            "unclaimed_vehicles": self.strange,
            "foreign_packets": rider.address.foreign,
            "link_dropped": came.dropped,
            "link_reopened": came.reopened,
        }
        if rider.signing is not None:
            counters["refused_packets"] = came.refused
        if rider.stations:
            each = [station.counters for station in rider.stations]
            counters["forwarded"] = sum(one.to_station for one in each)
            counters["passed_on"] = sum(one.to_vehicle for one in each)
            counters["forward_dropped"] = sum(one.dropped for one in each)
            counters["forward_echoes"] = sum(one.echoes for one in each)
            counters["forward_astray"] = sum(one.astray for one in each)
        return counters

    def copy(self, packet: bytearray, system: int, peer: Peer) -> None:
        """A packet came: pass it to the ground stations of its vehicle, unless it comes back from one of them.

        Each part of a vehicle has one address at a time: what another address says in its name meanwhile may be our
        own copy. Where signatures are needed, an address is that of a vehicle once a packet from there was taken.
        """
        rider = self.riders.get(system)
        if rider is None or not rider.stations:
            return
        if rider.signing is not None and system not in peer.systems:
            return
        now = asyncio.get_running_loop().time()
        speaker = (system, component(packet))
        if speaker[1] == AUTOPILOT:
            if rider.address.peer is not None and str(rider.address.peer) != str(peer):
                return
        else:
            home, at = self._homes.get(speaker, (peer, now))
            if home is not peer and now - at < HOME_AFTER and self.link is not None and home in self.link.peers:
                return
        self._homes[speaker] = (peer, now)
        for station in rider.stations:
            station.copy(bytes(packet))

    def refuse(self, system: int, objection: str, peer: Peer) -> None:
        """A packet was not taken for its signature."""
        what, now = (system, objection, str(peer)), asyncio.get_running_loop().time()
        if objection == OUTDATED and now - peer.told_at >= TELL_AGAIN:
            peer.told_at = now
            self._tell_time(system, peer)
        if what not in self._refused:
            self._refused = {other: at for other, at in self._refused.items() if at > now - STRANGE_FOR}
            if len(self._refused) >= MAX_NOTED:
                return
            log.warning("%s packets of system %d from %s are not taken", objection, system, peer)
        self._refused[what] = now

    def _tell_time(self, system: int, peer: Peer) -> None:
        """A vehicle whose clock stood still takes the time from our signature; until then nothing of it is taken.

        It has no route yet, so nothing else would reach it. The message itself asks for nothing but an answer.
        """
        rider = self.riders.get(system)
        if rider is not None and self.link is not None:
            asks = dialect.MAVLink_timesync_message(0, time.time_ns())
            self.link.send_to([peer], asks, ids=rider.ids, signing=rider.signing)

    def _signing(self, rider: LinkClient) -> Signing | None:
        """One for each key, all with one row of timestamps: a vehicle on the air may hear what is said to others."""
        if rider.key is None:
            return None
        try:
            if self._timestamps is None:
                name = re.sub(r"[^A-Za-z0-9.-]+", "_", str(self.address))
                file = None if rider.state is None else rider.state / f"{name}.signing"
                self._timestamps = Timestamps(file)
                self._signed = SignedStreams(file and file.with_name(f"{name}.signed"))
        except (OSError, SigningError) as error:
            raise LinkError(f"link {self.address}: timestamps of signatures: {error}") from error
        return self._by_key.setdefault(rider.key, Signing(rider.key, self._timestamps, streams=self._signed))

    def _attach(self, rider: LinkClient, address: LinkAddress) -> None:
        station = self._stations.setdefault(str(address), GroundStation(address))
        try:
            station.attach(rider.vehicle, lambda packet: self._pass_on(rider, packet))
        except LinkError as error:
            log.error("%s", error)
            rider.problems.append(Note("forward_refused", str(error), str(address)))
        else:
            rider.stations.append(station)

    def _pass_on(self, rider: LinkClient, packet: bytes) -> bool:
        """To the autopilot, and to the other parts of the vehicle wherever they speak."""
        since = asyncio.get_running_loop().time() - STILL_THERE
        homes = {
            home
            for (system, part), (home, at) in self._homes.items()
            if system == rider.vehicle and (part == AUTOPILOT or at > since)
        }
        return self.link is not None and bool(homes) and self.link.pass_on(homes, packet, MAX_FOREIGN_BYTES)

    def _receive(self, message: dialect.MAVLink_message, peer: Peer) -> None:
        system = message.get_srcSystem()
        if rider := self.riders.get(system):
            if not self._is_own_word(rider, message, peer):
                return
            rider.signs = bool(message.get_header().incompat_flags & SIGNED)
            rider.receive(message, peer)
        elif message.get_type() == "HEARTBEAT" and message.autopilot != dialect.MAV_AUTOPILOT_INVALID:
            self.strange += 1
            self._strangers[system] = (str(peer), asyncio.get_running_loop().time())
            if len(self._strangers) > MAX_NOTED:
                del self._strangers[next(iter(self._strangers))]

    def _is_own_word(self, rider: LinkClient, message: dialect.MAVLink_message, peer: Peer) -> bool:
        """Whether what is said in the autopilot's name comes from the vehicle; a link with one other end has no choice.

        Cameras and companions may speak from anywhere: what they say is not the vehicle's state.
        """
        if message.get_srcComponent() != AUTOPILOT or not self.address.kind.endswith("in"):
            return True
        heartbeat = message.get_type() == "HEARTBEAT"
        return rider.address.counts(peer, asyncio.get_running_loop().time(), heartbeat=heartbeat)

    def _tell_state(self, up: bool, why: str) -> None:
        log.info("link %s %s: %s", self.address, "up" if up else "down", why)
        for rider in list(self.riders.values()):
            try:
                rider.on_state(up)
            except Exception as error:  # of one robot: the link is opened again for all of them
                what = f"{self.address}: telling {rider.robot} of the link failed"
                asyncio.get_running_loop().call_exception_handler({"message": what, "exception": error})


class _RiderGate(Gate):
    """Reads what the robots at the link read, and of other systems only who they are."""

    def __init__(self, link: SharedLink, peer: Peer) -> None:
        self._link, self._peer = link, peer

    def wants(self, system: int, message_id: int) -> bool:
        rider = self._link.riders.get(system)
        return message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT if rider is None else message_id not in rider.unread

    def signing(self, system: int) -> Signing | None:
        rider = self._link.riders.get(system)
        return None if rider is None else rider.signing

    def refuse(self, system: int, objection: str) -> None:
        self._link.refuse(system, objection, self._peer)

    def copy(self, packet: bytearray, system: int, message_id: int) -> None:
        self._link.copy(packet, system, self._peer)
