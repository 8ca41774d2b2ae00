"""A simulated ArduPlane and a Rover with ArduPilot, as tests/data/autopilots have them."""

import math

import pytest

from bridged.simulation.vehicle.ardupilot.flight_modes import PlaneMode, RoverMode
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Landed
from tests.bridged.attended_vehicle import AttendedVehicle, Item

SET_MODE, ARM, REPOSITION = 176, 400, 192
NO = (0.0, 0.0, 0.0, 0.0)
HOME_ITEM: Item = (16, 0, NO, Vector(), 0.0)
TAKE_OFF: Item = (22, 3, (12.0, 0.0, 0.0, 0.0), None, 40.0)
AHEAD: Item = (16, 3, NO, Vector(500, 300, 0), 40.0)
START: Item = (189, 3, NO, None, 0.0)
FINAL: Item = (16, 3, NO, Vector(500, 0, 0), 30.0)
LAND: Item = (21, 3, NO, Vector(0, 0, 0), 0.0)


@pytest.fixture
def plane() -> AttendedVehicle:
    return AttendedVehicle("plane", "ardupilot")


def mode(vehicle: AttendedVehicle, wanted: PlaneMode | RoverMode) -> int:
    return vehicle.command(SET_MODE, 1, wanted)


@pytest.fixture
def flying(plane: AttendedVehicle) -> AttendedVehicle:
    """On its circle after a takeoff in TAKEOFF."""
    assert mode(plane, PlaneMode.TAKEOFF) == 0
    assert plane.command(ARM, 1) == 0
    plane.until(lambda: plane.autopilot.flight.landed is Landed.IN_AIR, "takeoff")
    plane.wait(5.0)
    plane.heard.clear()
    return plane


