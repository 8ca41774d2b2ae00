"""A simulated copter with PX4, as tests/data/autopilots/px4_quad_*.tlog.gz have it: modes, failsafes, OFFBOARD."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.px4.modes import Mode, packed
from tests.bridged.attended_vehicle import NAN, AttendedVehicle
from tests.bridged.sky import HOME

ARM, SET_MODE, TAKE_OFF, LAND, RETURN, REPOSITION, ORBIT = 400, 176, 22, 21, 20, 192, 34
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4


@pytest.fixture
def px4() -> AttendedVehicle:
    return AttendedVehicle("copter", "px4")


def flown(px4: AttendedVehicle, **parameters: float) -> AttendedVehicle:
    """At 10 m in AUTO.LOITER."""
    for name, value in parameters.items():
        px4.autopilot.parameters.set(name, value)
    assert px4.command(ARM, 1) == ACCEPTED
    assert px4.command(TAKE_OFF, -1, 0, 0, NAN, NAN, NAN, HOME.alt + 10) == ACCEPTED
    px4.until(lambda: px4.autopilot.mode is Mode.LOITER, "end of the takeoff")
    px4.heard.clear()
    return px4


@pytest.fixture
def flying(px4: AttendedVehicle) -> AttendedVehicle:
    return flown(px4)


def test_its_heartbeat_comes_each_second_and_has_main_and_sub_mode(px4: AttendedVehicle) -> None:
    beats = [one for one in px4.wait(5.0) if one.get_type() == "HEARTBEAT"]
    assert len(beats) == 5
    assert (beats[0].autopilot, beats[0].type, beats[0].custom_mode) == (12, 2, packed(4, 3))
    assert [beats[0].system_status, beats[0].base_mode & 128] == [3, 0]


@pytest.mark.parametrize(
    ("main", "sub", "result", "mode"),
    [
        (6, 0, ACCEPTED, Mode.OFFBOARD),
        (4, 5, ACCEPTED, Mode.RTL),
        (4, 0, ACCEPTED, Mode.MISSION),
        (3, 0, ACCEPTED, Mode.POSCTL),
        (99, 0, REJECTED, Mode.LOITER),
        (4, 77, REJECTED, Mode.LOITER),
    ],
)
def test_on_the_ground_any_mode_can_be_set(px4: AttendedVehicle, main: int, sub: int, result: int, mode: Mode) -> None:
    assert px4.command(SET_MODE, 1, main, sub) == result
    assert px4.autopilot.mode is mode
    px4.wait(1.2)
    assert px4.last("HEARTBEAT").custom_mode == mode
    assert ("Unsupported" in " ".join(px4.said)) == (result == REJECTED)


@pytest.mark.parametrize(
    ("main", "sub", "name"), [(6, 0, "Offboard"), (3, 0, "Position"), (4, 4, "Mission"), (1, 0, "Manual")]
)
def test_in_flight_a_mode_without_its_needs_is_refused(flying: AttendedVehicle, main: int, sub: int, name: str) -> None:
    assert flying.command(SET_MODE, 1, main, sub) == REJECTED
    flying.wait(0.2)
    assert flying.said == [f"Switching to {name} is currently not available"]
    assert flying.autopilot.mode is Mode.LOITER


def test_a_mode_that_lacks_something_clears_the_health_bit_and_arming_is_refused(px4: AttendedVehicle) -> None:
    def healthy() -> bool:
        px4.wait(1.5)
        return bool(px4.last("SYS_STATUS").onboard_control_sensors_health & 1 << 28)

    assert healthy()
    px4.command(SET_MODE, 1, 6)
    assert not healthy()
    px4.heard.clear()
    assert px4.command(ARM, 1) == REJECTED
    px4.wait(0.2)
    assert "Arming denied: Resolve system health failures first" in px4.said
    px4.command(SET_MODE, 1, 4, 3)
    assert healthy()
    assert px4.command(ARM, 1) == ACCEPTED


def test_it_disarms_itself_without_a_takeoff_and_sooner_after_a_landing(flying: AttendedVehicle) -> None:
    assert flying.command(ARM, 0) == REJECTED
    assert flying.command(LAND) == ACCEPTED
    flying.until(lambda: not flying.autopilot.armed, "disarming")
    assert flying.said == ["Disarming denied: not landed", "Landing at current position", "Landing detected",
                           "Disarmed by landing"]  # fmt: skip
    assert flying.autopilot.mode is Mode.LOITER
    flying.heard.clear()
    assert flying.command(ARM, 1) == ACCEPTED
    took = flying.until(lambda: not flying.autopilot.armed, "disarming")
    assert 10 < took < 12
    assert flying.said[-1] == "Disarmed by auto preflight disarming"


def test_a_takeoff_is_acknowledged_before_arming_and_flown_after_it(px4: AttendedVehicle) -> None:
    assert px4.command(TAKE_OFF, -1, 0, 0, NAN, NAN, NAN, HOME.alt + 8) == ACCEPTED
    px4.wait(3.0)
    assert px4.at.up == 0
    assert px4.command(ARM, 1) == ACCEPTED
    px4.until(lambda: px4.autopilot.mode is Mode.LOITER, "end of the takeoff")
    assert px4.at.up == pytest.approx(8, abs=0.7)


def test_a_takeoff_under_the_ground_is_acknowledged_and_not_flown(px4: AttendedVehicle) -> None:
    px4.command(ARM, 1)
    assert px4.command(TAKE_OFF, -1, 0, 0, NAN, NAN, NAN, 10.0) == ACCEPTED
    px4.wait(5.0)
    assert "Already higher than takeoff altitude" in px4.said
    assert px4.at.up == 0


def test_a_reposition_without_a_place_stops_here_and_from_another_mode_needs_the_flag(flying: AttendedVehicle) -> None:
    flying.place(REPOSITION, Vector(60, 0, 10), -1, 1, 0, NAN)
    flying.wait(4.0)
    assert flying.place(REPOSITION, None, -1, 1, 0, NAN) == ACCEPTED
    flying.wait(9.0)
    assert flying.at.north < 30
    assert flying.speed < 0.1
    flying.command(RETURN)
    assert flying.place(REPOSITION, Vector(60, 0, 10), -1, 0, 0, NAN) == DENIED
    assert flying.autopilot.mode is Mode.RTL


def test_a_reposition_out_of_the_fence_is_acknowledged_and_refused_by_a_text(flying: AttendedVehicle) -> None:
    flying.autopilot.parameters.set("GF_MAX_HOR_DIST", 50)
    assert flying.place(REPOSITION, Vector(80, 0, 10), -1, 1, 0, NAN) == ACCEPTED
    flying.wait(3.0)
    assert flying.said == ["Reposition is outside geofence"]
    assert flying.at.north < 1


def test_it_circles_a_place_by_a_command_and_holds_when_that_is_wanted(flying: AttendedVehicle) -> None:
    assert flying.place(ORBIT, Vector(0, 0, 10), 12, 3, 0, NAN) == ACCEPTED
    flying.wait(15.0)
    assert flying.autopilot.mode is Mode.ORBIT
    assert flying.at.flat() == pytest.approx(12, abs=1.5)
    assert {"ORBIT_EXECUTION_STATUS"} <= flying.kinds()
    assert flying.command(SET_MODE, 1, 4, 3) == ACCEPTED
    flying.wait(6.0)
    assert flying.speed < 0.2


def test_a_change_of_the_altitude_is_taken_in_hold_alone(flying: AttendedVehicle) -> None:
    assert flying.command(186, HOME.alt + 14) == ACCEPTED
    flying.until(lambda: abs(flying.at.up - 14) < 0.5, "altitude")
    flying.command(RETURN)
    assert flying.command(186, HOME.alt + 20) == REJECTED


def test_a_gripper_is_in_progress_and_then_done(px4: AttendedVehicle) -> None:
    assert px4.command(211, 1, 1) == 5
    acks = [one for one in px4.wait(2.0) if one.get_type() == "COMMAND_ACK"]
    assert [(one.command, one.result) for one in acks] == [(211, 0)]


def test_streams_come_unasked_and_those_that_it_does_not_have_fail(px4: AttendedVehicle) -> None:
    px4.heard.clear()
    px4.wait(4.0)
    assert {"ATTITUDE", "GLOBAL_POSITION_INT", "ESTIMATOR_STATUS", "BATTERY_STATUS", "CURRENT_MODE"} <= px4.kinds()
    assert "EKF_STATUS_REPORT" not in px4.kinds()
    assert px4.command(511, 193, 100_000) == FAILED
    assert px4.command(511, 33, 50_000) == ACCEPTED
    heard = [one for one in px4.wait(2.0) if one.get_type() == "GLOBAL_POSITION_INT"]
    assert len(heard) == pytest.approx(40, abs=2)
    assert px4.command(12345) == UNSUPPORTED


def test_texts_are_sent_only_while_a_ground_station_is_heard(px4: AttendedVehicle) -> None:
    px4.silent = True
    px4.wait(10.0)
    px4.heard.clear()
    px4.command(ARM, 1)
    px4.wait(1.0)
    assert px4.said == []
    px4.silent = False
    px4.wait(3.0)
    px4.heard.clear()
    px4.command(ARM, 0)
    px4.wait(1.0)
    assert px4.said == ["Disarmed by external command"]


def test_current_mode_tells_what_was_wanted_while_a_failsafe_has_it(flying: AttendedVehicle) -> None:
    flying.autopilot.parameters.set("NAV_DLL_ACT", 2)
    flying.silent = True
    flying.wait(20.0)
    mode = flying.last("CURRENT_MODE")
    assert (mode.custom_mode, mode.intended_custom_mode) == (Mode.RTL, Mode.LOITER)


def test_a_restart_keeps_the_parameters(px4: AttendedVehicle) -> None:
    px4.autopilot.parameters.set("RTL_RETURN_ALT", 44)
    assert px4.autopilot.restarted(HOME).parameters["RTL_RETURN_ALT"] == 44


def sticks(px4: AttendedVehicle, seconds: float, pitch: int = 0, throttle: int = 500) -> None:
    for _ in range(round(seconds * 10)):
        px4.say(dialect.MAVLink_manual_control_message(1, pitch, 0, throttle, 0, 0))
        px4.wait(0.1)


def test_a_lost_ground_station_does_nothing_by_default(flying: AttendedVehicle) -> None:
    flying.silent = True
    flying.wait(30.0)
    assert flying.autopilot.mode is Mode.LOITER


def test_lost_sticks_bring_it_home_from_the_mode_of_a_pilot_alone(flying: AttendedVehicle) -> None:
    sticks(flying, 1.0)
    flying.wait(8.0)
    assert flying.autopilot.mode is Mode.LOITER
    sticks(flying, 1.0)
    assert flying.command(SET_MODE, 1, 3) == 0
    flying.until(lambda: flying.autopilot.mode is Mode.RTL, "return", 20)


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.LOITER), (2, Mode.LAND), (3, Mode.RTL)])
def test_a_low_battery_does_what_its_parameter_says(px4: AttendedVehicle, action: int, mode: Mode) -> None:
    flown(px4, COM_LOW_BAT_ACT=action, SIM_BAT_DRAIN=60, SIM_BAT_MIN_PCT=6)
    px4.wait(80.0)
    modes = {one.custom_mode for one in px4.heard if one.get_type() == "HEARTBEAT"}
    assert mode in modes
    assert (Mode.RTL in modes or Mode.LAND in modes) == bool(action)


def test_a_breach_of_the_fence_is_told_and_brings_it_home(px4: AttendedVehicle) -> None:
    flown(px4, GF_ACTION=3)
    px4.place(192, Vector(60, 0, 10), -1, 1, 0, NAN)
    px4.wait(2.0)
    px4.autopilot.parameters.set("GF_MAX_HOR_DIST", 20)
    px4.until(lambda: px4.autopilot.mode is Mode.RTL, "return", 60)
    assert any("eofence" in text for text in px4.said)
    px4.until(lambda: not px4.autopilot.armed, "landing", 200)
    assert px4.at.flat() < 1.0


def stream(px4: AttendedVehicle, seconds: float, north: float, east: float) -> None:
    for _ in range(round(seconds * 10)):
        px4.velocity(north, east)
        px4.wait(0.1)


def enter(px4: AttendedVehicle, north: float = 2.0, east: float = 0.0) -> None:
    stream(px4, 1.0, north, east)
    assert px4.command(SET_MODE, 1, 6) == 0


def test_it_follows_velocities_once_the_mode_is_set(flying: AttendedVehicle) -> None:
    stream(flying, 2.0, 2.0, 0.0)
    assert flying.at.flat() < 0.5
    assert flying.command(SET_MODE, 1, 6) == 0
    stream(flying, 5.0, 2.0, 0.0)
    assert flying.at.north == pytest.approx(8.5, abs=2)
    assert flying.autopilot.motion.velocity.north == pytest.approx(2.0, abs=0.3)


def test_it_follows_places_above_the_home_position(flying: AttendedVehicle) -> None:
    goal = Vector(10, 5, 12)
    enter(flying, 0, 0)
    for _ in range(150):
        flying.setpoint(goal)
        flying.wait(0.1)
    assert flying.distance(goal) < 0.5
    assert flying.at.up == pytest.approx(12, abs=0.5)
    assert flying.autopilot.mode is Mode.OFFBOARD


def test_without_setpoints_it_returns_after_a_second_and_goes_on_when_they_come_again(flying: AttendedVehicle) -> None:
    enter(flying)
    flying.wait(0.9)
    assert flying.autopilot.mode is Mode.OFFBOARD
    flying.wait(0.6)
    assert (flying.autopilot.mode, flying.autopilot.intended) == (Mode.RTL, Mode.OFFBOARD)
    assert "Failsafe activated" in flying.said
    flying.wait(2.0)
    stream(flying, 0.5, 0.0, 1.0)
    assert flying.autopilot.mode is Mode.OFFBOARD


def test_a_mode_set_during_the_return_ends_it_and_setpoints_do_not_bring_it_back(flying: AttendedVehicle) -> None:
    enter(flying)
    flying.wait(3.0)
    assert flying.command(SET_MODE, 1, 4, 3) == 0
    stream(flying, 3.0, 2.0, 0.0)
    assert flying.autopilot.mode is Mode.LOITER
    assert flying.speed < 1.0


def test_setpoints_with_an_unknown_frame_are_not_taken(flying: AttendedVehicle) -> None:
    for _ in range(20):
        flying.say(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 20, 0b010111000111, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0
            )
        )
        flying.wait(0.1)
    assert flying.command(SET_MODE, 1, 6) == 1
