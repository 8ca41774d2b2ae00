"""Manifests: what ships reads, and whatever is wrong is said at its line, all of it at once."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridged.drivers.registry import check_manifest
from schemas.files.findings import Findings
from schemas.files.toml_positions import line_of, toml_lines
from schemas.manifest.document import write_value
from schemas.manifest.loader import load_manifest, read_manifest
from tests.schemas.manifest.test_manifest_mistakes import problems

WORDS = """robot percepts actions orders driver vehicle source args key buf rate ttl params name type each field fields
topic call pose go hold x a.b"""
NAMES = st.sampled_from(WORDS.split())
VALUES = st.recursive(
    st.one_of(st.integers(), st.floats(), st.booleans(), st.text(max_size=8), NAMES),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(NAMES, inner, max_size=3)),
    max_leaves=8,
)
ENTRIES = st.dictionaries(NAMES, st.one_of(VALUES, st.dictionaries(NAMES, VALUES, max_size=5)), max_size=3)
documents = st.fixed_dictionaries(
    {}, optional={"robot": VALUES, "percepts": ENTRIES, "actions": ENTRIES, "orders": ENTRIES, "rest": VALUES}
)
"""Data in the shape of a manifest, or nearly."""


def test_the_shipped_copter_has_the_papers_percepts_and_actions() -> None:
    manifest = load_manifest("copter")
    assert check_manifest(manifest) == []
    arities = {"state": 3, "altitude": 1, "global_pos": 2, "home_pos": 2, "battery": 3, "gps": 2}
    assert manifest.percept_arities().items() >= arities.items()
    papers = {"set_mode": 1, "arm_motors": 1, "takeoff": 1, "setpoint": 3, "goto": 3, "land": 0, "return_to_launch": 0}
    more = {
        "reposition": 3, "orbit": 5, "move": 3, "fly": 3, "upload_mission": 1, "upload_plan": 1,
        "upload_fence": 1, "download_mission": 0,
        "clear_mission": 0, "set_mission_item": 1, "start_mission": 0, "download_log": range(2), "get_param": 1,
        "set_param": 2, "enable_fence": 1, "fence_radius": 1, "fence_altitude": 1, "drop_buoy": 0,
        "grip": 1, "set_relay": 2, "winch": 1, "take_picture": range(2), "start_video": range(2),
        "stop_video": range(2), "set_camera_mode": range(1, 3), "zoom": range(1, 3), "point_gimbal": 2,
        "look_at": 3, "look_nowhere": 0,
    }  # fmt: skip
    assert manifest.action_arities() == papers | more


def test_what_the_driver_does_not_know_is_told_at_its_line() -> None:
    text = (
        '[robot]\ndriver = "mavlink"\nvehicle = "submarine"\n'
        '[percepts.altitude]\nsource = "ALTIMETER"\nargs = ["alt"]\n'
        '[percepts.gps]\nsource = "GPS_RAW_INT"\nargs = ["fix", "fix_type.1"]\n'
        '[percepts.place]\nsource = "GLOBAL_POSITON_INT"\nargs = ["lat"]\n'
        '[percepts.cells]\nsource = "BATTERY_STATUS"\nargs = ["voltages.9", "voltages.10"]\n'
        '[actions.land]\ncommand = "MAV_CMD_NAV_LADN"\nconfirm = "touched"\nfields = {param8 = 1}\n'
        '[actions.go]\nmessage = "SET_MODE"\nconfirm = "landed"\n'
    )
    assert problems(text) == [
        "3: robot.vehicle: the mavlink driver has no `submarine`, it has copter, plane, rover",
        "5: percepts.altitude.source: MAVLink has no message `ALTIMETER`, and the driver has HEARTBEAT, OVERRIDE, "
        "LINK, PARAM, VEHICLE_TEXT, MISSION, MISSION_LIST, BATTERY, RC_INPUT, SERVO_OUTPUTS, WIND_ESTIMATE of its own",
        "9: percepts.gps.args: GPS_RAW_INT has no field `fix`, it has time_usec, fix_type, lat, lon, alt, eph, epv, "
        "vel, cog, satellites_visible, alt_ellipsoid, h_acc, v_acc, vel_acc, hdg_acc, yaw",
        "9: percepts.gps.args: GPS_RAW_INT.fix_type has no element `1`",
        "11: percepts.place.source: MAVLink has no message `GLOBAL_POSITON_INT`, did you mean `GLOBAL_POSITION_INT`?",
        "15: percepts.cells.args: BATTERY_STATUS.voltages has no element `10`",
        "17: actions.land.command: MAVLink has no command `MAV_CMD_NAV_LADN`, did you mean `MAV_CMD_NAV_LAND`?",
        "18: actions.land.confirm: a command is confirmed by mode, armed, altitude, target, arrival, orbit, landed, "
        "home, at_home, servo, gripper, relay, winch, picture, camera, gimbal, fence, ack, got `touched`",
        "19: actions.land.fields: no field `param8`, there is param1, param2, param3, param4, param5, param6, param7",
        "21: actions.go.message: the driver sends SET_POSITION_TARGET_GLOBAL_INT, SET_POSITION_TARGET_LOCAL_NED, "
        "RC_CHANNELS_OVERRIDE, got `SET_MODE`",
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"x = = 3", "1:5: error: Invalid value"),
        (b"[robot\n", "1:7: error: Expected ']' at the end of a table declaration"),
        (b"[robot]\n[percepts.battery]\n[percepts.battery]", "3:18: error: [percepts.battery] is declared twice"),
        (b"[robot", "1: error: Expected ']' at the end of a table declaration"),
        (b"[robot]\n\xff\xfe", "2: error: expected UTF-8 text"),
        (b"", ": error: a `[robot]` table with its `driver` is missing"),
        (b"x = " + b"[" * 9_000, ": error: nested too deeply"),
    ],
)
def test_a_file_that_is_no_manifest_is_one_clear_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "m.toml"
    path.write_bytes(content)
    with pytest.raises(Findings) as caught:
        load_manifest(path)
    assert message in str(caught.value).splitlines()[-1]
    assert str(caught.value).startswith(str(path))


def test_a_manifest_that_is_not_there_is_told_with_those_that_ship() -> None:
    with pytest.raises(Findings, match=r"px4: error: no such manifest; expected a file or one of: .*copter"):
        load_manifest("px4")


@given(documents)
def test_any_data_in_any_place_is_a_manifest_or_findings_and_every_finding_has_its_line(document: Any) -> None:
    text = "\n".join(f"{write_value(name)} = {write_value(value)}" for name, value in document.items())
    try:
        read_manifest(text, "m.toml", check_manifest)
    except Findings as found:
        assert all(one.line or "is missing" in one.message for one in found.findings), text


DOCUMENT = r"""# [not.a.table]
top = 1
[a.b]   # comment
text = '''
[fake]
key = 1
'''
list = [
  "key = 2",   # ]
  {inner = 3, list = [1,
    {x = 2}]},
]
"quoted.key" = "a \\\" = # ]"
[[c]]
d.e = 4
[[c]]
[c.x]
y = '''two
'lines''''
z = 1
"""


def test_everything_in_a_document_is_found_on_its_line() -> None:
    tomllib.loads(DOCUMENT)
    assert toml_lines(DOCUMENT) == {
        ("top",): 2,
        ("a", "b"): 3,
        ("a", "b", "text"): 4,
        ("a", "b", "list"): 8,
        ("a", "b", "list", "0"): 9,
        ("a", "b", "list", "1"): 10,
        ("a", "b", "list", "1", "inner"): 10,
        ("a", "b", "list", "1", "list"): 10,
        ("a", "b", "list", "1", "list", "0"): 10,
        ("a", "b", "list", "1", "list", "1"): 11,
        ("a", "b", "list", "1", "list", "1", "x"): 11,
        ("a", "b", "quoted.key"): 13,
        ("c",): 14,
        ("c", "0"): 14,
        ("c", "0", "d", "e"): 15,
        ("c", "1"): 16,
        ("c", "1", "x"): 17,
        ("c", "1", "x", "y"): 18,
        ("c", "1", "x", "z"): 20,
    }
    assert line_of(toml_lines(DOCUMENT), ("a", "b", "list", "0", "deeper")) == 9
    assert line_of(toml_lines(DOCUMENT), ("elsewhere",)) == 0


def test_a_manifest_is_read_once_for_all_robots_of_a_fleet_and_anew_when_its_text_changes(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('[robot]\ndriver = "mavlink"\nvehicle = "copter"\nlink_loss = "5s"\n')
    first = load_manifest("mine.toml", tmp_path)
    assert load_manifest("mine.toml", tmp_path) is first
    path.write_text(path.read_text().replace("5s", "7s"))
    assert (first.robot.link_loss, load_manifest("mine.toml", tmp_path).robot.link_loss) == (5.0, 7.0)


@pytest.mark.parametrize("name", ["copter", "plane", "rover"])
def test_each_shipped_manifest_of_an_autopilot_has_the_vehicles_own_warnings(name: str) -> None:
    assert load_manifest(name).percepts["vehicle_text"].args == ("severity", "text")
