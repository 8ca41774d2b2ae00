"""What the simulated copter does and refuses beyond the recorded exchanges; virtual time, real MAVLink bytes."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.geodesy import FlatMap, Place
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Landed
from tests.bridged.sky import HOME
from tests.bridged.virtual_copter import Station

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4


def test_nothing_but_heartbeats_and_timesync_comes_unasked(station: Station) -> None:
    station.wait(60.0)
    assert station.kinds() == {"HEARTBEAT", "TIMESYNC"}
    assert sum(message.get_type() == "HEARTBEAT" for message in station.heard) == 60


def test_texts_go_only_to_a_link_on_which_somebody_was_heard() -> None:
    station = Station(ready=False)
    station.wait(5.0)
    assert not station.texts()
    station.heartbeat()
    station.guided()
    station.command(400, 1)
    assert "Arming motors" in station.texts()


def test_an_interval_is_kept_in_vehicle_time_and_told_and_stopped(station: Station) -> None:
    assert station.command(511, 33, 100_000) == ACCEPTED
    heard = [message for message in station.wait(10.0) if message.get_type() == "GLOBAL_POSITION_INT"]
    assert len(heard) == 100
    station.command(510, 33)
    assert station.heard[-2].interval_us == 100_000
    assert station.command(511, 33, -1) == ACCEPTED
    assert "GLOBAL_POSITION_INT" not in {message.get_type() for message in station.wait(5.0)}


def test_a_flight_is_the_same_in_steps_of_20_ms_and_in_as_long_ones_as_there_is_time_for() -> None:
    def flown(step: float) -> tuple[list[tuple[float, float, float]], float]:
        station = Station()
        station.command(511, 33, 100_000)
        station.fly_to(10.0)
        begin, heard = station.now, len(station.heard)
        station.setpoint(Vector(40.0, 0.0, 10.0))
        station.until(lambda: station.now - begin > 30.0, "half a minute", step=step)
        station.command(176, 1, Mode.RTL)
        station.until(lambda: not station.autopilot.armed, "landing", step=step)
        moved = [message for message in station.heard[heard:] if message.get_type() == "GLOBAL_POSITION_INT"]
        chart = station.autopilot.chart
        at = [chart.vector(Place(one.lat / 1e7, one.lon / 1e7, one.alt / 1e3)) for one in moved]
        return [(one.north, one.east, one.up) for one in at], station.now - begin

    (short, short_time), (long, long_time) = flown(0.02), flown(1.0)
    assert abs(len(short) - len(long)) <= 12  # a second
    assert abs(short_time - long_time) <= 1.0
    assert max(math.dist(one, other) for one, other in zip(short, long, strict=False)) < 0.25


def test_a_stream_request_sends_a_whole_group_and_stops_it(station: Station) -> None:
    station.say(dialect.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    kinds = [message.get_type() for message in station.wait(10.0)]
    for kind in ("SYS_STATUS", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ATTITUDE", "VFR_HUD", "EKF_STATUS_REPORT"):
        assert kinds.count(kind) == 40, kind
    station.say(dialect.MAVLink_request_data_stream_message(1, 1, 0, 0, 0))
    assert {message.get_type() for message in station.wait(9.0)} <= {"HEARTBEAT", "TIMESYNC"}


@pytest.mark.parametrize("message_id", [1, 24, 33, 74, 148, 193, 242, 245])
def test_a_message_is_sent_once_when_it_is_requested(station: Station, message_id: int) -> None:
    assert station.command(512, message_id) == ACCEPTED
    assert station.heard[-1].get_msgId() == message_id


def test_the_whole_list_of_parameters_comes_once_with_rising_indices(station: Station) -> None:
    station.say(dialect.MAVLink_param_request_list_message(1, 1))
    values = [message for message in station.wait(5.0) if message.get_type() == "PARAM_VALUE"]
    assert [value.param_index for value in values] == list(range(values[0].param_count))
    assert len({value.param_id for value in values}) == len(values)


def test_a_parameter_that_is_no_number_changes_nothing(station: Station) -> None:
    (answer,) = station.say(dialect.MAVLink_param_set_message(1, 1, b"RTL_ALT", math.nan, 9))
    assert answer.param_value == 1500.0


def test_parameters_change_the_flight(station: Station) -> None:
    station.say(dialect.MAVLink_param_set_message(1, 1, b"RTL_ALT", 3000, 6))
    station.fly_to(10.0)
    station.setpoint(Vector(30.0, 0.0, 10.0))
    station.wait(20.0)
    assert station.command(20) == ACCEPTED
    station.until(lambda: station.distance(Vector()) < 1, "home")
    assert abs(station.at.up - 30.0) < 0.2


def test_a_timesync_request_is_answered_with_vehicle_time(station: Station) -> None:
    (answer,) = station.say(dialect.MAVLink_timesync_message(0, 12345))
    assert (answer.ts1, answer.tc1) == (12345, round(station.now * 1e9))
    assert not station.say(dialect.MAVLink_timesync_message(1, 12345))


def test_the_reasons_against_arming_follow_the_start_of_the_vehicle() -> None:
    station = Station(boot="real", ready=False)
    reasons = []
    for until in (1.2, 3.0, 10.0, 18.0, 21.0, 30.0, 42.0):
        station.wait(max(0.0, until - station.now))
        station.guided()
        station.heard.clear()
        result = station.command(400, 1)
        reasons.append(station.texts() if result else "armed")
    assert reasons == [
        ["Arm: System not initialised"],
        ["Arm: Need Alt Estimate"],
        ["Arm: Accels inconsistent"],
        ["Arm: AHRS: waiting for home", "Arm: Gyros inconsistent", "Arm: Need Position Estimate"],
        ["Arm: Gyros inconsistent", "Arm: Need Position Estimate"],
        ["Arm: Need Position Estimate"],
        "armed",
    ]


def test_the_pilots_mode_switch_is_read_during_the_start() -> None:
    station = Station(boot="real", ready=False)
    station.heartbeat()
    station.guided()
    modes = [station.autopilot.mode]
    station.wait(2.0)
    assert [*modes, station.autopilot.mode] == [Mode.GUIDED, Mode.STABILIZE]


def test_a_mode_that_needs_a_position_is_refused_in_flight_without_one_and_accepted_on_the_ground() -> None:
    station = Station(boot="real", ready=False)
    station.heartbeat()
    station.wait(25.0)
    assert station.command(400, 1) == ACCEPTED  # STABILIZE needs no position
    assert station.command(176, 1, Mode.GUIDED) == FAILED
    assert station.texts()[-1] == "Mode change to GUIDED failed: requires position"


def test_a_mode_that_is_not_simulated_is_refused_in_words(station: Station) -> None:
    assert station.command(176, 1, Mode.CIRCLE) == FAILED
    assert station.texts()[-1] == "Mode change to CIRCLE failed: not simulated"


def test_home_is_where_the_copter_was_armed(station: Station) -> None:
    station.fly_to(5.0)
    station.setpoint(Vector(20.0, 0.0, 5.0))
    station.wait(15.0)
    station.command(21)
    station.until(lambda: not station.autopilot.armed, "landing")
    station.heard.clear()
    station.guided()
    station.command(400, 1)
    (home,) = [message for message in station.heard if message.get_type() == "HOME_POSITION"]
    assert abs((home.latitude / 1e7 - HOME.lat) * 111_319.5 - 20.0) < 0.5


def test_a_setpoint_during_a_takeoff_cancels_it_and_flies_straight_to_the_goal(station: Station) -> None:
    station.guided()
    station.command(400, 1)
    station.command(22, 0, 0, 0, 0, 0, 0, 30)
    station.until(lambda: station.at.up > 3.0, "lift-off")
    station.setpoint(Vector(0.0, 20.0, 6.0))
    station.wait(0.1)
    assert station.autopilot.flight.landed is Landed.IN_AIR
    station.until(lambda: station.distance(Vector(0.0, 20.0)) < 0.5, "arrival")
    assert abs(station.at.up - 6.0) < 0.5


def test_another_mode_before_lift_off_ends_the_takeoff(station: Station) -> None:
    station.guided()
    station.command(400, 1)
    station.command(22, 0, 0, 0, 0, 0, 0, 5)
    station.command(176, 1, Mode.LOITER)
    station.until(lambda: not station.autopilot.armed, "auto-disarm")
    assert station.at.up == 0.0


def test_guided_ends_a_landing(station: Station) -> None:
    station.fly_to(10.0)
    station.command(21)
    station.wait(3.0)
    assert station.autopilot.flight.landed is Landed.LANDING
    station.guided()
    station.wait(5.0)
    assert (station.autopilot.flight.landed, station.autopilot.armed) == (Landed.IN_AIR, True)
    assert station.speed < 0.05


def test_altitudes_of_frame_5_are_above_the_sea_and_of_frame_6_above_home() -> None:
    for frame in (5, 6):
        station = Station()
        station.fly_to(10.0)
        station.setpoint(Vector(0.0, 0.0, 14.0), frame=frame)
        station.wait(15.0)
        assert abs(station.at.up - 14.0) < 0.1
    station.setpoint(Vector(0.0, 0.0, -1.0), frame=5)  # 20 m above the sea is 1 m under the ground
    station.until(lambda: not station.autopilot.flight.airborne, "ground")
    assert station.at.up == 0.0


def test_a_velocity_is_flown_until_it_is_three_seconds_old(station: Station) -> None:
    station.fly_to(10.0)
    mask = 0b110111000111
    message = dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, mask, 0, 0, 0, 2.0, 0, -0.5, 0, 0, 0, 0, 0
    )
    station.say(message)
    station.wait(2.9)
    assert abs(station.autopilot.motion.velocity.north - 2.0) < 0.2
    station.wait(5.0)
    assert station.speed < 0.1
    assert 4.0 < station.at.north < 8.0
    assert 10.8 < station.at.up < 12.0


def test_a_body_offset_goes_where_the_nose_points(station: Station) -> None:
    station.fly_to(10.0)
    assert station.command(115, 90, 0, 1, 0) == ACCEPTED
    station.wait(5.0)
    message = dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 9, 3576, 10.0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    station.say(message)
    station.wait(12.0)
    assert (round(station.at.north), round(station.at.east)) == (0, 10)


def test_the_nose_turns_to_the_goal_in_guided_and_stays_as_it_is_in_rtl(station: Station) -> None:
    station.fly_to(15.0)
    station.setpoint(Vector(0.0, 30.0, 15.0))
    station.wait(15.0)
    assert abs(math.degrees(station.autopilot.motion.heading) - 90.0) < 3.0
    station.command(20)
    station.wait(12.0)
    assert abs(math.degrees(station.autopilot.motion.heading) - 90.0) < 3.0


def test_a_speed_that_was_set_is_flown(station: Station) -> None:
    station.fly_to(10.0)
    station.setpoint(Vector(100.0, 0.0, 10.0))
    assert station.command(178, 1, 3.0, -1) == ACCEPTED
    station.wait(15.0)
    assert abs(station.speed - 3.0) < 0.2


def test_a_forced_disarm_in_flight_lets_the_copter_fall(station: Station) -> None:
    station.fly_to(10.0)
    assert station.command(400, 0) == FAILED
    assert station.command(400, 0, 21196) == ACCEPTED
    station.until(lambda: not station.autopilot.flight.airborne, "ground", seconds=3.0)
    hit = next(text for text in station.texts() if text.startswith("SIM Hit ground"))
    assert abs(float(hit.split()[-2]) - 14.0) < 0.5  # root of 2 g h
    station.wait(2.0)
    assert station.autopilot.flight.landed is Landed.ON_GROUND


def test_loiter_brake_and_stabilize_hover_where_they_began() -> None:
    for mode in (Mode.LOITER, Mode.BRAKE, Mode.ALT_HOLD, Mode.STABILIZE, Mode.POSHOLD):
        station = Station()
        station.fly_to(10.0)
        assert station.command(176, 1, mode) == ACCEPTED
        station.wait(10.0)
        assert station.distance(Vector()) < 0.2
        assert abs(station.at.up - 10.0) < 0.2
        assert station.autopilot.armed


def test_rtl_within_the_cone_does_not_climb_to_its_full_height(station: Station) -> None:
    station.fly_to(5.0)
    station.setpoint(Vector(2.5, 0.0, 5.0))
    station.wait(10.0)
    station.command(20)
    highest = 0.0

    def landed() -> bool:
        nonlocal highest
        highest = max(highest, station.at.up)
        return not station.autopilot.armed

    station.until(landed, "landing")
    assert 7.0 < highest < 8.0  # 3 m per metre of distance


def test_the_battery_drains_in_flight_and_not_on_the_ground(station: Station) -> None:
    station.wait(100.0)
    assert station.autopilot.battery.remaining == 100
    station.fly_to(10.0)
    station.wait(60.0)
    assert 80 <= station.autopilot.battery.remaining <= 85


def test_the_fence_brings_the_copter_home_when_it_is_drawn_tighter_around_it(station: Station) -> None:
    station.fly_to(10.0)
    station.setpoint(Vector(60.0, 0.0, 10.0))
    station.wait(20.0)
    station.say(dialect.MAVLink_param_set_message(1, 1, b"FENCE_RADIUS", 30, 9))
    station.say(dialect.MAVLink_param_set_message(1, 1, b"FENCE_ENABLE", 1, 2))
    station.wait(1.0)
    assert "Circle fence breached" in station.texts()
    assert station.autopilot.mode is Mode.RTL


def test_a_lost_ground_station_disarms_on_the_ground_only_by_the_usual_delay(station: Station) -> None:
    station.say(dialect.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 1, 2))
    station.guided()
    station.command(400, 1)
    station.wait(6.0)
    assert "GCS Failsafe" in station.texts()
    assert station.autopilot.mode is Mode.GUIDED


def test_a_reboot_is_refused_with_motors_on_and_otherwise_begins_anew(station: Station) -> None:
    station.command(511, 33, 100_000)
    station.guided()
    station.command(400, 1)
    assert station.command(246, 1) == FAILED
    station.command(400, 0)
    assert station.command(246, 1) == ACCEPTED
    assert not station.wait(1.0)
    assert not station.say(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    station.wait(5.0)
    assert station.vehicle.autopilot.mode is Mode.STABILIZE
    assert station.now < 6.0
    assert "GLOBAL_POSITION_INT" not in {message.get_type() for message in station.wait(2.0)}


def test_dronekits_guided_mission_item_is_a_goal(station: Station) -> None:
    station.fly_to(10.0)
    goal = FlatMap(HOME).place(Vector(10.0, 10.0, 0.0))
    item = dialect.MAVLink_mission_item_message(1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, goal.lat, goal.lon, 12.0)
    (ack,) = station.say(item)
    assert (ack.get_type(), ack.type) == ("MISSION_ACK", 0)
    station.wait(15.0)
    assert station.distance(Vector(10.0, 10.0)) < 0.7
    assert abs(station.at.up - 12.0) < 0.2


def test_the_mission_list_of_a_fresh_vehicle_is_home_alone_and_the_other_lists_are_empty(station: Station) -> None:
    counts = [station.say(dialect.MAVLink_mission_request_list_message(1, 1, kind))[0].count for kind in (0, 1, 2)]
    assert counts == [1, 0, 0]
    (item,) = station.say(dialect.MAVLink_mission_request_int_message(1, 1, 0))
    assert (item.x, item.y) == (HOME.lat_e7, HOME.lon_e7)


def test_another_vehicles_messages_are_not_for_this_one() -> None:
    station = Station(system=3, ready=False)
    station.wait(4.0)
    assert not station.say(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert station.command(176, 1, Mode.GUIDED, target=3) == ACCEPTED
    assert station.command(176, 1, Mode.LOITER, target=0) == ACCEPTED
    assert {message.get_srcSystem() for message in station.heard} == {3}
