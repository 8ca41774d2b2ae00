"""Targets in metres and m/s, channels, servos and raw commands: each confirmed by what the vehicle itself reports."""

import math
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.fault_injection import Faults
from bridged.simulation.vehicle.mission_items import Item as Stored
from schemas.manifest.loader import Manifest, load_manifest, read_manifest
from tests.bridged.sky import GOAL, MISSION, Sky, end_of, is_command
from tests.support.notes import identities

MORE = """
[actions.velocity]
params = [{name = "east"}, {name = "north"}, {name = "up"}]
message = "SET_POSITION_TARGET_LOCAL_NED"
frame = "local"
fields = {vx = "north", vy = "east", vz = {param = "up", scale = -1}}
confirm = "velocity"
deadline = "20s"

[actions.local]
params = [{name = "east"}, {name = "north"}, {name = "up"}]
message = "SET_POSITION_TARGET_LOCAL_NED"
frame = "local"
fields = {x = "north", y = "east", z = {param = "up", scale = -1}}
confirm = "target"
supersedes = true

[actions.step]
params = [{name = "forward"}, {name = "right"}]
message = "SET_POSITION_TARGET_LOCAL_NED"
frame = "body"
fields = {x = "forward", y = "right", z = 0}
confirm = "arrival"
tolerance = 0.5

[actions.sticks]
params = [{name = "channels", type = "list"}]
message = "RC_CHANNELS_OVERRIDE"
confirm = "rc"
fields = {channels = "channels"}
motion = false
deadline = "20s"

[actions.throttle]
params = [{name = "pwm", type = "int"}]
message = "RC_CHANNELS_OVERRIDE"
confirm = "sent"
fields = {chan3_raw = "pwm"}
motion = false

[actions.repositioned]
params = [{name = "latitude"}, {name = "longitude"}, {name = "altitude"}]
command = "MAV_CMD_DO_REPOSITION"
frame = "relative"
fields = {param1 = -1, param2 = 1, param5 = "latitude", param6 = "longitude", param7 = "altitude"}
confirm = "arrival"
cancel = "hold"

[actions.servo]
params = [{name = "number", type = "int"}, {name = "pwm", type = "int"}]
command = "MAV_CMD_DO_SET_SERVO"
fields = {param1 = "number", param2 = "pwm"}
confirm = "servo"
motion = false
deadline = "15s"

[actions.gripper]
params = [{name = "grab", type = "boolean"}]
command = "MAV_CMD_DO_GRIPPER"
fields = {param1 = 1, param2 = "grab"}
confirm = "gripper"
motion = false
deadline = "15s"

[actions.raw]
params = [{name = "command", type = ["int", "string"]}, {name = "param1"}, {name = "param2"}, {name = "param7"}]
call = "command"
confirm = "ack"
deadline = "60s"
"""


def manifest() -> Manifest:
    file = Path(load_manifest("copter").file)
    return read_manifest(file.read_text() + MORE, str(file))


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return Sky(tmp_path, manifest=manifest())


def limited(tmp_path: Path, limits: str) -> Sky:
    return Sky(tmp_path, manifest=manifest(), mission=f"{MISSION}    limits: {limits}\n")


def place(sky: Sky) -> tuple[float, float, float]:
    at = sky.vehicle.autopilot.motion.position
    return at.north, at.east, at.up


def test_a_local_place_is_taken_east_north_up_when_the_manifest_says_so(sky: Sky) -> None:
    sky.flying()
    sky.done("local", 8, 12, 6)
    sky.wait(15)
    assert place(sky) == pytest.approx((12, 8, 6), abs=0.5)


def test_a_local_place_is_arrived_at(sky: Sky) -> None:
    sky.flying()
    sky.done("move", 12, 8, 6)
    assert place(sky) == pytest.approx((12, 8, 6), abs=1.2)


def test_a_place_ahead_of_the_body_is_arrived_at_once_however_often_it_is_sent(sky: Sky) -> None:
    sky.flying()
    sky.vehicle.autopilot.motion.heading = math.radians(90)
    sky.wait(1)
    lost = iter([False, False])
    sky.hears_us = lambda message: message.get_type() != "SET_POSITION_TARGET_LOCAL_NED" or next(lost, True)
    sky.done("step", 10, 0)
    assert place(sky)[:2] == pytest.approx((0, 10), abs=1)


