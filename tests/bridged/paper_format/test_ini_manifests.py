"""The paper's INI manifests as the bridge takes them: translated, or refused in words."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from argosy.__main__ import main
from bridged.drivers.argument_check import read_arguments
from bridged.drivers.registry import check_manifest, load_robot_manifest
from bridged.paper_format.ini_manifests import translate_pair
from bridged.paper_format.mavros_names import CALLS, TOPICS, below_mavros
from schemas.files.findings import Findings
from schemas.manifest.document import write_toml
from schemas.manifest.loader import ActionEntry, Manifest, PerceptEntry, load_manifest, read_manifest
from tests.argosy.recording.test_disks import files_no_larger_than
from tests.bridged.ini_pairs import MISSIONS, of_the_uav, pair, service

SAME = {
    "set_mode": "set_mode",
    "cmd/arming": "arm_motors",
    "cmd/takeoff": "takeoff",
    "cmd/land": "land",
    "setpoint_position/global": "setpoint",
    "setpoint_velocity/cmd_vel": "fly",
    "mission/push": "upload_mission",
    "mission/pull": "download_mission",
    "mission/clear": "clear_mission",
    "mission/set_current": "set_mission_item",
    "param/get": "get_param",
    "param/set": "set_param",
}
"""What the copter's own manifest calls what mavros does."""


def bare(manifest: Manifest) -> Manifest:
    """A manifest without where it stands."""
    return replace(manifest, file="", percepts_file="", lines={})


def problems(actions: str = "", percepts: str = "") -> list[str]:
    """What is wrong with a pair, as `file:line: message`."""
    with pytest.raises(Findings) as found:
        translate_pair(actions, "a", percepts, "p")
    return [f"{one.file}:{one.line}: {one.message}" for one in found.value.findings]


def test_calls_of_mavros_are_carried_out_as_the_copters_own_manifest_says() -> None:
    toml = load_manifest("copter")
    same = ("command", "message", "call", "confirm", "deadline", "retry", "cancel", "motion", "supersedes", "tolerance")
    for below, name in SAME.items():
        for field in same:
            assert getattr(CALLS[below].entry, field) == getattr(toml.actions[name], field), (below, field)


def test_the_shipped_pair_is_that_of_a_copter_whose_setpoints_count_from_the_sea() -> None:
    ini, toml = of_the_uav(), load_manifest("copter")
    assert (ini.robot.driver, ini.robot.vehicle, ini.robot.values) == ("mavlink", "copter", "text")
    assert check_manifest(ini) == []
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
    assert manifest.robot.vehicle == "copter"
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
        "a:7: [second] name: mavros/state is a percept, no action: it belongs in the perceptions manifest",
        "a:9: [third] method: mavros/setpoint_position/global is a topic, not a service",
        "a:11: [third] params_name: mavros/setpoint_position/global has no field `yaw` here; there is "
        "pose.position.latitude, pose.position.longitude, pose.position.altitude",
        "a:11: [third] params_name: mavros/setpoint_position/global needs `pose.position.latitude`",
        "a:11: [third] params_name: mavros/setpoint_position/global needs `pose.position.longitude`",
        "a:16: [fourth] params_type: `value` of mavros/cmd/arming is a boolean, not a string",
        "p:2: [a] name: no `mavros/states` here, did you mean `state`?",
        "p:6: [b] args: mavros/state has no field `header.stamp` here; there is mode, connected, armed, guided, "
        "manual_input, system_status",
        "p:8: [c] name: mavros/cmd/land is an action, no percept: it belongs in the actions manifest",
        "p:12: [d] args: mavros/state: `mode` is no list of structures",
    ]


def act(actions: str) -> ActionEntry:
    """The action of a pair with one section."""
    return pair(actions).actions["act"]


def test_older_names_of_a_global_setpoint_say_the_same() -> None:
    names = ("latitude", "longitude", "altitude")
    older = act(service("mavros/setpoint_position/global", *names, method="topic"))
    new_names = [f"pose.position.{name}" for name in names]
    today = act(service("mavros/setpoint_position/global", *new_names, method="topic"))
    assert [(one.unit, one.min, one.max) for one in older.params] == [(o.unit, o.min, o.max) for o in today.params]
    assert older.fields.keys() == today.fields.keys()
    twice = service("mavros/setpoint_position/global", "latitude", new_names[0], method="topic")
    where = "a:4: [act] params_name:"
    assert problems(twice) == [
        f"{where} `pose.position.latitude` of mavros/setpoint_position/global means the same as another field here",
        f"{where} mavros/setpoint_position/global needs `pose.position.altitude`",
        f"{where} mavros/setpoint_position/global needs `pose.position.longitude`",
    ]


def test_velocities_that_are_not_named_are_zero_as_in_ros() -> None:
    entry = act(service("mavros/setpoint_velocity/cmd_vel_unstamped", "linear.x", method="topic", types="float"))
    assert entry.fields == {"vx": 0, "vy": "linear.x", "vz": 0, "yaw_rate": 0}


def test_defaults_are_arguments_that_may_be_left_out() -> None:
    text = service("turtle1/set_pen", "r", "g", types="int, int") + "defaults = g=7, width=3, off=False, style=dotted\n"
    entry = act(text)
    assert entry.arities == range(1, 6)
    assert read_arguments("act", entry, [1], "text") == {"r": 1, "g": 7, "width": 3, "off": False, "style": "dotted"}
    assert read_arguments("act", entry, [1, 2, 9], "text")["width"] == 9
    arm = act(service("mavros/cmd/arming") + "defaults = value=True\n")
    assert read_arguments("act", arm, [], "text") == {"value": True}


def test_what_is_wrong_with_defaults_is_told() -> None:
    assert problems(
        service("turtle1/set_pen", "r", "g", types="int, int")
        + "defaults = r=red, g=1\n"
        + service("mavros/cmd/takeoff", "altitude").replace("[act]", "[up]")
        + "defaults = altitude=500\n"
        + service("x", "y").replace("[act]", "[other]")
        + "defaults = width\n"
    ) == [
        "a:6: [act] defaults: expected `r`: int, got `red`",
        "a:11: [up] defaults: `altitude` of mavros/cmd/takeoff: expected float 1..120 m, got `500.0`",
        "a:16: [other] defaults: expected a field and its value such as `width=3`, got `width`",
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


def test_a_pair_is_converted_into_one_equivalent_toml_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, file = MISSIONS / "paper_uav", tmp_path / "uav.toml"
    given = [str(folder / "actions_manifest"), str(folder / "perceptions_manifest")]
    with files_no_larger_than(100):
        assert main(["manifest", "convert", *given, "-o", str(file)]) == 1
    assert capsys.readouterr().err == f"error: {file}: File too large\n"
    assert main(["manifest", "convert", *given, "-o", str(file)]) == 0
    assert bare(load_manifest(str(file))) == bare(of_the_uav())
    assert main(["manifest", "convert", *given, "-o", str(file)]) == 2, "what is there is not written over"
    assert f"{file} exists: name another file" in capsys.readouterr().err
    assert main(["manifest", "convert", *given]) == 0
    assert capsys.readouterr().out == file.read_text()
    assert main(["manifest", "convert", *reversed(given)]) == 2
    assert capsys.readouterr().err.count("the actions come first") == 2
