"""The reasoning cycle: what happens in which cycle, waiting, actions, atomic plans."""

import pytest

from agentd.conversion.term_conversion import to_wire
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal
from agentd.mind.data.effects import PerformAction, Print
from agentd.mind.data.inputs import ActionDone, PerceptReplaced
from agentd.mind.execution.input_handling import heeds
from schemas.wire.mind_records import WaitView
from schemas.wire.terms import Variable
from tests.agentd.minds import World, mind_of, run


def test_one_cycle_takes_one_event_and_runs_one_formula() -> None:
    mind = mind_of('!a. !b. +!a <- .print("a1"); .print("a2"). +!b <- .print("b1").')
    printed = [[e.text for e in mind.step(0.0) if isinstance(e, Print)] for _ in range(4)]
    assert printed == [["a1"], ["a2"], ["b1"], []]


def test_an_agent_without_anything_to_do_is_not_ready_and_names_no_time() -> None:
    mind = run("!g. +!g.").mind
    assert not mind.ready
    assert mind.wake_at is None
    assert mind.idle


def test_a_wait_names_the_time_at_which_it_is_over() -> None:
    world = run('!g. +!g <- .wait(1500); .print("over").')
    assert world.mind.wake_at == 1.5
    assert not world.mind.ready
    assert world.prints == []
    assert world.at(1.4).prints == []
    assert world.at(1.5).prints == ["over"]


def test_an_action_goes_out_and_its_intention_goes_on_when_it_is_done() -> None:
    world = run('!g. +!g <- takeoff(2 + 3, "fast"); .print("up").')
    assert world.of(PerformAction) == [PerformAction(1, "takeoff", (5.0, "fast"))]
    assert world.prints == []
    assert world.feed(ActionDone(1, True)).prints == ["up"]


def test_a_failed_action_tells_its_reason_state_and_cause_to_the_handler() -> None:
    world = run('!g. +!g <- arm. -!g[error(E), reason(R), state(S), cause(C)] <- .print(E, "|", R, "|", S, "|", C).')
    world.feed(ActionDone(1, False, "PreArm: no GPS", "refused", "driver"))
    assert world.prints == ["action_failed|PreArm: no GPS|refused|driver"]


def test_a_handler_is_chosen_by_the_cause_of_a_failed_action() -> None:
    program = '!g. +!g <- arm. -!g[cause(operator)] <- .print("wait"). -!g[state(refused)] <- .print("try")'
    for cause, printed in (("operator", "wait"), ("pilot", "try")):
        world = run(f"{program}.")
        world.feed(ActionDone(1, False, "a text", "refused", cause))
        assert world.prints == [printed]


def test_an_action_with_a_free_variable_fails_the_plan_and_does_not_go_out() -> None:
    world = run("!g. +!g <- takeoff(X). -!g[error(E)] <- .print(E).")
    assert world.prints == ["action_failed"]
    assert world.of(PerformAction) == []


def test_a_free_variable_goes_out_by_its_name_to_a_robot_that_takes_names() -> None:
    world = run("!g. +!g <- arm_motors(True); .print(True).", names_variables=True)
    [action] = world.of(PerformAction)
    assert [to_wire(term) for term in action.parameters] == [Variable("True")]
    world.feed(ActionDone(1, True))
    assert len(world.prints) == 1, "the action has not given it a value"


def test_the_snapshot_tells_goals_positions_and_what_is_waited_for() -> None:
    world = run("!fly.\n+!fly <- !climb(5).\n+!climb(A) <-\n  takeoff(A).")
    (view,) = world.mind.intention_views()
    assert (view.state, view.waits_for) == ("waiting", WaitView(kind="action", name="takeoff"))
    assert (view.stack, view.at) == (("+!climb(5)", "+!fly"), "test.asl:4")


@pytest.mark.parametrize(
    ("program", "heeded"),
    [
        ("q. +q <- .print(p). r :- p(1).", False),
        ("+p(_) <- .print(p).", True),
        ("-p(_) <- .print(p).", True),
        ("!g. +!g <- .wait(p(9)).", True),
        ("!g. +!g <- .wait({+p(9)}).", True),
        ("!g. +!g <: p(9) <- .wait(100000).", True),
        ("!g. +!g <- .wait(100000). ", False),
        ("+jag_sleeping <- .print(asleep).", True),
    ],
)
def test_a_mind_heeds_a_percept_that_a_plan_or_a_wait_is_for(program: str, heeded: bool) -> None:
    def seen(number: float) -> PerceptReplaced:
        return PerceptReplaced(Literal(signature("p", 1), (number,)))

    mind = mind_of(program)
    assert heeds(mind, seen(1.0)), "the first one of its kind"
    World(mind).feed(seen(1.0))
    assert heeds(mind, seen(2.0)) is heeded
    assert heeds(mind, ActionDone(1, True))
