"""Flights by the paper's INI manifests, in virtual time."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from schemas.wire.terms import Term, Variable
from tests.bridged.ini_pairs import of_the_uav, pair
from tests.bridged.sky import Sky, end_of


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return Sky(tmp_path, manifest=of_the_uav())


def test_the_papers_mission_is_flown_by_its_manifests_and_percepts_are_told_as_texts(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("state") == ("STABILIZE", "True", "False"), "the state as texts")
    ends = [
        sky.do("set_mode", "GUIDED"),
        sky.do("arm_motors", Variable("True")),
        sky.do("takeoff", 5),
        sky.do("setpoint", -27.603683, -48.518052, 61),
    ]
    assert [(one.name, one.state, one.reason) for one in ends] == [
        ("set_mode", "succeeded", ""),
        ("arm_motors", "succeeded", ""),
        ("takeoff", "succeeded", ""),
        ("setpoint", "succeeded", ""),
    ]
    assert sky.belief("state") == ("GUIDED", "True", "True")

    def there() -> bool:
        at, height = sky.belief("global_pos"), sky.belief("altitude")
        assert at is not None
        near = [abs(float(one) - goal) for one, goal in zip(at, (-27.603683, -48.518052), strict=True)]  # type: ignore[arg-type]
        return max(near) <= 1e-5 and abs(float(height[0]) - 40) <= 0.2  # type: ignore[arg-type]

    sky.forward(there, "the waypoint, 61 m above the sea and 40 m above home")
    sky.done("set_mode", "RTL")
    sky.forward(lambda: sky.belief("state") == ("RTL", "True", "False"), "landed and disarmed at home", 200)
    assert sky.belief("home_pos") == (-27.604033, -48.518363)
    battery = sky.belief("battery")
    assert 0 < float(battery[1]) <= 1, "a share of 1, as in ROS"  # type: ignore[arg-type]


def test_a_lost_link_is_told_as_mavros_tells_it(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("altitude") is not None, "a position")
    sky.we_hear = lambda message: False
    sky.forward(lambda: sky.belief("state") == ("", "False", "False"), "the state of a lost link")
    sky.forward(lambda: sky.belief("altitude") is None, "the end of a stale altitude")


@pytest.mark.parametrize(
    ("argument", "armed"),
    [(Variable("True"), True), ("true", True), (True, True), (1, True), ("False", False), (Variable("False"), False)],
)
def test_a_truth_value_is_what_its_text_says(sky: Sky, argument: Term, armed: bool) -> None:
    sky.do("set_mode", "GUIDED")
    sky.done("arm_motors", argument)
    sent: dialect.MAVLink_message = sky.commands(dialect.MAV_CMD_COMPONENT_ARM_DISARM)[-1]
    assert sent.param1 == float(armed)


@pytest.mark.parametrize(
    ("name", "arguments", "reason"),
    [
        ("arm_motors", ("maybe",), 'arm_motors: expected value: boolean, got "maybe"'),
        ("arm_motors", (), "arm_motors(value: boolean) takes 1 argument, got 0"),
        ("takeoff", (500,), "takeoff: expected altitude: float 1..120 m, got 500"),
        ("takeoff", (Variable("High"),), "takeoff: expected altitude: float 1..120 m, got High"),
        ("set_mode", (Variable("Mode"),), "no mode 'Mode'; this vehicle has"),
    ],
)
def test_wrong_arguments_are_refused_in_words(sky: Sky, name: str, arguments: tuple[Term, ...], reason: str) -> None:
    status = sky.do(name, *arguments)
    assert status.state == "refused"
    assert status.reason.startswith(reason)


def test_an_action_of_the_paper_that_the_vehicle_does_not_do_fails(sky: Sky) -> None:
    sky.done("set_mode", "GUIDED")
    status = sky.do("takeoff", 5)
    assert (status.state, status.result) == ("refused", False)
    assert status.reason


WHOLE_VOCABULARY = """
[set_mode]
method = service
name = mavros/set_mode
params_name = custom_mode
[arm_motors]
method = service
name = mavros/cmd/arming
params_name = value
[takeoff]
method = service
name = mavros/cmd/takeoff
params_name = altitude
[move]
method = topic
name = mavros/setpoint_position/local
params_name = pose.position.x, pose.position.y, pose.position.z
params_type = float, float, float
[velocity]
method = topic
name = mavros/setpoint_velocity/cmd_vel_unstamped
params_name = linear.x, linear.y, linear.z, angular.z
params_type = float, float, float, float
[command]
method = service
name = mavros/cmd/command
params_name = command, param1, param2
params_type = int, float, float
[push]
method = service
name = mavros/mission/push
params_name = waypoints
params_type = mavros_msgs/Waypoint[](frame, command, is_current, autocontinue, x_lat, y_long, z_alt)
[pull]
method = service
name = mavros/mission/pull
[pull_parameters]
method = service
name = mavros/param/pull
[set_parameter]
method = service
name = mavros/param/set
params_name = param_id, value.real
params_type = str, float
"""
PERCEPTS = """
[state]
name = mavros/state
args = mode, guided, system_status
[local]
name = mavros/global_position/local
args = pose.pose.position.x, pose.pose.position.y, pose.pose.position.z
[waypoints]
name = mavros/mission/waypoints
args = waypoints[](command, x_lat, z_alt)
[parameter]
name = mavros/param/param_value
args = param_id, value.real
"""


@pytest.fixture
def full(tmp_path: Path) -> Sky:
    return Sky(tmp_path, manifest=pair(WHOLE_VOCABULARY, PERCEPTS))


def local(sky: Sky) -> list[float]:
    """Where the vehicle is, as an agent perceives it: east, north, up."""
    at = sky.belief("local")
    assert at is not None
    return [float(one) for one in at]  # type: ignore[arg-type]


def test_local_positions_and_velocities_are_east_north_and_up(full: Sky) -> None:
    full.flying(5)
    assert full.belief("state") == ("GUIDED", "True", 4)
    full.done("move", 10.0, -4.0, 8.0)
    full.forward(lambda: max(abs(a - b) for a, b in zip(local(full), (10, -4, 8), strict=True)) < 0.3, "arrival")
    full.done("velocity", 0.0, 2.0, 1.0, 0.0)
    full.wait(2.0)
    east, north, up = local(full)
    assert abs(east - 10) < 1
    assert north > -3
    assert up > 8.5


def test_a_mission_a_parameter_and_a_raw_command_go_the_ways_of_mavros(full: Sky) -> None:
    home: list[Term] = [0, 16, True, True, -27.604033, -48.518363, 21.0]
    point: list[Term] = [3, 16, False, True, -27.6038, -48.5182, 15.0]
    full.done("set_mode", "GUIDED")
    full.forward(lambda: full.vehicle.autopilot.home is not None, "the vehicle to know its home")
    full.done("push", [home, point])
    full.done("pull")
    told = full.belief("waypoints")
    assert told is not None
    [items] = told
    assert len(items) == 2, "home, and the one point"
    assert items[1] == [16, -27.6038, 15.0]
    full.done("set_parameter", "FENCE_RADIUS", 120.0)
    assert full.belief("parameter") == ("FENCE_RADIUS", 120.0)
    pulled = full.do("pull_parameters")
    assert (pulled.state, pulled.feedback["params"]) == ("succeeded", pulled.feedback["of"])
    full.done("command", dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
    assert full.vehicle.autopilot.armed, "a raw command too is proved by the vehicle's state where it can be"


def test_parameters_that_are_lost_on_the_way_are_asked_for_again(full: Sky) -> None:
    lost = iter(range(10_000))

    def most(message: dialect.MAVLink_message) -> bool:
        return message.get_type() != "PARAM_VALUE" or next(lost) % 3 != 0

    def others(message: dialect.MAVLink_message) -> bool:
        return bool(message.get_type() != "PARAM_VALUE")

    full.we_hear = most
    pulled = full.do("pull_parameters")
    assert pulled.state == "succeeded", pulled.reason
    assert pulled.feedback["params"] > 20
    full.we_hear = others
    assert end_of(full.do("pull_parameters")) == ("failed", "the vehicle does not send its parameters")
