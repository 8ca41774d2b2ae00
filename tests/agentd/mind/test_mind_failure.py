"""Failure: handlers, what they are told, and what is told when there is none."""

from __future__ import annotations

from agentd.language.parse import parse_formula
from tests.agentd.minds import run


def test_a_failure_without_handler_names_plan_goal_formula_and_place() -> None:
    world = run("!start.\n+!start <- !sub(1).\n+!sub(X) <-\n   X > 3.")
    (line,) = world.logs
    assert line.startswith("test.asl:4:4: (1 > 3) does not hold")
    assert "in the plan for +!sub(1) (test.asl:3), called by +!start (test.asl:2)" in line
    assert "no plan -!sub or -!start handles error(constraint_failed)" in line


def test_a_failure_whose_handlers_do_not_fit_names_the_formula_its_place_and_the_handlers() -> None:
    world = run("!g.\n+!g <-\n   ?nothing(3).\n-!g[reason(R)] <- .print(R).")
    (line,) = world.logs
    assert line.startswith("test.asl:3: nothing(3) finds nothing")
    assert "-!g[reason(R)] (test.asl:4): its trigger and annotations do not match" in line
    assert "no plan for -!g is applicable: the intention ends" in line


def test_bindings_made_before_the_failure_are_gone_for_the_handler() -> None:
    world = run('!s. +!s <- !read(X); .print("X=", X). +!read(Y) <- !deep(Y); .fail. +!deep(5). -!read(Y) <- Y = 6.')
    assert world.prints == ["X=6"]


def test_a_binding_of_an_inner_goal_survives_the_failure_of_a_later_one() -> None:
    world = run('!s. +!s <- !get(X); !bad; .print(X). +!get(7). +!bad <- !get(Y); .fail. -!bad <- .print("handled").')
    assert world.prints == ["handled", "7"]


def test_a_failing_handler_climbs_to_the_goal_below() -> None:
    world = run('!s. +!s <- !a. +!a <- !b. +!b <- .fail. -!b <- .fail. -!a <- .print("a handles").')
    assert world.prints == ["a handles"]


def test_a_failure_plan_at_the_bottom_that_always_fails_is_tried_a_hundred_times_with_one_warning() -> None:
    world = run("n(0). !s. !t. +!s <- .fail. -!s <- ?n(X); -+n(X+1); .fail. +!t.")
    first, last = world.logs
    assert "has failed itself; it is tried again" in first
    assert "its failure plan has failed 100 times" in last
    assert world.mind.query(parse_formula("n(101)"))


def test_all_branches_of_an_or_failing_end_the_intention_and_the_log_says_so() -> None:
    world = run("!s. +!s <- .fail ||| .fail; .print(never). -!s <- .print(handled).")
    assert not world.prints
    assert "all branches of ||| have failed" in world.logs[-1]


def test_a_failing_plan_of_a_deletion_ends_the_intention_and_the_log_says_so() -> None:
    world = run("b. !s. +!s <- -b; .print(never). -b <- .fail. -!s <- .print(handled).")
    assert not world.prints
    assert "the plan of a deletion asks no handler" in world.logs[-1]


def test_a_test_without_applicable_plan_runs_its_handler_and_the_log_says_that_the_caller_ends() -> None:
    world = run("!s. +!s <- ?q(1); .print(never). +?q(X) : X > 5. -?q(X) <- .print(handled).")
    assert world.prints == ["handled"]
    assert "the intention that asked ends" in world.logs[-1]


def test_a_goal_without_applicable_plan_is_told_with_the_plans_that_were_tried() -> None:
    world = run("!g(1).\n+!g(X) : X > 5 <- .print(never).")
    (line,) = world.logs
    assert "no plan for +!g(1) is applicable" in line
    assert "+!g(X) (test.asl:2): X > 5 does not hold, with X = 1" in line


def test_div_by_zero_fails_the_plan_only() -> None:
    world = run('!a. !b. +!a <- X = 1 div 0. -!a[error(E)] <- .print(E). +!b <- .print("b").')
    assert sorted(world.prints) == ["b", "undefined_number"]


def test_an_error_inside_a_context_only_makes_it_false() -> None:
    world = run('!g. +!g : .nth(9,[a],X) <- .print(never). +!g : not .nth(9,[a],X) <- .print("second").')
    assert world.prints == ["second"]


def test_a_division_by_zero_in_a_context_is_told() -> None:
    world = run("!g. +!g : X = 1 div 0 <- .print(never). -!g[error(E)] <- .print(E).")
    assert world.prints == ["no_applicable"]
    assert any("div" in line for line in world.logs)


def test_an_action_that_has_to_wait_makes_a_condition_false_and_says_so() -> None:
    world = run("!g. +!g <- if (.df_register(x)) { .print(yes) } else { .print(no) }; .wait(.df_register(y), 10).")
    assert world.prints == ["no"]
    assert any(".df_register may have to wait" in text for text in world.logs)
