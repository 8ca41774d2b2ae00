"""Percepts: terms of readings, only changes, limited by rate, aged by their source, equal at both ends of the bus."""

import asyncio
import functools
import math
from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridged.bridge.percepts import MAX_BELIEFS, PerceptPublisher
from bridged.drivers.api import Reading
from schemas.manifest.loader import Manifest, read_manifest
from schemas.mission.model import Robot
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import Header, Perception
from schemas.wire.terms import Atom
from tests.bridged.sky import VirtualClock

MANIFEST = """
[robot]
driver = "mavlink"
vehicle = "copter"
[percepts.altitude]
source = "POSITION"
args = [{field = "alt", scale = 0.001}]
rate = 10
ttl = "3s"
deadband = 0.01
[percepts.battery]
source = "BATTERY"
args = ["id", {field = "volts.0", scale = 0.001, absent = 65535}]
key = [0]
ttl = "10s"
[percepts.event]
source = "EVENT"
args = ["text"]
buf = "add"
[percepts.mode]
source = "MODE"
args = ["name", "armed"]
"""

LISTS = """
[robot]
driver = "zenoh"
[percepts.sonar]
source = "SONAR"
args = ["id", "range"]
key = [0]
rate = 2
ttl = "3s"
deadband = 0.1
[percepts.track]
source = "TRACK"
args = [{field = "points", each = ["name", {field = "at", each = ["x", "y"]}]}]
deadband = 0.5
[percepts.seen]
source = "SEEN"
args = ["what", "where"]
buf = "add"
ttl = "3s"
"""


class Board:
    """A percept board with its time and what it has told."""

    def __init__(self, manifest: Manifest | None = None, speed: float = 1.0) -> None:
        self.clock = VirtualClock(speed)
        self.told: list[Perception] = []
        self.of_each: list[tuple[str, str]] = []
        """The agents and the names of their changed percepts."""
        self.wake = asyncio.Event()
        self.percepts = PerceptPublisher(
            manifest or read_manifest(MANIFEST, "m.toml"),
            ["uav", "ground"],
            self._publish,
            robot="r",
            boot="b1",
            clock=self.clock,
            wake=self.wake,
        )

    def _publish(self, agent: str, change: Perception) -> None:
        self.of_each.append((agent, change.name))
        if agent == "uav":
            self.told.append(change)

    def hear(self, source: str, **fields: object) -> None:
        self.percepts.take(Reading(source, fields))

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.clock.time += 0.1
            self.percepts.tick()

    def taken(self) -> list[tuple[str, str, tuple[Any, ...]]]:
        told, self.told[:] = [(one.update, one.name, one.parameters) for one in self.told], []
        return told


@pytest.fixture
def board() -> Board:
    return Board()


def test_what_a_reading_or_tick_changes_is_published_to_each_agent_and_nothing_else() -> None:
    fields = {"alt": 5000, "hdg": 90}
    board = Board(
        read_manifest(MANIFEST + '[percepts.heading]\nsource = "POSITION"\nargs = ["hdg"]\nrate = 10\n', "m.toml")
    )
    both = [(agent, name) for name in ("altitude", "heading") for agent in ("uav", "ground")]
    board.hear("POSITION", **fields)
    assert board.of_each == both
    board.of_each.clear()
    board.hear("POSITION", **fields)
    assert board.of_each == [], "nothing has changed"
    board.hear("POSITION", alt=6000, hdg=91)
    assert board.of_each == [], "the rate holds both back"
    board.wait(0.1)
    assert board.of_each == both


def test_a_number_within_its_deadband_is_no_change_but_creeping_is(board: Board) -> None:
    board.hear("POSITION", alt=5000)
    for millimetres in (5004, 5008, 5011):
        board.wait(1)
        board.hear("POSITION", alt=millimetres)
    assert board.taken() == [("replace", "altitude", (5.0,)), ("replace", "altitude", (5.011,))]


def test_the_rate_bounds_what_is_told_and_the_newest_value_is_never_left_out(board: Board) -> None:
    for step in range(50):
        board.hear("POSITION", alt=step * 100)
        board.clock.time += 0.02
        board.percepts.tick()
    board.wait(0.2)
    told = board.taken()
    assert 10 <= len(told) <= 13
    assert told[-1] == ("replace", "altitude", (4.9,))


