"""The reasoning cycle: what happens in which cycle, waiting, actions, atomic plans."""

from __future__ import annotations

import pytest

from agentd.conversion.term_conversion import to_wire
from agentd.mind.data.effects import CancelAction, PerformAction, Print
from agentd.mind.data.inputs import ActionDone, BeliefAdded, GoalAdded
from schemas.wire.mind_records import WaitView
from schemas.wire.terms import Variable
from tests.agentd.minds import mind_of, run, term


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


def test_a_wait_for_a_formula_ends_with_the_belief_that_makes_it_true() -> None:
    world = run('!g. +!g <- .wait(level(X) & X > 3); .print("level ", X).')
    assert world.mind.wake_at is None
    assert world.feed(BeliefAdded(term("level(2)"))).prints == []
    assert world.feed(BeliefAdded(term("level(4)"))).prints == ["level 4"]


def test_a_wait_that_times_out_fails_with_wait_timeout() -> None:
    world = run("!g. +!g <- .wait(never, 2000). -!g[error(E)] <- .print(E).")
    assert world.at(1.9).prints == []
    assert world.at(2.0).prints == ["wait_timeout"]


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


def test_dropping_an_intention_cancels_its_action() -> None:
    world = run("!g. +!g <- goto(1,2). +!quit <- .drop_intention(g).")
    world.feed(GoalAdded(term("quit")))
    assert world.of(CancelAction) == [CancelAction(1)]
    assert world.feed(ActionDone(1, True)).prints == []


def test_other_intentions_run_while_one_waits() -> None:
    world = run('!a. !b. +!a <- .wait(1000); .print("a"). +!b <- .print("b1"); .print("b2").')
    assert world.prints == ["b1", "b2"]
    assert world.at(1.0).prints == ["b1", "b2", "a"]


def test_an_atomic_plan_is_not_interrupted_even_by_waiting() -> None:
    world = run('!a. !b. @x[atomic] +!a <- .print("a1"); .wait(1000); .print("a2"). +!b <- .print("b").')
    assert world.prints == ["a1"]
    assert world.at(1.0).prints == ["a1", "a2", "b"]


def test_a_suspended_intention_goes_on_after_resume() -> None:
    world = run('!a. +!a <- .wait(1000); .print("a"). +!hold <- .suspend(a). +!release <- .resume(a).')
    world.feed(GoalAdded(term("hold")))
    assert world.at(2.0).prints == []
    assert world.feed(GoalAdded(term("release"))).prints == ["a"]


def test_an_agent_that_floods_itself_is_bounded_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mind.state.MOST_FOCUSES", 500)
    world = run("!a. +!a <- for (.range(I,1,1000)) { !!b(I) }; .print(done). +!b(I) <- .wait(100000).")
    assert world.prints == ["done"]
    assert len(world.mind.all_intentions()) <= 501
    assert world.mind.drops.counts["events"] >= 499
    assert ["are dropped" in line for line in world.logs] == [True]


def test_the_snapshot_tells_goals_positions_and_what_is_waited_for() -> None:
    world = run("!fly.\n+!fly <- !climb(5).\n+!climb(A) <-\n  takeoff(A).")
    (view,) = world.mind.intention_views()
    assert (view.state, view.waits_for) == ("waiting", WaitView(kind="action", name="takeoff"))
    assert (view.stack, view.at) == (("+!climb(5)", "+!fly"), "test.asl:4")
