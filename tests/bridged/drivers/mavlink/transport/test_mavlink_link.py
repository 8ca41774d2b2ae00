import asyncio
import contextlib
import os
import pty
import socket
from functools import partial
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport import link as link_module
from bridged.drivers.mavlink.transport.address import LinkAddress, LinkAddressError
from bridged.drivers.mavlink.transport.endpoint import PASSES, PASSES_IN_A_ROW, ROOM_EACH, UdpSocket
from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.drivers.mavlink.transport.link import MAX_PEERS, Link, LinkError, open_link
from commd.common.wakeup_coalescing import CoalescingLoop
from tests.support.amount import some_of
from tests.support.buses import until
from tests.support.ports import free_port

LARGEST_BUFFER = int(Path("/proc/sys/net/core/rmem_max").read_text())
"""Bytes of a receive buffer that the kernel grants, as it is asked for; it holds twice as many."""


def heartbeat() -> dialect.MAVLink_message:
    return dialect.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3)


class Ear:
    """Collects what a link hears."""

    def __init__(self) -> None:
        self.heard: list[tuple[int, str, str]] = []
        self.states: list[bool] = []

    def packet(self, message: dialect.MAVLink_message, peer: object) -> None:
        self.heard.append((message.get_srcSystem(), message.get_type(), str(peer)))

    def state(self, up: bool, why: str) -> None:
        self.states.append(up)

    async def open(self, text: str, system: int) -> Link:
        address = LinkAddress.parse(text)
        return await open_link(address, self.packet, system=system, component=1, on_state=self.state)


@pytest.mark.parametrize(
    "text",
    [
        "udpin:127.0.0.1:14550",
        "udpout:vehicle.local:14550",
        "tcp:127.0.0.1:5760",
        "tcpin:0.0.0.0:5760",
        "udpin:[::1]:14550",
        "serial:/dev/ttyAMA0:921600",
        "serial:/dev/serial/by-id/usb-a:b:57600",
    ],
)
def test_a_link_string_reads_and_writes_back(text: str) -> None:
    assert str(LinkAddress.parse(text)) == text


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "expected udpin:HOST:PORT, udpout:"),
        ("udp:127.0.0.1:1", "expected udpin:HOST:PORT, udpout:"),
        ("udpin:14550", "expected udpin:HOST:PORT"),
        ("udpin::14550", "expected udpin:HOST:PORT"),
        ("tcp:localhost:port", "expected a number after the last colon (tcp:HOST:PORT), got 'port'"),
        ("tcp:localhost:65536", "expected a port between 1 and 65535, got 65536"),
        ("udpout:localhost:0", "expected a port between 1 and 65535, got 0"),
        ("udpin:::1:14550", "an IPv6 host is written in brackets, as in [::1]"),
        ("udpin:a b:14550", "expected a host name or an address, got 'a b'"),
        ("serial:/dev/ttyS0", "expected serial:DEVICE:BAUD"),
        ("serial:/dev/ttyS0:12345", "expected a usual baud rate such as 57600, 115200 or 921600, got 12345"),
    ],
)
def test_a_wrong_link_string_says_what_was_expected(text: str, problem: str) -> None:
    with pytest.raises(LinkAddressError) as caught:
        LinkAddress.parse(text)
    assert str(caught.value).startswith(f"link {text!r}: ")
    assert problem in str(caught.value)


@given(st.text())
def test_no_link_string_raises_anything_else(text: str) -> None:
    with contextlib.suppress(LinkAddressError):
        LinkAddress.parse(text)


def test_packets_between_console_text_and_noise_are_all_found() -> None:
    encoder, counters = Encoder(1, 1), WireCounters()
    framer = Framer(counters)
    stream = b"ArduPilot ready\n" + encoder.pack(heartbeat()) + b"\xfd\xff\x00\xfe" + encoder.pack(heartbeat())
    stream += encoder.pack(heartbeat())
    padding = encoder.pack(dialect.MAVLink_statustext_message(6, b"x" * 50)) * 6
    found = [message.get_type() for byte in stream + padding for message in framer.feed(bytes([byte]))]
    assert found == ["HEARTBEAT"] * 3 + ["STATUSTEXT"] * 6
    assert counters.skipped_bytes == len(b"ArduPilot ready\n") + 4