@pytest.mark.parametrize(
    ("late", "held_back"),
    [(0.02, []), (0.06, []), (0.09, []), (0.15, [400, 500]), (0.26, [400, 500, 600])],
)
def test_what_a_late_reading_of_a_source_at_the_rate_holds_back_is_at_most_what_comes_on_its_heels(
    board: Board, late: float, held_back: list[int]
) -> None:
    later = []
    for step in range(1, 11):
        sent = step / 10
        arrives = max(sent, 0.3 + late if step >= 3 else 0.0)
        while board.clock.time < arrives - 1e-9:
            board.clock.time = min(arrives, board.clock.time + 0.01)
            board.percepts.tick()
        board.hear("POSITION", alt=step * 100)
        if not ((told := board.taken()) and told[-1][2] == (step / 10,)):
            later.append(step * 100)
    assert later == held_back


def test_a_tick_returns_how_long_a_value_is_held_back(board: Board) -> None:
    board.hear("POSITION", alt=0)
    assert board.percepts.tick() == pytest.approx(3), "it ages then"
    board.clock.time += 0.02
    board.hear("POSITION", alt=100)
    assert board.percepts.tick() == pytest.approx(0.08)
    board.clock.time += 0.08
    assert board.percepts.tick() == pytest.approx(2.92), "it ages 3 s after it was heard"
    assert board.taken()[-1] == ("replace", "altitude", (0.1,))


def test_a_percept_ages_only_when_its_source_falls_silent(board: Board) -> None:
    for _ in range(20):
        board.hear("POSITION", alt=5000)
        board.wait(1)
    assert board.taken() == [("replace", "altitude", (5.0,))]
    board.wait(4)
    assert board.taken() == [("remove", "altitude", (5.0,))]
    assert board.percepts.expired == 1
    board.hear("POSITION", alt=5000)
    assert board.taken() == [("replace", "altitude", (5.0,))], "the same value is news again"


def test_at_speed_percepts_do_not_age_faster_than_the_wall_clock(board: Board) -> None:
    fast = Board(speed=20)
    fast.hear("POSITION", alt=5000)
    fast.wait(59)
    assert fast.taken() == [("replace", "altitude", (5.0,))]
    fast.wait(2)
    assert fast.taken() == [("remove", "altitude", (5.0,))]


def test_three_sonars_have_each_their_own_rate_deadband_and_age() -> None:
    board = Board(read_manifest(LISTS, "m.toml"))
    for sonar in range(3):
        board.hear("SONAR", id=sonar, range=1.0)
    assert board.taken() == [("replace", "sonar", (sonar, 1.0)) for sonar in range(3)]
    board.clock.time += 0.1
    board.hear("SONAR", id=0, range=1.05)
    board.hear("SONAR", id=1, range=2.0)
    assert board.taken() == [], "one has not moved, the other's rate is not over"
    board.wait(2)
    assert board.taken() == [("replace", "sonar", (1, 2.0))]
    board.hear("SONAR", id=1, range=2.0)
    board.wait(2)
    assert board.taken() == [("remove", "sonar", (2, 1.0)), ("remove", "sonar", (0, 1.0))]
    assert [one.parameters for one in board.percepts.sets["uav"].present()] == [(1, 2.0)]


def test_the_deadband_holds_for_numbers_inside_nested_lists() -> None:
    board = Board(read_manifest(LISTS, "m.toml"))

    def hear(*points: tuple[str, list[tuple[float, float]]]) -> list[Any]:
        told = [{"name": name, "at": [{"x": x, "y": y} for x, y in at]} for name, at in points]
        board.hear("TRACK", points=told)
        return board.taken()

    assert hear(("a", [(1, 2)])) == [("replace", "track", ([["a", [[1, 2]]]],))]
    assert hear(("a", [(1.4, 1.6)])) == []
    assert hear(("a", [(1.4, 2.6)])) == [("replace", "track", ([["a", [[1.4, 2.6]]]],))]
    assert hear(("b", [(1.4, 2.6)])) == [("replace", "track", ([["b", [[1.4, 2.6]]]],))]
    assert hear(("b", [])) == [("replace", "track", ([["b", []]],))]
    assert hear() == [("replace", "track", ([],))]


