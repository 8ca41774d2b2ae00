"""Percepts put by hand on a real bus: beside the bridge's, until they are taken away by hand."""

import asyncio
import json
import logging
from collections import Counter
from typing import Any

import pytest

from commd.bus.bus import Bus
from commd.client.manual_percepts import LARGEST, MOST, HandPercepts, HandPerceptSubscription
from commd.client.percept_sync import PerceptSync
from schemas.wire import keys, percept_set
from schemas.wire.records import Perception
from schemas.wire.terms import Structure, Variable
from tests.commd.client.test_percept_sync import FakeBridge
from tests.support.buses import FLEET, Connect, subscribed, until


class Believing:
    """What a mind believes of what it is told, as it takes percepts in."""

    def __init__(self, bus: Bus, inject: bool = True) -> None:
        self.beliefs: dict[tuple[str, str], Perception] = {}
        self.changes: list[tuple[str, str, tuple[Any, ...]]] = []
        self.perceiving = PerceptSync(bus, "uav", "uav1", self.take, inject)
        self.repairing = asyncio.create_task(self.perceiving.run())

    def take(self, one: Perception) -> None:
        self.changes.append((one.update, one.name, one.parameters))
        if one.update != "add":
            for at, known in list(self.beliefs.items()):
                same = (known.name, len(known.parameters)) == (one.name, len(one.parameters))
                if same and all(known.parameters[place] == one.parameters[place] for place in one.key):
                    del self.beliefs[at]
        if one.update != "remove":
            self.beliefs[one.name, repr(one.parameters)] = one

    def present(self) -> set[tuple[str, tuple[Any, ...]]]:
        return {(one.name, one.parameters) for one in self.beliefs.values()}


async def put(bus: Bus, name: str, /, **fields: Any) -> None:
    """Put what a person types."""
    key = keys.percept_by_hand(FLEET, "uav", name)
    await subscribed(bus, key)
    bus._session.put(key, json.dumps(fields))


async def test_a_percept_by_hand_stays_beside_the_bridges_whatever_becomes_of_those(connect: Connect) -> None:
    bridge = FakeBridge(await connect("uav1", "bridged"))
    mind = Believing(await connect("uav"))
    person = await connect("operator")
    bridge.tell("altitude", 1)
    await put(person, "victim", name="victim", parameters=[1, 2, 3])
    await put(person, "altitude", parameters=[99])
    both = {("victim", (1, 2, 3)), ("altitude", (99,)), ("altitude", (1,))}
    await until(lambda: mind.present() == both, "both are believed")
    bridge.tell("altitude", 2)
    await until(lambda: ("altitude", (2,)) in mind.present(), "the bridge's next word arrives")
    assert mind.present() == {("victim", (1, 2, 3)), ("altitude", (99,)), ("altitude", (2,))}
    before = mind.perceiving.counters["repairs"]
    bridge.tell("armed", True, lose=True)
    bridge.report()
    await until(lambda: ("armed", (True,)) in mind.present(), "a repair finds what was lost")
    assert mind.perceiving.counters["repairs"] == before + 1
    assert {("victim", (1, 2, 3)), ("altitude", (99,))} <= mind.present()
    bridge.report()
    mind.perceiving.forget()
    assert mind.present() == {("victim", (1, 2, 3)), ("altitude", (99,))}, "the bridge's alone go with it"
    await put(person, "victim", update="remove")
    await put(person, "altitude", update="remove", parameters=[99])
    await until(lambda: not {("victim", (1, 2, 3)), ("altitude", (99,))} & mind.present(), "taken away by hand")
    assert mind.perceiving.counters["by_hand"] == 4
    assert mind.perceiving.counters["unreadable"] == 0


async def test_what_both_tell_ends_when_the_last_of_them_says_so(connect: Connect) -> None:
    bridge = FakeBridge(await connect("uav1", "bridged"))
    mind = Believing(await connect("uav"))
    person = await connect("operator")
    await put(person, "link", parameters=["up"])
    bridge.tell("link", "up")
    bridge.tell("link", "up", update="remove", key=(0,))
    bridge.tell("mode", "AUTO")
    await until(lambda: ("mode", ("AUTO",)) in mind.present(), "the bridge's words arrive")
    assert ("link", ("up",)) in mind.present()
    bridge.tell("link", "up")
    await put(person, "link", update="remove")
    await until(lambda: mind.perceiving.counters["by_hand"] == 2, "it is taken away")
    assert ("link", ("up",)) in mind.present()
    bridge.tell("link", "up", update="remove", key=(0,))
    await until(lambda: ("link", ("up",)) not in mind.present(), "nobody tells it any more")


async def test_without_inject_percepts_by_hand_are_ignored_counted_and_told_once(
    connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "percepts")
    bridge = FakeBridge(await connect("uav1", "bridged"))
    mind = Believing(await connect("uav"), inject=False)
    person = await connect("operator")
    await until(lambda: mind.perceiving.counters["repairs"] == 1, "what it asked at its start is answered")
    asked = bridge.asked
    for number in range(5):
        await put(person, "victim", parameters=[number])
    await until(lambda: mind.perceiving.counters["by_hand_ignored"] == 5, "all are counted")
    assert mind.present() == set()
    assert bridge.asked == asked, "they are no reason to doubt what the bridge has told"
    told = [one.getMessage() for one in caplog.records if one.name == "percepts"]
    assert len(told) == 1
    assert "a percept `victim` put by hand is ignored" in told[0]
    assert "`inject: true`" in told[0]


