"""Manifests: what ships reads, and whatever is wrong is said at its line, all of it at once."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridged.drivers import check_manifest
from schemas.findings import Findings
from schemas.manifest import load_manifest, read_manifest
from schemas.shipped import shipped
from schemas.toml_lines import line_of, toml_lines

MINIMAL = '[robot]\ndriver = "mavlink"\nvehicle = "arducopter"\n'


def problems(text: str) -> list[str]:
    """What reading and the driver's check find, as `line: message`."""
    try:
        found = check_manifest(read_manifest(text, "m.toml"))
    except Findings as findings:
        found = findings.findings
    return [f"{one.line}: {one.message}" for one in found]


def test_the_shipped_copter_has_the_papers_percepts_and_actions() -> None:
    manifest = load_manifest("arducopter")
    assert check_manifest(manifest) == []
    arities = {"state": 3, "altitude": 1, "global_pos": 2, "home_pos": 2, "battery": 3, "gps": 2}
    assert manifest.percept_arities().items() >= arities.items()
    assert manifest.action_arities() == {
        "set_mode": 1,
        "arm_motors": 1,
        "takeoff": 1,
        "setpoint": 3,
        "goto": 3,
        "land": 0,
        "return_to_launch": 0,
    }


def test_all_problems_of_a_manifest_are_told_at_once_each_at_its_line() -> None:
    text = """
[robot]
driver = "mavlink"
vehicel = "arducopter"

[percepts.Altitude]
source = "GLOBAL_POSITION_INT"

[percepts.battery]
source = "BATTERY_STATUS"
args = [
  "id",
  {field = "voltages.0", scal = 0.001},
]
key = [4]
rate = 0
ttl = "3 parsecs"

[actions.takeoff]
params = [{name = "altitude", type = "metres"}]
command = 22
confirm = "altitude"

[actions.land]
fields = {param7 = "altitude"}
deadline = "0s"

[persepts.gps]
"""
    assert problems(text) == [
        "4: robot: contains unknown field `vehicel`",
        "6: `Altitude`: expected the name of a belief or action, such as `battery`",
        "11: percepts.battery.args: contains unknown field `scal`",
        "16: percepts.battery.rate: Expected `float` > 0.0",
        "17: percepts.battery.ttl: Expected a duration such as `5s`, `500ms` or `15min`, got `3 parsecs`",
        "20: actions.takeoff.params: Invalid enum value 'metres'",
        "21: actions.takeoff.command: Expected `str`, got `int`",
        "24: actions.land: missing required field `confirm`",
        "28: unknown table or key `persepts`, expected `robot`, `percepts` or `actions`",
    ]


def test_what_one_entry_says_of_itself_must_agree() -> None:
    text = MINIMAL + (
        "[percepts.battery]\n"
        'source = "BATTERY_STATUS"\n'
        'args = ["id"]\n'
        "key = [1]\n"
        "[actions.go]\n"
        'params = [{name = "x", min = 3, max = 2}, {name = "x"}]\n'
        'command = "MAV_CMD_NAV_LAND"\n'
        'fields = {param1 = "y"}\n'
        'confirm = "landed"\n'
        'deadline = "0s"\n'
        "[actions.come]\n"
        'confirm = "landed"\n'
    )
    assert problems(text) == [
        "7: percepts.battery.key: position 1 of 1 arguments",
        "9: actions.go.params: `x` has min above max",
        "9: actions.go.params: `x` stands there twice",
        "11: actions.go.fields.param1: no parameter `y`; there is x, x",
        "13: actions.go.deadline: expected more than 0 s",
        "14: actions.come: expected either `command` or `message`",
    ]


