"""Values as texts: what percepts and arguments are by way of their text, as in the paper's bridge."""

from collections.abc import Mapping
from typing import Any

import pytest

from bridged.bridge.percepts import PerceptPublisher
from bridged.drivers.api import Reading
from bridged.drivers.argument_check import BadArgument, read_arguments
from bridged.paper_format.text_values import percept_value
from schemas.wire.codec import codec
from schemas.wire.records import Perception
from schemas.wire.terms import Atom, Structure, Term, Variable
from tests.bridged.ini_pairs import pair, service
from tests.bridged.sky import VirtualClock


def perceived(percepts: str, fields: Mapping[str, object]) -> list[tuple[Any, ...]]:
    """What an agent perceives of a reading of the source `p`."""
    told: list[tuple[Any, ...]] = []
    board = PerceptPublisher(
        pair(percepts=percepts),
        ["uav"],
        lambda agent, change: told.append(change.parameters),
        robot="r",
        boot="b",
        clock=VirtualClock(),
    )
    board.take(Reading("p", fields))
    return told


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
    [parameters] = perceived(text, {"data": value})
    assert parameters == (term,)
    assert type(parameters[0]) is type(term)


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
    said = {"status": [{"name": "gps", "level": 0, "values": [{"key": "Fix", "value": "3"}]}]}
    [parameters] = perceived(text, said)
    assert parameters == ([[["Fix", 3]]], [[Atom("gps")]], [[0, Atom("gps")]])


@pytest.mark.parametrize("text", ["1e999", "-1e999", "[1e999]"])
def test_a_number_too_large_for_a_number_travels(text: str) -> None:
    term = percept_value(text)
    perception = Perception(name="x", parameters=(term,))
    assert codec(Perception).decode(codec(Perception).encode(perception)).parameters == (term,)


def test_an_atom_of_a_driver_stays_an_atom() -> None:
    assert percept_value(Atom("down")) == Atom("down")
