"""Selection functions: messages, events, options and intentions chosen from Python, options by a program's rule."""

from collections.abc import Sequence
from typing import Any

import pytest

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.mind import Mind
from agentd.mind.data.inputs import GoalAdded, Mail
from agentd.mind.data.intention import Intention
from agentd.mind.execution.option_selection import Event, Option
from schemas.wire.mind_records import DecisionView
from tests.agentd.minds import World, mind_of, run, term

PLANS = """
    likes(tea). likes(coffee).
    !drink(now).
    @slow[priority(1)] +!drink(W) : likes(X) <- .print("slow ", X).
    @no[priority(9)] +!drink(W) : likes(beer) <- .print(never).
    @fast[priority(5)] +!drink(W) : likes(X) & X \\== tea <- .print("fast ", X).
    @last +!drink(W) <- .print("last").
"""


def by_priority(mind: Mind, options: Sequence[Option]) -> Option:
    def priority(option: Option) -> float:
        found = option.annotation("priority")
        return float(found.args[0]) if found is not None else 0.0

    return max(options, key=priority)


def test_a_function_chooses_among_the_applicable_plans_with_their_bindings() -> None:
    assert run(PLANS).prints == ["slow tea"]
    assert run(PLANS, select_option=by_priority).prints == ["fast coffee"]


def test_a_function_sees_options_in_file_order_with_plan_event_and_bindings() -> None:
    seen: list[Any] = []

    def note(mind: Mind, options: Sequence[Option]) -> Option:
        seen.extend((str(o.plan.label.sig.functor), o.event.kind, o.event.literal, o.bindings) for o in options)
        return options[-1]

    assert run(PLANS, select_option=note).prints == ["last"]
    event = term("drink(now)[source(self)]")
    now = term("now")
    assert seen == [
        ("slow", "+!", event, {"W": now, "X": term("tea")}),
        ("fast", "+!", event, {"W": now, "X": term("coffee")}),
        ("last", "+!", event, {"W": now}),
    ]


def test_a_plan_gives_an_option_for_each_solution_where_its_label_says_all_unifs() -> None:
    program = 'n(1). n(2). n(3). !g. @p[all_unifs] +!g : n(X) & X > 1 <- .print(X). +!g <- .print("other").'
    assert run(program, select_option=lambda mind, options: options[-2]).prints == ["3"]
    assert run(program.replace("[all_unifs]", ""), select_option=lambda mind, options: options[-2]).prints == ["2"]


def test_bindings_of_the_goal_made_by_the_chosen_context_reach_the_caller() -> None:
    program = "n(1). n(2). !s. +!s <- !get(X); .print(X). @p[all_unifs] +!get(Y) : n(Y)."
    assert run(program, select_option=lambda mind, options: options[1]).prints == ["2"]


def test_choosing_no_option_is_having_no_applicable_plan() -> None:
    world = run("!g. +!g <- .print(a). -!g[error(E)] <- .print(E).", select_option=_never_for_goals)
    assert world.prints == ["no_applicable"]


def _never_for_goals(mind: Mind, options: Sequence[Option]) -> Option | None:
    return None if options[0].event.kind == "+!" else options[0]


def test_a_wrong_answer_is_reported_and_the_default_is_used() -> None:
    world = run("!g. +!g <- .print(a).", select_option=lambda mind, options: 7)
    assert world.prints == ["a"]
    assert world.logs == [
        "select_option must return one of the 1 that it was given, or None, not 7; the default is used instead"
    ]


def test_an_error_in_a_selection_function_is_reported_and_the_default_is_used() -> None:
    def broken(mind: Mind, events: Sequence[Event]) -> Event:
        raise KeyError("oops")

    world = run("!a. !b. +!a <- .print(a). +!b <- .print(b).", select_event=broken)
    assert world.prints == ["a", "b"]
    assert world.logs == ["select_event raised KeyError: 'oops'; the default is used instead"]


def test_a_function_chooses_the_next_event() -> None:
    def last(mind: Mind, events: Sequence[Event]) -> Event:
        return max(events, key=lambda event: (event.intention, event.literal.sig.functor))

    assert run("!a. !b. !c. +!a <- .print(a). +!b <- .print(b). +!c <- .print(c).", select_event=last).prints == [
        "c",
        "b",
        "a",
    ]


