"""Beliefs: percepts, annotations, indexes, queries."""

import random

import pytest

from agentd.language.parse import parse_formula
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.terms import Var
from agentd.mind.beliefs.belief_base import BeliefBase
from agentd.mind.beliefs.term_copy import with_source
from agentd.mind.data.inputs import PerceptAdded, PerceptRemoved, PerceptReplaced
from tests.agentd.minds import run, term

EVENTS = '+p(X,Y)[source(S)] <- .print("+", X, Y, S). -p(X,Y)[source(S)] <- .print("-", X, Y, S).'


def test_a_replaced_percept_raises_events_for_what_changed_only() -> None:
    world = run(EVENTS)
    world.feed(PerceptReplaced(term("p(a,1)")))
    world.feed(PerceptReplaced(term("p(a,1)")))
    world.feed(PerceptReplaced(term("p(a,2)")))
    assert world.prints == ["+a1percept", "-a1percept", "+a2percept"]


def test_a_keyed_percept_replaces_the_belief_with_the_same_key_only() -> None:
    world = run(EVENTS)
    world.feed(PerceptReplaced(term("p(a,1)"), (0,)), PerceptReplaced(term("p(b,1)"), (0,)))
    world.feed(PerceptReplaced(term("p(a,2)"), (0,)))
    assert world.prints == ["+a1percept", "+b1percept", "-a1percept", "+a2percept"]


def test_a_removed_percept_is_gone_with_its_event() -> None:
    world = run(EVENTS)
    world.feed(PerceptAdded(term("p(a,1)")), PerceptAdded(term("p(b,1)")), PerceptRemoved(term("p(b,0)"), (0,)))
    assert world.mind.query(parse_formula("p(a,1)"))
    assert not world.mind.query(parse_formula("p(b,_)"))


def test_a_percept_that_the_agent_believes_itself_stays_without_the_percept() -> None:
    world = run("p(a,1).")
    world.feed(PerceptAdded(term("p(a,1)")))
    assert world.mind.query(parse_formula("p(a,1)[source(self),source(percept)]"))
    world.feed(PerceptRemoved(term("p(a,1)"), (0, 1)))
    assert world.mind.query(parse_formula("p(a,1)[source(self)]"))
    assert not world.mind.query(parse_formula("p(a,1)[source(percept)]"))


def test_deletions_of_percepts_are_raised_before_additions() -> None:
    world = run('+q(X) <- .print("+", X). -p(X) <- .print("-", X).')
    world.feed(PerceptAdded(term("p(1)")))
    world.feed(PerceptAdded(term("q(2)")), PerceptRemoved(term("p(1)"), ()))
    assert world.prints == ["-1", "+2"]


def test_a_query_leaves_no_trace() -> None:
    world = run("at(1,2). r(X) :- at(X,Y) & Y > 1.")
    before = [b.text for b in world.mind.belief_views()]
    assert world.mind.query(parse_formula("r(1) & not r(2)"))
    assert not world.mind.query(parse_formula("r(X) & X > 1"))
    assert [b.text for b in world.mind.belief_views()] == before
    assert not world.mind.ready


@pytest.mark.parametrize("seed", range(5))
def test_an_indexed_query_gives_what_a_scan_gives_in_the_same_order(seed: int) -> None:
    """Facts come and go at random; looking up by either argument always agrees with going through all facts."""
    choose = random.Random(seed)
    base = BeliefBase()
    predicate = base.predicate(signature("f", 2))
    values = [float(n) for n in range(6)] + ["s", term("a"), term("g(1)"), term("[1]")]
    mode_of = {0: (True, False), 1: (False, True)}
    for _ in range(400):
        args = (choose.choice(values), choose.choice(values))
        known = predicate.entries.get(args)
        if known is not None and choose.random() < 0.6:
            predicate.remove(known)
        else:
            predicate.add(args, with_source(()), last=choose.random() < 0.1)
        position, key = choose.randrange(2), choose.choice(values)
        pattern = (key, None) if position == 0 else (None, key)
        found = [a for a in predicate.solve(mode_of[position], pattern, None, []) if a[position] == key]
        assert found == [a for a in reversed(predicate.entries) if a[position] == key]


def test_a_belief_with_a_free_variable_is_found_by_any_value() -> None:
    world = run("any(_, 2). f(1,1). f(2,2). f(3,3). f(4,4). f(5,5). f(6,6). f(7,7). f(8,8). f(9,9). f(X,10).")
    assert world.mind.query(parse_formula("any(1,2) & any(foo,2) & not any(1,3)"))
    assert world.mind.query(parse_formula("f(3,3) & f(3,10) & f(77,10) & not f(77,1)"))


def test_an_annotated_atom_as_argument_is_found_by_the_plain_atom() -> None:
    facts = " ".join(f"f(x{n})." for n in range(20))
    world = run(f"{facts} f(a[k]).")
    assert world.mind.query(parse_formula("f(a)"))
    assert not world.mind.query(parse_formula("f(a[z])"))


def test_the_text_of_a_belief_shows_its_annotations_in_order() -> None:
    world = run("b(1)[zeta, alpha, 3].")
    assert [b.text for b in world.mind.belief_views()] == ["b(1)[3,alpha,source(self),zeta]"]
    assert text(Var("X")) == "X"


def test_the_end_of_a_percept_has_the_annotations_that_its_news_has() -> None:
    world = run('-at(X)[room(R)] <- .print("left", X, R). -at(X) <- .print("gone", X).')
    world.feed(PerceptAdded(term("at(1)[room(hall)]")), PerceptAdded(term("at(2)[room(hall)]")))
    world.feed(PerceptRemoved(term("at(1)[room(hall)]"), (0,)))
    world.feed(PerceptRemoved(term("at(2)"), (0,)))
    assert world.prints == ["left1hall", "gone2"]