def test_events_stand_beside_each_other_and_age_by_their_own_last_time() -> None:
    board = Board(read_manifest(LISTS, "m.toml"))
    board.hear("SEEN", what="boat", where=[1, 2])
    board.hear("SEEN", what="boat", where=[3, 4])
    board.wait(2)
    board.hear("SEEN", what="boat", where=[3, 4])
    assert board.taken() == [("add", "seen", ("boat", at)) for at in ([1, 2], [3, 4], [3, 4])]
    board.wait(2)
    assert board.taken() == [("remove", "seen", ("boat", [1, 2]))]


def changed(text: str) -> Board:
    """A board that has heard of everything, and then goes on by another manifest."""
    board = Board()
    board.hear("POSITION", alt=5000)
    board.hear("BATTERY", id=0, volts=[12600, 0])
    board.hear("MODE", name="GUIDED", armed=False)
    board.hear("EVENT", text="bump")
    board.taken()
    board.percepts.adopt(read_manifest(text, "m.toml"))
    return board


def test_entries_that_another_manifest_leaves_as_they_are_keep_belief_seq_and_age() -> None:
    board = changed(MANIFEST + '[percepts.more]\nsource = "MODE"\nargs = ["name"]\n')
    assert board.taken() == [("replace", "more", ("GUIDED",))]
    assert board.percepts.sets["uav"].seq == 5
    board.hear("BATTERY", id=0, volts=[12600, 0])
    board.hear("MODE", name="GUIDED", armed=False)
    assert board.taken() == []
    board.wait(4)
    assert board.taken() == [("remove", "altitude", (5.0,))], "it ages from when it was heard before the change"


def test_a_change_that_is_held_back_wakes_the_bridge_only_if_it_is_due_before_the_next_tick(board: Board) -> None:
    board.hear("POSITION", alt=5000)
    board.wake.clear()
    board.percepts.next_tick = board.clock.now() + 0.05
    board.hear("POSITION", alt=6000)
    assert not board.wake.is_set(), "it is due in 0.1 s"
    board.percepts.next_tick = board.clock.now() + 0.25
    board.hear("POSITION", alt=7000)
    assert board.wake.is_set()


def test_a_belief_that_ages_before_the_next_tick_wakes_the_bridge() -> None:
    board = Board(read_manifest(MANIFEST.replace('ttl = "3s"', 'ttl = "0.2s"'), "m.toml"))
    board.percepts.next_tick = board.clock.now() + 1.0  # a robot that rests is looked at each second
    board.hear("POSITION", alt=5000)
    assert board.wake.is_set()
    assert board.percepts.tick() == pytest.approx(0.2)
    board.wait(0.3)
    assert ("remove", "altitude", (5.0,)) in board.taken()


def test_what_another_manifest_holds_back_for_less_long_wakes_the_bridge(board: Board) -> None:
    board.hear("POSITION", alt=0)
    board.hear("POSITION", alt=100)
    board.wake.clear()
    board.percepts.adopt(read_manifest(MANIFEST.replace("rate = 10", "rate = 50"), "m.toml"))
    assert board.wake.is_set()
    assert board.percepts.tick() == pytest.approx(0.02)


def test_a_percept_that_another_manifest_does_not_declare_is_withdrawn() -> None:
    board = changed(MANIFEST.replace("percepts.mode", "percepts.fly_mode"))
    assert board.taken() == [("remove", "mode", ("GUIDED", False)), ("replace", "fly_mode", ("GUIDED", False))]


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ('source = "MODE"', 'source = "FLY_MODE"', "mode"),
        ('args = ["name", "armed"]', 'args = ["name"]', "mode"),
        ("key = [0]", "", "battery"),
        ('buf = "add"', "", "event"),
    ],
)
def test_a_belief_that_another_manifest_would_not_have_is_withdrawn_first(old: str, new: str, name: str) -> None:
    board = changed(MANIFEST.replace(old, new))
    first, *rest = [(update, told) for update, told, _ in board.taken()]
    assert first == ("remove", name)
    assert rest in ([], [("replace", name)]), "what its source said last, unless it was an event"


