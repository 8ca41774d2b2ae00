"""The world of a search: its victims, the camera that sees them, the log of what fell; virtual time."""

from pathlib import Path

import pytest

from bridged.simulation.vehicle.camera import LOOK_S, MEMORY, Camera
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Landed
from bridged.simulation.vehicle.vehicle import Vehicle
from bridged.simulation.vehicle.world import APART, Area, ServoLog, Victim, read_moves, victims_of
from schemas.geo import distance
from tests.bridged.sky import HOME
from tests.bridged.virtual_copter import Station

AREA = Area(-27.603853, -48.519300, -27.602955, -48.517300)
SET_SERVO, ACCEPTED = 183, 0
SOMEBODY = Victim(1, -27.603, -48.518)
"""Somebody in the water."""


def north_of(victim: Victim, metres: float) -> Place:
    return Place(victim.lat + metres / 111_319.5, victim.lon, 40.0)


def test_the_same_seed_gives_the_same_victims_and_another_one_others() -> None:
    assert victims_of(3, 8, AREA) == victims_of(3, 8, AREA)
    assert victims_of(3, 8, AREA) != victims_of(4, 8, AREA)


@pytest.mark.parametrize("seed", range(20))
def test_victims_lie_in_the_area_and_apart_from_one_another(seed: int) -> None:
    found = victims_of(seed, 12, AREA)
    assert [one.number for one in found] == list(range(1, 13))
    assert all(AREA.south <= one.lat <= AREA.north and AREA.west <= one.lon <= AREA.east for one in found)
    places = [(one.lat, one.lon) for one in found]
    assert all(distance(a, b) >= APART - 0.1 for i, a in enumerate(places) for b in places[:i])


def test_an_area_without_room_for_its_victims_is_refused() -> None:
    with pytest.raises(ValueError, match="no room for 500 victims, 15 m apart"):
        victims_of(1, 500, AREA)


def test_an_area_that_is_upside_down_is_refused() -> None:
    with pytest.raises(ValueError, match="south below north"):
        Area(-27.60, -48.5193, -27.61, -48.5173)


@pytest.mark.parametrize(("metres", "seen"), [(0.0, True), (15.9, True), (16.1, False), (500.0, False)])
def test_a_camera_sees_who_is_within_its_range_over_ground(metres: float, seen: bool) -> None:
    camera = Camera([SOMEBODY], 16.0)
    camera.look(lambda: north_of(SOMEBODY, metres), 0.0, 0.0)
    assert [one.id for one in camera.sightings(0.0)] == ([1] if seen else [])


def test_a_camera_that_misses_victims_sees_its_share_of_those_that_come_into_range_and_as_long_as_they_are() -> None:
    camera, seen = Camera([SOMEBODY], 16.0, 0.3), 0
    for passed in range(500):
        at = passed * 100.0
        looks = []
        for second in range(3):
            camera.look(lambda: north_of(SOMEBODY, 5.0), at + second, at + second)
            looks.append(bool(camera.sightings(at + second)))
        assert len(set(looks)) == 1
        seen += looks[0]
        camera.look(lambda: north_of(SOMEBODY, 50.0), at + 10, at + 10)
    assert 100 < seen < 200


def test_a_victim_out_of_sight_is_told_for_a_while_and_then_no_more() -> None:
    camera = Camera([SOMEBODY], 16.0)
    camera.look(lambda: north_of(SOMEBODY, 5.0), 0.0, 100.0)
    camera.look(lambda: north_of(SOMEBODY, 50.0), 5.0, 101.0)
    assert len(camera.sightings(100.0 + MEMORY)) == 1
    assert camera.sightings(100.1 + MEMORY) == []


def test_a_victim_that_is_passed_between_two_tellings_is_not_missed() -> None:
    station, camera = Station(), Camera([SOMEBODY], 16.0)
    station.vehicle.on_step = lambda: camera.look(
        lambda: station.vehicle.autopilot.true_place, station.vehicle.age, 0.0
    )
    chart = station.autopilot.chart
    over = chart.vector(Place(SOMEBODY.lat, SOMEBODY.lon, 0.0))
    motion = station.autopilot.motion
    motion.north.position, motion.east.position = over.north, over.east
    station.vehicle.advance(2 * LOOK_S)
    motion.north.position += 200
    station.vehicle.advance(5.0)
    assert [one.id for one in camera.sightings(0.0)] == [1]


def test_what_an_output_does_is_logged_once_for_each_change_with_the_place_where_it_was(tmp_path: Path) -> None:
    station, log = Station(), ServoLog(tmp_path / "uav1.servo.jsonl")
    vehicle = station.vehicle
    vehicle.on_servo = lambda output, pulse: log.moved(station.autopilot, vehicle.system, vehicle.age, output, pulse)
    for pulse in (1900, 1900, 1100):
        assert station.command(SET_SERVO, 9, pulse) == ACCEPTED
    log.close()
    moves = list(read_moves(tmp_path / "uav1.servo.jsonl"))
    assert [(one.output, one.pulse, one.armed) for one in moves] == [(9, 1900, False), (9, 1100, False)]
    assert (moves[0].lat, moves[0].lon) == pytest.approx((HOME.lat, HOME.lon))
    assert (moves[0].height, moves[0].home) == (0.0, 0.0)


def test_a_log_with_a_line_that_is_none_is_refused_with_its_number(tmp_path: Path) -> None:
    path = tmp_path / "uav1.servo.jsonl"
    path.write_text('{"at":1\n')
    with pytest.raises(ValueError, match=r"uav1\.servo\.jsonl:1: "):
        list(read_moves(path))


@pytest.mark.parametrize(("told", "seconds"), [({}, 120.0), ({"charge_time": 30.0}, 30.0)])
def test_an_empty_battery_is_full_at_home_after_the_time_that_was_told(told: dict[str, float], seconds: float) -> None:
    vehicle = Vehicle(HOME, **told)  # type: ignore[arg-type]
    vehicle.advance(5.0)
    copter = vehicle.autopilot
    assert copter.flight.landed is not Landed.IN_AIR
    assert copter.motion.position == Vector()
    copter.battery.used = copter.parameters["BATT_CAPACITY"]
    vehicle.advance(0.9 * seconds)
    assert 80 <= copter.battery.remaining <= 95
    vehicle.advance(0.25 * seconds)
    assert copter.battery.remaining == 100
