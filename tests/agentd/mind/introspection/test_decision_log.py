"""Decision records: what was chosen, what was rejected and why, with the values at the time of the decision."""

import gc
from pathlib import Path
from typing import Any

import pytest

from agentd.conversion.mind_view import LAST_DECISIONS, decisions_of
from agentd.language.terms.terms import List, Literal, Var
from agentd.mind.data.effects import PerformAction
from agentd.mind.data.inputs import ActionDone, BeliefAdded, GoalAdded, Mail, PerceptAdded
from agentd.mind.introspection.snapshots import held, held_all, short_text
from agentd.standalone.decision_printer import DecisionPrinter
from schemas.wire.mind_records import CauseView, DecisionView, FailureView
from tests.agentd.conftest import agentd
from tests.agentd.minds import World, mind_of, run, term


def decisions(source: str, **arguments: Any) -> list[DecisionView]:
    return of(run(source, decisions=100, **arguments))


def of(world: World) -> list[DecisionView]:
    return [view for view in world.mind.decision_views() if isinstance(view, DecisionView)]


def failures(world: World) -> list[FailureView]:
    return [view for view in world.mind.decision_views() if isinstance(view, FailureView)]


def reasons(view: DecisionView) -> list[str]:
    return [rejected.message for rejected in view.rejected]


def test_a_mind_that_was_not_asked_to_remembers_nothing() -> None:
    mind = run("!g. +!g.").mind
    assert mind.decision_views() == []
    assert mind.compiler.form == "select"
    assert mind.plans.select is None


def test_each_rejected_plan_has_the_literal_that_failed_and_its_values() -> None:
    (_, view) = decisions("""
        battery(12). position(1,2). position(3,4).
        !start.
        +!start <- !fly(5).
        @careful +!fly(H) : battery(B) & B > 20.
        +!fly(H) : position(X,Y) & Y > H & X < 2.
        +!fly(home).
        +!fly(H) : not position(1,_).
        +!fly(H) : battery(B) & (B > 90 | H > 90).
        @chosen[mild] +!fly(H) : position(X,H-1).
        +!fly(H).
    """)
    assert [(r.why, r.literal, r.filled, r.plan.bindings) for r in view.rejected] == [
        ("context", "B > 20", "12 > 20", {"B": "12"}),
        ("context", "Y > H", "2 > 5", {"Y": "2", "H": "5"}),
        ("trigger", "", "", {}),
        ("context", "not position(1,_)", "not position(1,_)", {}),
        ("context", "(B > 90) | (H > 90)", "(12 > 90) | (5 > 90)", {"B": "12", "H": "5"}),
    ]
    assert (view.chosen.label, view.chosen.position) == ("chosen[mild]", "test.asl:10")
    assert view.chosen.bindings == {"H": "5", "X": "3"}
    assert [plan.position for plan in view.untried] == ["test.asl:11"]


def test_the_literal_that_failed_is_the_furthest_one_with_the_values_that_first_got_there() -> None:
    (view,) = decisions("p(1,5). p(2,6). p(3,1). q(2). !g. +!g : p(X,Y) & q(X) & Y > 8.")
    assert reasons(view) == ["6 > 8 does not hold"]
    (view,) = decisions("p(1,5). p(2,6). p(3,1). !g. +!g : p(X,Y) & q(X) & Y > 8.")
    assert reasons(view) == ["q(1) does not hold"]


@pytest.mark.parametrize("number", range(20))
def test_in_a_long_context_the_right_literal_is_named(number: int) -> None:
    facts = " ".join(f"f{n}({n}). f{n}({n + 100})." for n in range(20) if n != number)
    context = " & ".join(f"f{n}(X{n})" for n in range(20))
    (view,) = decisions(f"{facts} !g. +!g : {context}.")
    assert [r.literal for r in view.rejected] == [f"f{number}(X{number})"]
    assert reasons(decisions(f"f{number}(7). {facts} !g. +!g : {context}.")[0]) == []


