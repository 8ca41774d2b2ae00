"""Nothing that is kept changes without a word, in cycles in which but percepts come as in all others."""

from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from agentd.language.terms.terms import atom
from agentd.mind.data.inputs import ActionDone, GoalAdded, Mail, PerceptAdded, PerceptRemoved, PerceptReplaced
from tests.agentd.kept_minds import Life, begun
from tests.agentd.minds import term
from tests.support.amount import some_of

WAITS = {
    "formula": ".wait(at(N))",
    "event": ".wait({+at(N)})",
    "end": ".wait({-at(N)})",
    "limited": ".wait(at(N), 3000)",
    "timed": ".wait({+at(N)}, 3000, T)",
    "seconds": ".wait(N * 1000)",
    "subgoal": "!formula(N)",
    "between": "!formula(N); +done(N)",
    "all": "{ .wait(at(N)) |&| .wait({+at(N)}) }",
    "any": "{ .wait(at(N)) ||| .wait({-at(N)}) }",
    "own": "!!event(N)",
    "acts": "act(N)",
    "asks": ".send(cid, askOne, at(N), A)",
    "tells": ".send(cid, tell, at(N))",
    "notes": ".wait(at(N) & .namespace_set_prop(ns, colour, N) & false)",
    "drops": ".wait(at(N) & .drop_all_intentions & false)",
    "learns": ".wait(at(N) & .abolish(done(_)) & .add_plan({ +!new(N) }) & false)",
    "halts": ".suspend",
    "holds": ".suspend(formula(N))",
    "frees": ".resume(formula(N))",
    "ends": ".drop_desire(event(N))",
    "fails": ".fail_goal(formula(N))",
    "wins": ".succeed_goal(event(N))",
}
PROGRAM = "\n".join(f"+!{name}(N) <- {body}." for name, body in WAITS.items())
PROGRAM += "\n@whole[atomic] +!whole(N) <- .wait(at(N)). +!until(N) <: at(N) <- .wait({+never}). +!new(_).\n"
GOALS = (*WAITS, "whole", "until")

names, numbers = st.sampled_from(GOALS), st.integers(0, 2)
moments = st.sampled_from((PerceptAdded, PerceptRemoved, PerceptReplaced))


class WatchedMind(RuleBasedStateMachine):
    """Much is waited for at once, and percepts come; whenever the mind is said to be as it was saved, it is."""

    program = PROGRAM

    def __init__(self) -> None:
        super().__init__()
        self.life = begun(self.program)

    @rule(name=names, number=numbers, source=st.sampled_from(("self", "bob", "ann")))
    def is_given_a_goal(self, name: str, number: int, source: str) -> None:
        self.life.feed(GoalAdded(term(f"{name}({number})[source({source})]")))

    @rule(name=names, number=numbers)
    def is_asked_for_something_by_mail(self, name: str, number: int) -> None:
        self.life.mind.feed(Mail("ann", "achieve", term(f"{name}({number})"), "mid1"))

    @rule(kind=moments, number=numbers)
    def perceives(self, kind: Any, number: int) -> None:
        self.life.feed(kind(term(f"at({number})")))

    @rule(kind=moments, number=numbers, cycles=st.integers(0, 3))
    def perceives_and_is_not_done(self, kind: Any, number: int, cycles: int) -> None:
        self.life.mind.feed(kind(term(f"at({number})")))
        if cycles:
            self.life.mind.run(self.life.now, cycles)

    @rule(seconds=st.integers(1, 3))
    def time_passes(self, seconds: int) -> None:
        self.life.at(self.life.now + seconds)

    @precondition(lambda self: self.life.mind.action_client)
    @rule(ok=st.booleans())
    def an_action_ends(self, ok: bool) -> None:
        self.life.feed(ActionDone(min(self.life.mind.action_client), ok, "", "succeeded" if ok else "failed"))

    @rule()
    def is_saved(self) -> None:
        self.life.save()

    @rule()
    def begins_its_next_life(self) -> None:
        self.life.save()
        self.life = self.life.next()

    @invariant()
    def what_is_said_to_be_as_it_was_is(self) -> None:
        if not self.life.keeper.dirty:
            changes = self.life.keeper.changes()
            assert not changes, changes


class WatchedMindWithStatesOfGoals(WatchedMind):
    """The same of a program that has plans for the states of goals, whose plans end in another way."""

    program = f"{PROGRAM} ^!formula(N)[state(finished)] <- +done(N)."


WatchedMind.TestCase.settings = settings(max_examples=some_of(30, 2), stateful_step_count=30, deadline=None)
WatchedMindWithStatesOfGoals.TestCase.settings = settings(
    max_examples=some_of(15, 2), stateful_step_count=30, deadline=None
)
test_whatever_is_waited_for_no_change_goes_without_a_word = WatchedMind.TestCase
test_nor_in_a_mind_with_plans_for_the_states_of_goals = WatchedMindWithStatesOfGoals.TestCase


@pytest.mark.parametrize("wait", ["at(4)", "not at(0)", "{+at(4)}", "{-at(0)}"])
def test_a_goal_that_ends_with_its_wait_is_not_given_again(wait: str) -> None:
    life = begun(f"+!watch <- .wait({wait}).")
    life.feed(PerceptAdded(term("at(0)")), GoalAdded(term("watch[source(ann)]"))).save()
    assert [str(one) for one in life.next().keeper.pending_others] == ["+!watch[source(ann)]"]
    life.feed(PerceptReplaced(term("at(4)")))
    assert life.keeper.dirty
    life.save()
    assert life.next().keeper.pending_others == ()


def test_a_branch_and_its_intention_that_end_with_a_wait_are_not_begun_again() -> None:
    life = begun("+!watch <- .wait(at(4)); !last. +!last <- .wait(at(5)).")
    life.feed(GoalAdded(term("watch[source(ann)]")), PerceptAdded(term("at(4)"))).save()
    assert len(life.next().keeper.pending_others) == 1
    life.feed(PerceptReplaced(term("at(5)")))
    assert life.keeper.dirty
    life.save()
    assert life.next().keeper.pending_others == ()


def test_intentions_that_a_formula_drops_while_percepts_come_are_not_begun_again() -> None:
    life = begun("+!long <- .wait(100000). +!watch <- .wait(at(4) & .drop_all_intentions & at(5)).")
    life.feed(GoalAdded(term("long[source(ann)]")), GoalAdded(term("watch[source(ann)]"))).save()
    life.feed(PerceptAdded(term("at(4)")))
    assert life.keeper.dirty
    life.save()
    assert [str(one) for one in life.next().keeper.pending_others] == ["+!watch[source(ann)]"]


def test_a_property_that_a_formula_sets_while_percepts_come_is_kept() -> None:
    life = begun("+!note <- .namespace_set_prop(ns, n, 1); .wait(at(X) & .namespace_set_prop(ns, n, X) & X > 9).")
    life.feed(GoalAdded(atom("note"))).save()
    life.feed(PerceptAdded(term("at(4)")))
    assert life.keeper.dirty
    life.save()
    assert life.next().mind.namespaces == {"ns": {"n": 4.0}}


def test_what_was_pending_and_is_not_resumed_is_no_longer_kept_although_nothing_runs() -> None:
    life = begun("+!go <- !!watch. +!watch <- .wait(at(4)).")
    life.feed(GoalAdded(atom("go"))).save()
    again = Life(life.source, life.stored).settle()
    again.save()
    assert len(again.stored.pending) == 1
    again.keeper.resume(own=False)
    assert again.keeper.dirty
    again.save()
    assert again.stored.pending == []