def test_a_function_chooses_the_intention_that_goes_on() -> None:
    def oldest(mind: Mind, intentions: Sequence[Intention]) -> Intention:
        return min(intentions, key=lambda intention: intention.id)

    program = "!a. !b. +!a <- .print(a1); .print(a2); .print(a3). +!b <- .print(b1); .print(b2)."
    assert run(program).prints == ["a1", "a2", "b1", "a3", "b2"]
    assert run(program, select_intention=oldest).prints == ["a1", "a2", "a3", "b1", "b2"]


def test_a_function_chooses_the_next_message_and_may_leave_some_for_later() -> None:
    def urgent_first(mind: Mind, mails: Sequence[Mail]) -> Mail | None:
        return next((mail for mail in mails if mail.sender == "chief"), mails[0] if mind.cycle > 5 else None)

    mind = mind_of("+m(X)[source(S)] <- .print(S, X).", select_message=urgent_first)
    world = World(mind)
    world.feed(
        Mail("ann", "tell", term("m(1)")), Mail("ann", "tell", term("m(2)")), Mail("chief", "tell", term("m(3)"))
    )
    assert world.prints == ["chief3", "ann1", "ann2"]


def test_a_subclass_may_have_the_functions_as_methods() -> None:
    class Hasty(Mind):
        def select_option(self, options: Sequence[Option]) -> Option:
            return by_priority(self, options)

    world = World(Hasty("bob", compile_program(parse_program(PLANS, "test.asl")))).settle()
    assert world.prints == ["fast coffee"]


def test_a_function_that_never_chooses_is_reported_after_a_while() -> None:
    mind = mind_of("!g. +!g <- .print(a).", select_event=lambda mind, events: None)
    world = World(mind)
    for _ in range(3):
        world.effects += mind.run(0.0, 1000)
    assert world.logs == ["select_event has chosen none of 1 for 1000 cycles"]
    assert mind.ready


RULE = """
    select__option(E, I, P, U) :- P = { @Label +!T : C <- B } & Label =.. [F, Args, Annots] & .member(chosen, Annots).
    !drink(now).
    +!drink(W) <- .print("first").
    @p[chosen] +!drink(W) : likes(X) <- .print("chosen ", X).
    likes(tea).
"""


def test_a_rule_of_the_program_chooses_by_the_plan() -> None:
    assert run(RULE).prints == ["chosen tea"]


def test_a_rule_sees_event_intention_and_bindings_and_tries_all_solutions() -> None:
    program = """
        n(1). n(2). n(3).
        select__option({ +!sub(K) }, intention(Id, Stack), P, U) :- .length(Stack, 1) & .member(map("X", K), U).
        select__option({ +!go }, none, P, U).
        !go.
        +!go <- !sub(2).
        +!sub(K) : n(X) <- .print(K, X).
    """
    assert run(program).prints == ["22"]


def test_a_rule_that_holds_for_no_option_leaves_the_goal_without_applicable_plan() -> None:
    program = "select__option(E,I,P,U) :- false. !g. +!g <- .print(a). -!g[error(E)] <- .print(E)."
    world = run(program, decisions=10)
    assert world.prints == []
    first = world.mind.decision_views()[0]
    assert isinstance(first, DecisionView)
    assert [(r.why, r.message) for r in first.rejected] == [("choice", "it is applicable, but was not chosen")]


def test_a_rule_added_while_the_agent_runs_chooses_from_then_on() -> None:
    program = """
        +!g(X) <- .print("first ", X).
        @p[kk] +!g(X) <- .print("second ", X).
        +!learn <- +{ select__option(E,I,P,U) :- P = { @L +!T : C <- B } & L =.. [F,A,N] & .member(kk,N) }.
    """
    world = run(program)
    world.feed(GoalAdded(term("g(1)")), GoalAdded(term("learn")))
    world.feed(GoalAdded(term("g(2)")))
    assert world.prints == ["first 1", "second 2"]


@pytest.mark.parametrize("decisions", [0, 20])
def test_choosing_the_first_option_is_what_a_mind_does_anyway(decisions: int) -> None:
    first = {
        "select_option": lambda mind, options: options[0],
        "select_event": lambda mind, events: events[0],
        "select_intention": lambda mind, intentions: intentions[0],
        "select_message": lambda mind, mails: mails[0],
    }
    program = """
        n(3). n(4). !a(1). !b.
        +!a(X) : n(Y) & Y > X <- .print(X, Y); +seen(X); !a(X+1).
        +!a(X) <- .print(done).
        +seen(X) : X > 1 <- .print("seen ", X).
        +!b <- ?n(X); .print(X); !c; .print(after).
        +!c <- .fail. -!c[error(E)] <- .print(E).
    """
    assert run(program, decisions=decisions, **first).prints == run(program).prints
