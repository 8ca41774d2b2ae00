"""MAVLink packets in a stream of bytes: cutting them out, checking them, and packing our own."""

import struct
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

MAGIC_1 = 0xFE
MAGIC_2 = 0xFD
SIGNED = 0x01
"""The only incompatibility flag of MAVLink 2 that is defined; a packet with another one must be dropped."""

_MAGIC = (MAGIC_1, MAGIC_2)
_HEADER_1, _HEADER_2, _CHECKSUM, _SIGNATURE = 6, 10, 2, 13


@dataclass(slots=True)
class WireCounters:
    """What came in: whole packets, and everything that was not one."""

    packets: int = 0
    skipped_bytes: int = 0  # bytes that belong to no packet (console text, noise)
    bad_checksums: int = 0  # what looked like a packet of a known type, with a wrong checksum
    unknown_packets: int = 0  # message ids that the dialect does not know: cannot be checked
    unreadable_packets: int = 0  # right checksum, but unknown flags, a wrong signature or an impossible payload


class Framer:
    """Cuts MAVLink 1 and 2 packets out of what one peer sends, whatever the bytes are.

    After a wrong checksum the search goes on at the next byte, so a false start inside noise loses no packet.
    """

    def __init__(self, counters: WireCounters) -> None:
        self.counters = counters
        self._decoder = dialect.MAVLink(None)
        self._pending = bytearray()

    def feed(self, data: bytes) -> list[dialect.MAVLink_message]:
        """Bytes of a stream (TCP, serial): packets may be cut anywhere."""
        self._pending += data
        return self._packets(ends_here=False)

    def feed_datagram(self, data: bytes) -> list[dialect.MAVLink_message]:
        """One datagram. Packets cut by a datagram's border are joined, but noise at its end never delays the next."""
        if self._pending and _starts_whole(data):
            self.counters.skipped_bytes += len(self._pending)
            self._pending.clear()
        self._pending += data
        return self._packets(ends_here=True)

    def _packets(self, *, ends_here: bool) -> list[dialect.MAVLink_message]:
        pending, messages, at = self._pending, [], 0
        while at < len(pending):
            if pending[at] not in _MAGIC:
                at += 1
                self.counters.skipped_bytes += 1
                continue
            length = _packet_length(pending, at)
            if length is None or at + length > len(pending):
                break
            packet = pending[at : at + length]
            if _message_id(packet) in dialect.mavlink_map:
                message, used = self._decode(packet)
            elif at + length == len(pending) and not ends_here:
                break
            else:
                message, used = None, self._pass_over(length, pending[at + length : at + length + 1])
            at += used
            if message is not None:
                messages.append(message)
        del pending[:at]
        return messages

    def _pass_over(self, length: int, following: bytearray) -> int:
        """How much to skip of what cannot be checked: it is one packet only if another one, or nothing, follows it."""
        if not following or following[0] in _MAGIC:
            self.counters.unknown_packets += 1
            return length
        self.counters.skipped_bytes += 1
        return 1

    def _decode(self, packet: bytearray) -> tuple[dialect.MAVLink_message | None, int]:
        """The message in `packet`, and how many bytes are done with."""
        try:
            message = self._decoder.decode(packet)
        except (dialect.MAVError, ValueError):
            if _checksum_agrees(packet):
                self.counters.unreadable_packets += 1
                return None, len(packet)
            self.counters.bad_checksums += 1
            self.counters.skipped_bytes += 1
            return None, 1
        if packet[0] == MAGIC_2 and packet[2] & ~SIGNED:
            self.counters.unreadable_packets += 1
            return None, len(packet)
        self.counters.packets += 1
        return message, len(packet)


class Encoder:
    """Packs our messages for one peer as MAVLink 2, with our ids and that peer's sequence numbers."""

    def __init__(self, system: int, component: int) -> None:
        if not (1 <= system <= 255 and 1 <= component <= 255):
            raise ValueError(f"system and component ids lie between 1 and 255, got {system}/{component}")
        self._protocol = dialect.MAVLink(None, srcSystem=system, srcComponent=component)

    def pack(self, message: dialect.MAVLink_message) -> bytes:
        """The bytes of one packet. Raises ValueError if a field does not fit into its type."""
        try:
            packet: bytes = message.pack(self._protocol)
        except (struct.error, TypeError, OverflowError) as error:
            raise ValueError(f"{message.get_type()} cannot be packed: {error}") from error
        self._protocol.seq = (self._protocol.seq + 1) % 256
        return packet


def _packet_length(data: bytearray, at: int) -> int | None:
    """Length of the packet that starts at `at`, None while its header is not there yet."""
    if len(data) - at < 3:
        return None
    payload = data[at + 1]
    if data[at] == MAGIC_1:
        return _HEADER_1 + payload + _CHECKSUM
    return _HEADER_2 + payload + _CHECKSUM + (_SIGNATURE if data[at + 2] & SIGNED else 0)


def _message_id(packet: bytearray) -> int:
    if packet[0] == MAGIC_1:
        return packet[5]
    return packet[7] | packet[8] << 8 | packet[9] << 16


def _checksum_agrees(packet: bytearray) -> bool:
    signed = packet[0] == MAGIC_2 and bool(packet[2] & SIGNED)
    end = len(packet) - _CHECKSUM - (_SIGNATURE if signed else 0)
    covered = packet[1:end]
    covered.append(dialect.mavlink_map[_message_id(packet)].crc_extra)
    return bool(dialect.x25crc(covered).crc == packet[end] | packet[end + 1] << 8)


def _starts_whole(data: bytes) -> bool:
    if len(data) < 3 or data[0] not in _MAGIC:
        return False
    packet = bytearray(data[:300])
    length = _packet_length(packet, 0)
    if length is None or length > len(packet):
        return False
    packet = packet[:length]
    return _message_id(packet) in dialect.mavlink_map and _checksum_agrees(packet)
