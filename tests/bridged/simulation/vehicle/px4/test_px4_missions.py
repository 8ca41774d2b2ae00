"""Missions, fences and parameters of a simulated PX4."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.px4.modes import Mode
from tests.bridged.attended_vehicle import NAN, AttendedVehicle, Item

NO = (0.0, 0.0, 0.0, NAN)
TAKE_OFF: Item = (22, 6, NO, Vector(0, 0, 0), 10.0)
THERE: Item = (16, 6, NO, Vector(25, 0, 0), 10.0)
BACK: Item = (20, 2, NO, None, 0.0)
INT32, REAL32 = 6, 9


@pytest.fixture
def px4() -> AttendedVehicle:
    return AttendedVehicle("copter", "px4")


def test_a_mission_without_an_end_holds_at_its_last_item(px4: AttendedVehicle) -> None:
    assert px4.upload([TAKE_OFF, THERE]) == 0
    px4.command(400, 1)
    assert px4.command(300) == 0
    px4.until(lambda: px4.autopilot.mode is Mode.LOITER, "end of the mission", 90)
    assert "Mission finished, loitering" in px4.said
    px4.wait(3.0)
    assert px4.distance(Vector(25, 0, 10)) < 2.0
    assert px4.last("MISSION_CURRENT").mission_state == 5


def test_a_mission_that_cannot_be_flown_is_taken_and_then_refused(px4: AttendedVehicle) -> None:
    px4.autopilot.parameters.set("GF_MAX_HOR_DIST", 20)
    assert px4.upload([TAKE_OFF, THERE]) == 0
    px4.wait(2.0)
    assert "Geofence violation for waypoint 2" in px4.said
    px4.command(400, 1)
    assert px4.command(300) == 2
    px4.wait(0.5)
    assert "Mission start denied! No valid mission" in px4.said


def test_another_command_than_it_knows_ends_an_upload(px4: AttendedVehicle) -> None:
    assert px4.upload([TAKE_OFF, (31999, 6, NO, Vector(0, 0, 0), 5.0)]) != 0


def test_an_upload_that_stops_is_asked_for_and_given_up_after_5_s(px4: AttendedVehicle) -> None:
    px4.say(dialect.MAVLink_mission_count_message(1, 1, 2, 0))
    heard = px4.wait(8.0)
    asked = [one for one in heard if one.get_type() == "MISSION_REQUEST_INT"]
    assert 15 <= len(asked) <= 21
    assert {one.seq for one in asked} == {0}
    assert not [one for one in heard if one.get_type() == "MISSION_ACK"]


def test_what_is_stored_can_be_read_and_cleared(px4: AttendedVehicle) -> None:
    px4.upload([TAKE_OFF, THERE, BACK])
    (count,) = px4.say(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    assert count.count == 3
    (item,) = px4.say(dialect.MAVLink_mission_request_int_message(1, 1, 1, 0))
    assert (item.command, item.seq, item.z) == (16, 1, 10.0)
    acks = px4.say(dialect.MAVLink_mission_clear_all_message(1, 1, 0))
    assert [one.type for one in acks if one.get_type() == "MISSION_ACK"] == [0]
    (count,) = px4.say(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    assert count.count == 0


def test_a_fence_is_a_mission_of_type_1_and_bounds_repositions(px4: AttendedVehicle) -> None:
    inside: Item = (5003, 5, (30.0, 0.0, 0.0, 0.0), Vector(0, 0, 0), 0.0)
    assert px4.upload([inside], kind=1) == 0
    px4.command(400, 1)
    px4.command(22, -1, 0, 0, NAN, NAN, NAN, NAN)
    px4.until(lambda: px4.autopilot.mode is Mode.LOITER, "end of the takeoff")
    assert px4.place(192, Vector(60, 0, 10), -1, 1, 0, NAN) == 0
    px4.wait(2.0)
    assert "Reposition is outside geofence" in px4.said


def test_whole_numbers_travel_as_their_bytes(px4: AttendedVehicle) -> None:
    (value,) = px4.say(dialect.MAVLink_param_request_read_message(1, 1, b"NAV_DLL_ACT", -1))
    assert value.param_type == INT32
    (two,) = struct.unpack("<f", struct.pack("<i", 2))
    (value,) = px4.say(dialect.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", two, INT32))
    assert struct.unpack("<i", struct.pack("<f", value.param_value)) == (2,)
    assert px4.autopilot.parameters["NAV_DLL_ACT"] == 2


@pytest.mark.parametrize(("name", "kind"), [(b"NO_SUCH", REAL32), (b"NAV_DLL_ACT", REAL32)])
def test_an_unknown_parameter_or_another_type_is_an_error(px4: AttendedVehicle, name: bytes, kind: int) -> None:
    (error,) = px4.say(dialect.MAVLink_param_set_message(1, 1, name, 2.0, kind))
    assert error.get_type() == "PARAM_ERROR"
    assert px4.autopilot.parameters["NAV_DLL_ACT"] == 0


def test_the_list_of_parameters_is_sent_whole(px4: AttendedVehicle) -> None:
    px4.heard.clear()
    px4.say(dialect.MAVLink_param_request_list_message(1, 1))
    px4.wait(5.0)
    listed = {one.param_index for one in px4.heard if one.get_type() == "PARAM_VALUE"}
    assert listed >= set(range(len(px4.autopilot.parameters)))