def test_a_record_shows_the_state_at_its_time_not_what_became_of_it() -> None:
    world = run(
        """
        level(1). !g(Out).
        +!g(X) : level(L) & L > 5.
        +!g(X) : level(L) <- -level(L); +level(9); X = done; .print(X).
        """,
        decisions=10,
    )
    (view, *_) = of(world)
    assert world.prints == ["done"]
    assert view.event == "+!g(Out)"
    assert reasons(view) == ["1 > 5 does not hold"]
    assert view.chosen.bindings == {"L": "1"}


def test_a_variable_bound_while_a_context_was_tried_shows_its_value_then() -> None:
    (_, view) = decisions("""
        !s.
        +!s <- !g(A, f(B)).
        +!g(X, Y) : X = 3 & Y = f(4) & X > 5.
        +!g(X, Y) : X = 7.
    """)
    assert reasons(view) == ["3 > 5 does not hold"]
    assert view.event == "+!g(A,f(B))"
    assert view.chosen.bindings == {"X": "7", "Y": "f(B)"}


def test_where_an_event_comes_from_is_reported() -> None:
    world = run(
        """
        !start. note(0).
        +!start <- !sub; !!apart; +seen(1).
        +!sub. +!apart. +seen(X). +ball(X). +hello(X). +!help. +given(X). +!asked. +note(X).
        """,
        decisions=100,
    )
    world.feed(PerceptAdded(term("ball(1)")), Mail("ann", "tell", term("hello(1)"), "m1"))
    world.feed(Mail("ann", "achieve", term("help"), "m2"), BeliefAdded(term("given(1)")), GoalAdded(term("asked")))
    assert {view.name: (view.cause, view.asked_at, view.source) for view in of(world)} == {
        "note/1": (CauseView(kind="program"), "", "self"),
        "start/0": (CauseView(kind="program"), "", "self"),
        "sub/0": (CauseView(kind="plan", intention=2), "test.asl:3", "self"),
        "apart/0": (CauseView(kind="intention", intention=2), "test.asl:3", "self"),
        "seen/1": (CauseView(kind="plan", intention=2), "test.asl:3", "self"),
        "ball/1": (CauseView(kind="percept"), "", "percept"),
        "hello/1": (CauseView(kind="message", sender="ann", performative="tell", message="m1"), "", "ann"),
        "help/0": (CauseView(kind="message", sender="ann", performative="achieve", message="m2"), "", "ann"),
        "given/1": (CauseView(kind="outside"), "", "self"),
        "asked/0": (CauseView(kind="outside"), "", "self"),
    }


def test_what_became_of_a_plan_is_reported() -> None:
    world = run(
        """
        !ends. !waits. !fails. !dropped.
        +!ends. +!waits <- .wait(never). +!dropped <- .wait(never).
        +!fails <- !inner. +!inner <- ?nothing(1).
        +!quit <- .drop_intention(dropped).
        """,
        decisions=100,
    )
    world.feed(GoalAdded(term("quit")))
    found = {view.name: view for view in of(world)}
    assert {name: view.outcome for name, view in found.items()} == {
        "ends/0": "ended",
        "waits/0": "running",
        "fails/0": "failed",
        "inner/0": "failed",
        "dropped/0": "dropped",
        "quit/0": "ended",
    }
    assert found["inner/0"].failure == found["fails/0"].failure
    assert failures(world) == [
        FailureView(
            cycle=found["inner/0"].cycle,
            time=0.0,
            intention=3,
            formula="?nothing(1)",
            position="test.asl:4",
            error="test_goal_failed",
            reason="Failed to test 'nothing(1)'",
            given_up=("+!inner", "+!fails"),
            handled_by="",
        )
    ]


