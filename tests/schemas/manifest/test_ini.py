"""The paper's INI files as they are written: what reads, and every problem at its line, all of it at once."""

import pytest

from schemas.files.ini_positions import read_ini
from schemas.manifest.ini import (
    BadList,
    IniAction,
    IniPercept,
    read_actions,
    read_fields,
    read_parameter,
    read_percepts,
)
from schemas.manifest.loader import Field, Parameter
from schemas.manifest.model import ParameterType


def actions(text: str) -> list[IniAction]:
    """The actions of a text of which nothing is wrong."""
    entries, findings = read_actions(text, "a")
    assert findings == []
    return entries


def percepts(text: str) -> list[IniPercept]:
    """The percepts of a text of which nothing is wrong."""
    entries, findings = read_percepts(text, "p")
    assert findings == []
    return entries


def test_sections_options_remarks_and_continued_lines_are_read_with_their_lines() -> None:
    ini = read_ini(
        "\ufeff; remark\n[DEFAULT]\nRate: 5\n\n[pose]  # remark\nargs = x,\n    y,\n    theta\nname=/a = b ; remark\n",
        "m",
    )
    assert ini.findings == ()
    assert {name: option.value for name, option in ini.defaults.options.items()} == {"rate": "5"}
    [pose] = ini.sections
    assert (pose.name, pose.line) == ("pose", 5)
    assert {name: (one.value, one.line) for name, one in pose.options.items()} == {
        "args": ("x, y, theta", 6),
        "name": ("/a = b", 9),
    }


@pytest.mark.parametrize(
    ("text", "entries"),
    [
        ("", ()),
        ("data", ("data",)),
        (" mode,connected , armed,, ", ("mode", "connected", "armed")),
        ("pose.position.x, ranges.0", ("pose.position.x", "ranges.0")),
        ("status[](name, level)", (Field(field="status", each=("name", "level")),)),
        (
            "header.stamp, status[](values[](key, value))",
            ("header.stamp", Field(field="status", each=(Field(field="values", each=("key", "value")),))),
        ),
        ("a.b[] ( c.d , )", (Field(field="a.b", each=("c.d",)),)),
    ],
)
def test_args_are_paths_and_lists_of_structures(text: str, entries: tuple[str | Field, ...]) -> None:
    assert read_fields(text) == entries


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,,b", "entry 2 of the list is empty, in `a,,b`"),
        ("a[](b", "a bracket is not closed, in `a[](b`"),
        ("a)", "`)` closes nothing, in `a)`"),
        ("status[]", "`status[]`: expected its fields in brackets, or `status` for the whole list"),
        ("status(a)", "expected a field such as `pose.position.x` or `status[](name, level)`, got `status(a)`"),
        ("a b", "`a b` is not a field; expected a path such as `pose.position.x`"),
        ("pose..x", "`pose..x` is not a field; expected a path such as `pose.position.x`"),
        ("a[](" * 10 + "b" + ")" * 10, "nested deeper than 8"),
    ],
)
def test_bad_syntax_in_args_is_told(text: str, message: str) -> None:
    with pytest.raises(BadList) as problem:
        read_fields(text)
    assert str(problem.value) == message


ANY: tuple[ParameterType, ...] = ("int", "float", "boolean", "string", "list")


@pytest.mark.parametrize(
    ("text", "parameter"),
    [
        ("float", Parameter(name="p", type="float")),
        ("int", Parameter(name="p", type="int")),
        ("bool", Parameter(name="p", type="boolean")),
        ("str", Parameter(name="p", type="string")),
        ("int[]", Parameter(name="p", type="list")),
        ("uint16[8]", Parameter(name="p", type="list")),
        (
            "geometry_msgs/Point[](x, y)",
            Parameter(name="p", type="list", each=(Parameter(name="x", type=ANY), Parameter(name="y", type=ANY))),
        ),
    ],
)
def test_params_type_says_what_arguments_are(text: str, parameter: Parameter) -> None:
    assert read_parameter("p", text) == parameter


def test_a_type_is_never_looked_up_in_python() -> None:
    with pytest.raises(BadList, match=r"no type `eval`; expected one of str, string, float, int, long, bool, list"):
        read_parameter("p", "eval")


def test_an_action_has_its_way_its_name_its_parameters_and_is_latched_unless_it_says_otherwise() -> None:
    text = """
[go]
method = topic
name = /turtle1/cmd_vel
msg_type = Twist
dependencies = geometry_msgs.msg
params_name = linear.x, angular.z,
params_type = float, float,,
[stop]
method = service
name = robot/stop
latch = no
"""
    go, stop = actions(text)
    assert (go.name, go.method, go.target, go.latch, go.typed) == ("go", "topic", "turtle1/cmd_vel", True, True)
    assert [(one.name, one.type) for one in go.params] == [("linear.x", "float"), ("angular.z", "float")]
    assert (stop.method, stop.target, stop.params, stop.latch) == ("service", "robot/stop", (), False)