def test_a_percept_that_is_converted_otherwise_keeps_its_belief_until_the_next_reading() -> None:
    board = changed(MANIFEST.replace("scale = 0.001}]\nrate = 10", "scale = 0.01}]\nrate = 1"))
    assert board.taken() == []
    board.clock.time += 0.5
    board.hear("POSITION", alt=5000)
    assert board.taken() == [], "the new rate holds at once"
    board.wait(0.6)
    assert board.taken() == [("replace", "altitude", (50.0,))]


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"pp": 1}, "no field `ppm`, only pp"),
        ({}, "no field `ppm`, only an empty payload"),
        ({"ppm": None}, "`ppm`: expected a number, text, truth value or list, got null"),
        ({"ppm": {"a": 1}}, "`ppm`: expected a number, text, truth value or list, got an object"),
        ({"ppm": 10**400}, "int too large to convert to float"),
        (5, "it is of the type int, expected a mapping of fields with `ppm`"),
        ([1], "it is a list, expected a mapping of fields with `ppm`"),
        (object(), "it is of the type object, expected a mapping of fields with `ppm`"),
    ],
)
def test_readings_of_which_no_belief_can_be_made_are_a_note_with_the_reason(fields: Any, why: str) -> None:
    gas = '[robot]\ndriver = "zenoh"\n[percepts.gas]\nsource = "gas/ppm"\nargs = ["ppm"]\n'
    board = Board(read_manifest(gas, "m.toml"))
    board.hear("gas/ppm", ppm=1)
    assert board.percepts.notes(Robot(manifest="m", prefix="boot").source) == []
    for _ in range(2):
        board.percepts.take(Reading("gas/ppm", fields))
    board.hear("gas/ppm", ppm=2)
    (note,) = board.percepts.notes(Robot(manifest="m", prefix="boot").source)
    assert (note.code, note.about, note.value) == ("percepts_unreadable", "boot/gas/ppm", 2)
    assert note.text == f"boot/gas/ppm: 2 of the last 3 readings make no belief `gas`, the first: {why}"
    board.percepts.adopt(read_manifest(gas.replace('["ppm"]', '["pp"]'), "m.toml"))
    assert board.percepts.notes(Robot(manifest="m").source) == [], "another manifest begins anew"


def test_an_unknown_value_of_a_keyed_percept_withdraws_none_and_a_missing_one_is_counted(board: Board) -> None:
    board.hear("BATTERY", id=0, volts=[12600])
    assert board.taken() == [("replace", "battery", (0, 12.6))]
    board.hear("BATTERY", id=0, volts=[65535])
    board.hear("BATTERY", id=0, volts=[])
    board.hear("BATTERY", id=0)
    assert board.taken() == []
    assert board.percepts.unreadable == 2


def test_a_source_that_says_it_is_over_removes_its_percepts(board: Board) -> None:
    board.hear("MODE", name="RTL", armed=True)
    board.percepts.take(Reading("MODE", None))
    assert board.taken()[-1] == ("remove", "mode", ("RTL", True))


def test_what_is_held_back_by_the_rate_is_told_before_a_status_refers_to_it(board: Board) -> None:
    board.hear("POSITION", alt=1000)
    board.clock.time += 0.01
    board.hear("POSITION", alt=2000)
    assert board.taken() == [("replace", "altitude", (1.0,))]
    board.percepts.flush()
    assert board.taken() == [("replace", "altitude", (2.0,))]
    assert board.percepts.sets["uav"].seq == 2


def test_a_flood_of_different_events_stays_bounded(board: Board) -> None:
    for number in range(MAX_BELIEFS + 50):
        board.hear("EVENT", text=f"event {number}")
    assert len(board.percepts.sets["uav"]) == MAX_BELIEFS
    assert board.percepts.dropped == 50