def test_a_failed_action_has_the_reason_of_the_vehicle_and_the_handler_that_goes_on() -> None:
    world = run("!fly. +!fly <- takeoff(5). -!fly <- .print(no).", decisions=10)
    world.feed(ActionDone(world.of(PerformAction)[0].id, False, "PreArm: need 3D fix", "refused"))
    (view,) = failures(world)
    assert (view.formula, view.reason, view.handled_by) == ("takeoff(5)", "PreArm: need 3D fix", "-!fly/0")
    handler = of(world)[-1]
    assert handler.kind == "-!"
    assert (handler.cause, handler.goal) == (
        CauseView(kind="failure", intention=1),
        "+!fly",
    ) or handler.chosen is not None


def test_memory_is_bounded_by_the_number_asked_for() -> None:
    world = run("!count(0). +!count(N) : N < 5000 <- !count(N+1). +!count(N).", decisions=50)
    views = of(world)
    assert len(views) == 50
    assert views[-1].event == "+!count(5000)"
    assert [view.event for view in world.mind.decision_views(2)] == ["+!count(4999)", "+!count(5000)"]


def test_an_error_in_a_context_is_a_reason_and_the_other_plans_are_tried() -> None:
    world = run("!g. +!g : X = 1 div 0. +!g <- .print(second).", decisions=10)
    (view,) = of(world)
    assert [(r.why, r.message) for r in view.rejected] == [
        ("error", "its context cannot be computed: division by zero in 'div'")
    ]
    assert world.prints == ["second"]
    assert world.logs == run("!g. +!g : X = 1 div 0. +!g <- .print(second).").logs


def test_nested_plans_tried_in_vain_are_among_the_rejected() -> None:
    program = """
        !outer.
        +!outer <- !inner(1); .print(over). {
          +!inner(X) : X > 5 <- .print(nested).
          +!inner(X) : X > 3 <- .print(nested).
        }
        +!inner(X) <- .print(global).
    """
    world = run(program, decisions=10)
    view = of(world)[-1]
    assert reasons(view) == ["1 > 5 does not hold", "1 > 3 does not hold"]
    assert world.prints == run(program).prints == ["global", "over"]


def test_contexts_are_asked_once_only_and_in_the_same_order_with_and_without_records() -> None:
    program = """
        !g(1). !g(2). !g(3).
        +!g(X) : .print("a", X) & X > 1 & .random(R) & R > 0.5 <- .print(X, R).
        +!g(X) : .print("b", X) & .random(R) & R > 0.5 <- .print("other ", X, R).
        +!g(X) : .print("c", X) <- .print("last ", X).
    """
    for seed in range(20):
        assert run(program, decisions=5, seed=seed).prints == run(program, seed=seed).prints


def test_decisions_cross_the_bus_as_records_and_few_of_them() -> None:
    world = run("!count(0). +!count(N) : N < 500 <- !count(N+1). +!count(N) <- ?nothing.", decisions=400)
    records, failed = decisions_of(world.mind)
    assert len(records) + len(failed) == LAST_DECISIONS
    assert failed[0].formula == "?nothing"
    assert records[-1].event == "+!count(500)"
    assert records[-1].rejected[0].message == "500 < 500 does not hold"
    assert records[-1].failure == failed[0]


def test_held_terms_do_not_change_and_ground_ones_are_not_copied() -> None:
    ground = term('f(1,[a,"b",g(2)])')
    assert held(ground) is ground
    assert held_all((1.0, "a", ground))[2] is ground
    open_term = term("f(X,[X|T])")
    assert isinstance(open_term, Literal)
    kept = held(open_term)
    variable = open_term.args[0]
    assert isinstance(variable, Var)
    variable.ref = 5.0
    assert short_text(kept) == "f(X,[X|T])"
    assert short_text(open_term) == "f(5,[5|T])"


def test_long_terms_are_shown_by_their_beginning() -> None:
    long = term("[" + ",".join(str(n) for n in range(1000)) + "]")
    assert len(short_text(long)) <= 200
    assert short_text(long).startswith("[0,1,2,3,")
    (view, *_) = decisions("big(N) :- N = 1. !g([" + ",".join("x" * 30 + str(n) for n in range(500)) + "]). +!g(L).")
    assert len(view.event) <= 210


