"""What a restarted mind is given again: the roots of what it had begun, of others and of its own, nothing else."""

from typing import Any

import pytest

from agentd.language.terms.terms import Literal
from agentd.mind.data.inputs import ActionDone, BeliefAdded, GoalAdded, Mail, PerceptAdded, SignalRaised
from tests.agentd.kept_minds import Life, begun
from tests.agentd.minds import term

WAITS = "+!g(X) <- .print(begun, X); .wait(10000); .print(ended, X)."


def others(life: Life) -> list[str]:
    return [str(one) for one in life.next().keeper.pending_others]


def own(life: Life) -> list[str]:
    return [str(one) for one in life.next().keeper.pending_own]


def told(performative: str, content: str, sender: str = "ann", msg_id: str = "mid1") -> Mail:
    return Mail(sender, performative, term(content), msg_id)


def test_a_goal_of_another_agent_that_has_not_ended_begins_again_with_its_source() -> None:
    life = begun(WAITS).feed(told("achieve", "g(1)"))
    life.save()
    assert others(life) == ["+!g(1)[source(ann)]"]
    assert own(life) == []
    again = life.next(own=False).settle()
    assert again.prints == ["begun1"]
    assert again.at(20.0).prints == ["begun1", "ended1"]


def test_a_goal_suspended_before_it_had_a_plan_is_given_again_be_it_a_sub_goal_or_not() -> None:
    life = begun(
        "@a[atomic] +!all <- !!g(1); !!g(2); .suspend(g(_)). +!top <- !sub. +!sub. +!hold <- .suspend(top). " + WAITS
    )
    life.feed(GoalAdded(term("all")), GoalAdded(term("top")), GoalAdded(term("hold"))).settle()
    assert life.prints == ["begun2"]
    life.save()
    assert own(life) == ["+!top[source(self)]", "+!g(2)[source(self)]", "+!g(1)[source(self)]"]


PENDING: dict[str, tuple[str, list[Any], list[str], list[str]]] = {
    "an untold belief whose plan has not ended": (
        "-b(X)[source(S)] <- .wait(10000).",
        [told("tell", "b(1)"), told("untell", "b(1)")],
        ["-b(1)[source(ann)]"],
        [],
    ),
    "a signal of another agent": ("+e(X) <- .wait(10000).", [told("signal", "e(1)")], ["+e(1)[source(ann)]"], []),
    "a message to itself is its own matter": (
        WAITS,
        [told("achieve", "g(1)", sender="bob")],
        [],
        ["+!g(1)[source(self)]"],
    ),
    "own changes with a new focus, and signals": (
        "+b(X) <- .wait(10000). -b(X) <- .wait(10000). +s <- .wait(10000). +!go <- ++b(1); --b(1); .signal({+s}).",
        [GoalAdded(term("go")), BeliefAdded(term("b(2)")), SignalRaised.named("s")],
        [],
        ["+b(1)[source(self)]", "+b(2)[source(self)]", *["+s[source(self)]"] * 2, "-b(1)[source(self)]"],
    ),
    "no percepts: they come anew": (
        "+at(X) <- .wait(10000). -at(X) <- .wait(10000).",
        [PerceptAdded(term("at(1)"))],
        [],
        [],
    ),
    "no states of goals": ("^!g(X)[state(S)] <- .wait(10000). +!g(X).", [told("achieve", "g(1)")], [], []),
    "a goal whose variables are free again": (
        "+!find(X, f(Y, X)) <- X = 1; Y = 2; .wait(10000).",
        [told("achieve", "find(A, f(B, A))")],
        ["+!find(A,f(B,A))[source(ann)]"],
        [],
    ),
    "a message whose own plan has not ended": (
        "+!kqml_received(S, greet, C, M) <- .wait(10000).",
        [Mail("ann", "greet", term("hello(X)"), "mid3")],
        ['+!kqml_received(ann,greet,hello(X),"mid3")'],
        [],
    ),
    "messages that wait for an atomic plan": (
        "@a[atomic] +!block <- fly. +!go.",
        [GoalAdded(term("block")), told("achieve", "go"), told("askOne", "go", msg_id="m1")],
        ["+!go[source(ann)]", '+!kqml_received(ann,askOne,go,"m1")'],
        ["+!block[source(self)]"],
    ),
    **{
        f"no initial goal, nor what runs in its intention: {source}": (source, [], [], [])
        for source in (
            "p(1). +p(X) <- .wait(9000). !start. +!start <- !inner; .print(never). +!inner <- .wait(10000).",
            "!loop(0). +!loop(N) <- .wait(10); !loop(N + 1).",
            "!start. -!start <- .wait(10000).",
            "!start. +!start : false. -!start <- .wait(10000).",
            "!start. +!start <- .fail. -!start <- .wait(10000).",
        )
    },
}


