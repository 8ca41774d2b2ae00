"""Failure: handlers, what they are given, and what is reported when there is none."""

from agentd.language.parse import parse_formula
from tests.agentd.minds import run


def test_a_binding_of_an_inner_goal_survives_the_failure_of_a_later_one() -> None:
    world = run('!s. +!s <- !get(X); !bad; .print(X). +!get(7). +!bad <- !get(Y); .fail. -!bad <- .print("handled").')
    assert world.prints == ["handled", "7"]


def test_a_failure_plan_at_the_bottom_that_always_fails_is_tried_a_hundred_times_with_one_warning() -> None:
    world = run("n(0). !s. !t. +!s <- .fail. -!s <- ?n(X); -+n(X+1); .fail. +!t.")
    first, last = world.logs
    assert "has failed itself; it is tried again" in first
    assert "its failure plan has failed 100 times" in last
    assert world.mind.query(parse_formula("n(101)"))


def test_a_test_without_applicable_plan_runs_its_handler_and_the_log_says_that_the_caller_ends() -> None:
    world = run("!s. +!s <- ?q(1); .print(never). +?q(X) : X > 5. -?q(X) <- .print(handled).")
    assert world.prints == ["handled"]
    assert "the intention that asked ends" in world.logs[-1]


def test_an_action_that_has_to_wait_makes_a_condition_false_and_says_so() -> None:
    world = run("!g. +!g <- if (.df_register(x)) { .print(yes) } else { .print(no) }; .wait(.df_register(y), 10).")
    assert world.prints == ["no"]
    assert any(".df_register may have to wait" in text for text in world.logs)