def test_a_narrator_tells_the_same_kind_of_decision_three_times_and_counts_the_others() -> None:
    told: list[str] = []
    narrator = DecisionPrinter(write=told.append)
    mind = mind_of("!c(9). +!c(N) : N > 0 <- !c(N-1). +!c(0).", on_decision=narrator.listener("bob"))
    World(mind).settle()
    narrator.finish()
    assert told == [
        "[bob] why: +!c(9), from the program",
        "[bob] why:   chosen: +!c(N) (test.asl:1), with N = 9",
        "[bob] why:   not needed: +!c(0) (test.asl:1)",
        "[bob] why: +!c(8), raised by the plan for +!c(9) at test.asl:1",
        "[bob] why:   chosen: +!c(N) (test.asl:1), with N = 8",
        "[bob] why:   not needed: +!c(0) (test.asl:1)",
        "[bob] why: +!c(7), raised by the plan for +!c(8) at test.asl:1",
        "[bob] why:   chosen: +!c(N) (test.asl:1), with N = 7",
        "[bob] why:   not needed: +!c(0) (test.asl:1)",
        "[bob] why: +!c(0), raised by the plan for +!c(1) at test.asl:1",
        "[bob] why:   not +!c(N) (test.asl:1): N > 0 does not hold, with N = 0",
        "[bob] why:   chosen: +!c(0) (test.asl:1)",
        "[bob] why: 6 more times +!c/1: the plan at test.asl:1, for the same reasons",
    ]


def test_a_narrator_asked_about_a_name_tells_all_about_it_and_nothing_else() -> None:
    told: list[str] = []
    narrator = DecisionPrinter(["!c(N)", "patrl/0"], told.append)
    mind = mind_of(
        "!c(5). +!c(N) : N > 0 <- !patrol; !c(N-1). +!c(0) <- .fail. +!patrol.",
        on_decision=narrator.listener("bob"),
    )
    World(mind).settle()
    narrator.finish()
    events = [line for line in told if line.startswith("[bob] why: +")]
    assert len(events) == 6
    assert all("+!c(" in line for line in events)
    assert "[bob] why: test.asl:1: .fail fails, ia_failed" in told
    assert told[-1] == "why: no decision was about `patrl`, did you mean `patrol`?"


def test_agentd_run_why_leaves_stdout_to_the_program(tmp_path: Path) -> None:
    path = tmp_path / "fly.asl"
    path.write_text('battery(12).\n!fly.\n+!fly : battery(B) & B > 20 <- .print(up).\n+!fly <- .print("stay").\n')
    done = agentd("run", f"bob={path}", "--exit-when-idle", "--why")
    assert done.stdout == "[bob] stay\n"
    assert done.stderr.splitlines() == [
        "[bob] why: +!fly, from the program",
        f"[bob] why:   not +!fly ({path}:3): B > 20 does not hold, with B = 12",
        f"[bob] why:   chosen: +!fly ({path}:4)",
    ]
    plain = agentd("run", f"bob={path}", "--exit-when-idle")
    assert (plain.stdout, plain.stderr) == ("[bob] stay\n", "")


def test_records_hold_no_large_terms_of_plans_that_have_ended() -> None:
    program = """!go(0). +!go(40) <- .print(done).
    +!go(N) <- .findall(X, .range(X,1,6000), L); !use([N|L]); +seen(N); !go(N+1).
    +!use(L) : .length(L,6001) <- true."""
    world = World(mind_of(program, decisions=200)).settle()
    assert world.prints == ["done"]
    gc.collect()
    large = [o for o in gc.get_objects() if type(o) is List and len(o.items) > 5000]
    assert len(large) <= 4, "the last ones are let go when the next large list is made"
    assert len([v for v in world.mind.decision_views() if "use" in str(v)]) >= 40
