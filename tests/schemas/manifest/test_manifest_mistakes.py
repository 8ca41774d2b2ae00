"""Every mistake in a manifest is told in its own words at its own line: one row each."""

from __future__ import annotations

import pytest

from bridged.drivers.registry import check_manifest
from schemas.files.findings import Findings
from schemas.manifest.loader import read_manifest

ROBOT = '[robot]\ndriver = "zenoh"\n'
PERCEPT = ROBOT + '[percepts.pose]\nsource = "t/pose"\n'
ACTION = ROBOT + '[actions.go]\ntopic = "t/go"\n'

MISTAKES = [
    (
        PERCEPT + f'ttl = "{"9" * 400}s"\n',
        [f"5: percepts.pose.ttl: expected a duration such as `5s`, `500ms` or `15min`, got `{'9' * 400}s`"],
    ),
    (
        ACTION + "fields = {a = inf, b = {value = -9223372036854775808}}\n",
        [
            "5: actions.go.fields.a: expected a number of at most 64 bits, got `inf`",
            "5: actions.go.fields.b: expected a number of at most 64 bits, got `-9223372036854775808`",
        ],
    ),
    ('robots = 1\n[robot]\ndriver = "zenoh"\n', ["1: robots: there is no such table, did you mean `robot`?"]),
    (ROBOT + '[percept.pose]\nsource = "t"\n', ["3: percept: there is no such table, did you mean `percepts`?"]),
    ("robot = 3\n", ["1: robot: expected a table `[robot]`"]),
    ("[robot]\n", ["1: robot: needs the field `driver`"]),
    ('[robot]\ndriver = ""\n', ["2: robot.driver: expected the name of a driver, such as `mavlink`"]),
    ('[robot]\ndriver = "zenho"\n', ["2: robot.driver: no driver `zenho`, there is mavlink, zenoh, python"]),
    (ROBOT + 'drivr = "x"\n', ["3: robot.drivr: there is no such field, did you mean `driver`?"]),
    (ROBOT + 'link_loss = "0s"\n', ["3: robot.link_loss: expected more than 0 s"]),
    (
        ROBOT + 'link_loss = "soon"\n',
        ["3: robot.link_loss: expected a duration such as `5s`, `500ms` or `15min`, got `soon`"],
    ),
    (ROBOT + 'values = "txt"\n', ["3: robot.values: expected `typed` or `text`, got `txt`"]),
    ('percepts = 3\n[robot]\ndriver = "zenoh"\n', ["1: percepts: expected tables `[percepts.NAME]`"]),
    (ROBOT + "[percepts]\npose = 3\n", ["4: percepts.pose: expected a table `[percepts.pose]`"]),
    (
        ROBOT + '[percepts.Pose]\nsource = "t"\n',
        ["3: percepts.Pose: expected the name of a belief or action, such as `battery`, got `Pose`"],
    ),
    (
        ROBOT + '[percepts.bridge]\nsource = "t"\n',
        ["3: percepts.bridge: `bridge` is a name of the bridge: whether it is there"],
    ),
    (
        ROBOT + '[percepts.feedback]\nsource = "t"\n',
        ["3: percepts.feedback: `feedback` is a name of the bridge: what the bridge itself tells of running actions"],
    ),
    (
        ROBOT + '[actions.hand_over]\ntopic = "t"\n',
        ["3: actions.hand_over: `hand_over` is a name of the bridge: how an agent hands the robot to another one"],
    ),
    (
        ROBOT + '[actions.release]\ntopic = "t"\n',
        ["3: actions.release: `release` is a name of the bridge: how an agent lets go of the robot"],
    ),
    (ROBOT + "[percepts.pose]\nargs = []\n", ["3: percepts.pose: needs the field `source`"]),
    (
        ROBOT + '[percepts.pose]\nsource = " "\n',
        ["4: percepts.pose.source: expected where the driver has it from, such as a message or key"],
    ),
    (PERCEPT + 'driver = "zenho"\n', ["5: percepts.pose.driver: no driver `zenho`, there is mavlink, zenoh, python"]),
    (PERCEPT + 'arg = ["x"]\n', ["5: percepts.pose.arg: there is no such field, did you mean `args`?"]),
    (PERCEPT + 'args = ["x", ""]\n', ["5: percepts.pose.args[1]: `` is not a field path such as `voltages.0`"]),
    (
        PERCEPT + 'args = [\n  "x",\n  {field = "a..b"},\n]\n',
        ["7: percepts.pose.args[1]: `a..b` is not a field path such as `voltages.0`"],
    ),
    (PERCEPT + 'args = [\n  "x",\n  3,\n]\n', ["7: percepts.pose.args[1]: expected `str` or a table, got `int`"]),
    (
        PERCEPT + 'args = [{field = "x", scale = "1"}]\n',
        ["5: percepts.pose.args[0].scale: expected `float`, got `str`"],
    ),
    (
        PERCEPT + 'args = [\n  {field = "x", scle = 1},\n]\n',
        ["6: percepts.pose.args[0].scle: there is no such field, did you mean `scale`?"],
    ),
    (PERCEPT + "args = [{scale = 1}]\n", ["5: percepts.pose.args[0]: needs the field `field`"]),
    (
        PERCEPT + 'args = [{field = "x", absent = nan}]\n',
        ["5: percepts.pose.args[0].absent: expected `float` >= -1000000000000000.0, got `nan`"],
    ),
    (
        PERCEPT
        + 'args = [\n  {field = "status", each = [\n    "name",\n'
        + '    {field = "values", each = ["key", "val."]},\n  ]},\n]\n',
        ["8: percepts.pose.args[0].each[1].each[1]: `val.` is not a field path such as `voltages.0`"],
    ),
    (PERCEPT + 'buf = "append"\n', ["5: percepts.pose.buf: expected `update` or `add`, got `append`"]),
    (
        PERCEPT + 'args = ["x"]\nkey = [1]\n',
        ["6: percepts.pose.key[0]: no argument at position 1; the arguments are 0..0"],
    ),
    (PERCEPT + "key = [0]\n", ["5: percepts.pose.key[0]: no argument at position 0; there are no arguments"]),
    (PERCEPT + 'args = ["x"]\nkey = [0, 0]\n', ["6: percepts.pose.key[1]: position 0 is repeated"]),
    (PERCEPT + 'args = ["x"]\nkey = [-1]\n', ["6: percepts.pose.key[0]: expected `int` >= 0, got `-1`"]),
    (
        PERCEPT + 'args = ["x"]\nbuf = "add"\nkey = [0]\n',
        ['7: percepts.pose.key: `buf = "add"` keeps every one; this is for `update`'],
    ),
    (
        PERCEPT + 'buf = "add"\ndeadband = 1\n',
        ['6: percepts.pose.deadband: `buf = "add"` keeps every one; this is for `update`'],
    ),
    (PERCEPT + "deadband = -1\n", ["5: percepts.pose.deadband: expected `float` >= 0.0, got `-1`"]),
    (PERCEPT + "rate = 0\n", ["5: percepts.pose.rate: expected `float` > 0.0, got `0`"]),
    (PERCEPT + 'rate = "fast"\n', ["5: percepts.pose.rate: expected `float`, got `str`"]),
    (PERCEPT + "ttl = 0\n", ["5: percepts.pose.ttl: expected more than 0 s"]),
    (
        PERCEPT + 'ttl = "3 parsecs"\n',
        ["5: percepts.pose.ttl: expected a duration such as `5s`, `500ms` or `15min`, got `3 parsecs`"],
    ),
    (
        PERCEPT + f"ttl = {'9' * 400}\n",
        [f"5: percepts.pose.ttl: expected a duration such as `5s`, `500ms` or `15min`, got `{'9' * 400}`"],
    ),
    (PERCEPT + "ttl = -3\n", ["5: percepts.pose.ttl: expected a duration such as `5s`, `500ms` or `15min`, got `-3`"]),
    (
        ROBOT + "[actions.go]\nmotion = false\n",
        ["3: actions.go: expected one of `command`, `message`, `topic`, `service` and `call`, got none of them"],
    ),
    (
        ACTION + 'service = "t/go"\n',
        [
            "5: actions.go.service: expected one of `command`, `message`, `topic`, `service` and `call`, "
            "got `topic` and `service`"
        ],
    ),
    (ACTION + 'driver = "gpoi"\n', ["5: actions.go.driver: no driver `gpoi`, there is mavlink, zenoh, python"]),
    (ACTION + "parms = []\n", ["5: actions.go.parms: there is no such field, did you mean `params`?"]),
    (ACTION + 'params = [\n  {type = "int"},\n]\n', ["6: actions.go.params[0]: needs the field `name`"]),
    (
        ACTION + 'params = [\n  {name = "x"},\n  {name = "x"},\n]\n',
        ["7: actions.go.params[1].name: `x` is repeated"],
    ),
    (ACTION + 'params = [{name = ""}]\n', ["5: actions.go.params[0].name: expected a name, got ``"]),
    (
        ACTION + 'params = [{name = "x", type = "metres"}]\n',
        ["5: actions.go.params[0].type: expected `float` or `int` or `boolean` or `string` or `list`, got `metres`"],
    ),
    (ACTION + 'params = [{name = "x", type = []}]\n', ["5: actions.go.params[0].type: expected at least one type"]),
    (
        ACTION + 'params = [\n  {name = "x", min = 3, max = 2},\n]\n',
        ["6: actions.go.params[0].min: `x` has min 3 above max 2"],
    ),
    (
        ACTION + 'params = [{name = "x", max = inf}]\n',
        ["5: actions.go.params[0].max: expected a finite number, got `inf`"],
    ),
    (
        ACTION + 'params = [{name = "x", type = "string", min = 1}]\n',
        ["5: actions.go.params[0].min: a range is for numbers; `x` is a string"],
    ),
    (ACTION + 'params = [{name = "x", min = "1"}]\n', ["5: actions.go.params[0].min: expected `float`, got `str`"]),
    (
        ACTION + 'params = [{name = "x", each = [{name = "a"}]}]\n',
        ['5: actions.go.params[0].each: `each` is for `type = "list"`'],
    ),
    (
        ACTION + 'params = [\n  {name = "points", type = "list", each = [\n    {name = "lat"},\n    {name = "lat"},\n'
        '    {name = "lon", min = 2, max = 1},\n  ]},\n]\n',
        [
            "8: actions.go.params[0].each[1].name: `lat` is repeated",
            "9: actions.go.params[0].each[2].min: `lon` has min 2 above max 1",
        ],
    ),
    (
        ACTION + 'params = [{name = "x"}]\nfields = {linear = "y"}\n',
        ["6: actions.go.fields.linear: no parameter `y`; there is x"],
    ),
    (ACTION + 'fields = {linear = "y"}\n', ["5: actions.go.fields.linear: no parameter `y`; there is none"]),
    (
        ACTION + 'params = [{name = "x"}]\nfields = {linear = {scale = 2}}\n',
        ["6: actions.go.fields.linear: expected either `param` or `value`"],
    ),
    (
        ACTION + 'params = [{name = "x"}]\nfields = {linear = {param = "x", value = 2}}\n',
        ["6: actions.go.fields.linear: expected either `param` or `value`"],
    ),
    (
        ACTION + 'params = [{name = "x"}]\nfields = {linear = ""}\n',
        ["6: actions.go.fields.linear: expected the name of a parameter; a text is `{value = ...}`"],
    ),
    (
        ACTION + 'params = [{name = "x"}]\nfields = {linear = [1]}\n',
        ["6: actions.go.fields.linear: expected `bool` or `int` or `float` or `str` or a table, got a list"],
    ),
    (
        ACTION + 'params = [{name = "x"}]\n[actions.go.fields]\nlinear = "x"\nangular = {parm = "x"}\n',
        ["8: actions.go.fields.angular.parm: there is no such field, did you mean `param`?"],
    ),
    (
        ACTION + 'frame = "moon"\n',
        ["5: actions.go.frame: expected `relative` or `amsl` or `local` or `body`, got `moon`"],
    ),
    (
        ACTION + 'feedback = ["Distance"]\n',
        ["5: actions.go.feedback[0]: expected the name of a figure, such as `distance`, got `Distance`"],
    ),
    (
        ACTION + 'params = [{name = "x", max = 3, default = 4}, {name = "y", type = "int", default = 1.5}]\n',
        [
            "5: actions.go.params[0].default: expected float ..3, got `4`",
            "5: actions.go.params[1].default: expected int, got `1.5`",
        ],
    ),
    (
        ACTION + 'params = [{name = "x", default = 4}, {name = "y"}]\n',
        ["5: actions.go.params[1].default: `y` needs a default, because `x` before it has one"],
    ),
    (
        ACTION + 'params = [{name = "x", type = "list", each = [{name = "y", default = 1}]}]\n',
        ["5: actions.go.params[0].each: only an argument can have a default"],
    ),
    (ACTION + 'feedback = ["distance", "distance"]\n', ["5: actions.go.feedback[1]: `distance` is repeated"]),
    (ACTION + 'feedback = "distance"\n', ["5: actions.go.feedback: expected a list, got `str`"]),
    (ACTION + "latch = 1\n", ["5: actions.go.latch: expected `bool`, got `int`"]),
    (ACTION + "tolerance = 0\n", ["5: actions.go.tolerance: expected `float` > 0.0, got `0`"]),
    (ACTION + 'deadline = "0s"\n', ["5: actions.go.deadline: expected more than 0 s"]),
    (
        ACTION + "deadline = []\n",
        ["5: actions.go.deadline: expected a duration such as `5s`, `500ms` or `15min`, got `[]`"],
    ),
    (ACTION + "retry = {times = 99}\n", ["5: actions.go.retry.times: expected `int` <= 20, got `99`"]),
    (ACTION + "retry = 3\n", ["5: actions.go.retry: expected a table, got `int`"]),
    (ACTION + 'cancel = "stop"\n', ["5: actions.go.cancel: expected `hold` or `none`, got `stop`"]),
    (ACTION + 'motion = "no"\n', ["5: actions.go.motion: expected `bool`, got `str`"]),
    (ACTION + '[orders]\nhalt = "go"\n', ["6: orders.halt: there is no such order; known are hold, land, rtl"]),
    (
        ACTION + "[orders]\nhold = 3\n",
        ['6: orders.hold: expected an action with its arguments, such as `"cmd_vel(0, 0)"`'],
    ),
    (
        ACTION + '[orders]\nhold = "stop(0)"\n',
        ["6: orders.hold: `stop(0)`: the manifest has no action `stop`; it has go/0"],
    ),
    (ACTION + '[orders]\nhold = "go(1)"\n', ["6: orders.hold: go() takes 0 arguments, got 1"]),
    (
        ACTION + 'params = [{name = "x", max = 3}]\n[orders]\nhold = "go(4)"\n',
        ["7: orders.hold: go: expected x: float ..3, got 4"],
    ),
    (
        ACTION + '[orders]\nhold = "go("\n',
        [
            "6: orders.hold: expected an action with its arguments, such as `cmd_vel(0, 0)`, got `go(`: "
            "expected a term at character 4, got the end: go("
        ],
    ),
    ('orders = 3\n[robot]\ndriver = "zenoh"\n', ["1: orders: expected a table `[orders]`"]),
]