def test_a_wrong_checksum_is_counted_and_the_next_packet_is_read() -> None:
    encoder, counters = Encoder(1, 1), WireCounters()
    bad = bytearray(encoder.pack(heartbeat()))
    bad[-1] ^= 0xFF
    found = list(Framer(counters).feed(bytes(bad) + encoder.pack(heartbeat()), datagram=True))
    assert (len(found), counters.bad_checksums, counters.packets) == (1, 1, 1)


def test_a_packet_cut_by_a_datagram_border_is_joined() -> None:
    framer = Framer(WireCounters())
    packet = Encoder(1, 1).pack(heartbeat())
    assert not list(framer.feed(packet[:9], datagram=True))
    assert len(list(framer.feed(packet[9:], datagram=True))) == 1


def test_noise_at_the_end_of_a_datagram_does_not_delay_the_next_one() -> None:
    framer, encoder = Framer(WireCounters()), Encoder(1, 1)
    assert not list(framer.feed(b"\xfd\xff\x00", datagram=True))
    assert len(list(framer.feed(encoder.pack(heartbeat()), datagram=True))) == 1


@pytest.mark.parametrize("rubbish", [b"\xfe" * 65000, (b"\xfd\xff" + bytes(8)) * 6500])
def test_a_datagram_full_of_false_starts_costs_a_few_checksums_and_not_the_packet_after_it(rubbish: bytes) -> None:
    counters, encoder = WireCounters(), Encoder(1, 1)
    framer = Framer(counters)
    good = encoder.pack(heartbeat())
    assert len(framer.feed(good * 20 + b"\xfe\x01\x00" * 3 + good, datagram=True)) == 21, "a little noise loses nothing"
    before = counters.bad_checksums
    assert not framer.feed(rubbish, datagram=True)
    assert counters.bad_checksums - before <= 16
    assert counters.skipped_bytes >= len(rubbish)
    assert framer.feed(good, datagram=True)


def test_unknown_message_ids_and_unknown_flags_are_counted_not_delivered() -> None:
    counters, encoder = WireCounters(), Encoder(1, 1)
    unknown = bytearray(encoder.pack(heartbeat()))
    unknown[7:10] = (60000).to_bytes(3, "little")
    flagged = bytearray(encoder.pack(heartbeat()))
    flagged[2] = 0x80
    flagged[-2:] = dialect.x25crc(flagged[1:-2] + bytes([dialect.MAVLink_heartbeat_message.crc_extra])).crc.to_bytes(
        2, "little"
    )
    found = list(Framer(counters).feed(bytes(unknown + flagged) + encoder.pack(heartbeat())))
    assert (len(found), counters.unknown_packets, counters.unreadable_packets) == (1, 1, 1)


@pytest.mark.parametrize("zeros", [False, True])
def test_each_message_is_read_as_pymavlink_reads_it(zeros: bool) -> None:
    dice, protocol = Random(1), dialect.MAVLink(None, srcSystem=7, srcComponent=9)
    for number, kind in dialect.mavlink_map.items():
        payload = bytes(kind.unpacker.size) if zeros else dice.randbytes(kind.unpacker.size)
        message = dialect.MAVLink_message(number, kind.msgname)
        packet = message._pack(protocol, kind.crc_extra, payload)
        [read], expected = Framer(WireCounters()).feed(packet), dialect.MAVLink(None).decode(bytearray(packet))
        assert vars(read.get_header()) == vars(expected.get_header())
        assert repr(read.to_dict()) == repr(expected.to_dict())  # as text: not a number equals itself


def test_a_mavlink_1_packet_is_read() -> None:
    packet = heartbeat().pack(dialect.MAVLink(None, srcSystem=7, srcComponent=1), force_mavlink1=True)
    assert [message.get_srcSystem() for message in Framer(WireCounters()).feed(packet)] == [7]


