"""What the Zenoh driver says of a manifest and of a mission's robot, each problem at its line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridged.drivers.argument_check import read_arguments
from bridged.drivers.registry import check_manifest
from bridged.drivers.zenoh.payload_codecs import CODECS, BadPayload, payload_of
from bridged.drivers.zenoh.registration import check_robot
from schemas.manifest.loader import read_manifest
from schemas.mission.model import Robot
from schemas.wire.terms import Term

HEAD = '[robot]\ndriver = "zenoh"\n'
DRIVE = HEAD + '[actions.drive]\nparams = [{name = "a"}, {name = "b"}]\n'


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (
            HEAD + '[percepts.pose]\nsource = "turtle*/pose"\nargs = ["x"]\n',
            "4: error: percepts.pose.source: `turtle*/pose`: expected a key without wildcards, such as `turtle1/pose`",
        ),
        (HEAD + '[percepts.pose]\nsource = "/pose"\n', "4: error: percepts.pose.source: `/pose` is no Zenoh key"),
        (HEAD + '[percepts.pose]\nsource = "a//b"\n', "4: error: percepts.pose.source: `a//b` is no Zenoh key"),
        (HEAD + '[percepts.pose]\nsource = "a?b"\n', "4: error: percepts.pose.source: `a?b` is no Zenoh key"),
        (
            HEAD + '[percepts.pose]\nsource = "argosy/f/uav/action/land"\n',
            "4: error: percepts.pose.source: `argosy/f/uav/action/land`: keys under `argosy/` are Argosy's own",
        ),
        (HEAD + '[percepts.pose]\nsource = "@/x"\n', "4: error: percepts.pose.source: `@/x`: keys with `@` are"),
        (HEAD + 'vehicle = "copter"\n', "3: error: robot.vehicle: the driver `zenoh` has no vehicles"),
        (HEAD + 'payload = "xml"\n', "3: error: robot.payload: expected json or msgpack, got `xml`"),
        (
            DRIVE + 'command = "MAV_CMD_NAV_LAND"\n',
            "5: error: actions.drive.command: the driver `zenoh` has no `command`",
        ),
        (
            DRIVE + 'topic = "t/x"\nconfirm = "mode"\n',
            "6: error: actions.drive.confirm: the driver `zenoh` has no `confirm`",
        ),
        (DRIVE + 'topic = "t/**"\n', "5: error: actions.drive.topic: `t/**`: expected a key without wildcards"),
        (DRIVE + 'service = "t/x"\nlatch = true\n', "6: error: actions.drive.latch: only a `topic` has it"),
        (
            DRIVE + 'topic = "t"\nfields = {x = {param = "a", table = "modes"}}\n',
            "6: error: actions.drive.fields.x: the driver `zenoh` has no table `modes`",
        ),
        (
            DRIVE + 'topic = "t"\nfields = {x = "a", "x.y" = "b"}\n',
            "6: error: actions.drive.fields: `x` is a value, and has fields of its own",
        ),
        (
            DRIVE + 'topic = "t"\nfields = {"x.0" = "a", "x.2" = "b"}\n',
            "6: error: actions.drive.fields: a list has the places 0, 1, ... and nothing else; x has 0, 2",
        ),
        (
            DRIVE + 'topic = "t"\nfields = {"." = "a", x = "b"}\n',
            "6: error: actions.drive.fields: `.` is the whole payload, there can be no other field",
        ),
        (
            DRIVE + 'topic = "t"\nfields = {"x..y" = "a"}\n',
            "6: error: actions.drive.fields: `x..y` is not a path such as `linear.x`",
        ),
    ],
)
def test_what_is_wrong_is_told_at_its_line(text: str, found: str) -> None:
    (finding,) = check_manifest(read_manifest(text, "m.toml"))
    assert str(finding).startswith(f"m.toml:{found}")


def test_all_problems_are_told_at_once() -> None:
    text = DRIVE + 'topic = "a*"\nconfirm = "mode"\n[percepts.p]\nsource = "b*"\n'
    assert len(check_manifest(read_manifest(text, "m.toml"))) == 3


@pytest.mark.parametrize(
    ("prefix", "problem"),
    [("", ""), ("hall/2", ""), ("/hall", "is no Zenoh key"), ("hall/", "is no Zenoh key"), ("*", "wildcards")],
)
def test_a_prefix_is_part_of_a_key(prefix: str, problem: str) -> None:
    said = list(check_robot(Robot(manifest="turtle", prefix=prefix)))
    assert bool(said) is bool(problem)
    assert all(field == "prefix" and problem in text for field, text in said)


@pytest.mark.parametrize(
    ("declared", "terms", "sent"),
    [
        ('params = [{name = "linear.x"}, {name = "angular.z"}]', (1.5, 2), {"linear": {"x": 1.5}, "angular": {"z": 2}}),
        ('params = [{name = "deg"}]\nfields = {"." = {param = "deg", scale = 0.5, offset = 1}}', (90,), 46.0),
        (
            'params = [{name = "a"}]\nfields = {"v.0" = "a", "v.1" = 3, "v.2.k" = true}',
            (1,),
            {"v": [1, 3, {"k": True}]},
        ),
        (
            'params = [{name = "to", type = "list", each = [{name = "x"}, {name = "y"}]}]',
            ([[1, 2], [3, 4]],),
            {"to": [{"x": 1, "y": 2}, {"x": 3, "y": 4}]},
        ),
        ("", (), {}),
    ],
)
def test_arguments_become_a_payload(declared: str, terms: tuple[Term, ...], sent: object) -> None:
    manifest = read_manifest(f'{HEAD}[actions.go]\ntopic = "go"\n{declared}\n', "m.toml")
    assert check_manifest(manifest) == []
    entry = manifest.actions["go"]
    assert payload_of(entry, read_arguments("go", entry, terms)) == sent


_VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


@given(name=st.sampled_from(sorted(CODECS)), value=_VALUES, at=st.integers(0, 60), byte=st.integers(0, 255))
def test_whatever_bytes_come_they_are_fields_or_a_bad_payload(name: str, value: object, at: int, byte: int) -> None:
    try:
        payload = bytearray(CODECS[name].encode(value))
    except BadPayload as bad:
        assert str(bad)
        return
    payload[at % len(payload)] = byte
    try:
        fields = CODECS[name].decode(bytes(payload))
    except BadPayload as bad:
        assert 0 < len(str(bad)) < 400
    else:
        assert isinstance(fields, dict)