def test_a_velocity_is_taken_and_the_copter_stops_by_itself_without_a_new_one(sky: Sky) -> None:
    sky.flying()
    sky.done("velocity", 2, 0, 0)
    sky.wait(2)
    velocity = sky.belief("velocity")
    assert velocity is not None
    assert [float(one) for one in velocity] == pytest.approx([0, 2, 0], abs=0.3)  # type: ignore[arg-type]
    sky.wait(6)
    assert sky.belief("velocity") == pytest.approx((0, 0, 0), abs=0.1)


def test_a_velocity_of_the_body_counts_from_the_heading(sky: Sky) -> None:
    sky.flying()
    sky.vehicle.autopilot.motion.heading = math.radians(90)
    sky.wait(1)
    sky.done("fly", 2, 0, 0.5)
    sky.wait(2)
    assert place(sky)[1] > 1.5
    assert abs(place(sky)[0]) < 0.5


@pytest.mark.parametrize(("name", "what"), [("velocity", "velocities"), ("local", "position targets")])
def test_what_the_copter_would_drop_in_silence_is_refused(sky: Sky, name: str, what: str) -> None:
    sky.wait(2)
    final = sky.do(name, 1, 0, 5)
    assert final.state == "refused"
    assert final.reason == f"{what} are taken in GUIDED only; the vehicle is not armed, on the ground, in STABILIZE"
    sky.do("set_mode", "GUIDED")
    assert sky.do(name, 1, 0, 5).reason.startswith(f"{what} are taken in flight only")


@pytest.mark.parametrize("name", ["velocity", "local"])
def test_a_target_that_never_reaches_the_copter_is_refused_in_bounded_time(sky: Sky, name: str) -> None:
    sky.flying()
    sky.hears_us = lambda message: message.get_type() != "SET_POSITION_TARGET_LOCAL_NED"
    final = sky.do(name, 1, 0, 1, within=30)
    assert final.state == "refused"
    assert "did not take the" in final.reason


def test_local_targets_keep_the_limits(tmp_path: Path) -> None:
    sky = limited(tmp_path, "{altitude: 20, radius: 50}").flying()
    assert sky.do("local", 60, 0, 5).reason == "60 m from home is outside the mission's limit of 50 m"
    assert sky.do("move", 0, 0, 25).reason.endswith("m is above the mission's limit of 20 m")
    assert sky.do("reposition", *GOAL).reason == "altitude 40 m is above the mission's limit of 20 m"
    assert sky.do("raw", "MAV_CMD_NAV_TAKEOFF", 0, 0, 30).reason.startswith("altitude 30 m is above")


def test_a_velocity_that_leads_outside_the_limits_is_refused_and_the_way_back_is_open(tmp_path: Path) -> None:
    sky = limited(tmp_path, "{radius: 15}").flying()
    final = sky.do("velocity", 6, 0, 0)
    assert final.state == "refused"
    assert final.reason == "in 3 s at that velocity: 18 m from home is outside the mission's limit of 15 m"
    sky.done("velocity", 3, 0, 0)
    sky.wait(5)
    assert sky.do("velocity", 3, 0, 0).state == "refused"
    sky.done("velocity", -2, 0, 0)


def test_a_copter_that_drifts_over_a_limit_is_held_and_the_action_fails_with_the_reason(tmp_path: Path) -> None:
    sky = limited(tmp_path, "{radius: 30}").flying()
    heard = sky.begin("goto", -27.60385, -48.518363, 5)
    sky.wait(1)
    sky.vehicle.autopilot.motion.north.position = sky.vehicle.autopilot.motion.north.target = 34.0
    assert sky.end(heard, 5).state == "failed"
    said = "the vehicle left the mission's limits: 34 m from home, the limit is 30 m"
    assert heard[-1].reason == said
    sky.wait(4)
    assert sky.vehicle.autopilot.motion.course[0] < 0.3
    assert place(sky)[0] == pytest.approx(34, abs=3)
    assert ("outside_limits", "") in identities(sky.driver.notes())
    assert sky.do("goto", -27.60400, -48.518363, 5).state == "succeeded", "the way back is open"
    assert ("outside_limits", "") not in identities(sky.driver.notes())