@settings(max_examples=some_of(300))
@given(st.lists(st.binary(max_size=400), max_size=5), st.booleans())
def test_no_bytes_break_the_framer_and_a_packet_after_them_arrives(noise: list[bytes], datagrams: bool) -> None:
    framer, encoder = Framer(WireCounters()), Encoder(3, 1)
    feed = partial(framer.feed, datagram=datagrams)
    for data in noise:
        list(feed(data))
    # A false start may wait for up to 280 bytes more before it is given up.
    found = [m.get_type() for _ in range(30) for m in feed(encoder.pack(heartbeat()))]
    assert "HEARTBEAT" in found


@settings(max_examples=some_of(200))
@given(st.integers(0, 60000), st.binary(max_size=255), st.binary(min_size=6, max_size=6))
def test_no_payload_with_a_right_checksum_breaks_the_framer(msgid: int, payload: bytes, header: bytes) -> None:
    known = sorted(dialect.mavlink_map)
    message_id = known[msgid % len(known)]
    body = bytes([len(payload), header[0] & 1, 0, *header[1:4]]) + message_id.to_bytes(3, "little") + payload
    crc = dialect.x25crc(bytearray(body) + bytes([dialect.mavlink_map[message_id].crc_extra])).crc
    list(Framer(WireCounters()).feed(b"\xfd" + body + crc.to_bytes(2, "little") + bytes(13)))


def test_a_field_out_of_range_is_a_value_error_with_the_message_name() -> None:
    with pytest.raises(ValueError, match="HEARTBEAT cannot be packed"):
        Encoder(1, 1).pack(dialect.MAVLink_heartbeat_message(999, 3, 0, 0, 0, 3))


async def test_a_listening_link_answers_each_system_where_it_was_heard() -> None:
    station, one, two = Ear(), Ear(), Ear()
    port = free_port()
    listening = await station.open(f"udpin:127.0.0.1:{port}", 255)
    first = await one.open(f"udpout:127.0.0.1:{port}", 1)
    second = await two.open(f"udpout:127.0.0.1:{port}", 2)
    assert not listening.send(heartbeat())
    first.send(heartbeat())
    second.send(heartbeat())
    await until(lambda: len(station.heard) == 2, "both vehicles heard")
    assert listening.send(heartbeat(), listening.peers_of(2))
    await until(lambda: len(two.heard) == 1, "vehicle 2 answered")
    assert not one.heard
    assert not listening.peers_of(9)
    assert listening.send(heartbeat())
    await until(lambda: bool(one.heard) and len(two.heard) == 2, "everybody answered")
    await first.close()
    again = await one.open(f"udpout:127.0.0.1:{port}", 1)
    again.send(heartbeat())
    await until(lambda: len(listening.peers_of(1)) == 2, "vehicle 1 speaks from another address")
    listening.send(heartbeat(), listening.peers_of(1)[-1:])
    await until(lambda: len(one.heard) == 2, "vehicle 1 answered at its new address")
    for link in (listening, again, second):
        await link.close()


async def test_a_port_that_is_taken_is_one_clear_error() -> None:
    ear = Ear()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=f"link udpin:127.0.0.1:{port} cannot be opened: address already in"):
            await ear.open(f"udpin:127.0.0.1:{port}", 255)
    with pytest.raises(LinkError, match="link serial:/dev/null:57600 cannot be opened: it is not a serial device"):
        await ear.open("serial:/dev/null:57600", 255)
    with pytest.raises(LinkError, match="cannot be opened: no such file or directory"):
        await ear.open("serial:/dev/no_such_device:57600", 255)


