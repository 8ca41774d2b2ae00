"""Signed packets: pymavlink takes ours and we take its, and nothing unsigned, forged or replayed gets through."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, SignedGate, WireCounters
from bridged.drivers.mavlink.transport.signing import (
    AHEAD,
    FAR_AHEAD,
    LATEST,
    MINUTE,
    OUTDATED,
    RESERVE,
    SignedStreams,
    Signing,
    SigningError,
    Timestamps,
    key_of,
    read_key,
)

KEY = key_of(b"argo")
BEAT = dialect.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3)


class Hand:
    """A clock that a test sets, in 10 us."""

    def __init__(self, at: int = 10 * MINUTE) -> None:
        self.at = at

    def __call__(self) -> int:
        return self.at


def pymavlinks(key: bytes = KEY, system: int = 1) -> dialect.MAVLink:
    """The other end, as pymavlink does it."""
    protocol = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    protocol.signing.secret_key = key
    protocol.signing.sign_outgoing = True
    protocol.signing.timestamp = 10 * MINUTE
    return protocol


def signing(clock: Hand | None = None, file: Path | None = None, key: bytes = KEY) -> Signing:
    return Signing(key, Timestamps(file, clock or Hand()))


def framer(by: Signing, counters: WireCounters | None = None) -> Framer:
    """One that takes only what is signed."""
    return Framer(counters or WireCounters(), SignedGate(lambda: by))


def timestamp(packet: bytes) -> int:
    return int.from_bytes(packet[-12:-6], "little")


def test_pymavlink_verifies_what_we_sign() -> None:
    vehicle, encoder, by = pymavlinks(), Encoder(255, 190), signing()
    for _ in range(3):
        assert vehicle.decode(bytearray(encoder.pack(BEAT, by))).get_signed()
    assert (vehicle.signing.goodsig_count, vehicle.signing.badsig_count) == (3, 0)


def test_we_verify_what_pymavlink_signs() -> None:
    vehicle, counters = pymavlinks(), WireCounters()
    reader = framer(signing(), counters)
    for _ in range(3):
        assert [one.get_type() for one in reader.feed(BEAT.pack(vehicle), datagram=True)] == ["HEARTBEAT"]
    assert (counters.packets, counters.refused) == (3, 0)


def test_unsigned_forged_and_replayed_packets_are_not_taken() -> None:
    counters, vehicle = WireCounters(), pymavlinks()
    reader = framer(signing(), counters)
    good = BEAT.pack(vehicle)
    assert reader.feed(good)
    tampered = bytearray(BEAT.pack(vehicle))
    tampered[-1] ^= 1
    version_1 = BEAT.pack(dialect.MAVLink(None, srcSystem=1, srcComponent=1), force_mavlink1=True)
    for packet in (good, Encoder(1, 1).pack(BEAT), version_1, BEAT.pack(pymavlinks(key_of(b"gold"))), bytes(tampered)):
        assert not reader.feed(packet)
    assert counters.refused == 5
    assert reader.feed(BEAT.pack(vehicle)), "what comes after them is taken"


def test_a_forged_timestamp_does_not_silence_the_true_sender() -> None:
    vehicle, forger = pymavlinks(), pymavlinks(key_of(b"gold"))
    forger.signing.timestamp = 2**47
    reader = framer(signing())
    assert not reader.feed(BEAT.pack(forger))
    assert reader.feed(BEAT.pack(vehicle))


def test_a_new_stream_may_be_a_minute_behind_and_not_more() -> None:
    clock, vehicle = Hand(), pymavlinks()
    vehicle.signing.timestamp = clock.at - MINUTE
    assert framer(signing(clock)).feed(BEAT.pack(vehicle))
    late = pymavlinks(system=2)
    late.signing.timestamp = clock.at - MINUTE - 1
    assert not framer(signing(clock)).feed(BEAT.pack(late))


def test_streams_of_one_link_are_told_apart_and_shared_by_its_peers() -> None:
    by = signing()
    here, there = framer(by), framer(by)
    one, two = pymavlinks(system=1), pymavlinks(system=2)
    two.signing.timestamp += 1000
    packet = BEAT.pack(two)
    assert here.feed(packet)
    assert there.feed(BEAT.pack(one)), "another system has its own timestamps"
    assert not there.feed(packet), "a replay from another address is a replay"


def test_our_timestamps_go_on_above_those_of_others() -> None:
    by, vehicle = signing(), pymavlinks()
    vehicle.signing.timestamp = ahead = 11 * MINUTE
    assert framer(by).feed(BEAT.pack(vehicle))
    assert timestamp(Encoder(255, 190).pack(BEAT, by)) > ahead


@pytest.mark.parametrize("ahead", [FAR_AHEAD + 1, LATEST - 10 - 10 * MINUTE])
def test_a_timestamp_near_the_end_of_time_is_not_taken_and_spoils_none_of_ours(tmp_path: Path, ahead: int) -> None:
    file, clock, vehicle = tmp_path / "link.signing", Hand(), pymavlinks()
    by = signing(clock, file)
    vehicle.signing.timestamp = clock.at + ahead
    assert by.objection(BEAT.pack(vehicle)) == "impossibly new"
    encoder = Encoder(255, 190)
    assert [timestamp(encoder.pack(BEAT, by)) for _ in range(20)] == list(range(clock.at, clock.at + 20))
    by.timestamps.close()
    assert Timestamps(file, clock).next() >= clock.at + 20, "the next life goes on"


def test_a_vehicle_with_the_time_of_today_is_taken_by_a_board_that_starts_at_the_beginning_of_time() -> None:
    assert not signing(Hand(1)).objection(BEAT.pack(pymavlinks()))
    today, vehicle = 12 * 365 * 24 * 60 * MINUTE, pymavlinks()
    vehicle.signing.timestamp = today
    assert not signing(Hand(1)).objection(BEAT.pack(vehicle))


def test_timestamps_rise_while_the_clock_stands_and_follow_it_when_it_goes() -> None:
    clock = Hand()
    encoder, by = Encoder(255, 190), signing(clock)
    first, second = timestamp(encoder.pack(BEAT, by)), timestamp(encoder.pack(BEAT, by))
    assert (first, second) == (clock.at, clock.at + 1)
    clock.at += 5000
    assert timestamp(encoder.pack(BEAT, by)) == clock.at


@pytest.mark.parametrize("cleanly", [True, False])
def test_no_life_of_the_bridge_signs_below_an_earlier_one(tmp_path: Path, cleanly: bool) -> None:
    file, clock, last = tmp_path / "state" / "link.signing", Hand(), 0
    for _ in range(5):
        timestamps = Timestamps(file, clock)
        for _ in range(3):
            following = timestamps.next()
            assert following > last
            last = following
        if cleanly:
            timestamps.close()
        clock.at -= MINUTE  # a board without a clock of its own starts in the past
    assert last - 10 * MINUTE < (100 if cleanly else 5 * (RESERVE + 100))


def test_the_file_is_written_once_a_minute_and_holds_more_than_what_was_used(tmp_path: Path) -> None:
    file, clock, written = tmp_path / "link.signing", Hand(), set()
    timestamps = Timestamps(file, clock)
    for _ in range(60):
        clock.at += MINUTE // 30
        assert timestamps.next() < int(file.read_text())
        written.add(file.read_text())
    assert len(written) <= 3


def test_a_file_that_can_no_longer_be_written_is_a_problem_and_no_silence(tmp_path: Path) -> None:
    file, clock = tmp_path / "gone" / "link.signing", Hand()
    timestamps = Timestamps(file, clock)
    file.unlink()
    file.parent.rmdir()
    assert timestamps.next() == clock.at
    assert timestamps.problem == f"{file}: no such file or directory"


def test_a_file_with_something_else_in_it_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "link.signing"
    file.write_text("soon\n")
    with pytest.raises(SigningError, match="expected one number, the last timestamp, got 'soon'"):
        Timestamps(file)


def test_a_passphrase_is_the_first_line_of_a_file_that_only_its_owner_reads(tmp_path: Path) -> None:
    file = tmp_path / "phrase"
    file.write_text("argo\nnotes\n")
    file.chmod(0o600)
    assert read_key(file) == KEY
    file.chmod(0o640)
    with pytest.raises(SigningError) as caught:
        read_key(file)
    assert str(caught.value) == f"{file}: others than its owner may use this file: do `chmod 600 {file}`"
    assert "argo" not in str(caught.value).replace(str(file), "")
    file.chmod(0o600)
    file.write_text("\n")
    with pytest.raises(SigningError, match="expected the passphrase in the first line, it is empty"):
        read_key(file)
    with pytest.raises(SigningError, match="missing: no such file or directory"):
        read_key(tmp_path / "missing")


def life(file: Path, clock: Hand, key: bytes = KEY) -> tuple[Signing, SignedStreams]:
    """What one life of a bridge checks by."""
    streams = SignedStreams(file)
    return Signing(key, Timestamps(None, clock), streams=streams), streams


@pytest.mark.parametrize("cleanly", [True, False])
def test_packets_of_before_are_not_taken_by_the_next_life_of_the_bridge(tmp_path: Path, cleanly: bool) -> None:
    file, clock, vehicle, camera = tmp_path / "link.signed", Hand(), pymavlinks(), pymavlinks()
    camera.srcComponent = 100
    by, streams = life(file, clock)
    packets = [BEAT.pack(one) for _ in range(50) for one in (vehicle, camera)]
    assert [by.objection(packet) for packet in packets] == [""] * 100
    if cleanly:
        streams.close()
    by, streams = life(file, clock)
    assert [by.objection(packet) for packet in packets] == [OUTDATED] * 100
    vehicle.signing.timestamp += 1 if cleanly else AHEAD
    assert by.objection(BEAT.pack(vehicle)) == "", "its next packet is, after a crash two seconds later at most"


def test_a_sender_that_is_behind_after_a_crash_is_told_a_time_at_which_it_is_taken(tmp_path: Path) -> None:
    """Its clock stands still: it goes on above what it hears, as the devguide says."""
    file, clock, vehicle = tmp_path / "link.signed", Hand(), pymavlinks()
    by, _ = life(file, clock)
    vehicle.signing.timestamp = clock.at + 5 * MINUTE
    assert by.objection(BEAT.pack(vehicle)) == ""
    by, _ = life(file, clock)
    assert by.objection(BEAT.pack(vehicle)) == OUTDATED
    vehicle.signing.timestamp = max(vehicle.signing.timestamp, timestamp(Encoder(255, 190).pack(BEAT, by)) + 1)
    assert by.objection(BEAT.pack(vehicle)) == ""


def test_another_key_begins_its_streams_at_their_beginning(tmp_path: Path) -> None:
    file, clock, late = tmp_path / "link.signed", Hand(), pymavlinks(key_of(b"gold"))
    by, streams = life(file, clock)
    assert by.objection(BEAT.pack(pymavlinks())) == ""
    streams.close()
    by, _ = life(file, clock, key_of(b"gold"))
    late.signing.timestamp -= 1000
    assert by.objection(BEAT.pack(late)) == ""
    assert KEY.hex() not in file.read_text()


def test_bounds_are_written_every_two_seconds_and_not_for_every_packet(tmp_path: Path) -> None:
    file, clock, vehicle, written = tmp_path / "link.signed", Hand(), pymavlinks(), set()
    by, _ = life(file, clock)
    for _ in range(200):  # 10 s at 20 Hz
        vehicle.signing.timestamp += MINUTE // 1200
        assert by.objection(BEAT.pack(vehicle)) == ""
        written.add(file.read_text())
    assert len(written) <= 6


@pytest.mark.parametrize("at", [0, 10, 40, -3])
def test_a_damaged_file_is_told_whichever_byte_was_hit_and_the_vehicle_is_heard(
    tmp_path: Path, at: int, caplog: pytest.LogCaptureFixture
) -> None:
    file, clock, vehicle = tmp_path / "link.signed", Hand(), pymavlinks()
    by, streams = life(file, clock)
    assert by.objection(BEAT.pack(vehicle)) == ""
    streams.close()
    torn = bytearray(file.read_bytes())
    torn[at] ^= 0x85
    file.write_bytes(torn)
    by, streams = life(file, clock)
    assert streams.damage.startswith(f"{file} is damaged (")
    assert streams.damage in caplog.text
    assert by.objection(BEAT.pack(vehicle)) == ""


def test_bounds_that_can_no_longer_be_written_are_a_problem_and_no_silence(tmp_path: Path) -> None:
    by, streams = life(tmp_path / "gone" / "link.signed", Hand())
    assert by.objection(BEAT.pack(pymavlinks())) == ""
    assert streams.problem == f"{tmp_path / 'gone' / 'link.signed'}: no such file or directory"