@pytest.mark.parametrize("what", PENDING)
def test_what_is_given_again(what: str) -> None:
    source, given, of_others, of_its_own = PENDING[what]
    life = begun(source).feed(*given).at(5.0 if "loop" in source else 0.0)
    life.save()
    assert others(life) == of_others
    assert sorted(own(life)) == of_its_own


def test_a_goal_that_has_ended_is_not_given_again() -> None:
    life = begun(WAITS).feed(told("achieve", "g(1)"))
    assert life.save().pending
    life.at(20.0)
    assert life.save().pending_gone
    assert others(life) == []


def test_what_ran_through_between_two_saves_never_shows() -> None:
    life = begun("+!g <- +done.").feed(told("achieve", "g"))
    changes = life.save()
    assert not changes.pending
    assert not changes.pending_gone


def test_a_goal_given_again_and_again_stays_what_it_was_over_many_lives() -> None:
    life = begun(WAITS).feed(told("achieve", "g(1)"), GoalAdded(term("g(2)")))
    life.save()
    for _ in range(3):
        life = life.next()
        life.settle()
        life.save()
        assert others(life) == ["+!g(1)[source(ann)]"]
        assert own(life) == ["+!g(2)[source(self)]"]


def test_a_life_that_dies_before_its_first_save_changes_nothing() -> None:
    life = begun(WAITS).feed(told("achieve", "g(1)"))
    life.save()
    life.next().settle()
    assert others(life) == ["+!g(1)[source(ann)]"]


def test_what_was_pending_stays_kept_until_it_is_given_again_whatever_comes_before() -> None:
    life = begun(WAITS).feed(told("achieve", "g(1)"), told("achieve", "g(2)"))
    life.mind.post(life.mind.plans.relevant("+", "!", term("g(3)").sig), (3.0,), told_by_ann())
    life.save()
    before = others(life)
    again = Life(WAITS, life.stored).feed(told("achieve", "g(4)", sender="cid"))
    again.save()
    assert others(again) == [*before[:2], "+!g(4)[source(cid)]", before[2]]
    again.keeper.resume(own=False)
    again.settle().save()
    assert others(again) == ["+!g(4)[source(cid)]", *before]


def test_an_initial_goal_that_was_not_even_begun_is_not_given_again() -> None:
    life = Life("!start. +!start <- .print(started).")
    life.save()
    again = life.next().settle()
    assert own(life) == []
    assert again.prints == []


def test_a_new_intention_that_an_initial_goal_has_begun_is_its_own_matter() -> None:
    life = begun(WAITS + " !start. +!start <- !!g(1); .wait(10000).")
    assert own(life) == ["+!g(1)[source(self)]"]
    assert life.next(own=False).settle().prints == []
    assert life.next(own=True).settle().prints == ["begun1"]


def test_a_told_belief_whose_plan_has_not_ended_raises_its_event_again_but_is_believed_once() -> None:
    life = begun("+b(X)[source(S)] <- .print(S, X); .wait(10000).").feed(told("tell", "b(1)[urgent]"))
    life.save()
    assert others(life) == ["+b(1)[source(ann),urgent]"]
    again = life.next()
    changes = again.settle().save()
    assert again.prints == ["ann1"]
    assert not changes.beliefs


@pytest.mark.parametrize(
    ("waits", "source"),
    [
        ("an action", "+!g(1) <- fly; .print(ended)."),
        ("a sub-goal", "+!g(1) <- !inner. +!inner <- .wait(10000)."),
        ("an event", "+!g(1) <- .wait({+go})."),
        ("a formula", "+!g(1) <- .wait(go)."),
        ("a question", "+!g(1) <- .send(cid, askOne, x(X), A); .print(A)."),
        ("a fork", "+!g(1) <- { .wait(10000) |&| .wait(20000) }."),
        ("a suspension", "+!g(1) <- .suspend; .print(resumed)."),
        ("an atomic plan", "@a[atomic] +!g(1) <- fly."),
        ("its failure plan", "+!g(1) <- .fail. -!g(1)[source(S)] <- .wait(10000)."),
        ("a failure plan for want of another", "-!g(1) <- .wait(10000)."),
        ("a failure plan below", "+!g(1) <- !inner. +!inner <- .fail. -!g(1) <- .wait(10000)."),
        ("a condition of its goal", "+!g(1) <: done <- .wait(10000)."),
        ("a tail goal", "+!g(1) <- !next(1). +!next(N) <- .wait(10000)."),
    ],
)
def test_one_goal_of_another_agent_is_given_again_once_whatever_it_waits_in(waits: str, source: str) -> None:
    life = begun(source).feed(told("achieve", "g(1)"))
    life.save()
    (found,) = others(life)
    sign = "-" if "failure plan" in waits else "+"
    assert found.startswith(f"{sign}!g(1)[")
    assert "source(ann)" in found
    assert own(life) == []
    again = life.next()
    again.settle()
    again.save()
    assert [one[:6] for one in others(again)] == [found[:6]]