def test_parameters_without_types_are_texts() -> None:
    [action] = actions("[say]\nmethod = topic\nname = /say\nparams_name = data\n")
    assert action.params == (Parameter(name="data", type="string"),)
    assert not action.typed


def test_default_says_how_often_percepts_are_told_and_what_sections_leave_out() -> None:
    text = (
        "[DEFAULT]\nrate = 2\nbuf = add\n[a]\nname = /a\nargs = x\n[b]\nname = /b\nargs = x\nbuf = update\nrate = 5\n"
    )
    first, second = percepts(text)
    assert (first.buf, first.rate) == ("add", 2.0)
    assert (second.buf, second.rate) == ("update", 5.0)
    assert percepts("[a]\nname = /a\nargs = x\n")[0].rate == 30.0


def test_all_problems_of_an_actions_manifest_are_told_at_once_each_at_its_line() -> None:
    text = """before = 1
[DEFAULT]
lacht = True
[Takeoff]
method = servce
name = mavros/cmd/takeoff
params_name = altitude, yaw
params_type = float
[land]
metod = service
latch = perhaps
params_name = a,,b
[land]
name = x
[cmd]
method = topic
method = service
name = no name
params_name = a, b, a
params_type = float, eval, Point[](
nonsense
"""
    entries, findings = read_actions(text, "actions")
    assert [(one.name, one.wrong) for one in entries] == [("Takeoff", True)], "what has a name can be looked up"
    assert [f"{one.line}: {one.message}" for one in sorted(findings)] == [
        "1: expected a section such as `[takeoff]` before `before = 1`",
        "3: [DEFAULT]: no option `lacht`, did you mean `latch`?",
        "4: `[Takeoff]`: expected the name of a belief or action, such as `[battery]`",
        "5: [Takeoff] method: expected topic or service, got `servce`",
        "8: [Takeoff] params_type: 2 names in `params_name`, 1 types here",
        "9: [land]: `method` is missing; expected topic or service",
        "9: [land]: `name`, the topic or service, is missing",
        "10: [land]: no option `metod`, did you mean `method`?",
        "11: [land] latch: expected True or False, got `perhaps`",
        "12: [land] params_name: entry 2 of the list is empty, in `a,,b`",
        "13: `[land]` is repeated, first at line 9",
        "17: `method` is repeated, first at line 16",
        "18: [cmd] name: expected the name of a topic or service such as `/turtle1/pose`, got `no name`",
        "19: [cmd] params_name: `a` is repeated",
        "20: [cmd] params_type: a bracket is not closed, in `float, eval, Point[](`",
        "21: expected `option = value`, got `nonsense`",
    ]


def test_all_problems_of_a_perceptions_manifest_are_told_at_once_each_at_its_line() -> None:
    text = (
        "[DEFAULT]\nrate = often\n[a]\nmethod = service\nname =\nargs = x(\nbuf = replace\n[b]\nname = /b\nargs = x\n"
    )
    _, findings = read_percepts(text, "percepts")
    assert [f"{one.line}: {one.message}" for one in sorted(findings)] == [
        "2: [a] rate: expected a number of Hz above 0, got `often`",
        "2: [b] rate: expected a number of Hz above 0, got `often`",
        "4: [a] method: expected topic, got `service`",
        "5: [a] name: `name`, the topic or service, is missing",
        "6: [a] args: a bracket is not closed, in `x(`",
        "7: [a] buf: expected update or add, got `replace`",
    ]


def test_the_other_file_of_the_two_is_told_as_such() -> None:
    _, findings = read_actions("[pose]\nname = /pose\nargs = x\nbuf = update\n", "perceptions_manifest")
    assert [str(one) for one in findings] == [
        "perceptions_manifest: error: this is a perceptions manifest; "
        "the actions come first: `manifest: [actions_manifest, perceptions_manifest]`"
    ]
    _, findings = read_percepts("[go]\nmethod = topic\nname = /go\nparams_name = x\n", "actions_manifest")
    assert len(findings) == 1
    assert "this is an actions manifest" in findings[0].message


def test_names_of_the_bridge_are_refused() -> None:
    _, actions = read_actions("[release]\nmethod = service\nname = a\n[holder]\nmethod = service\nname = a\n", "a.ini")
    _, percepts = read_percepts("[holder]\nname = a\nargs = x\n[release]\nname = a\nargs = x\n", "p.ini")
    assert [f"{one.line}: {one.message}" for one in (*actions, *percepts)] == [
        "1: `[release]` is a name of the bridge: how an agent lets go of the robot",
        "1: `[holder]` is a name of the bridge: which of its agents has the robot",
    ]
