"""A function of a package may raise anything: only what needed it fails."""

from typing import Any

import agentd
from agentd.language.parse import parse_formula
from agentd.mind.data.effects import Log
from agentd.mind.data.inputs import Mail
from tests.agentd.minds import World, mind_of, term


@agentd.function("raising.f", 1)
def _raise(mind: Any, argument: Any) -> float:
    raise ValueError("boom")


RULE = "bad(X) :- v(Y) & X = raising.f(Y). v(1). "


def test_an_initial_belief_that_cannot_be_computed_is_left_out_and_reported() -> None:
    world = World(mind_of("b(raising.f(1)). !s. +!s <- .print(alive).")).settle()
    assert world.prints == ["alive"]
    assert [e.text for e in world.effects if isinstance(e, Log)] == [
        "test.asl:1:1: b/1 cannot be computed: ValueError: boom; it is left out"
    ]


def test_a_question_whose_rule_raises_ends_nothing() -> None:
    world = World(mind_of(RULE + "+!s <- .print(alive).")).settle()
    world.feed(Mail("ann", "askOne", term("bad(X)"), "sync1"), Mail("ann", "achieve", term("s")))
    assert world.prints == ["Communication error -- unknown: ValueError: boom", "alive"]


def test_a_formula_that_raises_does_not_hold() -> None:
    mind = mind_of(RULE)
    assert not mind.query(parse_formula("bad(X)"))
