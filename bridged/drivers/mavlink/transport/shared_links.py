"""Links that several robots of one process share: each is opened once, and its messages go to the robot they are of.

A robot's driver is a client of the link of its vehicle. The first one opens the link, the last one closes it.
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
from bridged.drivers.mavlink.transport.framing import AUTOPILOT, SIGNED, UNWANTED, Gate, ids_of
from bridged.drivers.mavlink.transport.link import STILL_THERE, Ids, Link, LinkError, Peer, open_link
from bridged.drivers.mavlink.transport.signing import OUTDATED, SignedStreams, Signing, SigningError, Timestamps
from bridged.drivers.mavlink.transport.vehicle_address import VehicleAddress
from schemas.wire.records import Note

STRANGE_FOR = 10.0
"""Wall seconds for which an unclaimed vehicle, or a refused packet, is a warning."""
MAX_NOTED = 8
"""Most such vehicles, and such packets, that are remembered."""
WARN_AGAIN = 1.0
"""Wall seconds between two packets that send the time to a sender."""
log = logging.getLogger("mavlink")


@dataclass(eq=False)
class LinkClient:
    """One robot at a link: its ids, the messages it reads, and its callbacks."""

    robot: str
    vehicle: int
    """System id of its vehicle."""
    ids: Ids
    """Ours, under which we speak to it."""
    receive: Callable[[dialect.MAVLink_message], None]
    on_state: Callable[[bool], None] = lambda up: None
    """Called with whether packets can pass, when that changes."""
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
    link: SharedLink | None = None
    """Where it is a client, from the first time on."""
    unsendable: int = 0
    """Messages so far that could not be packed."""

    def __post_init__(self) -> None:
        self.address = VehicleAddress(self.vehicle)

    def send(self, message: dialect.MAVLink_message) -> None:
        """Send to the vehicle where it is; if there are two, to each address where one was heard lately.

        What is for a camera or gimbal goes to where that one was heard. It is lost while there is no link.
        """
        if self.link is None or (link := self.link.link) is None:
            return
        part, _ = self.address.parts.get(getattr(message, "target_component", AUTOPILOT), (None, 0.0))
        peers = [part] if part is not None and not part.closed else self.homes(link)
        try:
            link.send(message, peers, ids=self.ids, signing=self.signing)
        except ValueError as error:
            self.unsendable += 1
            log.error("not sent: %s", error)

    def homes(self, link: Link) -> list[Peer]:
        """Return where its autopilot is; while there are two, or none was heard, each address of its system."""
        home, now = self.address.peer, asyncio.get_running_loop().time()
        unsure = home is None or home.closed or self.address.two_vehicles(now)
        return link.peers_of(self.vehicle) if unsure or home is None else [home]


@asynccontextmanager
async def shared_link(
    shared: dict[str, Any], address: LinkAddress, link_client: LinkClient
) -> AsyncIterator[SharedLink]:
    """Be a client of a link while the block lasts; `shared` is what the drivers of this process share.

    Raises LinkError if the link cannot be opened, or the id is taken.
    """
    links: dict[str, SharedLink] = shared.setdefault("mavlink links", {})
    stations: dict[str, GroundStation] = shared.setdefault("mavlink ground stations", {})
    link = links.setdefault(str(address), SharedLink(address, stations))
    await link.enter(link_client)
    try:
        yield link
    finally:
        await link.leave(link_client)


class SharedLink:
    """One link and the robots at it, by the system ids of their vehicles."""

    def __init__(self, address: LinkAddress, stations: dict[str, GroundStation]) -> None:
        """`stations` are those of the process."""
        self.address = address
        self.link_clients: dict[int, LinkClient] = {}
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

    @property
    def up(self) -> bool:
        """Whether packets can pass."""
        return self.link is not None and self.link.up

    async def enter(self, link_client: LinkClient) -> None:
        """Add a robot; the first one opens the link. Raises LinkError."""
        async with self._lock:
            if other := self.link_clients.get(link_client.vehicle):
                raise LinkError(f"link {self.address}: system {link_client.vehicle} is robot {other.robot} already")
            link_client.signing = self._signing(link_client)
            if self.link is None:
                self.link = await open_link(
                    self.address,
                    self._receive,
                    system=link_client.ids.system,
                    component=link_client.ids.component,
                    on_state=self._report_state,
                    make_gate=lambda peer: _ClientGate(self, peer),
                )
            self.link_clients[link_client.vehicle], link_client.link = link_client, self
            for address in link_client.forward:
                self._attach(link_client, address)

    async def leave(self, link_client: LinkClient) -> None:
        """Remove a robot; the last one closes the link."""
        async with self._lock:
            if self.link_clients.get(link_client.vehicle) is link_client:
                del self.link_clients[link_client.vehicle]
            link_client.problems.clear()
            while link_client.stations:
                await link_client.stations.pop().detach(link_client.vehicle)
            if not self.link_clients and self.link is not None:
                link, self.link = self.link, None
                await link.close()
                if self._timestamps is not None:
                    self._timestamps.close()
                    self._signed.close()
                    self._timestamps = None
                    self._by_key.clear()

    def notes(self, link_client: LinkClient) -> list[Note]:
        """Return the warnings of the link that hold now, and those of one robot's place at it."""
        notes, here = [*link_client.address.notes(asyncio.get_running_loop().time())], str(self.address)
        if self.link is not None and not self.link.up:
            notes.append(Note("link_down", f"link {here} is down: {self.link.why}", here))
        since = asyncio.get_running_loop().time() - STRANGE_FOR
        for system, (where, at) in self._strangers.items():
            if at > since and system not in self.link_clients:
                ours = ", ".join(map(str, sorted(self.link_clients)))
                robots = f"robot is {ours}" if len(self.link_clients) == 1 else f"robots are {ours}"
                text = f"heard system {system} at {where}; this link's {robots}"
                notes.append(Note("other_system", text, str(system)))
        for (system, objection, where), at in self._refused.items():
            if at > since and system == link_client.vehicle:
                text = f"{objection} packets of system {system} from {where} are refused"
                notes.append(Note("packets_refused", text, f"{objection} {where}"))
        if link_client.signs and link_client.signing is None:
            text = (
                f"system {link_client.vehicle} signs its packets, and will not listen to unsigned ones: "
                "the mission gives no `signing`"
            )
            notes.append(Note("signing_missing", text))
        timestamps = "" if self._timestamps is None else self._timestamps.problem
        for of, problem in (("sent", timestamps), ("received", self._signed.problem)):
            if problem:
                notes.append(Note("signatures_not_kept", f"timestamps of signatures are not kept: {problem}", of))
        if self._signed.damage:
            notes.append(Note("signatures_forgotten", self._signed.damage))
        for station in link_client.stations:
            notes += station.notes()
            if station.speaks_as == link_client.ids:
                ids = f"{link_client.ids.system}/{link_client.ids.component}"
                text = f"the ground station at {station.address} speaks as {ids}, as this bridge does: change `ids`"
                notes.append(Note("station_same_ids", text, str(station.address)))
        return notes + link_client.problems

    def counters(self, link_client: LinkClient) -> dict[str, float]:
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
            "foreign_packets": link_client.address.foreign,
            "link_dropped": came.dropped,
            "link_reopened": came.reopened,
        }
        if link_client.signing is not None:
            counters["refused_packets"] = came.refused
        if link_client.stations:
            each = [station.counters for station in link_client.stations]
            counters["forwarded"] = sum(one.to_station for one in each)
            counters["passed_on"] = sum(one.to_vehicle for one in each)
            counters["forward_dropped"] = sum(one.dropped for one in each)
            counters["forward_echoes"] = sum(one.echoes for one in each)
            counters["forward_astray"] = sum(one.astray for one in each)
        return counters

    def refuse(self, system: int, objection: str, peer: Peer) -> None:
        """Take in that a packet of a system (MAVLink id) was refused for its signature."""
        what, now = (system, objection, str(peer)), asyncio.get_running_loop().time()
        if objection == OUTDATED and now - peer.warned_at >= WARN_AGAIN:
            peer.warned_at = now
            self._send_time(system, peer)
        if what not in self._refused:
            self._refused = {other: at for other, at in self._refused.items() if at > now - STRANGE_FOR}
            if len(self._refused) >= MAX_NOTED:
                return
            log.warning("%s packets of system %d from %s are refused", objection, system, peer)
        self._refused[what] = now

    def _send_time(self, system: int, peer: Peer) -> None:
        """Send the time in a signature: a vehicle whose clock stood still takes it over, and is refused until then.

        It has no route yet, so nothing else would reach it. The message itself asks only for an answer.
        """
        link_client = self.link_clients.get(system)
        if link_client is not None and self.link is not None:
            asks = dialect.MAVLink_timesync_message(0, time.time_ns())
            self.link.send(asks, [peer], ids=link_client.ids, signing=link_client.signing)

    def _signing(self, link_client: LinkClient) -> Signing | None:
        """Return the signing of a key; all share one row of timestamps: a vehicle may hear packets to others."""
        if link_client.key is None:
            return None
        try:
            if self._timestamps is None:
                name = re.sub(r"[^A-Za-z0-9.-]+", "_", str(self.address))
                file = None if link_client.state is None else link_client.state / f"{name}.signing"
                self._timestamps = Timestamps(file)
                self._signed = SignedStreams(file and file.with_name(f"{name}.signed"))
        except (OSError, SigningError) as error:
            raise LinkError(f"link {self.address}: timestamps of signatures: {error}") from error
        return self._by_key.setdefault(
            link_client.key, Signing(link_client.key, self._timestamps, streams=self._signed)
        )

    def _attach(self, link_client: LinkClient, address: LinkAddress) -> None:
        station = self._stations.setdefault(str(address), GroundStation(address))
        try:
            station.attach(link_client.vehicle, lambda packet: self._pass_on(link_client, packet))
        except LinkError as error:
            log.error("%s", error)
            link_client.problems.append(Note("forward_refused", str(error), str(address)))
        else:
            link_client.stations.append(station)

    def _pass_on(self, link_client: LinkClient, packet: bytes) -> bool:
        """Send a packet to the autopilot, and to the other parts of the vehicle where they were heard."""
        if self.link is None:
            return False
        since, parts = asyncio.get_running_loop().time() - STILL_THERE, link_client.address.parts.values()
        homes = {*link_client.homes(self.link), *(home for home, at in parts if at > since)}
        return bool(homes) and self.link.pass_on(homes, packet, MAX_FOREIGN_BYTES)

    def _receive(self, message: dialect.MAVLink_message, peer: Peer) -> None:
        system = message.get_srcSystem()
        if link_client := self.link_clients.get(system):
            component, now = message.get_srcComponent(), asyncio.get_running_loop().time()
            if component != AUTOPILOT:
                counts = link_client.address.counts_of_part(component, peer, now)
            else:
                heartbeat, one_end = message.get_type() == "HEARTBEAT", self.link is None or not self.link.listens
                counts = one_end or link_client.address.counts(peer, now, heartbeat=heartbeat)
            if not counts:
                return
            link_client.signs = bool(message.get_header().incompat_flags & SIGNED)
            link_client.receive(message)
        elif message.get_type() == "HEARTBEAT" and message.autopilot != dialect.MAV_AUTOPILOT_INVALID:
            self.strange += 1
            self._strangers[system] = (str(peer), asyncio.get_running_loop().time())
            if len(self._strangers) > MAX_NOTED:
                del self._strangers[next(iter(self._strangers))]

    def _report_state(self, up: bool, why: str) -> None:
        log.info("link %s %s: %s", self.address, "up" if up else "down", why)
        for link_client in list(self.link_clients.values()):
            try:
                link_client.on_state(up)
            except Exception as error:  # of one robot: the link is opened again for all of them
                what = f"{self.address}: {link_client.robot} failed on a change of the link"
                asyncio.get_running_loop().call_exception_handler({"message": what, "exception": error})


