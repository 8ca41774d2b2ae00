"""A mind on the event loop: its sleep with one timer that is moved as little as possible, and its lag."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from agentd.conversion.term_conversion import perceived
from agentd.language.parse import parse_formula
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mind.data.inputs import Input, PerceptRemoved, PerceptReplaced, SignalRaised
from agentd.runtime.mind_runner import BELIEVED_WITHIN, LagEstimator, MindRunner, WakeupTimer
from commd.bus.bus import Bus
from schemas.wire.records import Perception
from tests.agentd.hosts import host_on
from tests.agentd.minds import World, mind_of
from tests.support.buses import Connect, bus_test, until, virtual_test


async def wakes_when_set(timer: WakeupTimer) -> None:
    sleeping = asyncio.create_task(timer.wait(None))
    await asyncio.sleep(0)
    assert timer.asleep
    timer.set()
    assert not timer.asleep
    await sleeping


async def does_not_sleep_if_it_was_set_before(timer: WakeupTimer) -> None:
    timer.set()
    await timer.wait(None)
    timer.clear()
    assert not timer.asleep


async def wakes_at_its_time_and_not_before(timer: WakeupTimer) -> None:
    loop = asyncio.get_running_loop()
    begun = loop.time()
    await timer.wait(0.05)
    assert loop.time() - begun == pytest.approx(0.05)


async def keeps_a_timer_that_is_due_earlier_and_does_not_wake_then(timer: WakeupTimer) -> None:
    loop = asyncio.get_running_loop()
    begun = loop.time()
    sleeping = asyncio.create_task(timer.wait(0.02))
    await asyncio.sleep(0)
    running = timer._alarm._timer
    timer.within(0.1)
    assert timer._alarm._timer is running
    await sleeping
    assert loop.time() - begun == pytest.approx(0.1)


async def replaces_a_timer_that_is_due_too_late(timer: WakeupTimer) -> None:
    sleeping = asyncio.create_task(timer.wait(1000))
    await asyncio.sleep(0)
    timer.within(0.02)
    await sleeping


async def without_a_time_sleeps_until_set(timer: WakeupTimer) -> None:
    sleeping = asyncio.create_task(timer.wait(0.02))
    await asyncio.sleep(0)
    timer.within(None)
    await asyncio.sleep(0.1)
    assert timer.asleep
    timer.set()
    await sleeping


async def leaves_no_timer_when_closed(timer: WakeupTimer) -> None:
    sleeping = asyncio.create_task(timer.wait(0.02))
    await asyncio.sleep(0)
    timer.close()
    await asyncio.sleep(0.1)
    assert timer.asleep
    sleeping.cancel()


@pytest.mark.parametrize(
    "behaviour",
    [
        wakes_when_set,
        does_not_sleep_if_it_was_set_before,
        wakes_at_its_time_and_not_before,
        keeps_a_timer_that_is_due_earlier_and_does_not_wake_then,
        replaces_a_timer_that_is_due_too_late,
        without_a_time_sleeps_until_set,
        leaves_no_timer_when_closed,
    ],
    ids=lambda behaviour: behaviour.__name__,
)
@virtual_test
async def test_a_wakeup_timer(behaviour: Callable[[WakeupTimer], Awaitable[None]]) -> None:
    await behaviour(WakeupTimer())


def test_a_mind_that_takes_what_waits_between_two_looks_is_not_behind() -> None:
    backlog = LagEstimator()
    assert backlog.lag(100, 0, 1.0) == 0
    assert backlog.lag(150, 20, 2.0) == 0
    assert backlog.lag(170, 30, 3.0) == 0
    assert backlog.lag(5000, 0, 4.0) == 0


def test_a_mind_is_behind_for_as_long_as_what_waited_has_not_been_taken() -> None:
    backlog = LagEstimator()
    backlog.lag(0, 1000, 10.0)
    assert [backlog.lag(200 * second, 1000, 10.0 + second) for second in (1, 2, 3, 4)] == [1, 2, 3, 4]
    assert backlog.lag(1000, 1000, 15.0) == 0, "what waits now has not waited since then"
    assert backlog.lag(1100, 900, 16.0) == 1


def test_what_is_dropped_is_not_waited_for() -> None:
    backlog = LagEstimator()
    backlog.lag(0, 1000, 0.0)
    assert backlog.lag(1, 0, 1.0) == 0
    assert backlog.lag(2, 5, 9.0) == 0


WAITS = """
!start.
+!start <- !guarded.
@a[atomic] +!guarded <- .print(waits); .wait(60000).
+news(_) <- .print(news).
"""


@bus_test
async def test_what_waits_for_an_atomic_plan_that_waits_itself_is_not_lag(connect: Connect, tmp_path: Path) -> None:
    agent = await host_on(await connect("a"), "a", WAITS, tmp_path)
    await until(lambda: "waits" in agent.prints, "the atomic plan waits")
    for number in range(3):
        agent.host.feed(SignalRaised.named("news", number))
    await until(lambda: len(agent.host._mind.events) == 3, "the events wait")
    agent.host.health()
    await asyncio.sleep(0.05)
    assert agent.host.health().lag == 0
    await agent.end()


@virtual_test
async def test_of_percepts_that_nothing_waits_for_the_mind_is_given_the_newest_before_all_that_follows() -> None:
    def percept(name: str, number: float, update: Any = "replace", *key: int) -> Perception:
        return Perception(name=name, parameters=(number,), update=update, key=key)

    def turn() -> None:
        world.settle()

    def read(one: Perception) -> Input:
        read_values.append((one.name, one.parameters[0]))
        literal = perceived(one)
        return PerceptReplaced(literal) if one.update == "replace" else PerceptRemoved(literal)

    world, read_values = World(mind_of('+mode(_) : height(H) <- .print("at ", H).')), list[tuple[str, object]]()
    bus = cast(Bus, SimpleNamespace(afterwards=asyncio.get_running_loop().call_soon))
    runner, stop = MindRunner(bus, world.mind, turn, read), asyncio.Event()
    running = asyncio.create_task(runner.run(stop))
    await asyncio.sleep(0)
    runner.perceive(percept("height", 0.0))  # the first of its kind
    await asyncio.sleep(0)
    for number in (1.0, 2.0, 3.0):
        runner.perceive(percept("height", number))
    runner.perceive(percept("mode", 1.0))
    await asyncio.sleep(0)
    assert (world.prints, read_values) == (["at 3"], [("height", 0.0), ("mode", 1.0), ("height", 3.0)])
    runner.perceive(percept("height", 4.0))
    runner.perceive(percept("height", 4.0, "remove", 0))
    runner.perceive(percept("height", 5.0))
    await asyncio.sleep(BELIEVED_WITHIN + 0.1)
    assert [one for name, one in read_values[3:]] == [4.0, 4.0, 5.0]
    assert world.mind.query(parse_formula("height(5)"))
    stop.set()
    await running


def seen(number: int) -> PerceptReplaced:
    return PerceptReplaced(Literal(signature("height", 1), (float(number),)))


@bus_test
async def test_a_percept_that_nothing_waits_for_is_believed_soon_and_whenever_somebody_looks(
    connect: Connect, tmp_path: Path
) -> None:
    agent = await host_on(await connect("a"), "a", "!begin. +!begin <- .print(begun). +mode(M) <- .print(M).", tmp_path)
    mind = agent.host._mind
    await until(lambda: "begun" in agent.prints and not mind.ready, "the mind rests")
    for number in (1, 2):
        agent.host.feed(seen(number))
        await until(lambda: not mind.inputs, "it is believed without anything else")
    cycle = mind.cycle
    agent.host.feed(seen(3))
    await asyncio.sleep(0)
    assert (mind.cycle, len(mind.inputs)) == (cycle, 1), "no turn for it alone"
    assert [one.text for one in agent.host.view().believed if one.text.startswith("height")] == [
        "height(3)[source(percept)]"
    ]
    agent.host.feed(seen(4))
    assert agent.host.health().idle, "an input that nobody waits for is no work"
    agent.host.feed(seen(5))
    agent.host.feed(PerceptReplaced(Literal(signature("mode", 1), (atom("rtl"),))))
    await until(lambda: "rtl" in agent.prints, "a plan runs")
    assert not mind.inputs
    await agent.end()