async def test_an_agent_without_a_robot_perceives_by_hand_too(connect: Connect) -> None:
    heard: list[tuple[str, tuple[Any, ...]]] = []
    by_hand = HandPerceptSubscription(await connect("uav")).add(
        "uav", True, lambda one: heard.append((one.update, one.parameters))
    )
    person = await connect("operator")
    await put(person, "victim", parameters=[1])
    await put(person, "victim", parameters=[2], update="add")
    await put(person, "victim", update="remove")
    await until(lambda: len(heard) == 4, "all changes come")
    assert heard == [("add", (1,)), ("add", (2,)), ("remove", (1,)), ("remove", (2,))]
    assert by_hand.counters == {"by_hand": 3}


@pytest.mark.parametrize(
    ("key", "perception", "why"),
    [
        ("argosy/f/uav/percept_by_hand/Victim", Perception(), "expected a name such as `victim`, got `Victim`"),
        ("argosy/f/uav/percept_by_hand/a", Perception(name="b"), "the key has a, the percept has b"),
        (
            "argosy/f/uav/percept_by_hand/not",
            Perception(parameters=(1,)),
            "expected a name such as `victim`, got `not`",
        ),
        ("argosy/f/uav/percept_by_hand/true", Perception(), "expected a name such as `victim`, got `true`"),
        (
            "argosy/f/uav/percept_by_hand/bridge",
            Perception(parameters=("up",)),
            "`bridge` is the agent's own percept of",
        ),
        (
            "argosy/f/uav/percept_by_hand/p",
            Perception(parameters=(Variable("X"),)),
            "p: expected values, got a variable",
        ),
        (
            "argosy/f/uav/percept_by_hand/p",
            Perception(parameters=([Structure("f", (Variable("X"),))],)),
            "p: expected values, got a variable",
        ),
        *(
            (
                "argosy/f/uav/percept_by_hand/flag",
                Perception(parameters=(1, 2), key=key),
                f"flag: `key` holds different positions from 0 to below 2, got {list(key)}",
            )
            for key in ((-1,), (2,), (0, 0))
        ),
        (
            "argosy/f/uav/percept_by_hand/p",
            Perception(parameters=("x" * LARGEST,)),
            "p: expected at most 4096 bytes, got 41",
        ),
    ],
)
def test_what_is_no_percept_is_refused_in_words(
    key: str, perception: Perception, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    by_hand = HandPercepts("uav", True, counters := Counter[str]())
    assert by_hand.take(key, perception) == []
    assert counters == {"by_hand_refused": 1}
    assert why in caplog.text


def test_there_is_room_for_so_many_and_a_removal_always_is_taken() -> None:
    by_hand = HandPercepts("uav", True, counters := Counter[str]())
    key = "argosy/f/uav/percept_by_hand/victim"
    for number in range(MOST + 5):
        by_hand.take(key, Perception(parameters=(number,), update="add"))
    assert len(by_hand.percepts) == MOST
    assert counters["by_hand_refused"] == 5
    assert len(by_hand.take(key, Perception(update="remove"))) == MOST
    assert len(by_hand.percepts) == 0


def test_at_the_bound_what_holds_can_be_replaced() -> None:
    by_hand = HandPercepts("uav", True, counters := Counter[str]())
    for number in range(MOST):
        by_hand.take(f"argosy/f/uav/percept_by_hand/h{number}", Perception(parameters=(number,)))
    [gone, come] = by_hand.take("argosy/f/uav/percept_by_hand/h5", Perception(parameters=(-1,)))
    assert (gone.update, gone.parameters, come.update, come.parameters) == ("remove", (5,), "add", (-1,))
    assert by_hand.take("argosy/f/uav/percept_by_hand/other", Perception(parameters=(1,))) == []
    assert by_hand.take("argosy/f/uav/percept_by_hand/h6", Perception(parameters=(1,), update="add")) == []
    assert (len(by_hand.percepts), counters["by_hand_refused"]) == (MOST, 2)


def test_one_percept_costs_as_much_beside_many_as_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    written = Counter[str]()
    encode = percept_set._ENCODE

    def counted(value: object) -> bytes:
        written["terms"] += 1
        return encode(value)

    monkeypatch.setattr(percept_set, "_ENCODE", counted)
    by_hand = HandPercepts("uav", True, Counter[str]())
    for number in range(MOST - 1):
        by_hand.take(f"argosy/f/uav/percept_by_hand/h{number}", Perception(parameters=(number,)))
    written.clear()
    for number in range(10):
        by_hand.take("argosy/f/uav/percept_by_hand/h5", Perception(parameters=(-number,)))
    by_hand.take("argosy/f/uav/percept_by_hand/h5", Perception(update="remove"))
    assert written["terms"] < 100


def test_what_holds_by_hand_is_told_until_it_is_taken_away() -> None:
    by_hand = HandPercepts("uav", True, Counter[str]())
    assert by_hand.notes() == ()
    by_hand.take("argosy/f/uav/percept_by_hand/battery", Perception(parameters=(0, 10.5, 20)))
    [note] = by_hand.notes()
    assert (note.identity, note.value) == (("percepts_by_hand", "battery/3"), 1)
    for number in range(10):
        by_hand.take(f"argosy/f/uav/percept_by_hand/c{number}", Perception())
    [note] = by_hand.notes()
    assert (note.code, note.value) == ("percepts_by_hand", 11)
    assert note.about.startswith("battery/3, c0/0, ")
    assert note.about.endswith(", ...")
    for name in ("battery", *(f"c{number}" for number in range(10))):
        by_hand.take(f"argosy/f/uav/percept_by_hand/{name}", Perception(update="remove"))
    assert by_hand.notes() == ()
