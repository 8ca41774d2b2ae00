"""Percepts of equipment that not every vehicle has: radio, wind, range finder, collisions, aircraft."""

import math
from pathlib import Path

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.vehicle.readings import DERIVED
from bridged.drivers.mavlink.vehicle.streams import unread
from bridged.simulation.vehicle.fault_injection import Faults
from bridged.simulation.vehicle.kinds import KINDS, AutopilotName
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.manifest.loader import Manifest, load_manifest
from tests.bridged.sky import HOME, MISSION, Message, Sky

COPTER = load_manifest("copter")


def required(name: str) -> Manifest:
    """The copter's manifest, with a percept that is not optional."""
    percepts = COPTER.percepts | {name: msgspec.structs.replace(COPTER.percepts[name], optional=False)}
    return msgspec.structs.replace(COPTER, percepts=percepts)


def intervals(sky: Sky, message: int) -> list[float]:
    """The intervals asked for a message so far, in seconds."""
    asked = sky.commands(dialect.MAV_CMD_SET_MESSAGE_INTERVAL)
    return [one.param2 / 1e6 for one in asked if one.param1 == message]


def test_the_pilots_channels_are_a_percept(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.forward(lambda: sky.belief("rc"), "the percept of the radio")
    channels, rssi = sky.belief("rc") or ()
    assert (channels, rssi) == (sky.vehicle.autopilot.transmitter.pulses(0.0), 255)  # type: ignore[attr-defined]


def test_the_wind_is_a_percept_by_the_direction_from_which_it_blows(tmp_path: Path) -> None:
    sky = Sky(tmp_path, faults=Faults.parse(["wind=6:270"]))
    sky.flying()
    sky.wait(15)
    direction, speed = sky.belief("wind") or (0.0, 0.0)
    assert direction == pytest.approx(270, abs=1)
    assert speed == pytest.approx(6, abs=0.6)


@pytest.mark.parametrize(
    ("north", "east", "direction"), [(-3.0, 0.0, 0), (0.0, -3.0, 90), (3.0, 0.0, 180), (0.0, 3.0, 270)]
)
def test_wind_means_the_same_from_both_autopilots(north: float, east: float, direction: float) -> None:
    signed = math.remainder(direction, 360)
    of_px4 = dialect.MAVLink_wind_cov_message(0, north, east, 0, 0, 0, 0, 0, 0)
    of_ardupilot = dialect.MAVLink_wind_message(signed, 3, 0)
    readings = [DERIVED[message.get_type()][1](message) for message in (of_px4, of_ardupilot)]
    for reading in readings:
        assert reading == {"direction": pytest.approx(direction), "speed": pytest.approx(3)}


@pytest.mark.parametrize(
    ("cells", "more", "volts"),
    [
        ([12600], [], 12.6),
        ([4100, 4080, 4090], [], 12.27),
        ([65534, 2466], [], 68.0),
        ([4000] * 10, [4000, 4000], 48.0),
    ],
)
def test_a_battery_has_the_voltage_of_all_its_cells(
    tmp_path: Path, cells: list[int], more: list[int], volts: float
) -> None:
    sky = Sky(tmp_path)
    voltages, extra = [*cells, *[65535] * (10 - len(cells))], [*more, *[0] * (4 - len(more))]
    status = (1, 0, 0, 0, voltages, 0, 0, 0, 77, 0, 0, extra)
    sky.downlink.append(dialect.MAVLink_battery_status_message(*status))
    sky.step()
    assert sky.belief("battery") == (1, volts, 77)
    unknown = (1, 0, 0, 0, [65535] * 10, 0, 0, 0, 77)
    sky.downlink.append(dialect.MAVLink_battery_status_message(*unknown))
    sky.step()
    assert sky.belief("battery") == (1, volts, 77), "until it is silent for the ttl"


def test_what_a_vehicle_does_not_have_is_no_warning_if_it_is_optional(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.flying()
    sky.wait(30)
    assert intervals(sky, dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR)
    assert [note for note in sky.driver.notes() if note.code in ("message_unknown", "message_late")] == []


@pytest.mark.parametrize(("kind", "autopilot"), KINDS)
def test_the_percepts_of_each_kind_with_each_autopilot_are_sent_or_optional(
    tmp_path: Path, kind: str, autopilot: AutopilotName
) -> None:
    mission = MISSION.replace("copter", kind)
    sky = Sky(tmp_path, mission=mission, manifest=load_manifest(kind), vehicle=Vehicle(HOME, KINDS[kind, autopilot]))
    sky.forward(lambda: sky.belief("home_pos"), "home")
    sky.wait(20)
    assert [note for note in sky.driver.notes() if note.code in ("message_unknown", "message_late")] == []


def test_what_a_vehicle_does_not_have_is_a_warning_otherwise(tmp_path: Path) -> None:
    sky = Sky(tmp_path, manifest=required("distance_sensor"))
    sky.wait(10)
    assert ("message_unknown", "DISTANCE_SENSOR") in {(note.code, note.about) for note in sky.driver.notes()}


def test_an_optional_message_that_is_accepted_and_never_comes_is_no_warning(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.we_hear = lambda message: message.get_type() != "RC_CHANNELS"
    sky.wait(30)
    assert sky.driver.notes() == []


def test_a_message_that_is_not_known_is_asked_for_once_until_the_vehicle_restarts(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.flying()
    sky.done("land")
    sky.wait(10)
    assert len(intervals(sky, dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR)) == 1


def sensor(metres: float, number: int, orientation: int) -> Message:
    return dialect.MAVLink_distance_sensor_message(0, 20, 4000, round(metres * 100), 0, number, orientation, 255)


def test_range_finders_are_told_apart_and_age(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.downlink += [sensor(3.5, 0, 0), sensor(12.25, 1, 25)]
    sky.step()
    present = {one.parameters for one in sky.bridge.percepts.sets["uav"].present() if one.name == "distance_sensor"}
    assert present == {(0, 0, 3.5), (1, 25, 12.25)}
    sky.wait(6)
    assert sky.belief("distance_sensor") is None


def test_collisions_and_aircraft_are_percepts_though_nobody_asks_for_collisions(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.downlink += [
        dialect.MAVLink_collision_message(0, 7, 0, 2, 12.5, 3.0, 40.0),
        dialect.MAVLink_adsb_vehicle_message(
            0xABCDEF, -276_000_000, -485_000_000, 1, 350_000, 9000, 5000, 0, b"TAM3054", 0, 1, 0, 0
        ),
    ]
    sky.step()
    assert sky.belief("collision") == (7, 2, 12.5, 40.0)
    assert sky.belief("adsb") == (0xABCDEF, "TAM3054", -27.6, -48.5, 350.0)
    assert intervals(sky, dialect.MAVLINK_MSG_ID_COLLISION) == []


def test_messages_of_which_no_percept_is_made_are_not_decoded() -> None:
    plain = msgspec.structs.replace(COPTER, percepts={})
    equipment = {dialect.MAVLINK_MSG_ID_WIND, dialect.MAVLINK_MSG_ID_WIND_COV, dialect.MAVLINK_MSG_ID_ADSB_VEHICLE}
    assert equipment <= unread(plain)
    assert not equipment & unread(COPTER)
