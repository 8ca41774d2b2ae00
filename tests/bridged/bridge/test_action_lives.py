"""Actions from the request to their one final status, against the simulated copter in virtual time."""

from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.running_action import MAX_FOLLOWERS
from bridged.drivers.mavlink.action_binding import GLOBAL_TARGET, MESSAGES
from bridged.drivers.mavlink.actions.context import BoundAction, Procedure, ProcedureContext, ProcedureRun, Steps
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from schemas.wire.records import Action, ActionStatus, Header
from tests.bridged.drivers.mavlink.test_six_kinds import FAR, sky_of, under_way
from tests.bridged.sky import GOAL, MISSION, Sky, end_of, is_ack_of, is_command


def test_an_action_is_accepted_then_runs_with_feedback_once_a_second_then_ends_once(sky: Sky) -> None:
    sky.flying()
    heard = sky.begin("goto", *GOAL)
    took = sky.forward(lambda: heard[-1].final, "the end")
    states = [one.state for one in heard]
    assert states[0] == "accepted"
    assert states[-1] == "succeeded"
    assert set(states[1:-1]) == {"running"}
    assert len(states) - 2 == pytest.approx(took, abs=2)
    running = [one for one in heard if one.state == "running" and "distance" in one.feedback]
    assert running[-1].feedback["distance"] < running[0].feedback["distance"]
    assert [one for one in sky.statuses if one.id == heard[0].id] == heard, "observers hear the same"


def test_the_status_names_the_last_percept_that_was_published_before_it(sky: Sky) -> None:
    sky.flying()
    sky.wait(0.05)
    final = sky.do("setpoint", *GOAL)
    told = [one for agent, one in sky.percepts if agent == "uav" and one.header.seq == final.after]
    assert len(told) == 1


def test_a_refused_takeoff_tells_the_vehicles_text(sky: Sky) -> None:
    sky.armed()
    sky.pretend(is_command(dialect.MAV_CMD_NAV_TAKEOFF), dialect.MAV_RESULT_FAILED, "Takeoff: rotors not spooled")
    final = sky.do("takeoff", 5)
    assert final.state == "refused"
    assert final.result is False
    assert final.reason == "the vehicle refused MAV_CMD_NAV_TAKEOFF (FAILED): Takeoff: rotors not spooled"
    assert len(sky.commands(dialect.MAV_CMD_NAV_TAKEOFF)) == 1, "a refusal is an answer; nothing is sent again"


def test_arming_in_a_mode_that_does_not_arm_is_refused_with_the_vehicles_text(sky: Sky) -> None:
    sky.do("set_mode", "RTL")
    final = sky.do("arm_motors", True)
    assert final.state == "refused"
    assert final.reason == "the vehicle refuses to arm until a person corrects this: RTL mode not armable"


def test_an_acknowledged_mode_without_effect_is_no_success(sky: Sky) -> None:
    sky.pretend(is_command(dialect.MAV_CMD_DO_SET_MODE))
    final = sky.do("set_mode", "GUIDED")
    assert final.state == "failed"
    assert final.reason.startswith("GUIDED was acknowledged, but the vehicle is in STABILIZE")


def test_an_acknowledged_takeoff_without_effect_is_no_success(sky: Sky) -> None:
    sky.armed()
    sky.pretend(is_command(dialect.MAV_CMD_NAV_TAKEOFF))
    final = sky.do("takeoff", 5)
    assert final.state == "failed"
    assert "disarmed before it was up: Disarming motors" in final.reason


@pytest.mark.parametrize(
    ("number", "name", "parameter"),
    [
        (dialect.MAV_CMD_DO_SET_MODE, "set_mode", "GUIDED"),
        (dialect.MAV_CMD_COMPONENT_ARM_DISARM, "arm_motors", True),
        (dialect.MAV_CMD_NAV_TAKEOFF, "takeoff", 5),
    ],
)
def test_an_effect_without_acknowledgement_is_a_success(sky: Sky, number: int, name: str, parameter: object) -> None:
    sky.we_hear = lambda message: not is_ack_of(number)(message)
    finals = {one: sky.do(one, value) for one, value in (("set_mode", "GUIDED"), ("arm_motors", True), ("takeoff", 5))}
    assert finals[name].state == "succeeded", finals[name].reason
    assert [one.state for one in finals.values()] == ["succeeded"] * 3