async def test_a_tcp_link_waits_for_its_peer_and_comes_back_after_a_drop() -> None:
    station, vehicle = Ear(), Ear()
    port = free_port()
    calling = await station.open(f"tcp:127.0.0.1:{port}", 255)
    assert not calling.send(heartbeat())
    assert calling.counters.dropped == 1
    listening = await vehicle.open(f"tcpin:127.0.0.1:{port}", 1)
    await until(lambda: calling.up, "connected")
    calling.send(heartbeat())
    await until(lambda: bool(vehicle.heard), "vehicle heard the station")
    listening.send(heartbeat(), listening.peers_of(255))
    await until(lambda: bool(station.heard), "station heard the vehicle")
    await listening.close()
    await until(lambda: not calling.up, "loss noticed")
    assert calling.why
    listening = await vehicle.open(f"tcpin:127.0.0.1:{port}", 1)
    await until(lambda: calling.up, "connected again")
    assert calling.counters.reopened == 1
    assert station.states == [True, False, True]
    await calling.close()
    await listening.close()


async def test_a_serial_line_carries_packets_both_ways_and_its_loss_is_noticed() -> None:
    far, near = pty.openpty()
    name = os.ttyname(near)
    ear = Ear()
    line = await ear.open(f"serial:{name}:57600", 255)
    os.close(near)
    await until(lambda: line.up, "open")
    os.write(far, b"boot text\n" + Encoder(1, 1).pack(heartbeat()))
    await until(lambda: bool(ear.heard), "heard over the line")
    assert line.counters.skipped_bytes == len(b"boot text\n")
    assert line.send(heartbeat(), line.peers_of(1))
    assert os.read(far, 100) == Encoder(255, 1).pack(heartbeat())
    os.close(far)
    await until(lambda: not line.up, "unplugged")
    assert not line.send(heartbeat())
    await line.close()
    await line.close()


async def test_a_peer_that_does_not_read_costs_packets_not_memory() -> None:
    port = free_port()
    vehicle = Ear()
    listening = await vehicle.open(f"tcpin:127.0.0.1:{port}", 1)
    with socket.create_connection(("127.0.0.1", port)) as deaf:
        deaf.send(Encoder(255, 1).pack(heartbeat()))
        await until(lambda: bool(vehicle.heard), "the client is known")
        text = dialect.MAVLink_statustext_message(6, b"x" * 50)
        async with asyncio.timeout(240):
            while not listening.counters.dropped:
                listening.send(text)
                await asyncio.sleep(0)
    await listening.close()


async def test_silent_connections_take_no_place_from_a_speaker_and_are_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_module, "MAX_PEERS", 4)
    port, vehicle = free_port(), Ear()
    listening = await vehicle.open(f"tcpin:127.0.0.1:{port}", 1)
    speaking, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(Encoder(255, 1).pack(heartbeat()))
    await until(lambda: bool(vehicle.heard), "the client is known")
    silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(8)]
    async with asyncio.timeout(60):
        for reader, _ in silent[:5]:
            with contextlib.suppress(ConnectionError):
                assert await reader.read() == b"", "it is closed"
    listening.send(heartbeat(), listening.peers_of(255))
    assert await speaking.readexactly(1)
    for _, end in (*silent, (speaking, writer)):
        end.close()
    await listening.close()


async def test_an_error_in_the_handler_does_not_end_the_link() -> None:
    port, seen, complaints = free_port(), [], []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context["message"]))

    def clumsy(message: dialect.MAVLink_message, _: object) -> None:
        seen.append(message)
        raise RuntimeError("clumsy")

    listening = await open_link(LinkAddress.parse(f"udpin:127.0.0.1:{port}"), clumsy, system=255, component=1)
    calling = await Ear().open(f"udpout:127.0.0.1:{port}", 1)
    calling.send(heartbeat())
    calling.send(heartbeat())
    await until(lambda: len(seen) == 2, "the second packet was handled too")
    assert complaints == [f"udpin:127.0.0.1:{port}: handling HEARTBEAT failed"] * 2
    await listening.close()
    await calling.close()


