"""What holds for all six kinds of simulated vehicles: they bear anything, and have all faults."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.kinds import COPTER, KINDS
from tests.bridged.attended_vehicle import NAN, AttendedVehicle
from tests.bridged.simulation.vehicle.ardupilot.test_simulated_copter_fuzzed import messages
from tests.bridged.sky import HOME
from tests.support.amount import some_of

ALL = sorted(KINDS)


def depart(vehicle: AttendedVehicle, kind: str, autopilot: str) -> None:
    """Lets it take off, or drive."""
    if (kind, autopilot) == ("plane", "ardupilot"):
        assert vehicle.command(176, 1, 13) == 0
    elif autopilot == "ardupilot":
        assert vehicle.command(176, 1, 15 if kind == "rover" else 4) == 0
    assert vehicle.command(400, 1) == 0
    if kind == "rover":
        goal = vehicle.autopilot.chart.place(vehicle.at)
        assert vehicle.say(
            dialect.MAVLink_command_int_message(1, 1, 6, 192, 0, 0, -1, 1, 0, NAN, goal.lat_e7 + 10_000, goal.lon_e7, 0)
        )
    elif autopilot == "px4":
        assert vehicle.command(22, -1, 0, 0, NAN, NAN, NAN, HOME.alt + 20) == 0
    elif kind == "copter":
        assert vehicle.command(22, 0, 0, 0, 0, 0, 0, 20) == 0
    vehicle.wait(8.0)


@pytest.mark.parametrize(("kind", "autopilot"), ALL)
def test_it_says_what_it_is_and_departs(kind: str, autopilot: str) -> None:
    vehicle = AttendedVehicle(kind, autopilot)
    depart(vehicle, kind, autopilot)
    beat = vehicle.last("HEARTBEAT")
    assert beat.autopilot == {"ardupilot": 3, "px4": 12}[autopilot]
    assert beat.type == {"copter": 2, "plane": 1, "rover": 10}[kind]
    assert vehicle.speed > 0.5


@pytest.mark.parametrize(("kind", "autopilot"), ALL)
@settings(max_examples=some_of(60, 8), deadline=None)
@given(story=st.lists(st.tuples(messages(), st.floats(0, 3)), max_size=25), under_way=st.booleans())
def test_no_messages_break_it(
    kind: str, autopilot: str, story: list[tuple[dialect.MAVLink_message, float]], under_way: bool
) -> None:
    vehicle = AttendedVehicle(kind, autopilot)
    if under_way:
        depart(vehicle, kind, autopilot)
    for message, pause in story:
        vehicle._hear(vehicle.vehicle.receive(message))
        vehicle.wait(pause)
    vehicle.wait(5.0)
    assert any(message.get_type() == "HEARTBEAT" for message in vehicle.wait(3.0))


@pytest.mark.parametrize(
    "fault",
    ["wind=8:270:2", "gps-loss=20+15", "gps-jump=20+10:20", "pilot=20+10", "pilot=20+10:lands", "reboot=25",
     "lie", "mute-acks", "prearm=3:Compass not calibrated"],
)  # fmt: skip
@pytest.mark.parametrize(("kind", "autopilot"), ALL)
def test_it_goes_on_with_any_fault(kind: str, autopilot: str, fault: str) -> None:
    vehicle = AttendedVehicle(kind, autopilot, fault)
    if fault not in ("lie", "mute-acks"):
        depart(vehicle, kind, autopilot)
    vehicle.wait(60.0)
    assert any(message.get_type() == "HEARTBEAT" for message in vehicle.wait(3.0))


def test_the_same_messages_lead_to_the_same_flight() -> None:
    for kind, autopilot in ALL:
        flights = []
        for _ in range(2):
            vehicle = AttendedVehicle(kind, autopilot, "wind=6:200:2")
            depart(vehicle, kind, autopilot)
            vehicle.wait(20.0)
            flights.append((vehicle.at, [str(message) for message in vehicle.heard]))
        assert flights[0] == flights[1]


OF_STATION = {"ardupilot": {"copter": "FS_GCS_ENABLE", "plane": "FS_GCS_ENABL", "rover": "FS_GCS_ENABLE"}}
"""Parameter of the failsafe of the ground station, by autopilot and kind."""


@pytest.mark.parametrize(("kind", "autopilot"), ALL)
def test_only_parameters_of_its_autopilot_can_be_set(kind: str, autopilot: str) -> None:
    found = KINDS[kind, autopilot]
    found.check((OF_STATION[autopilot][kind] if autopilot in OF_STATION else "NAV_DLL_ACT", 1.0))
    with pytest.raises(ValueError, match=f"the simulated {kind} has no parameter 'NO_SUCH'"):
        found.check(("NO_SUCH", 1.0))


def test_the_default_is_an_arducopter() -> None:
    assert KINDS["copter", "ardupilot"] is COPTER


def test_the_page_of_the_simulated_vehicles_tells_how_many_parameters_each_has() -> None:
    page = (Path(__file__).parents[4] / "docs/guides/simulation.md").read_text()
    count = {kind: len(AttendedVehicle(*kind).autopilot.parameters) for kind in ALL}
    plane, rover = count["plane", "ardupilot"], count["rover", "ardupilot"]
    of_px4 = "{}, {} and {}".format(*(count[kind, "px4"] for kind in ("copter", "plane", "rover")))
    assert f"{plane} of an ArduPlane, {rover} of a Rover, and {of_px4} of a PX4" in page