@pytest.mark.parametrize("heartbeats", [0, 1])
def test_a_change_acknowledged_before_a_silence_is_judged_by_the_heartbeats_after_it(sky: Sky, heartbeats: int) -> None:
    sky.do("set_mode", "GUIDED")
    arming = sky.begin("arm_motors", True)
    sky.forward(lambda: sky.vehicle.autopilot.armed, "the motors turn")
    sky.forward(lambda: sky.driver.vehicle.armed or not heartbeats, "the first heartbeat")
    sky.we_hear = is_ack_of(dialect.MAV_CMD_COMPONENT_ARM_DISARM)
    sky.wait(4.5)
    assert not arming[-1].final
    sky.we_hear = lambda message: True
    assert sky.end(arming, 3).state == "succeeded", arming[-1].reason


def test_a_takeoff_that_has_begun_is_not_sent_again_when_its_acknowledgement_is_lost(sky: Sky) -> None:
    sky.armed()
    sky.we_hear = lambda message: not is_ack_of(dialect.MAV_CMD_NAV_TAKEOFF)(message)
    final = sky.do("takeoff", 20)
    assert final.state == "succeeded"
    assert len(sky.commands(dialect.MAV_CMD_NAV_TAKEOFF)) == 1


def test_a_command_whose_acknowledgement_is_lost_is_sent_again_with_its_confirmation_counted_up(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("state"), "the first heartbeat")
    sky.hears_us = lambda message: not (is_command(dialect.MAV_CMD_DO_SET_MODE)(message) and message.confirmation < 2)
    sky.done("set_mode", "GUIDED")
    assert [one.confirmation for one in sky.commands(dialect.MAV_CMD_DO_SET_MODE)] == [0, 1, 2]


def test_a_takeoff_answered_failed_after_its_repetition_is_judged_by_the_altitude(sky: Sky) -> None:
    """The first one worked and its acknowledgement was lost; the repetition is refused because it flies already."""
    seen = 0

    def first_ack_lost_second_failed(message: dialect.MAVLink_message) -> bool:
        nonlocal seen
        if is_ack_of(dialect.MAV_CMD_NAV_TAKEOFF)(message):
            seen += 1
            if seen == 1:
                return False
            message.result = dialect.MAV_RESULT_FAILED
        return seen >= 2 or message.get_type() not in ("EXTENDED_SYS_STATE", "GLOBAL_POSITION_INT")

    sky.armed()
    sky.we_hear = first_ack_lost_second_failed
    sky.done("takeoff", 5)
    assert seen >= 2


def test_a_takeoff_goes_on_in_the_air_after_a_restart_of_the_bridge(sky: Sky, tmp_path: Path) -> None:
    sky.armed()
    sky.begin("takeoff", 20)
    sky.forward(
        lambda: sky.vehicle.autopilot.motion.position.up > sky.vehicle.autopilot.home_on_chart.up + 1, "lift-off"
    )
    again = Sky(tmp_path / "again", vehicle=sky.vehicle, clock=sky.clock)
    again.forward(lambda: again.belief("altitude"), "its altitude")
    again.done("takeoff", 20)
    assert again.do("takeoff", 10).state == "refused", "what is above does not take off"


def test_a_takeoff_is_done_where_it_hovers_a_little_above(sky: Sky) -> None:
    position = sky.flying(10).driver.vehicle.position
    sky.done("takeoff", position.altitude - 0.2)
    assert len(sky.commands(dialect.MAV_CMD_NAV_TAKEOFF)) == 1


def test_a_target_that_no_stream_reports_is_requested(sky: Sky) -> None:
    """Of a vehicle that acknowledges nothing, the intervals of other messages are asked for first, one by one."""
    interval, target = dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT
    sky.hears_us = lambda message: not (is_command(interval)(message) and message.param1 == target)
    final = sky.flying().do("goto", *GOAL)
    assert final.state == "succeeded", final.reason


def test_a_home_that_is_lost_on_the_way_to_a_new_bridge_is_requested_again(sky: Sky, tmp_path: Path) -> None:
    sky.flying().do("land")
    again = Sky(tmp_path / "again", vehicle=sky.vehicle, clock=sky.clock)
    lost: list[dialect.MAVLink_message] = []

    def first_is_lost(message: dialect.MAVLink_message) -> bool:
        if message.get_type() != "HOME_POSITION" or lost:
            return True
        lost.append(message)
        return False

    again.we_hear = first_is_lost
    again.done("return_to_launch")
    assert lost


