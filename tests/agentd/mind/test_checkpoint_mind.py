"""A mind that is kept and restored: beliefs in query order, rules, plans, and what it counts, whatever has happened."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from agentd.conversion.term_conversion import perceived
from agentd.language.parse import parse_plan
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.terms import Collection, Literal, Var, atom
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import BeliefAdded, GoalAdded, Mail, PerceptAdded, PerceptRemoved, PerceptReplaced
from agentd.mind.execution.belief_updates import add_belief
from agentd.mind.execution.program_loading import register_functions
from agentd.mind.plans.plan_terms import add_plans, label_of, remove_plans
from schemas.wire.records import Perception
from tests.agentd.generated_terms import any_terms, ground
from tests.agentd.kept_minds import Life, begun, state_of
from tests.agentd.minds import term
from tests.support.amount import some_of

EDITOR = """
p(1). p(2)[noted]. p(X) :- q(X). p(3). q(4). ns::r(1). ~p(5). open(X, Y, X).
+!add(B) <- +B.
+!del(B) <- -B.
+!replace(B) <- -+B.
+!put_last(B) <- +>B.
+!abolish(B) <- .abolish(B).
@named +!act(X) <- .print(X).
+!act(_).
"""
RULES = ("{ p(X) :- q(X) }", "{ p(X) :- r(X) & not q(X) }", "{ q(X) :- p(f(X)) | p(X) }", "{ ~p(X) :- q(X) }")
PLANS = (
    "+!act(1) <- .print(one).",
    "@named +!act(X) <- .print(X).",
    "@other[atomic] +!act(2) : p(Y) <- !act(Y).",
    "+p(X)[source(S)] : S \\== self <- +heard(X, S).",
)
TELLERS = ("self", "ann", "cid")

literals = st.builds(
    lambda name, args: Literal(signature(name, len(args)), tuple(args)),
    st.sampled_from(("p", "q", "r")),
    st.lists(ground | any_terms, min_size=1, max_size=2),
)
few = st.builds(lambda name, n: term(f"{name}({n})"), st.sampled_from(("p", "q", "ns::r", "~p")), st.integers(1, 5))
noted = st.sampled_from(["x", "x[a]", "x[source(self)]", "x[source(ann)]", "x[source(ann),source(self)]"])
annotated = st.builds(lambda literal, given: literal.with_annots(term(given).annots), few, noted)


class KeptMind(RuleBasedStateMachine):
    """Anything may happen to a mind; whenever it is saved, its next life is as it is."""

    def __init__(self) -> None:
        super().__init__()
        self.life = begun(EDITOR)
        self.maps = 0

    def _do(self, name: str, what: Any) -> None:
        self.life.feed(GoalAdded(Literal(signature(name, 1), (what,))))

    @rule(name=st.sampled_from(("add", "del", "replace", "put_last", "abolish")), what=annotated | literals)
    def changes_a_belief(self, name: str, what: Any) -> None:
        self._do(name, what)

    @rule(name=st.sampled_from(("tell", "untell")), what=annotated, sender=st.sampled_from(TELLERS[1:]))
    def is_told(self, name: str, what: Any, sender: str) -> None:
        self.life.feed(Mail(sender, name, what, "mid1"))

    @rule(kind=st.sampled_from((PerceptAdded, PerceptRemoved, PerceptReplaced)), what=few)
    def perceives(self, kind: Any, what: Any) -> None:
        self.life.feed(kind(what.bare()))

    @rule(name=st.sampled_from(("add", "del", "put_last")), what=st.sampled_from(RULES))
    def changes_a_rule(self, name: str, what: str) -> None:
        self._do(name, term(what))

    @rule(what=st.sampled_from(PLANS), teller=st.sampled_from(TELLERS), first=st.booleans())
    def adds_a_plan(self, what: str, teller: str, first: bool) -> None:
        with suppress(Failed):  # there is one with its label
            add_plans(self.life.mind, what, atom(teller), first)

    @rule(label=st.sampled_from(("named", "other", "p__2", "p__9")), teller=st.sampled_from(TELLERS))
    def removes_a_plan(self, label: str, teller: str) -> None:
        self.life.feed(Mail(teller, "untellHow", atom(label), "mid1"))

    @rule(what=st.sampled_from(PLANS), teller=st.sampled_from(TELLERS[1:]))
    def is_told_how(self, what: str, teller: str) -> None:
        self.life.feed(Mail(teller, "tellHow", what, "mid1"))

    @rule()
    def believes_a_map(self) -> None:
        self.maps += 1
        self.life.feed(BeliefAdded(Literal(signature("has", 1), (Collection("map", {float(self.maps): "x"}),))))

    @rule(value=st.integers(0, 3))
    def changes_a_map_in_place(self, value: int) -> None:
        known = self.life.mind.beliefs.known(signature("has", 1))
        for fact in known.facts() if known is not None else ():
            fact.args[0].content[float(100 + value)] = float(value)

    @rule(value=ground)
    def notes_a_property(self, value: Any) -> None:
        self.life.mind.namespaces.setdefault("ns", {})["colour"] = value

    @rule()
    def is_saved(self) -> None:
        self.life.save()
        assert not self.life.keeper.changes()
        assert state_of(self.life.next().mind) == state_of(self.life.mind)

    @rule()
    def begins_its_next_life(self) -> None:
        self.life.save()
        self.life = self.life.next()

    @rule()
    def dies_before_it_is_saved(self) -> None:
        before = state_of(Life(EDITOR, self.life.stored).mind)
        self.life = self.life.next()
        assert state_of(self.life.mind) == before

    @invariant()
    def everything_can_be_kept_and_restored(self) -> None:
        assert not self.life.keeper.left_out
        assert not self.life.keeper.unkept


KeptMind.TestCase.settings = settings(max_examples=some_of(30, 2), stateful_step_count=25, deadline=None)
test_whatever_happens_to_a_mind_its_next_life_is_as_it_was_when_saved = KeptMind.TestCase


def beliefs(life: Life, name: str) -> list[Any]:
    """The entries of a predicate in query order."""
    return dict(state_of(life.mind)["beliefs"]).get(name, [])


def test_initial_beliefs_and_goals_are_those_of_the_first_start_only() -> None:
    life = begun("p(1). !start. +!start <- -p(1); +started.")
    again = life.next().settle()
    assert beliefs(again, "p/1") == []
    assert beliefs(again, "started/0") == ["started[source(self)]"]
    assert again.prints == []
    assert state_of(again.mind) == state_of(life.mind)


def test_restoring_raises_no_event() -> None:
    life = begun("+seen(X) <- .print(X). !start. +!start <- +seen(1); +seen(2).")
    assert life.prints == ["1", "2"]
    assert life.next().settle().prints == []


def test_predicates_are_gone_through_in_the_order_in_which_they_were_first_mentioned() -> None:
    life = begun("b(1). a(1). c(1). !go. +!go <- .findall(B, .belief(B), L); .print(L); -a(1); +a(2); +z; +d.")
    order = [p.sig.functor for p in life.mind.beliefs.predicates()]
    assert [p.sig.functor for p in life.next().mind.beliefs.predicates()][: len(order)] == order


def test_a_percept_is_not_kept_and_comes_again_with_its_event() -> None:
    source = "+at(X)[source(percept)] <- .print(at(X))."
    life = begun(source)
    life.feed(PerceptAdded(term("at(1)")), PerceptAdded(term("at(2)"))).save()
    again = life.next().settle()
    assert beliefs(again, "at/1") == []
    assert again.feed(PerceptAdded(term("at(1)"))).prints == ["at(1)"]


@pytest.mark.parametrize(
    "made",
    [lambda value: term(f"at({value:g})"), lambda value: perceived(Perception(name="at", parameters=(value,)))],
    ids=["as terms", "as records of the bus"],
)
def test_percepts_that_change_are_nothing_to_save(made: Callable[[float], Any]) -> None:
    life = begun("a.")
    life.feed(PerceptAdded(made(1.0))).save()
    for n in range(5):
        life.feed(PerceptReplaced(made(float(n))))
        assert not life.save()


def test_percepts_that_no_plan_is_for_do_not_even_have_to_be_looked_at() -> None:
    life = begun("!watch. +!watch <- .wait(100000).")
    life.feed(PerceptAdded(term("at(0)"))).save()
    for n in range(5):
        life.feed(PerceptReplaced(term(f"at({n})")))
        assert not life.keeper.dirty


@pytest.mark.parametrize(
    "source",
    [
        "+at(_) <- +seen.",
        "-at(_) <- +seen.",
        "!watch. +!watch <- .wait(at(4)); +seen.",
        "!watch. +!watch <- .wait(not at(0), 100000); +seen.",
        "far :- at(X) & X > 3. !watch. +!watch <- .wait(far); +seen.",
    ],
)
def test_what_percepts_bring_about_is_kept(source: str) -> None:
    life = begun(f"{source} @other +!other.")
    life.feed(PerceptAdded(term("at(0)"))).save()
    life.feed(PerceptReplaced(term("at(4)"))).settle()
    assert life.keeper.dirty
    life.save()
    assert "seen/0" in dict(state_of(life.next().mind)["beliefs"])


@pytest.mark.parametrize("percept_ends", [False, True])
def test_a_belief_that_is_but_a_percept_or_not_even_that_is_kept_no_longer(percept_ends: bool) -> None:
    life = begun("+!add(B) <- +B. +!del(B) <- -B.")
    life.feed(GoalAdded(term("add(at(1))")), PerceptAdded(term("at(1)"))).save()
    end = [PerceptRemoved(term("at(1)"))] if percept_ends else []
    life.feed(GoalAdded(term("del(at(1)[source(self)])")), *end).save()
    assert beliefs(life.next(), "at/1") == []


def test_a_belief_with_free_variables_is_asked_as_before() -> None:
    life = begun("likes(X, X). !go. +!go <- +hates(ann, Y). +!ask <- ?likes(A, 3); ?hates(W, Z); .print(A, W).")
    assert life.next().feed(GoalAdded(term("ask"))).prints == ["3ann"]


def test_an_initial_belief_with_variables_is_a_schema_in_the_next_life_too() -> None:
    life = begun("limit(_,50). limit(road,80). !go. +!go <- -+done(1). +!ask <- ?limit(a,X); ?limit(b,Y); .print(X,Y).")
    assert life.next().feed(GoalAdded(term("ask"))).prints == ["5050"]


def test_a_rule_and_a_plan_with_values_are_kept_with_them() -> None:
    source = """
    +!learn(N) <- +{ big(X) :- X > N }; .add_plan({ +!show <- .print(N) }).
    +!ask(X) : big(X) <- .print(big). +!ask(_) <- .print(small).
    """
    life = begun(source).feed(GoalAdded(term("learn(5)")))
    life.save()
    again = life.next().feed(GoalAdded(term("ask(6)")), GoalAdded(term("ask(4)")), GoalAdded(term("show")))
    assert again.prints == ["big", "small", "5"]


def test_an_edited_program_counts_at_the_restart_for_plans_and_rules_but_not_for_beliefs() -> None:
    life = begun("p(1). top(X) :- p(X). old(X) :- p(X). +!go : top(X) <- .print(before, X).")
    edited = (
        "p(2). top(X) :- p(Y) & X = Y * 10. old(X) :- p(X). +!go : top(X) <- .print(after, X). +!more <- .print(more)."
    )
    again = life.next(source=edited).feed(GoalAdded(term("go")), GoalAdded(term("more")))
    assert again.prints == ["after10", "more"]
    again.save()
    assert state_of(again.next().mind) == state_of(again.mind)


def test_what_the_run_has_removed_of_the_program_stays_removed_also_in_an_edited_one() -> None:
    source = "q(1). p(X) :- q(X). @a +!go <- .print(a). +!go <- .print(b). +!cut <- -{ p(X) :- q(X) }; .remove_plan(a)."
    life = begun(source).feed(GoalAdded(term("cut")))
    life.save()
    again = life.next(source=source + " @new +!other <- .print(new). p(9).").feed(GoalAdded(term("go")))
    assert again.prints == ["b"]
    assert beliefs(again, "p/1") == []


def test_labels_made_for_plans_without_one_are_kept_and_not_given_twice() -> None:
    life = begun("+!go.")
    add_plans(life.mind, "+!go(1).", atom("self"), False)
    life.save()
    again = life.next()
    add_plans(again.mind, "+!go(2).", atom("self"), False)
    labels = [text(p.label) for p in again.mind.plans]
    assert labels[:2] == [text(p.label) for p in life.mind.plans]
    assert len(set(labels)) == 3


def test_the_label_of_a_plan_names_its_file_in_the_next_life_too() -> None:
    life = begun("+!go.")
    life.mind.plans.add(life.mind.plans.make_of_file(parse_plan("@one +!go(1).", "more.asl")))
    add_plans(life.mind, "@two +!go(2).", atom("self"), False)
    life.save()
    labels = [text(label_of(plan)) for plan in life.next().mind.plans]
    assert [label.partition("[")[2] for label in labels] == [
        'source(self),url("file:test.asl")]',
        'source(self),url("file:more.asl")]',
        "source(self)]",
    ]


def test_a_plan_keeps_the_label_that_was_made_for_it_when_others_before_it_are_gone() -> None:
    life = begun("+!go.")
    for n in (1, 2):
        add_plans(life.mind, f"+!go({n}).", atom("self"), False)
    remove_plans(life.mind, atom("p__2"), atom("self"))
    life.save()
    assert [text(p.label) for p in life.next().mind.plans] == ["p__1", "p__3"]


def test_ids_of_messages_and_actions_go_on_where_they_ended() -> None:
    source = "+!tell <- .send(ann, tell, x). +!act <- fly."
    life = begun(source).feed(GoalAdded(term("tell")), GoalAdded(term("act")))
    life.save()
    again = life.next(own=False).feed(GoalAdded(term("tell")))
    ids = [mail.msg_id for each in (life, again) for mail in each.of(Mail)]
    assert len(set(ids)) == 2
    assert again.mind.action_count == 1


def test_lives_are_counted() -> None:
    life = begun("a.")
    assert life.keeper.lives == 0
    for number in (1, 2, 3):
        life = life.next()
        life.save()
        assert life.keeper.lives == number


def test_random_numbers_of_a_new_life_are_others_and_yet_decided_by_the_seed() -> None:
    source = "+!roll <- .random(X); .print(X)."
    first = begun(source, seed=7)
    rolls = [
        life.feed(GoalAdded(term("roll"))).prints for life in (first, first.next(), first.next(), first.next().next())
    ]
    assert rolls[1] == rolls[2]
    assert rolls[0] != rolls[1]


def test_functions_of_a_file_included_in_the_run_are_known_again() -> None:
    life = begun("sum(X, Y, Z) :- Z = X + Y. +!go <- .print(my.sum(1, 2)).")
    register_functions(life.mind, [("my.sum", 2, "sum")])
    for plan in life.mind.plans:
        plan.unload()
    assert life.feed(GoalAdded(term("go"))).prints == ["3"]
    life.save()
    assert life.next().feed(GoalAdded(term("go"))).prints == ["3"]


def test_what_cannot_be_kept_is_reported_once_and_counted_and_the_rest_is_kept() -> None:
    life = begun("a.")
    endless = Collection("map", {})
    endless.content["me"] = endless
    life.feed(BeliefAdded(term("good(1)")), BeliefAdded(Literal(signature("bad", 1), (endless,))))
    changes = life.save()
    assert len(changes.unkept) == 1
    assert "bad/1" in changes.unkept[0]
    assert "contains itself" in changes.unkept[0]
    assert not life.save()
    assert life.keeper.unkept == 1
    assert beliefs(life.next(), "good/1") == ["good(1)[source(self)]"]


def test_a_belief_that_can_be_kept_no_longer_is_not_restored_as_it_was() -> None:
    life = begun("!start. +!start <- .map.create(M); +store(M).")
    (store,) = life.mind.beliefs.predicate(signature("store", 1)).facts()
    store.args[0].content["me"] = store.args[0]
    assert len(life.save().unkept) == 1
    assert beliefs(life.next(), "store/1") == []


def test_rows_that_cannot_be_read_are_left_out_and_reported_and_the_rest_is_restored() -> None:
    life = begun("p(1). p(2). +!go <- .print(went).")
    add_plans(life.mind, "+!go(1).", atom("self"), False)
    life.save()
    life.stored.beliefs[0] = (life.stored.beliefs[0][0], b"\xc1")
    life.stored.plans[0] = (life.stored.plans[0][0], b"\x91\x91\xa1a")
    life.stored.pending.append(((0, 99), 2, b"\x90"))
    again = life.next()
    assert beliefs(again, "p/1") == ["p(1)[source(self)]"]
    assert [told.split(" cannot")[0] for told in again.keeper.left_out] == [
        "a plan (row 1)",
        "a belief (row 1)",
        "an event (row (0, 99))",
    ]


def test_a_clone_and_an_included_plan_are_changes_as_any_other() -> None:
    giver = begun("p(1). r(X) :- p(X). +!go(X) <- .print(X).")
    taker = begun("")
    taker.mind.copy_from(giver.mind)
    taker.save()
    assert state_of(taker.next().mind) == state_of(taker.mind)


def test_an_agent_with_a_rule_that_selects_options_selects_by_it_in_its_next_life() -> None:
    source = "+!go <- .print(one). @two +!go <- .print(two). +!learn <- +{ select__option(L, I, 1) :- true }."
    life = begun(source).feed(GoalAdded(term("learn")))
    life.save()
    assert life.mind.compiler.form == life.next().mind.compiler.form == "options"


@pytest.mark.parametrize("decisions", [0, 50])
def test_a_mind_is_kept_the_same_whether_or_not_it_records_its_decisions(decisions: int) -> None:
    life = Life("p(1). !go. +!go <- +q(2); !!later. +!later <- .wait(5000).", decisions=decisions).settle()
    life.save()
    assert [str(one) for one in life.next().keeper.pending_own] == ["+!later[source(self)]"]


def test_variables_of_a_kept_belief_are_its_own() -> None:
    life = begun("a.")
    shared = Var("S")
    for name in ("p", "q"):
        add_belief(life.mind, Literal(signature(name, 1), (shared,)))
    life.save()
    p, q = (next(iter(life.next().mind.beliefs.predicate(signature(n, 1)).facts())) for n in ("p", "q"))
    assert p.args[0] is not q.args[0]