def test_a_flood_of_one_percept_takes_the_place_of_no_other(board: Board) -> None:
    board.hear("MODE", name="GUIDED", armed=False)
    for number in range(MAX_BELIEFS + 50):
        board.hear("EVENT", text=f"event {number}")
    assert board.percepts.sets["uav"].named("mode")
    assert board.percepts.sets["uav"].named("event")[0].parameters == ("event 51",)


def test_an_older_digest_is_asked_about_and_what_is_newer_stays(board: Board) -> None:
    copy = PerceptSet()
    board.hear("MODE", name="GUIDED", armed=False)
    old = board.percepts.sets["uav"].digest()
    board.hear("MODE", name="RTL", armed=True)
    for one in board.told:
        copy.apply(one)
    assert copy.needs_repair(old), "it may be that somebody else has spoken in the bridge's name"
    assert copy.restore(board.percepts.sets["uav"].snapshot(), copy.seq) == []
    assert not copy.needs_repair(board.percepts.sets["uav"].digest())


def test_a_snapshot_older_than_what_came_meanwhile_is_not_taken(board: Board) -> None:
    copy = PerceptSet()
    board.hear("MODE", name="GUIDED", armed=False)
    snapshot = board.percepts.sets["uav"].snapshot()
    board.hear("MODE", name="RTL", armed=True)
    for one in board.told:
        copy.apply(one)
    assert copy.restore(snapshot) is None
    assert [one.parameters for one in copy.present()] == [("RTL", True)]


def test_another_life_of_the_bridge_puts_the_old_set_in_doubt(board: Board) -> None:
    copy = PerceptSet()
    board.hear("MODE", name="GUIDED", armed=False)
    board.hear("BATTERY", id=0, volts=[12600])
    for one in board.told:
        copy.apply(one)
    header = Header(seq=1, boot="b2", source="r")
    fresh = Perception(header=header, name="mode", parameters=("STABILIZE", False))
    assert copy.apply(fresh)
    assert copy.needs_repair()
    changes = copy.restore([fresh])
    assert changes is not None
    assert [(one.update, one.name) for one in changes] == [("remove", "battery")]
    assert copy.boot == "b2"


def test_forgetting_tells_what_is_gone(board: Board) -> None:
    copy = PerceptSet()
    board.hear("MODE", name="GUIDED", armed=False)
    copy.apply(board.told[0])
    assert [(one.update, one.name, one.key) for one in copy.clear()] == [("remove", "mode", (0, 1))]
    assert len(copy) == 0


changes = st.builds(
    lambda name, value, update, keyed: (name, value, update, keyed),
    st.sampled_from(["a", "b"]),
    st.tuples(st.integers(0, 2), st.integers(0, 2)),
    st.sampled_from(["replace", "add", "remove"]),
    st.booleans(),
)


@given(st.lists(changes, max_size=30), st.sets(st.integers(0, 29)))
def test_whatever_is_lost_a_repair_makes_both_ends_and_the_mind_equal(sequence: list[Any], lost: set[int]) -> None:
    theirs, ours, mind = PerceptSet(), PerceptSet(), set[tuple[str, tuple[int, int]]]()
    for index, (name, value, update, keyed) in enumerate(sequence):
        header = Header(seq=index + 1, boot="b")
        one = Perception(header=header, name=name, parameters=value, update=update, key=(0,) if keyed else ())
        theirs.apply(one)
        if index not in lost:
            ours.apply(one)
            revise(mind, one)
    if ours.needs_repair(theirs.digest()):
        for one in ours.restore(theirs.snapshot()) or ():
            revise(mind, one)
    assert contents(ours) == contents(theirs) == mind
    assert ours.digest().rpartition(":")[2] == theirs.digest().rpartition(":")[2]


def revise(mind: set[tuple[str, Any]], one: Perception) -> None:
    """What a belief base does with a perception, written down once more and simply."""
    if one.update != "add":
        for name, value in list(mind):
            if name == one.name and all(value[at] == one.parameters[at] for at in one.key):
                mind.discard((name, value))
    if one.update != "remove":
        mind.add((one.name, one.parameters))


def contents(percepts: PerceptSet) -> set[tuple[str, Any]]:
    return {(one.name, one.parameters) for one in percepts.present()}


