"""From what a robot says to terms: conversion, lists and structures within one another, and what it does not know."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import pytest

from bridged.bridge.translation import Translator
from bridged.drivers.api import Reading
from schemas.manifest.loader import read_manifest
from schemas.wire.terms import Atom, Number


def perceived(args: str, message: Mapping[str, object]) -> tuple[Any, ...] | str:
    """The arguments of a percept of `message`; `unreadable` or `unknown` if there is none."""
    text = f'[robot]\ndriver = "zenoh"\n[percepts.p]\nsource = "m"\nargs = {args}\n'
    translator = Translator(read_manifest(text, "m.toml"))
    found = [belief.parameters for belief in translator.beliefs(Reading("m", message))]
    if found and found[0] is not None:
        return found[0]
    return "unreadable" if translator.unreadable else "unknown"


DIAGNOSTICS = {
    "status": [
        {"name": "imu", "values": [{"key": "t", "value": 31.5}, {"key": "ok", "value": True}]},
        {"name": "gps", "values": []},
    ]
}
STATUS = '{field = "status", each = ["name", {field = "values", each = ["key", "value"]}]}'


@pytest.mark.parametrize(
    ("args", "message", "expected"),
    [
        (f"[{STATUS}]", DIAGNOSTICS, ([["imu", [["t", 31.5], ["ok", True]]], ["gps", []]],)),
        ('[{field = "status", each = ["name"]}]', DIAGNOSTICS, (["imu", "gps"],)),
        ('["status.0.values.1.key"]', DIAGNOSTICS, ("ok",)),
        ('["status"]', DIAGNOSTICS, "unreadable"),
        ('[{field = "status", each = ["level"]}]', DIAGNOSTICS, "unreadable"),
        ('[{field = "x", each = ["a"]}]', {"x": 3}, "unreadable"),
        ('[{field = "x", each = ["0", "1"]}]', {"x": [[1, 2], [3, 4]]}, ([[1, 2], [3, 4]],)),
        ('["x"]', {"x": [1, 2.5, "a", [True, b"\x01\x02"]]}, ([1, 2.5, "a", [True, [1, 2]]],)),
        ('[{field = "x", scale = 0.001}]', {"x": [12600, 12500]}, ([12.6, 12.5],)),
        ('[{field = "x", scale = 0.001, absent = 65535}]', {"x": [12600, 65535]}, ([12.6],)),
        ('[{field = "x", scale = 2, offset = -1}]', {"x": 3}, (5.0,)),
        ('[{field = "x", scale = 2}]', {"x": [[1], [2, "a"]]}, ([[2.0], [4.0, "a"]],)),
        ('[{field = "x", scale = 2}]', {"x": True}, (True,)),
        ('[{field = "x", absent = -1}]', {"x": -1}, "unknown"),
        (
            '[{field = "cells", each = ["id", {field = "mv", scale = 0.001, absent = 0}]}]',
            {"cells": [{"id": 1, "mv": 3700}, {"id": 2, "mv": 0}]},
            ([[1, 3.7]],),
        ),
        ('["x"]', {"x": float("nan")}, (Number("NaN"),)),
        ('["x"]', {"x": None}, "unreadable"),
        ('[{field = "x", scale = 0.5}]', {"x": 10**400}, "unreadable"),
        ('["x", "y"]', {"x": 1}, "unreadable"),
        ('["x"]', {"x": Atom("down")}, (Atom("down"),)),
    ],
)
def test_what_a_robot_says_becomes_terms(args: str, message: Mapping[str, object], expected: object) -> None:
    assert perceived(args, message) == expected


def test_sources_of_one_name_of_two_drivers_are_two() -> None:
    text = """
[robot]
driver = "zenoh"
[percepts.depth]
source = "sonar"
args = ["m"]
[percepts.echo]
source = "sonar"
driver = "python"
args = ["ms"]
"""
    translator = Translator(read_manifest(text, "m.toml"))
    said = [Reading("sonar", {"m": 3}), Reading("sonar", {"ms": 4}, driver="python")]
    assert [[(one.name, one.parameters) for one in translator.beliefs(reading)] for reading in said] == [
        [("depth", (3,))],
        [("echo", (4,))],
    ]
    assert translator.unreadable == 0


@pytest.mark.parametrize(
    "value",
    [10**30, "\ud800", [[0]] * 40_000, functools.reduce(lambda inner, _: [inner], range(50_000), [])],
    ids=["an integer of 100 bits", "half a character", "too large", "too deep"],
)
def test_what_cannot_be_told_is_counted_and_hides_no_other_percept(value: object) -> None:
    manifest = read_manifest(
        '[robot]\ndriver = "zenoh"\n[percepts.odd]\nsource = "s"\nargs = ["odd"]\n[percepts.even]\nsource = "s"\n'
        'args = ["even"]\n',
        "m.toml",
    )
    translator = Translator(manifest)
    told = list(translator.beliefs(Reading("s", {"odd": value, "even": 2})))
    assert [(one.name, one.parameters) for one in told] == [("even", (2,))]
    assert translator.unreadable == 1


def test_a_value_that_the_robot_no_longer_knows_ends_the_belief() -> None:
    manifest = read_manifest(
        '[robot]\ndriver = "zenoh"\n[percepts.depth]\nsource = "s"\nargs = [{field = "d", absent = -1}]\n', "m.toml"
    )
    told = [next(iter(Translator(manifest).beliefs(Reading("s", {"d": depth})))).parameters for depth in (5, -1)]
    assert told == [(5,), None]