def test_it_takes_off_in_takeoff_and_circles_ahead(flying: AttendedVehicle) -> None:
    flying.wait(40.0)
    home = flying.autopilot.home_on_chart.up
    assert flying.at.up - home == pytest.approx(flying.autopilot.parameters["TKOFF_ALT"], abs=5)
    assert flying.speed > 15
    assert flying.distance(Vector(200, 0, 0)) < 130
    beat = flying.last("HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.custom_mode, beat.system_status) == (1, 3, 13, 4)


@pytest.mark.parametrize(
    ("altitude", "text"), [(90, "Climbing to TKOFF alt then loitering"), (30, "Above TKOFF alt - loitering")]
)
def test_in_the_air_takeoff_climbs_or_circles_above_it(flying: AttendedVehicle, altitude: int, text: str) -> None:
    flying.wait(20.0)
    high = flying.at.up - flying.autopilot.home_on_chart.up
    mode(flying, PlaneMode.LOITER)
    flying.autopilot.parameters.set("TKOFF_ALT", altitude)
    mode(flying, PlaneMode.TAKEOFF)
    flying.wait(40.0)
    assert text in flying.said
    assert flying.at.up - flying.autopilot.home_on_chart.up == pytest.approx(max(high, altitude), abs=5)


def test_a_takeoff_by_command_and_modes_of_vertical_takeoff_are_refused(plane: AttendedVehicle) -> None:
    assert mode(plane, PlaneMode.GUIDED) == 0
    assert plane.command(ARM, 1) == 0
    assert plane.command(22, 0, 0, 0, 0, 0, 0, 30) == 4
    assert mode(plane, PlaneMode.QLOITER) == 4
    assert "Q_ENABLE 0" in plane.said


def test_autoland_is_refused_before_a_takeoff_and_lands_after_one(plane: AttendedVehicle) -> None:
    assert mode(plane, PlaneMode.AUTOLAND) == 4
    assert plane.said[-1] == "Takeoff initial direction not set"
    mode(plane, PlaneMode.TAKEOFF)
    plane.command(ARM, 1)
    plane.until(lambda: plane.autopilot.flight.landed is Landed.IN_AIR, "takeoff")
    assert mode(plane, PlaneMode.AUTOLAND) == 0
    plane.until(lambda: not plane.autopilot.armed, "landing", 300)
    assert plane.at.flat() < 200
    assert plane.said[-2] == "Auto disarmed"


def test_guided_takes_repositions_and_ignores_setpoints(flying: AttendedVehicle) -> None:
    assert mode(flying, PlaneMode.GUIDED) == 0
    flying.setpoint(Vector(-800, 0, 60))
    flying.wait(5.0)
    assert flying.at.north > -100
    goal = Vector(-400, 0, 60)
    assert flying.place(REPOSITION, goal, -1, 0, 0, 0, alt=60.0, frame=6) == 0
    flying.until(lambda: flying.distance(goal) < 110, "goal")
    flying.wait(30.0)
    assert 40 < flying.distance(goal) < 130
    assert flying.at.up == pytest.approx(60, abs=4)
    assert {one.seq for one in flying.heard if one.get_type() == "MISSION_ITEM_REACHED"} == {0}


def test_a_reposition_outside_guided_needs_the_flag(flying: AttendedVehicle) -> None:
    assert flying.place(REPOSITION, Vector(0, 300, 0), -1, 0, 0, 0, alt=60.0, frame=6) != 0
    assert flying.autopilot.mode is PlaneMode.TAKEOFF
    assert flying.place(REPOSITION, Vector(0, 300, 0), -1, 1, 0, 0, alt=60.0, frame=6) == 0
    assert flying.autopilot.mode is PlaneMode.GUIDED


def test_auto_without_a_mission_is_a_return_which_circles_over_home(flying: AttendedVehicle) -> None:
    assert mode(flying, PlaneMode.AUTO) == 0
    assert flying.autopilot.mode is PlaneMode.RTL
    flying.wait(0.5)
    assert "Mission complete, changing mode to RTL" in flying.said
    flying.wait(90.0)
    assert flying.at.flat() < 130
    assert flying.at.up == pytest.approx(flying.autopilot.parameters["RTL_ALTITUDE"], abs=5)


def test_a_mission_lands_and_the_motor_stops_20_s_later(plane: AttendedVehicle) -> None:
    assert plane.upload([HOME_ITEM, TAKE_OFF, AHEAD, START, FINAL, LAND]) == 0
    plane.autopilot.parameters.set("RTL_AUTOLAND", 2)
    assert mode(plane, PlaneMode.AUTO) == 0
    assert plane.command(ARM, 1) == 0
    plane.until(lambda: plane.at.up > 5, "takeoff")
    plane.until(lambda: plane.autopilot.flight.landed is Landed.ON_GROUND, "landing", 400)
    took = plane.until(lambda: not plane.autopilot.armed, "disarming")
    assert took == pytest.approx(20, abs=1.5)
    assert plane.at.flat() < 200
    assert plane.command(ARM, 1) == 4
    plane.wait(0.5)
    assert "Arm: In landing sequence" in plane.said


def test_a_mission_without_a_landing_ends_in_a_return(plane: AttendedVehicle) -> None:
    assert plane.upload([HOME_ITEM, TAKE_OFF, AHEAD]) == 0
    mode(plane, PlaneMode.AUTO)
    plane.command(ARM, 1)
    plane.until(lambda: plane.autopilot.mode is PlaneMode.RTL, "return", 200)
    assert plane.autopilot.armed


def test_the_landing_of_its_mission_can_be_ordered(flying: AttendedVehicle) -> None:
    assert flying.command(189) == 4
    assert flying.upload([HOME_ITEM, TAKE_OFF, AHEAD, START, FINAL, LAND]) == 0
    assert flying.command(189) == 0
    assert flying.autopilot.mode is PlaneMode.AUTO
    flying.until(lambda: not flying.autopilot.armed, "landing", 400)


@pytest.mark.parametrize(("action", "after"), [(0, PlaneMode.TAKEOFF), (1, PlaneMode.RTL)])
def test_a_lost_ground_station_brings_it_home_if_its_parameters_say_so(
    flying: AttendedVehicle, action: int, after: PlaneMode
) -> None:
    flying.autopilot.parameters.set("FS_GCS_ENABL", 1)
    flying.autopilot.parameters.set("FS_LONG_ACTN", action)
    flying.silent = True
    flying.wait(15.0)
    assert flying.autopilot.mode is after
    assert any(text.startswith("GCS Failsafe On") for text in flying.said)
    flying.silent = False
    flying.wait(3.0)
    assert "GCS Failsafe Off" in flying.said
    assert flying.autopilot.mode is after


def test_it_is_not_disarmed_in_the_air_unless_forced(flying: AttendedVehicle) -> None:
    assert flying.command(ARM, 0) == 4
    assert flying.command(ARM, 0, 21196) == 0
    flying.until(lambda: not flying.autopilot.flight.airborne, "ground", 60)


@pytest.fixture
def rover() -> AttendedVehicle:
    """Armed in GUIDED."""
    rover = AttendedVehicle("rover", "ardupilot")
    assert mode(rover, RoverMode.GUIDED) == 0
    assert rover.command(ARM, 1) == 0
    rover.heard.clear()
    return rover


def test_a_rover_drives_to_setpoints_and_repositions(rover: AttendedVehicle) -> None:
    goal = Vector(15, 10, 0)
    rover.setpoint(goal)
    rover.until(lambda: rover.distance(goal) < 1.5, "goal", 60)
    rover.wait(4.0)
    assert rover.distance(goal) < 2.5
    goal = Vector(0, 20, 0)
    assert rover.place(REPOSITION, goal, -1, 0, 0, 0, alt=0.0, frame=6) == 0
    rover.until(lambda: rover.distance(goal) < 1.5, "goal", 60)
    assert rover.at.up == 0


def test_a_rover_follows_velocities_and_stops_3_s_after_the_last_one(rover: AttendedVehicle) -> None:
    for _ in range(40):
        rover.velocity(1.0, 0.0)
        rover.wait(0.1)
    assert rover.autopilot.motion.velocity.north == pytest.approx(1.0, abs=0.4)
    rover.wait(3.5)
    assert "target not received last 3secs, stopping" in rover.said
    rover.wait(6.0)
    assert rover.speed < 0.1


def test_hold_stops_it_and_setpoints_are_ignored_there(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(40, 0, 0))
    rover.wait(5.0)
    assert rover.speed > 0.5
    assert mode(rover, RoverMode.HOLD) == 0
    rover.setpoint(Vector(40, 0, 0))
    rover.wait(15.0)
    assert rover.speed < 0.1
    assert rover.at.north < 30


def test_a_takeoff_and_modes_without_their_conditions_are_refused(rover: AttendedVehicle) -> None:
    assert rover.command(22, 0, 0, 0, 0, 0, 0, 10) != 0
    assert mode(rover, RoverMode.AUTO) == 4
    rover.wait(0.3)
    assert rover.said[-2:] == ["No Mission. Can't set AUTO.", "Flight mode change failed"]
    assert mode(rover, RoverMode.DOCK) == 4
    assert rover.autopilot.mode is RoverMode.GUIDED


@pytest.mark.parametrize("wanted", [RoverMode.RTL, RoverMode.SMART_RTL])
def test_a_return_drives_home_and_stays_armed(rover: AttendedVehicle, wanted: RoverMode) -> None:
    rover.setpoint(Vector(20, 0, 0))
    rover.wait(14.0)
    assert mode(rover, wanted) == 0
    rover.until(lambda: "Reached destination" in rover.said, "home", 90)
    assert rover.at.flat() < 3
    assert rover.autopilot.armed


def test_a_rover_is_disarmed_while_it_drives_and_rolls_out(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(40, 0, 0))
    rover.wait(6.0)
    assert rover.command(ARM, 0) == 0
    before = rover.at.north
    rover.wait(10.0)
    assert rover.at.north > before + 0.5
    assert rover.speed < 0.1


def test_a_lost_ground_station_brings_a_rover_home_if_its_parameters_say_so(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(30, 0, 0))
    rover.autopilot.parameters.set("FS_GCS_ENABLE", 1)
    rover.autopilot.parameters.set("FS_ACTION", 1)
    rover.silent = True
    rover.wait(12.0)
    assert rover.autopilot.mode is RoverMode.RTL
    assert "Radio Failsafe" in rover.said


def test_home_follows_it_while_it_is_disarmed(rover: AttendedVehicle) -> None:
    rover.setpoint(Vector(20, 0, 0))
    rover.wait(14.0)
    assert math.isclose(rover.autopilot.home_on_chart.flat(), 0.0, abs_tol=0.5)
    rover.command(ARM, 0)
    rover.wait(8.0)
    assert rover.autopilot.home_on_chart.distance(rover.at) < 1.0
