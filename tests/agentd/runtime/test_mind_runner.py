"""A mind on the event loop: its turns, with one timer that is moved as little as possible, and its lag."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import Any, cast

import pytest

from agentd.language.parse import parse_formula
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mind.data.inputs import PerceptReplaced, SignalRaised
from agentd.runtime.mind_runner import BELIEVED_WITHIN, LagEstimator, MindRunner
from commd.bus.bus import Bus
from schemas.wire.records import Perception
from tests.agentd.hosts import Board
from tests.agentd.minds import World, mind_of
from tests.support.buses import until, virtual_test


class Turns:
    """The turns of a mind that has nothing to do: each takes the next of `pauses`, the last one again and again."""

    def __init__(self, *pauses: float | None) -> None:
        self.loop = asyncio.get_running_loop()
        self.begun, self.at, self._pauses = self.loop.time(), list[float](), list(pauses)
        bus = cast(Bus, SimpleNamespace(afterwards=self.loop.call_soon))
        self.runner, self.stop = MindRunner(bus, mind_of(""), self.turn), asyncio.Event()
        self.running = asyncio.create_task(self.runner.run(self.stop))

    def turn(self) -> float | None:
        self.at.append(round(self.loop.time() - self.begun, 3))
        return self._pauses.pop(0) if len(self._pauses) > 1 else self._pauses[0]

    async def end(self) -> None:
        self.stop.set()
        await self.running


@virtual_test
async def test_a_turn_comes_at_its_time_or_when_the_mind_is_woken_once_for_several_calls() -> None:
    turns = Turns(0.05, None)
    await asyncio.sleep(1)
    assert turns.at == [0, 0.05]
    turns.runner.wake()
    turns.runner.wake()
    await asyncio.sleep(1)
    assert turns.at == [0, 0.05, 1]
    await turns.end()


@virtual_test
async def test_a_mind_that_is_not_done_has_turns_between_which_others_have_theirs() -> None:
    turns, passes = Turns(0, 0, 0, None), 0
    while len(turns.at) < 4:
        await asyncio.sleep(0)
        passes += 1
    assert passes >= 4
    await turns.end()


@virtual_test
async def test_a_timer_that_is_due_before_the_next_turn_is_left_running() -> None:
    turns = Turns(0.02, 0.1, None)
    await asyncio.sleep(0.01)
    timer = turns.runner._alarm._timer
    turns.runner.wake()
    await asyncio.sleep(0.005)
    assert turns.at == [0, 0.01]
    assert turns.runner._alarm._timer is timer
    await asyncio.sleep(1)
    assert turns.at == [0, 0.01, 0.11]
    await turns.end()


@virtual_test
async def test_a_timer_that_is_due_too_late_is_replaced() -> None:
    turns = Turns(1000, 0.02, None)
    await asyncio.sleep(0.01)
    turns.runner.wake()
    await asyncio.sleep(1)
    assert turns.at == [0, 0.01, 0.03]
    await turns.end()


@virtual_test
async def test_a_mind_that_is_woken_when_its_turn_is_due_has_one_turn() -> None:
    turns = Turns(0.05, 0, None)
    await asyncio.sleep(0.04999)
    turns.runner.wake()
    turns.runner._ring()  # the timer, in the same pass of the loop
    await asyncio.sleep(1)
    assert turns.at == [0, 0.05, 0.05]


@virtual_test
async def test_a_mind_that_is_to_stop_has_no_turn_and_leaves_no_timer() -> None:
    turns = Turns(0.02)
    await asyncio.sleep(0.01)
    turns.runner.wake()
    turns.stop.set()
    await turns.running
    assert turns.runner._alarm._timer is None
    turns.runner.wake()
    turns.runner.catch_up()
    await asyncio.sleep(1)
    assert turns.at == [0]


@virtual_test
async def test_a_mind_that_is_finished_has_one_more_turn() -> None:
    turns = Turns(None)
    await asyncio.sleep(0.01)
    turns.runner.finish()
    await turns.running
    assert turns.at == [0, 0.01]


@pytest.mark.parametrize(
    ("error", "raised"), [(ZeroDivisionError, ZeroDivisionError), (StopIteration, RuntimeError)], ids=["usual", "stop"]
)
@virtual_test
async def test_what_a_turn_raises_ends_the_run(error: type[Exception], raised: type[Exception]) -> None:
    def breaks() -> None:
        raise error

    turns = Turns(0.02)
    turns.runner._reason = breaks
    with pytest.raises(raised):
        await turns.running


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


async def test_what_waits_for_an_atomic_plan_that_waits_itself_is_not_lag(board: Board) -> None:
    agent = await board.host("a", WAITS)
    await until(lambda: "waits" in agent.prints, "the atomic plan waits")
    for number in range(3):
        agent.host.feed(SignalRaised.named("news", number))
    await until(lambda: len(agent.host._mind.events) == 3, "the events wait")
    agent.host.health()
    await asyncio.sleep(0.05)
    assert agent.host.health().lag == 0


async def test_intentions_that_end_by_a_failure_that_no_plan_handles_are_counted(board: Board) -> None:
    agent = await board.host("a", "!a. !b. !c. +!a <- .fail. -!a <- .print(handled). +!b <- .fail. +!c <- !nobody.")
    await until(lambda: agent.host.health().idle, "all plans have ended")
    assert agent.host.health().counters["intentions_failed"] == 2


@asynccontextmanager
async def turning(world: World) -> AsyncIterator[MindRunner]:
    """Run the mind of a world, which settles in each turn, until the block ends."""

    def turn() -> None:
        world.settle()

    bus = cast(Bus, SimpleNamespace(afterwards=asyncio.get_running_loop().call_soon))
    runner, stop = MindRunner(bus, world.mind, turn), asyncio.Event()
    running = asyncio.create_task(runner.run(stop))
    await asyncio.sleep(0)
    yield runner
    stop.set()
    await running


@virtual_test
async def test_of_percepts_that_nothing_waits_for_the_mind_is_given_the_newest_before_all_that_follows() -> None:
    def perceive(name: str, number: float, update: Any = "replace", *key: int) -> None:
        runner.perceive(Perception(name=name, parameters=(number,), update=update, key=key))

    def given(_: int, item: Any) -> None:
        inputs.append((item.literal.sig.functor, *item.literal.args))

    inputs = list[tuple[object, ...]]()
    world = World(mind_of('+mode(_) : height(H) <- .print("at ", H).', on_input=given))
    async with turning(world) as runner:
        perceive("height", 0.0)  # the first of its kind
        await asyncio.sleep(0)
        for number in (1.0, 2.0, 3.0):
            perceive("height", number)
        perceive("mode", 1.0)
        await asyncio.sleep(0)
        assert (world.prints, inputs) == (["at 3"], [("height", 0.0), ("height", 3.0), ("mode", 1.0)])
        perceive("height", 4.0)
        perceive("height", 4.0, "remove", 0)
        perceive("height", 5.0)
        await asyncio.sleep(BELIEVED_WITHIN + 0.1)
        assert inputs[3:] == [("height", 4.0), ("height", 4.0), ("height", 5.0)]
        assert world.mind.query(parse_formula("height(5)"))


@virtual_test
async def test_of_percepts_with_a_key_that_nothing_waits_for_the_mind_is_given_the_newest_of_each_value() -> None:
    def perceive(robot: str, number: float, *key: int) -> None:
        runner.perceive(Perception(name="feedback", parameters=(robot, number), update="replace", key=key))

    def given(_: int, item: Any) -> None:
        inputs.append(item.literal.args)

    inputs = list[tuple[object, ...]]()
    world = World(mind_of("!rest. +!rest.", on_input=given))
    async with turning(world) as runner:
        perceive("a", 0.0, 0)  # the first of its kind
        await asyncio.sleep(0)
        for robot, number in (("a", 1.0), ("b", 1.0), ("a", 2.0)):
            perceive(robot, number, 0)
        assert inputs == [("a", 0.0)]
        perceive("c", 3.0)  # in the place of all that there are
        perceive("c", 4.0, 0)
        await asyncio.sleep(BELIEVED_WITHIN + 0.1)
        assert inputs[1:] == [("a", 2.0), ("b", 1.0), ("c", 3.0), ("c", 4.0)]


def seen(number: int) -> PerceptReplaced:
    return PerceptReplaced(Literal(signature("height", 1), (float(number),)))


async def test_a_percept_that_nothing_waits_for_is_believed_soon_and_whenever_somebody_looks(board: Board) -> None:
    agent = await board.host("a", "!begin. +!begin <- .print(begun). +mode(M) <- .print(M).")
    mind = agent.host._mind
    await until(lambda: "begun" in agent.prints and not mind.ready, "the mind rests")
    for number in (1, 2):
        agent.host.feed(seen(number))
        await until(lambda: not mind.inputs, "it is believed without anything else")
    cycle = mind.cycle
    agent.host.feed(seen(3))
    await asyncio.sleep(0)
    assert (mind.cycle, len(mind.inputs)) == (cycle, 1), "no turn for it alone"
    assert [one.text for one in agent.host.viewer.view().beliefs if one.text.startswith("height")] == [
        "height(3)[source(percept)]"
    ]
    agent.host.feed(seen(4))
    assert agent.host.health().idle, "an input that nobody waits for is no work"
    assert len(mind.inputs) == 1, "health needs no belief"
    agent.host.feed(seen(5))
    agent.host.feed(PerceptReplaced(Literal(signature("mode", 1), (atom("rtl"),))))
    await until(lambda: "rtl" in agent.prints, "a plan runs")
    assert not mind.inputs