def test_a_percept_that_is_new_or_another_belief_is_made_of_what_its_source_said_last() -> None:
    text = '[robot]\ndriver = "zenoh"\n[percepts.home]\nsource = "HOME"\nargs = ["lat"]\n'
    board = Board(read_manifest(text, "m.toml"))
    board.hear("HOME", lat=1, alt=2)
    board.taken()
    board.percepts.adopt(
        read_manifest(
            text.replace('["lat"]', '["lat", "alt"]') + '[percepts.height]\nsource = "HOME"\nargs = ["alt"]\n', "m.toml"
        )
    )
    assert board.taken() == [("remove", "home", (1,)), ("replace", "home", (1, 2)), ("replace", "height", (2,))]
    board.percepts.take(Reading("HOME", None))
    board.taken()
    board.percepts.adopt(read_manifest(text, "m.toml"))
    assert board.taken() == [], "what its source has taken back does not come again"


def published(text: str, *readings: Reading) -> tuple[list[tuple[str, str, tuple[Any, ...]]], int]:
    """What an agent is told of readings (update, name, arguments), and how many were unreadable."""
    board = Board(read_manifest(text, "m.toml"))
    for reading in readings:
        board.percepts.take(reading)
    return board.taken(), board.percepts.unreadable


def perceived(args: str, message: Mapping[str, object]) -> tuple[Any, ...] | str:
    """The arguments of a percept of `message`; `unreadable` or `unknown` if there is none."""
    text = f'[robot]\ndriver = "zenoh"\n[percepts.p]\nsource = "m"\nargs = {args}\n'
    told, unreadable = published(text, Reading("m", message))
    return told[0][2] if told else "unreadable" if unreadable else "unknown"


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
        ('["x"]', {"x": float("nan")}, "unknown"),
        ('[{field = "x", each = ["0"]}]', {"x": [[math.nan], [2.0]]}, ([2.0],)),
        ('["x"]', {"x": [1.0, math.nan]}, ([1.0],)),
        ('["x"]', {"x": [1, float("inf")]}, "unreadable"),
        ('[{field = "x", scale = 2}]', {"x": -float("inf")}, "unreadable"),
        ('["x"]', {"x": None}, "unreadable"),
        ('[{field = "x", scale = 0.5}]', {"x": 10**400}, "unreadable"),
        ('["x", "y"]', {"x": 1}, "unreadable"),
        ('["x"]', {"x": Atom("down")}, (Atom("down"),)),
    ],
)
def test_what_a_robot_says_becomes_terms(args: str, message: Mapping[str, object], expected: object) -> None:
    assert perceived(args, message) == expected


@pytest.mark.parametrize("unknown", [math.nan, -1], ids=["NaN", "absent"])
def test_a_value_that_the_robot_no_longer_knows_is_believed_no_longer(unknown: float) -> None:
    text = '[robot]\ndriver = "zenoh"\n[percepts.depth]\nsource = "s"\nargs = [{field = "d", absent = -1}]\n'
    told, unreadable = published(text, *(Reading("s", {"d": depth}) for depth in (5, unknown)))
    assert told == [("replace", "depth", (5,)), ("remove", "depth", (5,))]
    assert not unreadable, "a plane without a sensor sends NaN all the time"


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
    said = [Reading("sonar", {"m": 3}), Reading("sonar", {"ms": 4}, driver="python")]
    assert published(text, *said) == ([("replace", "depth", (3,)), ("replace", "echo", (4,))], 0)


@pytest.mark.parametrize(
    "value",
    [10**30, "\ud800", [[0]] * 40_000, functools.reduce(lambda inner, _: [inner], range(50_000), [])],
    ids=["an integer of 100 bits", "half a character", "too large", "too deep"],
)
def test_what_cannot_be_told_is_counted_and_hides_no_other_percept(value: object) -> None:
    text = (
        '[robot]\ndriver = "zenoh"\n[percepts.odd]\nsource = "s"\nargs = ["odd"]\n[percepts.even]\nsource = "s"\n'
        'args = ["even"]\n'
    )
    assert published(text, Reading("s", {"odd": value, "even": 2})) == ([("replace", "even", (2,))], 1)