def test_a_pilot_outside_the_limits_is_left_alone(tmp_path: Path) -> None:
    sky = limited(tmp_path, "{radius: 30}").flying()
    sky.vehicle.autopilot.set_mode(5)
    sky.wait(2)
    sky.vehicle.autopilot.motion.north.position = sky.vehicle.autopilot.motion.north.target = 40.0
    sky.wait(3)
    assert sky.belief("state") == ("LOITER", True, True)


def test_a_reposition_enters_guided_and_arrives(sky: Sky) -> None:
    sky.flying()
    sky.do("set_mode", "BRAKE")
    sky.done("repositioned", *GOAL)
    assert sky.belief("state") == ("GUIDED", True, True)
    sent = [one for one in sky.sent if one.get_type() == "COMMAND_INT"]
    assert [(one.command, one.frame, one.x, one.z) for one in sent] == [
        (dialect.MAV_CMD_DO_REPOSITION, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, -276036830, 40.0)
    ]


def test_a_reposition_that_is_cancelled_holds_the_copter(sky: Sky) -> None:
    sky.flying()
    heard = sky.begin("repositioned", *GOAL)
    sky.wait(3)
    sky.bridge.action_server.cancel("uav", heard[0].id)
    sky.wait(6)
    assert sky.vehicle.autopilot.motion.course[0] < 0.3


def test_a_reposition_that_is_acknowledged_and_not_flown_fails(sky: Sky) -> None:
    sky.flying()
    sky.pretend(lambda message: message.get_type() == "COMMAND_INT")
    final = sky.do("reposition", *GOAL)
    assert final.state == "failed"
    assert final.reason.startswith("MAV_CMD_DO_REPOSITION was acknowledged, but it")


def test_the_buoy_is_dropped_when_the_output_shows_it(sky: Sky) -> None:
    sky.done("drop_buoy")
    (sent,) = sky.commands(dialect.MAV_CMD_DO_SET_SERVO)
    assert (sent.param1, sent.param2) == (9, 1900)


def test_a_servo_that_is_acknowledged_and_does_not_move_is_no_success(sky: Sky) -> None:
    sky.wait(1)
    sky.pretend(is_command(dialect.MAV_CMD_DO_SET_SERVO))
    final = sky.do("drop_buoy")
    assert final.state == "failed"
    assert "was acknowledged, but SERVO_OUTPUT_RAW does not show servo 9 at 1900" in final.reason


def test_a_servo_whose_acknowledgement_is_lost_is_known_by_its_output(sky: Sky) -> None:
    sky.wait(1)
    sky.we_hear = lambda message: not (message.get_type() == "COMMAND_ACK" and message.command == 183)
    sky.done("drop_buoy")
    assert len(sky.commands(dialect.MAV_CMD_DO_SET_SERVO)) == 1


def test_a_motors_output_is_no_servo(sky: Sky) -> None:
    sky.wait(1)
    final = sky.do("servo", 1, 1900)
    assert final.state == "refused"
    assert "MAV_CMD_DO_SET_SERVO (FAILED)" in final.reason
    assert sky.do("servo", 40, 1900).reason == "a servo is one of 1 to 16, got 40"


def test_raw_commands_are_known_by_their_acknowledgement_unless_more_is_known_of_them(sky: Sky) -> None:
    sky.wait(2)
    sky.done("raw", dialect.MAV_CMD_RUN_PREARM_CHECKS, 0, 0, 0)
    refused = sky.do("raw", 31999, 0, 0, 0)
    assert refused.state == "refused"
    without_state = "the vehicle refused command 31999 (UNSUPPORTED): it does not support this command"
    assert refused.reason.startswith(f"{without_state}; EKF3")
    sky.wait(20)
    assert sky.do("raw", 31999, 0, 0, 0).reason == without_state
    sky.done("raw", "MAV_CMD_DO_SET_MODE", 1, 4, 0)
    sky.hears_us = lambda message: not is_command(dialect.MAV_CMD_COMPONENT_ARM_DISARM)(message)
    assert sky.do("raw", "MAV_CMD_COMPONENT_ARM_DISARM", 1, 0, 0, within=200).state == "failed"
    assert sky.do("raw", "MAV_CMD_NO_SUCH", 1, 0, 0).reason == "MAVLink has no command 'MAV_CMD_NO_SUCH'"