def test_a_goal_that_has_given_way_to_a_later_one_of_its_kind_begins_again_there() -> None:
    life = begun("+!g(N) <- +at(N); .wait(10); !g(N + 1).").feed(told("achieve", "g(0)"))
    life.at(1.005)
    life.save()
    (found,) = others(life)
    assert found == "+!g(100)[source(self)]"
    again = life.next(own=False).settle()
    again.save()
    assert others(again) == [found]


def test_a_mind_that_is_saved_while_it_runs_does_not_repeat_rounds_that_ran_through() -> None:
    life = begun("+!g(N) : N < 50 <- +at(N); !g(N + 1). +!g(_).")
    life.mind.feed(told("achieve", "g(0)"))
    for _ in range(400):
        life.mind.run(0.0, 1)
        life.save()
        rounds = len(list(life.mind.beliefs.facts()))
        found = others(life)
        if life.mind.events and rounds:  # the next round is to begin
            assert found[0].startswith(f"+!g({rounds})")
        elif rounds < 50 and found:
            assert found[0].startswith((f"+!g({rounds})", f"+!g({rounds - 1})"))
    assert rounds == 50
    assert others(life) == []


def test_a_question_that_a_plan_answers_is_answered_in_the_next_life() -> None:
    life = begun("+?x(X) <- .wait(1000); X = 5.").feed(told("askOne", "x(V)", msg_id="sync7.ann"))
    life.save()
    assert others(life) == ['+!kqml_received(ann,askOne,x(V),"sync7.ann")']
    again = life.next(own=False).at(2.0)
    (reply,) = again.of(Mail)
    assert (reply.receiver, reply.in_reply_to) == ("ann", "sync7.ann")
    assert str(reply.content) == "x(5)[source(bob)]"
    again.save()
    assert others(again) == []


def test_a_question_that_falls_to_a_plan_behind_own_plans_for_messages_is_given_again() -> None:
    source = "+!kqml_received(_, greet, _, _). +?x(X) <- .wait(1000); X = 5."
    life = begun(source).feed(told("askOne", "x(V)", msg_id="sync7.ann"))
    life.save()
    assert others(life) == ['+!kqml_received(ann,askOne,x(V),"sync7.ann")']
    assert len(life.next().at(2.0).of(Mail)) == 1


def test_pending_events_are_given_again_in_the_order_in_which_they_came() -> None:
    life = begun(WAITS + " @a[atomic] +!block <- fly. +!go(X) <- .print(X); .wait(10000).")
    for n in range(3):
        life.feed(told("achieve", f"go({n})"))
    life.feed(GoalAdded(term("block")))
    action = life.effects[-1].id
    life.mind.feed(told("achieve", "go(3)", sender="cid"))  # not taken yet
    for n in (4, 5):
        life.mind.post(life.mind.plans.relevant("+", "!", term(f"go({n})").sig), (float(n),), told_by_ann())
    life.save()
    assert [one[5] for one in others(life)] == ["0", "1", "2", "4", "5"]
    life.settle().save()
    assert [one[5] for one in others(life)] == ["0", "1", "2", "4", "5", "3"], "taken while the atomic plan waits"
    life.feed(ActionDone(action, True))
    life.save()
    assert sorted(one[5] for one in others(life)) == ["0", "1", "2", "3", "4", "5"]
    given = [one[5] for one in others(life)]
    assert given.index("4") < given.index("5")
    assert life.next().settle().prints == given


def told_by_ann() -> tuple[Any, ...]:
    found: Literal = term("x[source(ann)]")
    return found.annots


def test_an_event_that_cannot_be_kept_is_reported_and_the_others_are_kept() -> None:
    life = begun("+!g(X) <- .wait(10000).")
    life.feed(told("achieve", "g(1)"), Mail("ann", "achieve", Literal(term("g(1)").sig, ("\ud800",)), "mid2"))
    changes = life.save()
    assert len(changes.unkept) == 1
    assert "+!g/1" in changes.unkept[0]
    assert others(life) == ["+!g(1)[source(ann)]"]
    assert not life.save()


def test_intentions_that_have_ended_are_not_remembered() -> None:
    life = begun("+!g <- true.")
    for _ in range(10_000):
        life.mind.feed(told("achieve", "g"))
    life.settle()
    assert len(life.keeper.origins._roots) <= 4096 + 1
    life.save()
    assert not life.keeper.origins._roots


def test_the_keeper_says_when_there_may_be_something_to_save() -> None:
    life = begun("+!g <- true.")
    assert not life.keeper.dirty
    life.feed(told("achieve", "g"))
    assert life.keeper.dirty
    life.save()
    assert not life.keeper.dirty
