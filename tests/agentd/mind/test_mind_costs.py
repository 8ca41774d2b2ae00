"""What things cost a mind, counted in instructions of the interpreter, not in time: much of one thing makes another
thing no dearer.
"""

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

from agentd.mind import Mind
from agentd.mind.data.inputs import (
    ActionDone,
    BeliefAdded,
    GoalAdded,
    Mail,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
)
from agentd.mind.execution.goal_execution import add_goal
from tests.agentd.minds import World, mind_of, run, term


def instructions(call: Callable[[], object]) -> int:
    """How many instructions the interpreter executes for a call."""
    count = 0

    def each(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == "opcode"
        return each

    def enter(frame: FrameType, event: str, argument: Any) -> Any:
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return each

    before = sys.gettrace()
    sys.settrace(enter)
    try:
        call()
    finally:
        sys.settrace(before)
    return count


def cost(make: Callable[[int], World], size: int, act: Callable[[World], object]) -> int:
    """What it costs to act in a world of a size, the second time: what is made once is there then."""
    world = make(size)
    act(world)
    return instructions(lambda: act(world))


def assert_independent_of_size(make: Callable[[int], World], act: Callable[[World], object]) -> None:
    few, many = cost(make, 20, act), cost(make, 2000, act)
    assert many <= few * 1.1, f"{few} instructions with 20, {many} with 2000"


def deepest(mind: Mind, cycles: int) -> tuple[int, int]:
    """The longest stack and the longest trail that an intention has in so many cycles."""
    stack = trail = 0
    for _ in range(cycles):
        mind.run(0.0, 1)
        for intention in mind.all_intentions():
            stack, trail = max(stack, len(intention.stack)), max(trail, len(intention.trail))
    return stack, trail


@pytest.mark.parametrize(
    "body", ["!count(N + 1)", "X = N + 1; !count(X)", ".print(N); !count(N + 1)", "?step(S); +seen(N); !count(N + S)"]
)
def test_a_goal_that_calls_itself_last_needs_constant_memory(body: str) -> None:
    mind = mind_of(f"step(1). !start. +!start <- !count(0); .print(done). +!count(N) : N < 300 <- {body}. +!count(N).")
    stack, trail = deepest(mind, 2000)
    assert stack <= 3
    assert trail <= 3
    assert mind.idle


def test_a_goal_that_does_not_call_itself_last_does_need_memory() -> None:
    mind = mind_of("!count(0). +!count(N) : N < 300 <- !count(N + 1); +seen(N). +!count(N).")
    assert deepest(mind, 700)[0] == 300


def test_a_cycle_costs_the_same_however_many_intentions_run() -> None:
    def make(size: int) -> World:
        mind = mind_of("+!work(I) <- .my_name(_); !work(I).")
        for number in range(size):
            add_goal(mind, term(f"work({number})"))
        mind.run(0.0, 4 * size)
        return World(mind)

    assert_independent_of_size(make, lambda world: world.mind.run(0.0, 200))


def test_a_cycle_costs_the_same_however_many_intentions_wait() -> None:
    def make(size: int) -> World:
        world = run("+!rest <- .wait(1000000). +!act <- fly. +!count(N) : N < 50 <- !count(N + 1). +!count(N).")
        return world.feed(*[GoalAdded(term("rest")), GoalAdded(term("act"))] * size)

    assert_independent_of_size(make, lambda world: world.feed(GoalAdded(term("count(0)"))))


def test_the_result_of_an_action_finds_its_intention_however_many_wait_for_others() -> None:
    def make(size: int) -> World:
        return run("+!act <- fly.").feed(*[GoalAdded(term("act"))] * size)

    def act(world: World) -> None:
        running = len(world.mind.waiting)
        world.feed(ActionDone(world.effects.pop().id, True))
        assert len(world.mind.waiting) == running - 1

    assert_independent_of_size(make, act)


def test_an_atomic_plan_takes_its_turns_however_many_intentions_stand_by() -> None:
    def make(size: int) -> World:
        mind = mind_of("+!work <- .my_name(_); !work. @a[atomic] +!go <- !part; !part; !part. +!part <- .my_name(_).")
        for _ in range(size):
            add_goal(mind, term("work"))
        mind.run(0.0, 4 * size)
        return World(mind)

    def act(world: World) -> None:
        add_goal(world.mind, term("go"))
        for _ in range(40):
            world.mind.run(0.0, 1)
        assert world.mind.atomic is None

    assert_independent_of_size(make, act)


@pytest.mark.parametrize("kind", ["replaced by key", "added", "removed by key"])
def test_a_percept_changes_at_the_same_cost_however_many_others_hold(kind: str) -> None:
    def make(size: int) -> World:
        world = run("+at(N, X) : N < 0 <- .print(X). -at(N, X) : N < 0.")
        return world.feed(*[PerceptAdded(term(f"at({number}, 1)")) for number in range(size)])

    def act(world: World) -> None:
        fresh = len(world.effects) + world.mind.changes
        if kind == "added":
            world.feed(PerceptAdded(term(f"at(5, {fresh})")))
        elif kind == "replaced by key":
            world.feed(PerceptReplaced(term(f"at(5, {fresh})"), (0,)))
        else:
            world.feed(PerceptRemoved(term("at(7, 0)"), (0,)), PerceptAdded(term("at(7, 1)")))

    assert_independent_of_size(make, act)


@pytest.mark.parametrize("body", ["?fact(7, V)", "+extra(1); -extra(1)", "+fact(9000, 1); -fact(9000, 1)", "-+n(1)"])
def test_beliefs_are_asked_and_changed_at_the_same_cost_however_many_there_are(body: str) -> None:
    def make(size: int) -> World:
        world = run(f"+!go <- {body}.")
        return world.feed(*[BeliefAdded(term(f"fact({number}, {number})")) for number in range(size)])

    assert_independent_of_size(make, lambda world: world.feed(GoalAdded(term("go"))))


def test_a_message_is_taken_at_the_same_cost_however_many_intentions_wait() -> None:
    def make(size: int) -> World:
        world = run("+!rest <- .wait(1000000). +!hello(X) <- -+heard(X).")
        return world.feed(*[GoalAdded(term("rest"))] * size)

    assert_independent_of_size(make, lambda world: world.feed(Mail("ann", "achieve", term("hello(1)"), "mid1")))