async def test_a_link_has_as_many_vehicles_as_there_are_system_ids_and_answers_each_where_it_speaks() -> None:
    station, port = Ear(), free_port()
    listening = await station.open(f"udpin:127.0.0.1:{port}", 255)
    with contextlib.ExitStack() as stack:
        vehicles = {}
        for system in range(1, 255):
            vehicle = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            vehicle.setblocking(False)
            vehicles[system] = vehicle
        for _ in range(2):
            for system, vehicle in vehicles.items():
                vehicle.sendto(Encoder(system, 1).pack(heartbeat()), ("127.0.0.1", port))
                await asyncio.sleep(0)
        await until(lambda: len(station.heard) == 2 * len(vehicles), "all vehicles are heard twice")
        assert len(listening.peers) == len(vehicles)
        for system in vehicles:
            [peer] = listening.peers_of(system)
            assert listening.send(heartbeat(), [peer])
        loop = asyncio.get_running_loop()
        for vehicle in vehicles.values():
            assert await asyncio.wait_for(loop.sock_recv(vehicle, 300), 120)
    await listening.close()


def test_a_quiet_link_is_read_as_it_sends_and_a_busy_one_in_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    passes, take = list[float](), UdpSocket.datagram_received

    def note(wire: UdpSocket, data: bytes, addr: tuple[str, int]) -> None:
        passes.append(asyncio.get_running_loop().time())
        take(wire, data, addr)

    monkeypatch.setattr(UdpSocket, "datagram_received", note)

    async def talk() -> None:
        station, vehicle, port = Ear(), Ear(), free_port()
        listening = await station.open(f"udpin:127.0.0.1:{port}", 255)
        calling = await vehicle.open(f"udpout:127.0.0.1:{port}", 1)
        for sent in range(1, 5):
            calling.send(heartbeat())
            await until(lambda sent=sent: len(station.heard) == sent, "each is read")  # type: ignore[misc]
        assert len(passes) == 4
        loop = asyncio.get_running_loop()
        begun = loop.time()

        def send(left: int) -> None:
            calling.send(heartbeat())
            if left > 1:
                loop.call_later(0.001, send, left - 1)

        send(300)
        await until(lambda: len(station.heard) == 304, "all are read")
        assert len(passes) - 4 <= PASSES_IN_A_ROW + PASSES * (loop.time() - begun) + 1
        await calling.close()
        await listening.close()

    with asyncio.Runner(loop_factory=CoalescingLoop) as runner:
        runner.run(talk())


async def test_what_waits_to_be_read_has_more_room_the_more_vehicles_speak_and_no_more_for_one() -> None:
    rooms = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        unasked = other.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    station, port = Ear(), free_port()
    listening = await station.open(f"udpin:127.0.0.1:{port}", 255)
    wire = listening._endpoint._present.close.__self__._transport.get_extra_info("socket")  # type: ignore[union-attr]
    with contextlib.ExitStack() as stack:
        for system in range(1, 201):
            vehicle = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            vehicle.sendto(Encoder(system, 1).pack(heartbeat()), ("127.0.0.1", port))
            if system in (1, 200):
                await until(lambda system=system: len(station.heard) == system, "all are heard")  # type: ignore[misc]
                rooms.append(wire.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF))
            await asyncio.sleep(0)
    await listening.close()
    most = 2 * LARGEST_BUFFER
    assert rooms[0] == unasked
    assert rooms[1] >= min(most, 2 * 200 * ROOM_EACH)


async def test_noise_from_many_addresses_neither_grows_the_link_nor_drives_a_vehicle_out() -> None:
    station, vehicle, port = Ear(), Ear(), free_port()
    listening = await station.open(f"udpin:127.0.0.1:{port}", 255)
    calling = await vehicle.open(f"udpout:127.0.0.1:{port}", 1)
    calling.send(heartbeat())
    await until(lambda: bool(station.heard), "the vehicle is heard")
    random = Random(1)
    for _ in range(4 * MAX_PEERS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noisy:
            noisy.sendto(random.randbytes(random.randrange(1, 400)), ("127.0.0.1", port))
        await asyncio.sleep(0)
    await until(lambda: listening.counters.skipped_bytes > 0, "noise read")
    assert len(listening.peers) == 1
    assert listening.send(heartbeat(), listening.peers_of(1))
    await until(lambda: bool(vehicle.heard), "the vehicle is answered")
    await listening.close()
    await calling.close()