@pytest.mark.parametrize(("text", "said"), MISTAKES, ids=[text.splitlines()[-1] for text, _ in MISTAKES])
def test_a_mistake_is_told_where_it_stands(text: str, said: list[str]) -> None:
    assert problems(text) == said


def test_the_mistakes_of_a_whole_manifest_are_told_at_once_those_that_only_drivers_see_too() -> None:
    text = (
        '[robot]\ndriver = "zenoh"\n'
        '[percepts.altitude]\nsource = "alt"\ndriver = "zenho"\n'
        '[percepts.Battery]\nsource = "bat"\nrate = 0\n'
        '[actions.go]\nparams = [{nam = "x"}]\ndeadline = "0s"\n[orders]\nhold = "go(1)"\nland = 3\n'
    )
    assert problems(text) == [
        "5: percepts.altitude.driver: no driver `zenho`, there is mavlink, zenoh, python",
        "6: percepts.Battery: expected the name of a belief or action, such as `battery`, got `Battery`",
        "8: percepts.Battery.rate: expected `float` > 0.0, got `0`",
        "9: actions.go: expected one of `command`, `message`, `topic`, `service` and `call`, got none of them",
        "10: actions.go.params[0].nam: there is no such field, did you mean `name`?",
        "10: actions.go.params[0]: needs the field `name`",
        "11: actions.go.deadline: expected more than 0 s",
        '14: orders.land: expected an action with its arguments, such as `"cmd_vel(0, 0)"`',
    ]


def problems(text: str) -> list[str]:
    """What is wrong with a manifest, as `line: message`, in the order of the lines."""
    try:
        found = check_manifest(read_manifest(text, "m.toml", check_manifest))
    except Findings as findings:
        found = findings.findings
    return [f"{one.line}: {one.message}" for one in found]