class _ClientGate(Gate):
    """Lets through what the robots at the link read, and HEARTBEATs of other systems."""

    def __init__(self, link: SharedLink, peer: Peer) -> None:
        self._link, self._peer = link, peer

    def refusal(self, packet: bytearray, system: int, message_id: int) -> str:
        link_client = self._link.link_clients.get(system)
        if link_client is None:
            return "" if message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT else UNWANTED
        if message_id in link_client.unread:
            return UNWANTED
        objection = "" if link_client.signing is None else link_client.signing.objection(packet)
        if objection:
            self._link.refuse(system, objection, self._peer)
        return objection

    def copy(self, packet: bytearray, system: int, message_id: int) -> None:
        """Pass a packet to the ground stations of its vehicle, unless it comes back from one of them.

        What another address than that of a part of the vehicle says in its name may be our own copy. Where signatures
        are needed, an address is that of a vehicle once a packet from there was taken.
        """
        link, peer = self._link, self._peer
        link_client = link.link_clients.get(system)
        if link_client is None or not link_client.stations:
            return
        if link_client.signing is not None and system not in peer.systems:
            return
        _, component, _ = ids_of(packet)
        if link_client.address.is_home(component, peer, asyncio.get_running_loop().time()):
            for station in link_client.stations:
                station.copy(bytes(packet))