def test_channels_are_shown_by_the_ground_station_that_the_copter_takes_them_from(tmp_path: Path) -> None:
    sky = Sky(tmp_path, manifest=manifest(), mission=f"{MISSION}    failsafe: {{gcs: bridge}}\n")
    sky.wait(2)
    sky.done("sticks", [1600, 65535, 1100])
    sent = [one for one in sky.sent if one.get_type() == "RC_CHANNELS_OVERRIDE"][-1]
    assert (sent.chan1_raw, sent.chan2_raw, sent.chan3_raw, sent.chan4_raw) == (1600, 65535, 1100, 65535)
    assert sent.chan18_raw == 0
    sky.done("sticks", [0, 0, 0])


def test_channels_that_the_copter_ignores_are_no_success(sky: Sky) -> None:
    sky.wait(2)
    final = sky.do("sticks", [1600])
    assert final.state == "failed"
    assert "ArduPilot takes overrides from its ground station only (MAV_GCS_SYSID)" in final.reason


def test_channels_that_are_only_sent_succeed_by_being_sent(sky: Sky) -> None:
    sky.wait(2)
    sky.done("throttle", 1200)
    sky.wait(0.1)
    assert [one.chan3_raw for one in sky.sent if one.get_type() == "RC_CHANNELS_OVERRIDE"] == [1200]


@pytest.mark.parametrize(
    ("channels", "reason"),
    [([], "no channel is given"), ([1500.5], "channel 1: expected whole microseconds"), ([0] * 19, "expected a list")],
)
def test_channels_that_cannot_be_are_refused(sky: Sky, channels: list[float], reason: str) -> None:
    sky.wait(1)
    final = sky.do("sticks", channels)
    assert final.state == "refused"
    assert final.reason.startswith(reason)


def test_a_gripper_is_known_by_the_output_that_its_parameter_names(sky: Sky) -> None:
    for name, value in (("SERVO9_FUNCTION", 28), ("GRIP_ENABLE", 1)):
        sky.vehicle.autopilot.parameters.set(name, value)
    sky.wait(1)
    sky.done("gripper", True)
    sky.done("gripper", False)


def test_a_motor_that_idles_at_the_width_of_a_gripper_is_no_gripper(sky: Sky) -> None:
    for name, value in (("SERVO9_FUNCTION", 28), ("GRIP_ENABLE", 1), ("GRIP_RELEASE", 1000)):
        sky.vehicle.autopilot.parameters.set(name, value)
    sky.wait(1)
    sky.hears_us = lambda message: not is_command(dialect.MAV_CMD_DO_GRIPPER)(message)
    final = sky.do("gripper", False)
    assert final.state == "failed"
    assert final.reason.startswith("no acknowledgement of MAV_CMD_DO_GRIPPER")


def test_a_vehicle_none_of_whose_outputs_is_a_gripper_says_so(sky: Sky) -> None:
    sky.wait(1)
    final = sky.do("gripper", True)
    said = "none of the 16 outputs that were reported is a gripper (SERVOn_FUNCTION = 28)"
    assert (final.state, final.reason) == ("failed", said)


def test_a_reposition_is_known_by_the_target_although_no_acknowledgement_comes(tmp_path: Path) -> None:
    sky = Sky(tmp_path, faults=Faults.parse(["mute-acks"])).flying()
    assert end_of(sky.do("reposition", *GOAL[:2], 10)) == ("succeeded", "")


def test_a_raw_command_does_not_go_round_what_the_limits_need(tmp_path: Path) -> None:
    sky = limited(tmp_path, "{altitude: 30, radius: 100}").flying()
    home = sky.vehicle.autopilot.home
    final = sky.do("raw", "MAV_CMD_DO_SET_HOME", 0, 0, 0)
    said = "it moves home, from where the mission's limits are measured"
    assert (final.state, final.reason) == ("refused", said)
    assert sky.vehicle.autopilot.home == home
    sky.vehicle.autopilot.mission.store([
        Stored(0, 0, 16, (0, 0, 0, 0), 0, 0, 0.0), Stored(1, 3, 16, (0, 0, 0, 0), -276036830, -485180520, 50.0),
    ])  # fmt: skip
    sky.vehicle.autopilot.count_mission(2)
    final = sky.do("raw", "MAV_CMD_MISSION_START", 0, 0, 0)
    assert final.reason == "item 1 of the mission: altitude 50 m is above the mission's limit of 30 m"
    assert (final.state, sky.vehicle.autopilot.mode.name) == ("refused", "GUIDED")