def test_an_acknowledgement_for_somebody_else_is_not_ours(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("state"), "the first heartbeat")
    sky.hears_us = lambda message: not is_command(dialect.MAV_CMD_DO_SET_MODE)(message)
    sky.downlink.append(dialect.MAVLink_command_ack_message(dialect.MAV_CMD_DO_SET_MODE, 0, 0, 0, 255, 190))
    final = sky.do("set_mode", "GUIDED")
    assert "no acknowledgement" in final.reason
    assert sky.bridge.driver.counters()["acks_unmatched"] >= 1


def test_a_duplicated_request_is_executed_once_and_both_askers_hear_the_end(sky: Sky) -> None:
    sky.flying()
    first = sky.begin("goto", *GOAL)
    sky.wait(2)
    second: list[ActionStatus] = []
    sky.bridge.action_server.ask("uav", "goto", action_of(first, attempt=2), second.append)
    assert second[0].state in ("accepted", "running")
    sky.end(first)
    assert second[-1] == first[-1]
    late: list[ActionStatus] = []
    sky.bridge.action_server.ask("uav", "goto", action_of(first), late.append)
    assert [kept_of(one) for one in late] == [kept_of(first[-1])]


def test_the_newest_askers_hear_the_end_however_often_the_link_flaps(sky: Sky) -> None:
    sky.flying()
    first = sky.begin("goto", *GOAL)
    askers: list[list[ActionStatus | None]] = [[] for _ in range(MAX_FOLLOWERS + 4)]
    for attempt, backfill in enumerate(askers, start=2):
        sky.bridge.action_server.ask("uav", "goto", action_of(first, attempt=attempt), backfill.append)
    sky.forward(lambda: askers[-1][-1] is not None and askers[-1][-1].final, "arrival")
    ends = [backfill[-1].state if backfill[-1] is not None else None for backfill in askers]
    assert ends == [None] * 4 + ["succeeded"] * MAX_FOLLOWERS


def test_an_asker_that_asks_again_leaves_no_follower_of_its_former_query_behind(sky: Sky) -> None:
    sky.flying()
    first = sky.begin("goto", *GOAL)
    heard: dict[str, list[ActionStatus | None]] = {}
    for query, source, attempt in (("1st", "uav", 2), ("watcher", "anna", 1), ("2nd", "uav", 3)):
        action = replace(action_of(first, attempt=attempt), header=Header(source=source))
        sky.bridge.action_server.ask("uav", "goto", action, heard.setdefault(query, []).append)
    assert heard["1st"][-1] is None, "its query ends"
    assert len(sky.bridge.action_server._running[first[0].id].followers) <= 3
    sky.forward(lambda: heard["2nd"][-1] is not None and heard["2nd"][-1].final, "arrival")
    assert [one.state for one in (heard["2nd"][-1], heard["watcher"][-1]) if one] == ["succeeded"] * 2
    assert len(sky.commands(dialect.MAV_CMD_NAV_TAKEOFF)) == 1, "nothing is done twice"