def test_what_the_driver_does_not_know_is_told_at_its_line() -> None:
    text = (
        '[robot]\ndriver = "mavlink"\nvehicle = "submarine"\n'
        '[percepts.altitude]\nsource = "ALTIMETER"\nargs = ["alt"]\n'
        '[percepts.gps]\nsource = "GPS_RAW_INT"\nargs = ["fix", "fix_type.1"]\n'
        '[percepts.cells]\nsource = "BATTERY_STATUS"\nargs = ["voltages.9", "voltages.10"]\n'
        '[actions.land]\ncommand = "MAV_CMD_NAV_LADN"\nconfirm = "touched"\nfields = {param8 = 1}\n'
        '[actions.go]\nmessage = "SET_MODE"\nconfirm = "landed"\n'
    )
    assert problems(text) == [
        "3: robot.vehicle: the mavlink driver has no `submarine`, it has arducopter",
        "5: percepts.altitude.source: MAVLink has no message `ALTIMETER`",
        "9: percepts.gps.args: GPS_RAW_INT has no field `fix`, it has time_usec, fix_type, lat, lon, alt, eph, epv, "
        "vel, cog, satellites_visible, alt_ellipsoid, h_acc, v_acc, vel_acc, hdg_acc, yaw",
        "9: percepts.gps.args: GPS_RAW_INT.fix_type has no element `1`",
        "12: percepts.cells.args: BATTERY_STATUS.voltages has no element `10`",
        "15: actions.land.confirm: expected one of mode, armed, altitude, target, arrival, landed, home, got `touched`",
        "14: actions.land.command: MAVLink has no command `MAV_CMD_NAV_LADN`",
        "16: actions.land.fields: no field `param8`, there is param1, param2, param3, param4, param5, param6, param7",
        "19: actions.go.confirm: `landed` confirms a command, not a message",
        "18: actions.go.message: the driver sends SET_POSITION_TARGET_GLOBAL_INT only, got `SET_MODE`",
        "18: actions.go.message: a position target needs `frame`, relative (to home) or amsl",
        "17: actions.go.fields: `lat_int` is missing",
        "17: actions.go.fields: `lon_int` is missing",
        "17: actions.go.fields: `alt` is missing",
    ]


def test_a_driver_that_there_is_not_is_told_with_those_there_are() -> None:
    assert problems('[robot]\ndriver = "ros"\n') == ["2: robot.driver: no driver `ros`, there is mavlink"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"x = = 3", "1:5: error: Invalid value"),
        (b"[robot\n", "1:7: error: Expected ']' at the end of a table declaration"),
        (b"[robot", "1: error: Expected ']' at the end of a table declaration"),
        (b"[robot]\n\xff\xfe", "2: error: expected UTF-8 text"),
        (b"", ": error: a `[robot]` table with its `driver` is missing"),
        (b"x = " + b"[" * 20_000, ": error: nested too deeply"),
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
    with pytest.raises(Findings, match=r"px4: error: no such manifest; expected a file or one of: .*arducopter"):
        load_manifest("px4")


@given(st.text(alphabet=st.characters(codec="utf-8"), max_size=200))
def test_any_text_is_a_manifest_or_findings(text: str) -> None:
    problems(text)


@given(st.integers(0, 200), st.integers(0, 200), st.sampled_from(["", "=", "[", '"', "3", "{}", "nan", "-1", "[]"]))
def test_the_shipped_manifest_with_any_damage_is_a_manifest_or_findings(at: int, size: int, put: str) -> None:
    path = shipped("manifests", "arducopter.toml")
    assert path is not None
    text = path.read_text()
    lines = text.splitlines(keepends=True)
    line = lines[at % len(lines)]
    cut = size % (len(line) + 1)
    lines[at % len(lines)] = line[:cut] + put + line[cut + len(put) :]
    problems("".join(lines))


def test_tables_and_keys_are_found_on_their_lines() -> None:
    text = """# [not.a.table]
top = 1
[a.b]   # comment
text = '''
[fake]
key = 1
'''
list = [
  "key = 2",   # ]
  {inner = 3},
]
"quoted key" = 1
[[c]]
d.e = 4
"""
    tomllib.loads(text)
    assert toml_lines(text) == {
        ("top",): 2,
        ("a", "b"): 3,
        ("a", "b", "text"): 4,
        ("a", "b", "list"): 8,
        ("a", "b", "quoted key"): 12,
        ("c",): 13,
        ("c", "d", "e"): 14,
    }
    assert line_of(toml_lines(text), ("a", "b", "list", "deeper")) == 8
    assert line_of(toml_lines(text), ("elsewhere",)) == 0
