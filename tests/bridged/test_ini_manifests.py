"""The paper's INI manifests as the bridge takes them: translated, refused in words, and flown."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from argosy.__main__ import main
from bridged.arguments import BadArgument, read_arguments
from bridged.drivers import check_manifest
from bridged.drivers.mavlink.mavros import CALLS, TOPICS, below_mavros
from bridged.drivers.robot import Reading
from bridged.ini_manifests import translate_pair
from bridged.manifests import load_robot_manifest
from bridged.translation import Translator
from schemas.findings import Findings
from schemas.manifest import Manifest, PerceptEntry, load_manifest, read_manifest
from schemas.manifest_text import write_toml
from schemas.terms import Atom, Structure, Term, Variable
from tests.bridged.sky import Sky

MISSIONS = Path(__file__).parents[2] / "missions"


def of_the_uav() -> Manifest:
    """The shipped pair."""
    return load_robot_manifest(("actions_manifest", "perceptions_manifest"), MISSIONS / "paper_uav")


def pair(actions: str = "", percepts: str = "") -> Manifest:
    """A pair of which nothing is wrong."""
    manifest = translate_pair(actions, "a", percepts, "p")
    assert check_manifest(manifest) == []
    return manifest


def bare(manifest: Manifest) -> Manifest:
    """A manifest without where it stands."""
    return replace(manifest, file="", percepts_file="", lines={})


def problems(actions: str = "", percepts: str = "") -> list[str]:
    """What is wrong with a pair, as `file:line: message`."""
    with pytest.raises(Findings) as found:
        translate_pair(actions, "a", percepts, "p")
    return [f"{one.file}:{one.line}: {one.message}" for one in found.value.findings]


def service(name: str, *params: str, method: str = "service", types: str = "") -> str:
    """A section of an actions manifest."""
    text = f"[act]\nmethod = {method}\nname = {name}\nparams_name = {', '.join(params)}\n"
    return text + (f"params_type = {types}\n" if types else "")


# --- translation -----------------------------------------------------------------------------------------------------


def test_the_shipped_pair_is_carried_out_as_the_copters_own_manifest_says() -> None:
    ini, toml = of_the_uav(), load_manifest("arducopter")
    assert (ini.robot.driver, ini.robot.vehicle, ini.robot.values) == ("mavlink", "arducopter", "text")
    assert check_manifest(ini) == []
    same = ("command", "message", "call", "confirm", "deadline", "retry", "cancel", "motion", "supersedes", "tolerance")
    for name in ("set_mode", "arm_motors", "takeoff", "setpoint", "land"):
        for field in same:
            assert getattr(ini.actions[name], field) == getattr(toml.actions[name], field), (name, field)
    assert (ini.actions["setpoint"].frame, toml.actions["setpoint"].frame) == ("amsl", "relative")
    assert {name: ini.percept_arities()[name] for name in ("state", "altitude", "global_pos", "home_pos")} == {
        name: toml.percept_arities()[name] for name in ("state", "altitude", "global_pos", "home_pos")
    }


def test_the_turtle_of_the_paper_is_a_robot_on_zenoh_keys() -> None:
    manifest = load_robot_manifest(("actions_manifest", "perceptions_manifest"), MISSIONS / "paper_turtle")
    assert check_manifest(manifest) == []
    assert (manifest.robot.driver, manifest.robot.vehicle) == ("zenoh", "")
    assert manifest.percepts == {"pose": PerceptEntry(source="turtle1/pose", args=("x", "y", "theta"), rate=30.0)}
    [action] = manifest.actions.values()
    assert (action.topic, action.latch) == ("turtle1/cmd_vel", True)
    assert [(one.name, one.type) for one in action.params] == [
        ("linear.x", "float"), ("linear.y", "float"), ("linear.z", "float"),
    ]  # fmt: skip


def test_a_pair_with_names_of_both_is_a_vehicle_with_entries_of_the_zenoh_driver() -> None:
    manifest = pair(
        "[go]\nmethod = service\nname = uav1/mavros/set_mode\nparams_name = custom_mode\n"
        "[lamp]\nmethod = topic\nname = /lamp\nparams_name = on\nparams_type = bool\nlatch = False\n",
        "[height]\nname = /uav1/mavros/global_position/rel_alt\nargs = data\n[sonar]\nname = /sonar\nargs = ranges.0\n",
    )
    assert manifest.drivers() == ["mavlink", "zenoh"]
    assert manifest.robot.vehicle == "arducopter"
    assert manifest.actions["lamp"].driver == manifest.percepts["sonar"].driver == "zenoh"
    assert manifest.actions["go"].driver == manifest.percepts["height"].driver == ""
    assert (manifest.actions["lamp"].topic, manifest.actions["lamp"].latch) == ("lamp", False)


@pytest.mark.parametrize(
    ("name", "below"),
    [
        ("mavros/state", "state"),
        ("uav1/mavros/cmd/arming", "cmd/arming"),
        ("mavros", None),
        ("turtle1/pose", None),
        ("my_mavros/state", None),
    ],
)
def test_names_of_mavros_are_known_below_any_namespace(name: str, below: str | None) -> None:
    assert below_mavros(name) == below


def test_the_rate_of_the_pair_caps_what_the_vehicle_is_asked_for_and_never_raises_it() -> None:
    text = "[DEFAULT]\nrate = {}\n[altitude]\nname = mavros/global_position/rel_alt\nargs = data\n"
    assert pair(percepts=text.format(30)).percepts["altitude"].rate == 10.0
    assert pair(percepts=text.format(2)).percepts["altitude"].rate == 2.0


def test_what_the_vocabulary_lacks_is_an_error_at_its_line_that_names_what_there_is() -> None:
    wrong = problems(
        service("mavros/cmd/armin", "value")
        + "[second]\nmethod = service\nname = mavros/state\n"
        + "[third]\nmethod = service\nname = mavros/setpoint_position/global\n"
        + "params_name = pose.position.altitude, yaw\n"
        + "[fourth]\nmethod = service\nname = mavros/cmd/arming\nparams_name = value\nparams_type = str\n",
        "[a]\nname = mavros/states\nargs = mode\n[b]\nname = mavros/state\nargs = mode, header.stamp\n"
        "[c]\nname = /mavros/cmd/land\nargs = x\n[d]\nname = mavros/state\nargs = mode[](x)\n",
    )
    assert wrong == [
        "a:3: [act] name: no `mavros/cmd/armin` here, did you mean `cmd/arming`?",
        "a:7: [second] name: mavros/state is not done but perceived: it belongs into the perceptions manifest",
        "a:9: [third] method: mavros/setpoint_position/global is a topic, not a service",
        "a:11: [third] params_name: mavros/setpoint_position/global has no field `yaw` here; there is "
        "pose.position.latitude, pose.position.longitude, pose.position.altitude",
        "a:11: [third] params_name: mavros/setpoint_position/global needs `pose.position.latitude`",
        "a:11: [third] params_name: mavros/setpoint_position/global needs `pose.position.longitude`",
        "a:16: [fourth] params_type: `value` of mavros/cmd/arming is a boolean, not a string",
        "p:2: [a] name: no `mavros/states` here, did you mean `state`?",
        "p:6: [b] args: mavros/state has no field `header.stamp` here; there is mode, connected, armed, guided, "
        "manual_input, system_status",
        "p:8: [c] name: mavros/cmd/land is not perceived but done: it belongs into the actions manifest",
        "p:12: [d] args: mavros/state: `mode` is no list of structures",
    ]


def test_what_a_driver_misses_is_told_in_the_right_file_of_the_two() -> None:
    manifest = translate_pair("[go]\nmethod = topic\nname = argosy/x\n", "a", "[p]\nname = argosy/y\nargs = x\n", "p")
    assert [(one.file, one.line) for one in check_manifest(manifest)] == [("p", 2), ("a", 3)]


def test_both_files_are_read_before_anything_is_told(tmp_path: Path) -> None:
    (tmp_path / "actions").write_text("[a]\n")
    (tmp_path / "percepts").write_text("[b]\n")
    with pytest.raises(Findings) as found:
        load_robot_manifest(("actions", "percepts"), tmp_path)
    assert {Path(one.file).name for one in found.value.findings} == {"actions", "percepts"}
    with pytest.raises(Findings, match="cannot be read: No such file") as found:
        load_robot_manifest(("nowhere", "neither"), tmp_path)
    assert len(found.value.findings) == 2
    with pytest.raises(Findings, match=r"expected one manifest, or two"):
        load_robot_manifest(("actions", "percepts", "more"), tmp_path)


@pytest.mark.parametrize("below", TOPICS)
def test_every_topic_of_the_vocabulary_is_one_that_the_driver_can_hear(below: str) -> None:
    names = list(TOPICS[below].fields)
    parents = {name.rpartition(".")[0] for name in names} & set(names)
    told = [
        f"{name}[]({', '.join(one[len(name) + 1 :] for one in names if one.startswith(f'{name}.'))})"
        for name in sorted(parents)
    ]
    plain = [name for name in names if name not in parents and name.rpartition(".")[0] not in parents]
    manifest = pair(percepts=f"[p]\nname = mavros/{below}\nargs = {', '.join(plain + told)}\n")
    assert bare(read_manifest(write_toml(manifest), "m.toml")) == bare(manifest)


@pytest.mark.parametrize("below", CALLS)
def test_every_call_of_the_vocabulary_is_one_that_the_driver_can_do(below: str) -> None:
    taken = CALLS[below]
    fields = {into.field: name for name, into in taken.fields.items()}  # of two forms of one value, the last
    manifest = pair(service(f"mavros/{below}", *fields.values(), method=taken.method))
    assert bare(read_manifest(write_toml(manifest), "m.toml")) == bare(manifest)


def test_a_pair_is_converted_into_one_toml_file_that_says_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, file = MISSIONS / "paper_uav", tmp_path / "uav.toml"
    given = [str(folder / "actions_manifest"), str(folder / "perceptions_manifest")]
    assert main(["manifest", "convert", *given, "-o", str(file)]) == 0
    assert bare(load_manifest(str(file))) == bare(of_the_uav())
    assert main(["manifest", "convert", *given, "-o", str(file)]) == 2, "what is there is not written over"
    assert "File exists" in capsys.readouterr().err
    assert main(["manifest", "convert", *given]) == 0
    assert capsys.readouterr().out == file.read_text()
    assert main(["manifest", "convert", *reversed(given)]) == 2
    assert capsys.readouterr().err.count("the actions come first") == 2


# --- values as texts -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "term"),
    [
        (3.0, 3.0),
        (-7, -7),
        (True, "True"),
        (False, "False"),
        ("GUIDED", "GUIDED"),
        ("_x", "_x"),
        ("guided", Atom("guided")),
        ("true", True),
        ("12.5", 12.5),
        ("", ""),
        ("two words", "two words"),
        ("it's", Atom("its")),
        ("CMODE(21)", "CMODE(21)"),
        ("at(1,b)", Structure("at", (1, Atom("b")))),
        ("at(X)", "at(X)"),
        ([1, "a", "B", [True]], [1, Atom("a"), "B", ["True"]]),
        ((1.5, 2), [1.5, 2]),
        (None, "None"),
        ({"x": 1.0, "at": {"y": 2}}, "x: 1.0\nat:\n  y: 2"),
    ],
)
def test_a_percept_is_read_from_the_text_of_its_value(value: object, term: Term) -> None:
    text = "[p]\nname = /p\nargs = data\n"
    translator = Translator(pair(percepts=text))
    [belief] = translator.beliefs(Reading("p", {"data": value}))
    assert belief.parameters == (term,)
    assert [type(one) for one in belief.parameters or ()] == [type(term)]


@pytest.mark.parametrize(
    ("kind", "term", "value"),
    [
        ("str", "two words", "two words"),
        ("str", Atom("guided"), "guided"),
        ("str", Variable("GUIDED"), "GUIDED"),
        ("str", 5.0, "5"),
        ("str", True, "true"),
        ("str", [1, "a"], '[1,"a"]'),
        ("str", Structure("at", (1, Atom("b"))), "at(1,b)"),
        ("float", "2.5", 2.5),
        ("float", 3, 3.0),
        ("int", " 7 ", 7),
        ("bool", Atom("yes"), True),
        ("bool", "0", False),
        ("int[]", [1, 2], [1, 2]),
        ("int[]", "[1, [2, 3]]", [1, [2, 3]]),
        ("geometry_msgs/Point[](x, y)", [[1, 2.5], [3, "t"]], [{"x": 1, "y": 2.5}, {"x": 3, "y": "t"}]),
    ],
)
def test_an_argument_is_read_from_its_text(kind: str, term: Term, value: object) -> None:
    entry = pair(service("/s", "data", types=kind)).actions["act"]
    assert read_arguments("act", entry, (term,), "text") == {"data": value}
    assert type(read_arguments("act", entry, (term,), "text")["data"]) is type(value)


@pytest.mark.parametrize(
    ("kind", "term"),
    [("float", "high"), ("float", Variable("X")), ("int", 2.5), ("bool", "maybe"), ("bool", 2), ("int[]", "1, 2")],
)
def test_a_text_that_is_not_of_the_type_is_refused(kind: str, term: Term) -> None:
    entry = pair(service("/s", "data", types=kind)).actions["act"]
    with pytest.raises(BadArgument, match="act: expected data: "):
        read_arguments("act", entry, (term,), "text")


def test_lists_of_structures_come_as_the_paper_nested_them() -> None:
    text = "[p]\nname = /p\nargs = status[](values[](key, value)), status[](name), status[](level, name)\n"
    [belief] = Translator(pair(percepts=text)).beliefs(
        Reading("p", {"status": [{"name": "gps", "level": 0, "values": [{"key": "Fix", "value": "3"}]}]})
    )
    assert belief.parameters == ([[["Fix", 3]]], [[Atom("gps")]], [[0, Atom("gps")]])


# --- flown -----------------------------------------------------------------------------------------------------------


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
        assert height is not None
        near = [abs(float(one) - goal) for one, goal in zip(at, (-27.603683, -48.518052), strict=True)]  # type: ignore[arg-type]
        return max(near) <= 1e-5 and abs(float(height[0]) - 40) <= 0.2  # type: ignore[arg-type]

    sky.forward(there, "the waypoint, 61 m above the sea and 40 m above home")
    assert sky.do("set_mode", "RTL").state == "succeeded"
    sky.forward(lambda: sky.belief("state") == ("RTL", "True", "False"), "landed and disarmed at home", 200)
    assert sky.belief("home_pos") == (-27.604033, -48.518363)
    battery = sky.belief("battery")
    assert battery is not None
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
    assert sky.do("arm_motors", argument).state == "succeeded"
    sent: dialect.MAVLink_message = sky.commands(dialect.MAV_CMD_COMPONENT_ARM_DISARM)[-1]
    assert sent.param1 == float(armed)


@pytest.mark.parametrize(
    ("name", "arguments", "reason"),
    [
        ("arm_motors", ("maybe",), 'arm_motors: expected value: boolean, got "maybe"'),
        ("arm_motors", (), "arm_motors(value: boolean) takes 1 arguments, got 0"),
        ("takeoff", (500,), "takeoff: expected altitude: float 1..120 m, got 500"),
        ("takeoff", (Variable("High"),), "takeoff: expected altitude: float 1..120 m, got High"),
        ("set_mode", (Variable("Mode"),), "no mode 'Mode'; this vehicle has"),
    ],
)
def test_what_an_argument_cannot_be_is_refused_in_words(
    sky: Sky, name: str, arguments: tuple[Term, ...], reason: str
) -> None:
    status = sky.do(name, *arguments)
    assert status.state == "refused"
    assert status.reason.startswith(reason)


def test_an_action_of_the_paper_that_the_vehicle_does_not_do_fails(sky: Sky) -> None:
    assert sky.do("set_mode", "GUIDED").state == "succeeded"
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


def succeeds(sky: Sky, name: str, *arguments: Term) -> None:
    """Do an action, which must succeed."""
    status = sky.do(name, *arguments)
    assert status.state == "succeeded", status.reason


def local(sky: Sky) -> list[float]:
    """Where the vehicle is, as an agent perceives it: east, north, up."""
    at = sky.belief("local")
    assert at is not None
    return [float(one) for one in at]  # type: ignore[arg-type]


def test_local_positions_and_velocities_are_east_north_and_up(full: Sky) -> None:
    full.flying(5)
    assert full.belief("state") == ("GUIDED", "True", 4)
    succeeds(full, "move", 10.0, -4.0, 8.0)
    full.forward(lambda: max(abs(a - b) for a, b in zip(local(full), (10, -4, 8), strict=True)) < 0.3, "arrival")
    succeeds(full, "velocity", 0.0, 2.0, 1.0, 0.0)
    full.wait(2.0)
    east, north, up = local(full)
    assert abs(east - 10) < 1
    assert north > -3
    assert up > 8.5


def test_a_mission_a_parameter_and_a_raw_command_go_the_ways_of_mavros(full: Sky) -> None:
    home: list[Term] = [0, 16, True, True, -27.604033, -48.518363, 21.0]
    point: list[Term] = [3, 16, False, True, -27.6038, -48.5182, 15.0]
    succeeds(full, "set_mode", "GUIDED")
    full.forward(lambda: full.vehicle.copter.home is not None, "the vehicle to know its home")
    succeeds(full, "push", [home, point])
    succeeds(full, "pull")
    told = full.belief("waypoints")
    assert told is not None
    [items] = told
    assert isinstance(items, list)
    assert len(items) == 2, "home, and the one point"
    assert items[1] == [16, -27.6038, 15.0]
    succeeds(full, "set_parameter", "FENCE_RADIUS", 120.0)
    assert full.belief("parameter") == ("FENCE_RADIUS", 120.0)
    succeeds(full, "command", dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
    assert full.vehicle.copter.armed, "a raw command too is proved by the vehicle's state where it can be"
