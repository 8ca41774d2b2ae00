"""MAVLink packets in a stream of bytes: cutting them out, checking them, and packing our own."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.signing import SIGNATURE_BYTES, Signing

MAGIC_1 = 0xFE
MAGIC_2 = 0xFD
AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1: the component of a system that flies it."""
SIGNED = 0x01
"""The only incompatibility flag of MAVLink 2 that is defined; a packet with another one must be dropped."""

MAX_FALSE_STARTS = 16
"""What may look like a packet and be none in one datagram, before its rest is passed over: each costs a checksum, and
in a datagram of nothing else there may be 65000."""

_MAGIC = (MAGIC_1, MAGIC_2)
HEADER_1, HEADER_2 = 6, 10
"""Bytes before the payload."""
_CHECKSUM, _SIGNATURE = 2, SIGNATURE_BYTES


@dataclass(slots=True)
class WireCounters:
    """Received whole packets, and bytes outside of packets."""

    packets: int = 0
    skipped_bytes: int = 0  # bytes that belong to no packet (console text, noise)
    bad_checksums: int = 0  # what looked like a packet of a known type, with a wrong checksum
    unknown_packets: int = 0  # message ids that the dialect does not know: cannot be checked
    unreadable_packets: int = 0  # right checksum, but unknown flags or an impossible payload
    unwanted: int = 0  # right checksum, but nobody here reads such messages
    refused: int = 0  # right checksum, but unsigned, wrongly signed or replayed where signatures are needed


UNWANTED = "unwanted"
"""Why a packet is not read that nobody here reads."""


class Gate:
    """A framer's judgement of each packet before it is decoded. This one reads all of them."""

    def refusal(self, packet: bytearray, system: int, message_id: int) -> str:
        """Return why a packet of `system` (1..255) with a right checksum is not read; empty if it is.

        `UNWANTED`, or the objection of `Signing`. `message_id`: 0..16,777,215.
        """
        return ""

    def copy(self, packet: bytearray, system: int, message_id: int) -> None:
        """Take every packet of `system` (1..255) unchanged, of any `message_id`, read or not."""


class SignedGate(Gate):
    """Reads packets that are signed with the present key; without a key all of them."""

    def __init__(self, signing: Callable[[], Signing | None]) -> None:
        self._signing = signing

    def refusal(self, packet: bytearray, system: int, message_id: int) -> str:
        """Return the objection to a packet's signature."""
        signing = self._signing()
        return "" if signing is None else signing.objection(packet)


@cache
def _numbers(number: int) -> dialect.MAVLink_message | None:
    """Return the type of a message id of the dialect if its fields are numbers; None if it has texts or arrays."""
    kind = dialect.mavlink_map[number]
    return None if any(kind.array_lengths) else kind


class Framer:
    """Cuts MAVLink 1 and 2 packets out of the bytes of one peer.

    After a wrong checksum the search continues at the next byte, so a false start inside noise loses no packet.
    """

    def __init__(self, counters: WireCounters, gate: Gate | None = None) -> None:
        self.counters = counters
        self._gate = gate or Gate()
        self._decoder = dialect.MAVLink(None)
        self._pending = bytearray()

    def feed(self, data: bytes, *, datagram: bool = False) -> list[dialect.MAVLink_message]:
        """Read bytes of a stream (TCP, serial), in which packets may be cut anywhere, or one datagram.

        A packet across datagrams is joined, but noise at the end of one never delays the next.
        """
        pending, messages, at = self._pending, [], 0
        if datagram and pending and _starts_whole(data):
            self.counters.skipped_bytes += len(pending)
            pending.clear()
        pending += data
        false_starts = 0
        while at < len(pending):
            if datagram and false_starts >= MAX_FALSE_STARTS:
                self.counters.skipped_bytes += len(pending) - at
                at = len(pending)
                break
            if pending[at] not in _MAGIC:
                at += 1
                self.counters.skipped_bytes += 1
                continue
            length = _packet_length(pending, at)
            if length is None or at + length > len(pending):
                break
            packet = pending[at : at + length]
            system, _, number = ids_of(packet)
            if number not in dialect.mavlink_map:
                if at + length == len(pending) and not datagram:
                    break
                skip = self._pass_over(packet, system, number, pending[at + length : at + length + 1])
                false_starts += skip == 1
                at += skip
            elif not _checksum_agrees(packet, number):
                self.counters.bad_checksums += 1
                self.counters.skipped_bytes += 1
                false_starts += 1
                at += 1
            else:
                at += length
                if (message := self._read(packet, system, number)) is not None:
                    messages.append(message)
        del pending[:at]
        return messages

    def _pass_over(self, packet: bytearray, system: int, number: int, following: bytearray) -> int:
        """Return how much to skip of what cannot be checked: a packet only if another one, or nothing, follows it."""
        if not following or following[0] in _MAGIC:
            self.counters.unknown_packets += 1
            self._gate.copy(packet, system, number)
            return len(packet)
        self.counters.skipped_bytes += 1
        return 1

    def _read(self, packet: bytearray, system: int, number: int) -> dialect.MAVLink_message | None:
        """Return the message in a packet with a right checksum, None if it is not wanted or refused.

        pymavlink computes the checksum again, and takes twice the time for a message of numbers, as telemetry is.
        """
        self._gate.copy(packet, system, number)
        if packet[0] == MAGIC_2 and packet[2] & ~SIGNED:
            self.counters.unreadable_packets += 1
            return None
        if refusal := self._gate.refusal(packet, system, number):
            if refusal == UNWANTED:
                self.counters.unwanted += 1
            else:
                self.counters.refused += 1
            return None
        try:
            if packet[0] == MAGIC_1 or (kind := _numbers(number)) is None:
                message = self._decoder.decode(packet)
            else:
                payload = packet[HEADER_2 : HEADER_2 + packet[1]]
                payload = payload.ljust(kind.unpacker.size, b"\0")  # zeros at its end are not sent
                values = kind.unpacker.unpack_from(payload)
                message = kind(*[values[place] for place in kind.orders])
                header = message.get_header()
                header.mlen, header.incompat_flags, header.compat_flags = packet[1:4]
                header.seq, header.srcSystem, header.srcComponent = packet[4:7]
        except (dialect.MAVError, ValueError):
            self.counters.unreadable_packets += 1
            return None
        self.counters.packets += 1
        return message