def test_a_bridge_that_begins_with_a_full_disk_serves_a_vehicle_in_the_air(
    sky: Sky, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sky.flying()
    monkeypatch.setattr("bridged.bridge.action_log._write", Mock(side_effect=OSError(28, "No space left on device")))
    again = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    moving = again.do("goto", *GOAL, id="later:1")
    assert (moving.state, moving.reason) == ("refused", "its id cannot be kept on disk: No space left on device")
    assert "ledger_failing" in [note.code for note in again.bridge.notes()]
    again.done("land", id="later:2")


def test_an_id_is_not_executed_again_by_the_next_life_of_the_bridge(sky: Sky, tmp_path: Path) -> None:
    ended = sky.do("set_mode", "GUIDED")
    begun = sky.begin("arm_motors", True)
    again = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    for known, expected in ((ended, "succeeded"), (begun[0], "failed")):
        heard: list[ActionStatus] = []
        again.bridge.action_server.ask("uav", known.name, action_of([known], attempt=2), heard.append)
        assert [one.state for one in heard] == [expected]
    assert heard[0].reason == "the bridge restarted while it ran; how it ended is not known"
    assert not again.commands(dialect.MAV_CMD_COMPONENT_ARM_DISARM)


def test_a_retry_of_an_id_that_the_bridge_never_saw_is_refused(sky: Sky) -> None:
    assert end_of(sky.do("set_mode", "GUIDED", attempt=2)) == ("refused", "bridge restarted")


@pytest.mark.parametrize(
    ("by", "how"), [({"id": ""}, ", by hand"), ({"header": Header(source="operator")}, ", by hand"), ({}, "")]
)
def test_a_superseded_action_says_by_what_and_whether_by_hand(sky: Sky, by: dict[str, object], how: str) -> None:
    sky.flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(1)
    sky.begin("land", **by)
    assert (going[-1].state, going[-1].reason) == ("cancelled", f"superseded by land of uav{how}")


def test_a_cancelled_motion_leaves_the_vehicle_holding(sky: Sky) -> None:
    sky.flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(4)
    cancelled = sky.bridge.action_server.cancel("uav", going[0].id)
    assert (cancelled.state, cancelled.reason) == ("cancelled", "cancelled by uav")
    assert going[-1] == cancelled
    sky.wait(10)
    here = sky.belief("global_pos")
    sky.wait(5)
    assert sky.belief("global_pos") == pytest.approx(here, abs=2e-6), "20 cm"
    assert kept_of(sky.bridge.action_server.cancel("uav", going[0].id)) == kept_of(cancelled), (
        "a second cancel hears the same end"
    )


def test_an_action_out_of_time_says_what_it_waited_for(sky: Sky) -> None:
    sky.flying()
    final = sky.do("goto", *GOAL, deadline=3.0)
    assert final.state == "timed_out"
    assert final.reason.startswith("not done within 3 s; it waited for arrival;")


def test_arming_waits_for_readiness_and_says_what_is_missing(sky: Sky) -> None:
    sky.do("set_mode", "GUIDED")
    heard = sky.begin("arm_motors", True, deadline=2.0)
    sky.we_hear = lambda message: message.get_type() not in ("SYS_STATUS", "GPS_RAW_INT")
    assert sky.end(heard).state == "timed_out"
    assert "pre-arm checks have not passed" in heard[-1].reason
    assert "no GPS position (fix type 0)" in heard[-1].reason
    assert not sky.commands(dialect.MAV_CMD_COMPONENT_ARM_DISARM)


def test_a_lost_link_fails_the_running_action_and_is_told_once(sky: Sky) -> None:
    sky.flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(2)
    sky.we_hear = lambda message: False
    took = sky.forward(lambda: going[-1].final, "the end")
    assert 4 <= took <= 6
    assert going[-1].state == "failed"
    assert going[-1].reason.startswith("link lost: no heartbeat for 5")
    sky.wait(10)
    told = sky.told("state")
    assert told[-1] == ("", False, False)
    assert told.count(("", False, False)) == 1
    assert sky.belief("altitude") is None, "what a silent vehicle said has aged"
    sky.we_hear = lambda message: True
    sky.forward(lambda: sky.belief("altitude"), "the altitude after the link is back", 10)
    sky.wait(1)
    assert sky.belief("state") == ("GUIDED", True, True)


@pytest.mark.parametrize(("vehicle", "autopilot"), [("copter", "ardupilot"), ("copter", "px4"), ("rover", "ardupilot")])
def test_a_mode_that_an_agent_sets_after_a_cancel_is_not_replaced_by_the_hold_of_the_cancelled_motion(
    tmp_path: Path, vehicle: str, autopilot: str
) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    under_way(sky, vehicle)
    sky.hears_us = lambda message: False
    sky.bridge.action_server.cancel("uav", sky.statuses[-1].id, "uav")
    sky.wait(0.5)
    homeward = sky.begin("set_mode", "RTL")
    sky.hears_us = lambda message: True
    assert sky.end(homeward).state == "succeeded"
    sky.wait(6)
    assert sky.driver.under_way == "rtl"


@pytest.mark.parametrize(("vehicle", "autopilot"), [("copter", "px4"), ("plane", "px4"), ("copter", "ardupilot")])
def test_a_way_home_ends_a_mode_that_is_being_set_which_would_be_set_again_and_replace_it(
    tmp_path: Path, vehicle: str, autopilot: str
) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    under_way(sky, vehicle)
    sky.begin("return_to_launch")
    sky.wait(1.7)
    guided = sky.begin("set_mode", "GUIDED")
    sky.wait(0.1)
    sky.begin("return_to_launch")
    sky.wait(8)
    assert guided[-1].state in ("cancelled", "succeeded")
    assert sky.driver.under_way == "rtl"


@pytest.mark.parametrize("asked", ["return_to_launch", "set_mode", "cancel"])
def test_what_a_vehicle_did_not_hear_before_a_pilot_took_it_is_not_repeated(tmp_path: Path, asked: str) -> None:
    sky = sky_of(tmp_path, "rover", "ardupilot").armed()
    going = sky.begin("goto", *FAR)
    sky.wait(3)
    sky.hears_us = lambda message: False
    if asked == "cancel":
        sky.bridge.action_server.cancel("uav", going[-1].id, "uav")
    else:
        going = sky.begin(asked, *(["HOLD"] if asked == "set_mode" else []))
    sky.wait(0.8)
    sky.pilot_sets(0)
    sky.wait(0.1)
    sky.hears_us = lambda message: True
    sky.wait(5)
    assert sky.vehicle.autopilot.mode.name == "MANUAL"
    assert going[-1].state == ("cancelled" if asked == "cancel" else "failed")


def test_a_pilots_mode_change_fails_the_motion_and_is_a_percept_until_the_agent_takes_control(sky: Sky) -> None:
    sky.flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(1)
    sky.pilot_sets(5)
    assert sky.end(going, 3).state == "failed"
    assert "the mode became LOITER, which nobody here asked for" in going[-1].reason
    assert sky.belief("override") == ("LOITER",)
    sky.done("set_mode", "GUIDED")
    assert sky.belief("override") is None
    sky.done("goto", *GOAL)


def test_a_pilot_who_leaves_his_mode_for_guided_hands_the_vehicle_over_until_he_takes_it_again(sky: Sky) -> None:
    def pilot_sets(mode: Mode) -> None:
        sky.pilot_sets(mode)

    sky.flying()
    for _ in range(2):
        pilot_sets(Mode.LOITER)
        sky.forward(lambda: sky.belief("override"), "the pilot's mode", 3)
        assert sky.driver.overridden == "LOITER"
        pilot_sets(Mode.GUIDED)
        sky.forward(lambda: sky.belief("override") is None, "the end of the override", 3)
        assert sky.driver.overridden == ""
        sky.do("set_mode", "GUIDED")  # it is expected for some seconds: who leaves and returns meanwhile hands over too
    sky.done("goto", *GOAL)


def test_an_order_to_a_silent_vehicle_does_not_take_it_from_a_pilot_who_has_it_when_it_is_heard(sky: Sky) -> None:
    sky.flying()
    sky.we_hear = lambda message: False
    sky.forward(lambda: sky.belief("state") == ("", False, False), "the silence", 10)
    asked = sky.begin("set_mode", "GUIDED")
    sky.vehicle.receive(dialect.MAVLink_set_mode_message(1, 1, Mode.LOITER))
    sky.wait(2)
    sky.we_hear = lambda message: True
    sky.end(asked, 5)
    assert (asked[-1].state, asked[-1].cause) == ("failed", "pilot")
    sky.forward(lambda: sky.belief("override") == ("LOITER",), "the pilot's mode, once a restart is ruled out", 3)
    assert sky.vehicle.autopilot.mode is Mode.LOITER


def test_an_order_does_not_take_a_vehicle_whose_pilot_the_agents_do_not_perceive_yet(sky: Sky) -> None:
    sky.flying()
    sky.we_hear = lambda message: False
    sky.forward(lambda: sky.belief("state") == ("", False, False), "the silence", 10)
    sky.vehicle.receive(dialect.MAVLink_set_mode_message(1, 1, Mode.LOITER))
    sky.wait(2)
    sky.we_hear = lambda message: True
    sky.forward(lambda: sky.belief("state") == ("LOITER", True, True), "the vehicle", 3)
    assert sky.belief("override") is None, "it may have begun with this mode"
    asked = sky.begin("set_mode", "GUIDED")
    sky.end(asked, 5)
    assert (asked[-1].state, asked[-1].cause) == ("failed", "pilot")
    sky.forward(lambda: sky.belief("override") == ("LOITER",), "the pilot's mode", 3)
    assert sky.vehicle.autopilot.mode is Mode.LOITER


def test_a_pilot_who_takes_a_vehicle_from_a_bridge_restarted_in_flight_is_perceived(sky: Sky, tmp_path: Path) -> None:
    again = Sky(tmp_path, vehicle=sky.flying().vehicle, clock=sky.clock)
    again.forward(lambda: again.belief("state") == ("GUIDED", True, True), "the vehicle", 3)
    again.pilot_sets(Mode.LOITER)
    again.forward(lambda: again.belief("override") == ("LOITER",), "the pilot's mode", 3)


def test_who_sets_guided_while_the_vehicle_is_silent_hands_it_over(sky: Sky) -> None:
    sky.flying()
    sky.pilot_sets(Mode.LOITER)
    sky.forward(lambda: sky.belief("override"), "the pilot's mode", 3)
    sky.we_hear = lambda message: False
    sky.forward(lambda: sky.belief("state") == ("", False, False), "the silence", 10)
    sky.vehicle.receive(dialect.MAVLink_set_mode_message(1, 1, Mode.GUIDED))
    sky.we_hear = lambda message: True
    sky.forward(lambda: sky.belief("state") == ("GUIDED", True, True), "GUIDED", 5)
    assert sky.belief("override") is None
    assert sky.driver.overridden == ""


def test_guided_that_a_ground_station_sets_while_an_agent_flies_home_is_its_own(sky: Sky) -> None:
    sky.flying()
    going = sky.begin("return_to_launch")
    sky.forward(lambda: sky.vehicle.autopilot.mode is Mode.RTL, "RTL", 3)
    sky.wait(2)
    sky.pilot_sets(Mode.GUIDED)
    sky.end(going, 3)
    assert (going[-1].state, going[-1].cause) == ("failed", "pilot")
    assert sky.belief("override") == ("GUIDED",)


@pytest.mark.parametrize("action", [("goto", *GOAL), ("return_to_launch",), ("land",), ("arm_motors", False)])
def test_while_a_pilot_has_the_vehicle_no_action_is_taken_until_a_takeover(sky: Sky, action: tuple[Any, ...]) -> None:
    sky.flying()
    sky.pilot_sets(5)
    sky.forward(lambda: sky.belief("override"), "the pilot's mode", 3)
    assert end_of(sky.do(*action)) == (
        "refused",
        "override: others have set LOITER (pilot, ground station or failsafe); "
        "an agent takes control again by setting the mode",
    )
    assert sky.vehicle.autopilot.mode.name == "LOITER"
    assert sky.vehicle.autopilot.armed
    sky.done("set_mode", "GUIDED")
    sky.done("land")


def test_a_target_outside_the_missions_limits_is_refused(tmp_path: Path) -> None:
    limited = MISSION.replace("    link:", "    limits: {altitude: 30, radius: 100}\n    link:")
    sky = Sky(tmp_path, mission=limited).flying()
    assert sky.do("goto", *GOAL).reason == "altitude 40 m is above the mission's limit of 30 m"
    assert sky.do("goto", -27.7, -48.5, 20).reason.endswith("m from home is outside the mission's limit of 100 m")
    sky.done("land")
    sky.armed()
    assert sky.do("takeoff", 31).reason == "altitude 31 m is above the mission's limit of 30 m"


@pytest.mark.parametrize(
    ("name", "parameters", "reason"),
    [
        ("takeoff", (500,), "takeoff: expected altitude: float 1..120 m, got 500"),
        ("takeoff", ("high",), 'takeoff: expected altitude: float 1..120 m, got "high"'),
        ("takeoff", (), "takeoff(altitude: float 1..120 m) takes 1 argument, got 0"),
        ("arm_motors", ("True",), 'arm_motors: expected arm: boolean, got "True"'),
        ("set_mode", (4.5,), "set_mode: expected mode: string or int, got 4.5"),
        ("setpoint", (95.0, 0.0, 5.0), "setpoint: expected latitude: float -90..90 deg, got 95"),
    ],
)
def test_a_bad_argument_is_refused_with_what_was_expected(
    sky: Sky, name: str, parameters: tuple[object, ...], reason: str
) -> None:
    final = sky.do(name, *parameters)  # type: ignore[arg-type]
    assert (final.state, final.reason) == ("refused", reason)


def test_a_mode_that_the_vehicle_does_not_have_is_refused_with_those_it_has(sky: Sky) -> None:
    final = sky.do("set_mode", "HOVER")
    assert final.state == "refused"
    assert final.reason.startswith("no mode 'HOVER'; this vehicle has STABILIZE, ACRO")


def test_an_action_that_the_robot_does_not_have_is_refused_with_those_it_has(sky: Sky) -> None:
    final = sky.do("jump", 3)
    assert final.state == "refused"
    assert final.reason.startswith("uav1 has no action jump; it has set_mode/1, arm_motors/1")


def test_deadlines_scale_with_speed_but_the_wait_for_an_acknowledgement_does_not(tmp_path: Path) -> None:
    sky = Sky(tmp_path, speed=8)
    sky.forward(lambda: sky.belief("state"), "the first heartbeat")
    sky.hears_us = lambda message: message.get_type() == "HEARTBEAT"
    start = sky.clock.wall()
    final = sky.do("set_mode", "GUIDED", deadline=1000.0)
    assert final.state == "failed"
    assert 4 * 0.7 <= sky.clock.wall() - start <= 4 * (0.7 + 1 / 8), "a HEARTBEAT, one a second, comes before each"
    beats = [one for one in sky.sent if one.get_type() == "HEARTBEAT"]
    assert len(beats) == pytest.approx(sky.clock.now(), abs=3), "heartbeats follow the vehicle's clock"


def kept_of(status: ActionStatus) -> tuple[object, ...]:
    """What the action log keeps of it."""
    return status.id, status.name, status.state, status.result, status.reason, status.after, status.header.boot


def action_of(heard: list[ActionStatus], attempt: int = 1) -> Action:
    return Action(id=heard[0].id, parameters=heard[0].parameters, attempt=attempt)


def test_a_parked_vehicle_is_asked_for_little_and_one_at_work_for_its_full_rates(sky: Sky) -> None:
    def heard_per_second(seconds: float) -> float:
        before = sky.bridge.driver.counters()["messages"]
        sky.wait(seconds)
        return (sky.bridge.driver.counters()["messages"] - before) / seconds

    sky.wait(5)
    assert heard_per_second(10) < 8
    sky.flying()
    assert heard_per_second(5) > 15
    sky.done("land")
    sky.wait(15)
    assert heard_per_second(10) < 8
    assert sky.bridge.percepts.expired == 0, "what comes slower does not age"


def test_streams_that_another_station_slows_down_are_asked_for_again(sky: Sky) -> None:
    sky.flying()
    for number in (33, 245):
        slow = dialect.MAVLink_command_long_message(
            1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, number, -1, *(0,) * 5
        )
        sky.vehicle.receive(slow)
    before = sky.bridge.driver.counters()["streams_requested"]
    sky.forward(lambda: sky.bridge.driver.counters()["streams_requested"] >= before + 2, "the requests", 10)
    seen = len([one for agent, one in sky.percepts if one.name == "global_pos"])
    sky.do("setpoint", *GOAL)
    sky.wait(2)
    assert len([one for agent, one in sky.percepts if one.name == "global_pos"]) > seen + 10


def test_a_defect_in_a_procedure_fails_its_action_and_nothing_else(sky: Sky, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
        yield
        raise KeyError("target")

    sky.flying()
    monkeypatch.setitem(MESSAGES[GLOBAL_TARGET].confirm, "arrival", Procedure(broken))
    assert end_of(sky.do("goto", *GOAL, within=2)) == ("failed", "defect in argosy: KeyError: 'target'")
    sky.done("land")


def test_the_request_for_the_vehicles_own_target_is_made_again_when_nobody_answered_it(sky: Sky) -> None:
    target = float(dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT)
    interval = is_command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL)
    sky.hears_us = lambda message: not (interval(message) and message.param1 == target)
    sky.armed()
    sky.wait(3)
    sky.hears_us = lambda message: True
    sky.done("takeoff", 5)
    sky.done("setpoint", *GOAL)
