"""Faults of the simulated copter and its link: what passes, what does not, and that it can be repeated."""

from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.fault_injection import HELD_S, TABLE, Cut, Faults, LinkFaults, VehicleFaults

PACKETS = 4000


def air(text: str) -> LinkFaults:
    return LinkFaults(Faults.parse([text]), "down")


def carried(air: LinkFaults, count: int = PACKETS, step: float = 0.1) -> list[int]:
    """The numbers of the packets that come out, in their order."""
    out = [packet for number in range(count) for packet in air.carry(b"%d" % number, number * step)]
    return [int(packet) for packet in out + air.due(count * step + HELD_S)]


def test_nothing_is_wrong_if_nothing_is_said() -> None:
    assert Faults.parse([]) == Faults()
    assert carried(LinkFaults(Faults(), "up")) == list(range(PACKETS))


def test_faults_are_read_from_one_text_or_several() -> None:
    expected = Faults(loss=0.2, lie=True, mute_acks=True, cuts=(Cut(10, 60), Cut(100, 5)), reboots=(3.0, 30.0), seed=7)
    assert Faults.parse(["loss=0.2,lie", "mute-acks,cut=10+60,cut=100+5", "reboot=30,reboot=3,seed=7"]) == expected


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("rain", "expected one of loss=SHARE, duplicate=SHARE, .*, got 'rain'"),
        ("loss", "expected one of loss=SHARE, .*, got 'loss'"),
        ("lie=1", "expected one of .*, got 'lie=1'"),
        ("", "expected one of .*, got ''"),
        ("loss=2", r"expected loss=SHARE \(share \(0 to 1\) of packets that are lost, both ways\), got 'loss=2'"),
        ("loss=nan", "expected loss=SHARE"),
        ("cut=10", r"expected cut=AT\+SECONDS"),
        ("cut=10+x", r"expected cut=AT\+SECONDS"),
        ("reboot=-1", "expected reboot=AT"),
        ("seed=1.5", "expected seed=N"),
        ("pilot=5", "expected pilot="),
        ("pilot=5+x", "expected pilot="),
        ("pilot=5+3:crashes", "expected pilot="),
    ],
)
def test_a_fault_that_is_none_is_one_clear_line(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Faults.parse([text])


def test_lost_packets_are_as_many_as_asked_for_and_the_same_ones_each_time() -> None:
    first = carried(air("loss=0.2"))
    assert abs(len(first) - 0.8 * PACKETS) < 0.03 * PACKETS
    assert carried(air("loss=0.2")) == first
    assert carried(air("loss=0.2,seed=2")) != first
    assert carried(LinkFaults(Faults(loss=0.2), "up")) != first


def test_duplicates_come_one_after_the_other() -> None:
    out = carried(air("duplicate=0.1"))
    assert sorted(set(out)) == list(range(PACKETS))
    assert abs(len(out) - 1.1 * PACKETS) < 0.02 * PACKETS


def test_a_reordered_packet_comes_after_the_next_one_and_none_is_lost() -> None:
    out = carried(air("reorder=0.1"))
    assert sorted(out) == list(range(PACKETS))
    swapped = sum(one > other for one, other in pairwise(out))
    assert abs(swapped - 0.09 * PACKETS) < 0.02 * PACKETS
    assert all(abs(number - at) <= 1 for at, number in enumerate(out))


def test_a_held_back_packet_comes_late_if_no_other_one_follows() -> None:
    link = air("reorder=1")
    assert link.carry(b"alone", 10.0) == []
    assert link.due(10.0 + HELD_S / 2) == []
    assert link.due(10.0 + HELD_S) == [b"alone"]
    assert link.due(20.0) == []


def test_a_cut_link_carries_nothing_until_it_is_whole_again() -> None:
    link = air("cut=10+60")
    out = carried(link, 100, 1.0)
    assert out == [*range(10), *range(70, 100)]
    assert link.counters.lost == 60


def test_garbage_stands_between_packets_and_harms_none() -> None:
    link, encoder = air("garbage=0.3"), Encoder(1, 1)
    framer = Framer(WireCounters())
    heard = 0
    for number in range(1000):
        packet = encoder.pack(dialect.MAVLink_heartbeat_message(2, 3, 81, number, 4, 3))
        heard += sum(len(framer.feed(data, datagram=True)) for data in link.carry(packet, number))
    assert heard == 1000
    assert link.counters.garbage > 250
    assert framer.counters.skipped_bytes > 1000


def command(number: int) -> dialect.MAVLink_message:
    packet = Encoder(255, 190).pack(dialect.MAVLink_command_long_message(1, 1, number, 0, *([0.0] * 7)))
    (message,) = Framer(WireCounters()).feed(packet, datagram=True)
    return message


def test_a_liar_acknowledges_orders_and_still_tells_what_it_is_asked() -> None:
    liar = VehicleFaults(Faults(lie=True))
    (ack,) = liar.false_reply(command(400)) or []
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (400, 0, 255, 190)
    assert liar.false_reply(command(511)) is None
    assert VehicleFaults(Faults()).false_reply(command(400)) is None


def test_a_mute_vehicle_says_all_but_acknowledgements() -> None:
    ack = dialect.MAVLink_command_ack_message(400, 0)
    text = dialect.MAVLink_statustext_message(6, b"Arming motors")
    assert VehicleFaults(Faults(mute_acks=True)).applied_to([text, ack]) == [text]
    assert VehicleFaults(Faults()).applied_to([text, ack]) == [text, ack]


def test_a_vehicle_restarts_once_at_each_time() -> None:
    vehicle = VehicleFaults(Faults(reboots=(1.0, 5.0)))
    assert [second for second in range(10) if vehicle.restarts(second)] == [1, 5]


def test_the_page_of_the_simulated_copter_lists_all_faults_in_their_order() -> None:
    page = (Path(__file__).parents[4] / "docs/guides/simulation.md").read_text()
    table = [line for line in page.partition("## Faults of a vehicle")[2].splitlines() if line.startswith("| `")]
    assert table == [f"| `{row.form}` | {row.meaning} |" for row in TABLE.values()]


def switched(fault: str, *times: float, airborne: bool = True) -> list[Mode]:
    """Return the mode at each time of a vehicle that begins in GUIDED."""
    vehicle_faults, mode, found = VehicleFaults(Faults.parse([fault])), Mode.GUIDED, []
    for now in times:
        mode = Mode(vehicle_faults.switched_mode(now, mode, airborne=airborne) or mode)
        found.append(mode)
    return found


def test_a_pilot_has_a_vehicle_and_gives_it_back_in_its_mode() -> None:
    assert switched("pilot=5+10", 4, 5, 14, 15, 20) == [Mode.GUIDED, Mode.LOITER, Mode.LOITER, Mode.GUIDED, Mode.GUIDED]


def test_a_pilot_may_land_it() -> None:
    assert switched("pilot=5+10:lands", 6, 16) == [Mode.LOITER, Mode.LAND]


def test_a_pilot_leaves_a_vehicle_on_the_ground() -> None:
    assert switched("pilot=5+10", 6, airborne=False) == [Mode.GUIDED]


def test_a_vehicle_that_a_failsafe_puts_down_was_not_landed_by_the_pilot_who_had_it() -> None:
    for flies_to_the_end in (True, False):
        vehicle_faults = VehicleFaults(Faults.parse(["pilot=5+10:lands"]))
        vehicle_faults.switched_mode(6, Mode.GUIDED, airborne=True)
        vehicle_faults.switched_mode(16, Mode.LAND, airborne=flies_to_the_end)
        vehicle_faults.switched_mode(26, Mode.LAND, airborne=False)
        assert vehicle_faults.switch is None
        assert vehicle_faults.landed is flies_to_the_end