class Encoder:
    """Packs our messages for one peer as MAVLink 2, with our ids and that peer's sequence numbers."""

    def __init__(self, system: int, component: int) -> None:
        """`system` and `component` (1..255) are our ids. Raises ValueError."""
        check_ids(system, component)
        self._protocol = dialect.MAVLink(None, srcSystem=system, srcComponent=component)

    def pack(self, message: dialect.MAVLink_message, signing: Signing | None = None) -> bytes:
        """Return the bytes of one packet, signed with `signing` if it is given.

        Raises ValueError if a field does not fit into its type.
        """
        if signing is None:
            self._protocol.signing.sign_outgoing = False
        else:
            signing.sign_with(self._protocol)
        try:
            packet: bytes = message.pack(self._protocol)
        except (struct.error, TypeError, OverflowError) as error:
            raise ValueError(f"{message.get_type()} cannot be packed: {error}") from error
        self._protocol.seq = (self._protocol.seq + 1) % 256
        return packet


def check_ids(system: int, component: int) -> None:
    """Raise ValueError unless `system` and `component` are MAVLink ids (1..255)."""
    if not (1 <= system <= 255 and 1 <= component <= 255):
        raise ValueError(f"system and component ids lie between 1 and 255, got {system}/{component}")


def ids_of(packet: bytes | bytearray) -> tuple[int, int, int]:
    """Return the system and component id of a packet's sender, and the message id."""
    if packet[0] == MAGIC_1:
        return packet[3], packet[4], packet[5]
    return packet[5], packet[6], packet[7] | packet[8] << 8 | packet[9] << 16


def _packet_length(data: bytearray, at: int) -> int | None:
    """Return the length of the packet at `at`, None while its header is incomplete."""
    if len(data) - at < 3:
        return None
    payload = data[at + 1]
    if data[at] == MAGIC_1:
        return HEADER_1 + payload + _CHECKSUM
    return HEADER_2 + payload + _CHECKSUM + (_SIGNATURE if data[at + 2] & SIGNED else 0)


def _checksum_agrees(packet: bytearray, number: int) -> bool:
    signed = packet[0] == MAGIC_2 and packet[2] & SIGNED
    end = len(packet) - _CHECKSUM - (_SIGNATURE if signed else 0)
    covered = packet[1:end]
    covered.append(dialect.mavlink_map[number].crc_extra)
    return bool(dialect.x25crc(covered).crc == packet[end] | packet[end + 1] << 8)


def _starts_whole(data: bytes) -> bool:
    if len(data) < 3 or data[0] not in _MAGIC:
        return False
    packet = bytearray(data[:300])
    length = _packet_length(packet, 0)
    if length is None or length > len(packet):
        return False
    packet = packet[:length]
    _, _, number = ids_of(packet)
    return number in dialect.mavlink_map and _checksum_agrees(packet, number)
