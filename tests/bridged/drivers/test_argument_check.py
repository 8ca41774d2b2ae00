"""Arguments of actions: typed, in range, lists and structures element by element, and errors that say which."""

import re

import pytest

from bridged.drivers.argument_check import BadArgument, read_arguments, signature
from schemas.manifest.loader import ActionEntry, Argument, read_manifest
from schemas.wire.term_text import read

MANIFEST = """
[robot]
driver = "zenoh"
[actions.fly]
topic = "fly"
params = [
  {name = "points", type = "list", each = [
    {name = "lat", min = -90, max = 90, unit = "deg"},
    {name = "tags", type = "list", each = [
      {name = "key", type = "string"}, {name = "value", type = ["int", "string"]},
    ]},
  ]},
  {name = "speed", type = "int", min = 1, max = 20, unit = "m/s"},
]
[actions.play]
topic = "play"
params = [{name = "tones", type = "list", each = [{name = "hertz", min = 20}]}, {name = "rest", type = "list"}]
[actions.light]
topic = "light"
params = [{name = "on", type = "boolean"}, {name = "colour", type = ["string", "list"]}]
[actions.pen]
topic = "pen"
params = [
  {name = "r", type = "int"},
  {name = "width", type = "int", max = 9, default = 3},
  {name = "off", type = "boolean", default = false},
]
"""
ACTIONS = read_manifest(MANIFEST, "m.toml").actions


def called(text: str) -> dict[str, Argument]:
    """What the driver is given for a call."""
    call = read(text)
    name, arguments = call.functor, call.args  # type: ignore[union-attr]
    return read_arguments(name, ACTIONS[name], arguments)


def test_lists_of_structures_are_named_by_each_also_within_one_another() -> None:
    assert called('fly([[1, [["a", 2], [b, "c"]]], [-90, []]], 5)') == {
        "points": [
            {"lat": 1, "tags": [{"key": "a", "value": 2}, {"key": "b", "value": "c"}]},
            {"lat": -90, "tags": []},
        ],
        "speed": 5,
    }


def test_structures_of_one_value_may_stand_bare_and_a_plain_list_holds_anything() -> None:
    assert called('play([440, [880]], [1, "x", [true, guided]])') == {
        "tones": [{"hertz": 440}, {"hertz": 880}],
        "rest": [1, "x", [True, "guided"]],
    }


def test_of_several_types_the_first_that_fits_is_taken() -> None:
    assert called('light(true, "red")') == {"on": True, "colour": "red"}
    assert called("light(false, [255, 0, 0])") == {"on": False, "colour": [255, 0, 0]}


POINT = "[lat: float -90..90 deg, tags: list of [key: string, value: int or string]]"


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("fly([[91, []]], 5)", "fly: expected points[0].lat: float -90..90 deg, got 91"),
        ("fly([[1, []], [2]], 5)", f"fly: expected points[1]: {POINT}, got [2]"),
        ("fly([[1, []], 2], 5)", f"fly: expected points[1]: {POINT}, got 2"),
        ("fly([[1, [[k, 1], [k, 1.5]]]], 5)", "fly: expected points[0].tags[1].value: int or string, got 1.5"),
        ("fly([[1, k]], 5)", "fly: expected points[0].tags: list of [key: string, value: int or string], got k"),
        ("fly(3, 5)", f"fly: expected points: list of {POINT}, got 3"),
        ("fly([], 2.5)", "fly: expected speed: int 1..20 m/s, got 2.5"),
        ("fly([], true)", "fly: expected speed: int 1..20 m/s, got true"),
        ("fly([], 21)", "fly: expected speed: int 1..20 m/s, got 21"),
        ("fly([])", f"fly(points: list of {POINT}, speed: int 1..20 m/s) takes 2 arguments, got 1"),
        ("play([440, 3], [])", "play: expected tones[1].hertz: float 20.., got 3"),
        ("play([], [1, [f(x)]])", "play: expected rest[1][0]: a number, text, boolean or list, got f(x)"),
        ("play([], X)", "play: expected rest: list, got X"),
        ('light("yes", red)', 'light: expected on: boolean, got "yes"'),
        ("light(true, 3)", "light: expected colour: string or list, got 3"),
    ],
)
def test_an_error_says_which_element_what_was_expected_and_what_came(call: str, said: str) -> None:
    with pytest.raises(BadArgument) as caught:
        called(call)
    assert str(caught.value) == said


def test_a_long_argument_is_shown_short() -> None:
    with pytest.raises(BadArgument) as caught:
        called(f'light("{"x" * 5000}", red)')
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("call", "arguments"),
    [
        ("pen(1)", {"r": 1, "width": 3, "off": False}),
        ("pen(1, 9)", {"r": 1, "width": 9, "off": False}),
        ("pen(1, 9, true)", {"r": 1, "width": 9, "off": True}),
    ],
)
def test_arguments_that_are_left_out_are_their_defaults(call: str, arguments: dict[str, Argument]) -> None:
    assert called(call) == arguments


def test_too_few_and_too_many_are_told_with_how_many_it_takes() -> None:
    expected = "pen(r: int, width: int ..9 = 3, off: boolean = false) takes 1 to 3 arguments, got"
    for count in (0, 4):
        with pytest.raises(BadArgument, match=re.escape(f"{expected} {count}")):
            read_arguments("pen", ACTIONS["pen"], [1] * count)


def test_a_signature_shows_the_structures() -> None:
    entry: ActionEntry = ACTIONS["play"]
    assert signature("play", entry) == "play(tones: list of [hertz: float 20..], rest: list)"
