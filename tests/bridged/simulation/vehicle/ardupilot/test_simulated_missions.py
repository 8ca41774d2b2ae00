"""Missions of the simulated copter: how they are loaded, flown, jumped about in and ended; virtual time."""

from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.motion.dynamics import Vector
from tests.bridged.virtual_copter import Station

ACCEPTED, UNSUPPORTED, FAILED = 0, 3, 4
CLEAR, SET_CURRENT = dialect.MAVLink_mission_clear_all_message, dialect.MAVLink_mission_set_current_message
STAY = (0.0, 0.0, 0.0, 0.0)


class Item(NamedTuple):
    command: int
    params: tuple[float, float, float, float] = STAY
    place: Vector | None = None


TAKEOFF = Item(22, place=Vector(up=10.0))


def waypoint(north: float, east: float = 0.0, up: float = 10.0) -> Item:
    return Item(16, place=Vector(north, east, up))


def offer(station: Station, items: list[Item]) -> int:
    """Uploads a mission; returns the type of the last MISSION_ACK."""
    said = station.say(dialect.MAVLink_mission_count_message(1, 1, len(items) + 1))
    stored = [Item(16, place=Vector()), *items]
    while asked := [one for one in said if one.get_type() == "MISSION_REQUEST"]:
        item, seq = stored[asked[0].seq], asked[0].seq
        place = item.place or Vector()
        where = station.autopilot.chart.place(place)
        x, y = (where.lat_e7, where.lon_e7) if item.command == 16 else (0, 0)
        said = station.say(
            dialect.MAVLink_mission_item_int_message(1, 1, seq, 3, item.command, 0, 1, *item.params, x, y, place.up)
        )
    (kind,) = [one.type for one in said if one.get_type() == "MISSION_ACK"]
    return int(kind)


def flying(*items: Item) -> Station:
    """A station whose vehicle flies these items in AUTO."""
    station = Station()
    assert offer(station, list(items)) == ACCEPTED
    station.guided()
    assert station.command(400, 1) == ACCEPTED
    assert station.command(300) == ACCEPTED  # AUTO, and then off the ground
    assert station.command(300) == ACCEPTED
    return station


def reached(station: Station) -> list[int]:
    return [one.seq for one in station.heard if one.get_type() == "MISSION_ITEM_REACHED"]


def current(station: Station) -> dialect.MAVLink_message:
    assert station.command(512, 42) == ACCEPTED
    return station.heard[-1]


def test_servos_speed_and_delays_are_done_on_the_way_to_the_next_place() -> None:
    commands = [Item(178, (1, 3, 0, 0)), Item(112, (4, 0, 0, 0)), Item(183, (9, 1900, 0, 0))]
    station = flying(TAKEOFF, waypoint(5.0), *commands, waypoint(60.0))
    station.until(lambda: 3 in reached(station), "the speed")
    assert station.autopilot.outputs.pulses(armed=True, airborne=True)[8] == 0
    waited = station.until(lambda: 5 in reached(station), "the servo")
    assert 3.5 < waited < 4.5
    assert station.autopilot.outputs.pulses(armed=True, airborne=True)[8] == 1900
    station.wait(3.0)
    assert 2.5 < station.speed < 3.8
    assert 6 not in reached(station)
    station.until(lambda: 6 in reached(station), "the last place")
    assert [text for text in station.texts() if text.startswith("Mission:")] == [
        "Mission: 1 Takeoff", "Mission: 2 WP", "Mission: 6 WP", "Mission: 3 ChangeSpeed", "Mission: 4 CondDelay",
        "Mission: 5 SetServo",
    ]  # fmt: skip


def test_a_mission_of_jumps_alone_ends() -> None:
    station = flying(TAKEOFF, Item(177, (3, -1, 0, 0)), Item(177, (2, -1, 0, 0)))
    station.until(lambda: reached(station) == [1], "takeoff")
    assert current(station).mission_state == dialect.MISSION_STATE_COMPLETE


@pytest.mark.parametrize("command", [19, 93], ids=["NAV_LOITER_TIME", "NAV_DELAY"])
def test_loitering_takes_its_time(command: int) -> None:
    station = flying(TAKEOFF, Item(command, (8, 0, 0, 0)), waypoint(10.0))
    station.until(lambda: 1 in reached(station), "takeoff")
    took = station.until(lambda: 2 in reached(station), "loiter time")
    assert 7.5 < took < 10.0


def test_the_current_item_is_set_by_message_and_by_command_and_one_that_is_not_there_is_refused() -> None:
    station = flying(TAKEOFF, waypoint(50.0), waypoint(0.0, 50.0))
    station.until(lambda: 1 in reached(station), "takeoff")
    (answer,) = [one for one in station.say(SET_CURRENT(1, 1, 3)) if one.get_type() == "MISSION_CURRENT"]
    assert (answer.seq, answer.total) == (3, 3)
    station.wait(6.0)
    assert station.at.east > 3
    assert not station.say(SET_CURRENT(1, 1, 9))
    assert station.command(224, 9) == FAILED
    assert station.command(224, 2) == ACCEPTED
    assert current(station).seq == 2


def test_auto_goes_on_where_it_was_left() -> None:
    station = flying(TAKEOFF, waypoint(50.0), waypoint(0.0, 50.0))
    station.until(lambda: current(station).seq == 2, "the first leg")
    station.guided()
    station.wait(5.0)
    assert station.command(176, 1, Mode.AUTO) == ACCEPTED
    assert current(station).seq == 2


def test_a_mission_is_cleared_and_auto_is_then_refused(station: Station) -> None:
    assert offer(station, [TAKEOFF, waypoint(5.0)]) == ACCEPTED
    assert [one.type for one in station.say(CLEAR(1, 1)) if one.get_type() == "MISSION_ACK"] == [ACCEPTED]
    assert station.say(dialect.MAVLink_mission_request_list_message(1, 1))[0].count == 1
    assert station.command(176, 1, Mode.AUTO) == station.command(300) == FAILED


def test_a_command_that_the_vehicle_does_not_know_ends_the_upload(station: Station) -> None:
    assert offer(station, [TAKEOFF, Item(31_000)]) == UNSUPPORTED
    assert station.say(dialect.MAVLink_mission_request_list_message(1, 1))[0].count == 1


def test_an_upload_that_is_left_alone_is_asked_for_again_and_given_up(station: Station) -> None:
    station.say(dialect.MAVLink_mission_count_message(1, 1, 3))
    kinds = [one.get_type() for one in station.wait(9.0)]
    assert kinds.count("MISSION_REQUEST") == 7
    assert "Mission upload timeout" in station.texts()
    assert kinds.count("MISSION_ACK") == 1
