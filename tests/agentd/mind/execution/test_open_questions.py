"""What the question of another agent may do to the one that is asked: look, within bounds, and nothing else."""

from typing import Any

import pytest

from agentd.language.terms.format import text
from agentd.mind.data.effects import Log, Print
from agentd.mind.data.inputs import Mail
from agentd.mind.data.registry import ACTIONS, FUNCTIONS, function, internal_action
from tests.agentd.minds import World, mind_of, term

BOB = """
p(1). p(2). secret(42). held((p(1) & .print(hacked))). big([1,2,3]).
holds(Q) :- Q.
collected(Q, L) :- .findall(x, Q, L).
loud(X) :- .print(loud) & p(X).
many(X) :- .range(X, 1, 20000).
endless(X) :- .range(X, 1, 1000000000000).
deep(X) :- deep(Y) & X = Y + 1.
+?plan(X) <- X = 5.
"""


def asked(performative: str, question: str, msg_id: str = "sync1.amy") -> tuple[World, list[str], list[str]]:
    """The world of Bob after a question of Amy's, the answers and the warnings."""
    world = World(mind_of(BOB, agents=lambda: ["bob", "amy"], has_team=True)).settle()
    world.effects.clear()
    world.feed(Mail("amy", performative, term(question), msg_id))
    answers = [text(e.content) for e in world.of(Mail) if e.in_reply_to == msg_id]
    warnings = [e.text for e in world.of(Log) if e.level == "warning"]
    return world, answers, warnings


WITH_EFFECTS = {
    "(p(X) & .stopMAS)": ".stopMAS",
    "(.print(hacked) & p(X))": ".print",
    "(not .print(hacked))": ".print",
    "(p(9) | .print(hacked))": ".print",
    "(p(X) & not (p(9) | not .print(hacked)))": ".print",
    "(p(X) & .abolish(secret(_)))": ".abolish",
    "(p(X) & .add_plan({ +!z <- .print(hacked) }))": ".add_plan",
    "(p(X) & .drop_all_intentions)": ".drop_all_intentions",
    "(p(X) & .send(amy, tell, boo))": ".send",
    "(p(X) & .create_agent(evil))": ".create_agent",
    "(p(X) & .set_random_seed(1))": ".set_random_seed",
    "(p(X) & .random(R))": ".random",
    "(p(X) & math.random > 2)": "math.random",
    "(p(Y) & .findall(X, (p(X) & .stopMAS), L))": ".stopMAS",
    "(p(X) & not .findall(X, .stopMAS, L))": ".stopMAS",
    "(.eval(X, .print(hacked)) & p(Y))": ".print",
    "(.count((p(X) & .print(hacked)), N) & N > 0)": ".print",
    "(X = .stopMAS & X)": ".stopMAS",
    '(.term2string(X, ".stopMAS") & X)': ".stopMAS",
    "(.member(X, [p(9), .stopMAS]) & X)": ".stopMAS",
    "(held(X) & X)": ".print",
    "holds(.stopMAS)": ".stopMAS",
    "holds((p(1) & .print(hacked)))": ".print",
    "collected(.stopMAS, L)": ".stopMAS",
    "(p(X) & holds(.stopMAS))": ".stopMAS",
    "(p(X) & unknown_package.act(X))": "unknown_package.act",
    '(p(X) & .replace("aaaa", "(a+)+b", "", R))': ".replace",
    '(p(X) & .delete("(a+)+b", "aaaa", R))': ".delete",
}


@pytest.mark.parametrize("performative", ["askOne", "askAll"])
@pytest.mark.parametrize("question", WITH_EFFECTS)
def test_a_question_that_names_an_action_with_an_effect_does_nothing_and_is_answered_immediately(
    question: str, performative: str
) -> None:
    world, answers, warnings = asked(performative, question)
    assert answers == ["false" if performative == "askOne" else "[]"]
    assert len(warnings) == 1
    assert "amy" in warnings[0]
    assert WITH_EFFECTS[question] in warnings[0]
    assert {type(e) for e in world.effects} == {Log, Mail}
    assert "secret(42)[source(self)]" in [text(b) for known in world.mind.beliefs.predicates() for b in known.facts()]


LARGE = "[" + ", ".join(f"V{n}" for n in range(200)) + "]"
WITHOUT_END = [
    f"(.range(X, 1, 15000) & p({LARGE}) & X < 0)",
    f"(Y = {LARGE} & .range(X, 1, 20000) & p(Y) & X < 0)",
    f"(Y = f({LARGE}) & .range(X, 1, 20000) & X == Y)",
    f"(Y = f({LARGE}) & .range(X, 1, 20000) & not .ground(Y) & X < 0)",
    "(.range(X, 1, 1000000000000) & X < 0)",
    "(p(Y) & .findall(X, .range(X, 1, 1000000000000), L))",
    "(not (.range(X, 1, 1000000000000) & X < 0) & p(Y))",
    "(not (p(9) | not .count(.range(X, 1, 1000000000000), N)))",
    "(p(Y) & .findall(X, .range(X, 1, 45000), L) & .suffix(P, L) & P == 0)",
    "(endless(X) & X < 0)",
    "holds((.range(X, 1, 1000000000000) & X < 0))",
    "(.range(A, 1, 1000) & .range(B, 1, 1000) & .range(C, 1, 1000) & A + B + C < 0)",
    "(" + " & ".join(['X0 = "ab"', *[f".concat(X{n}, X{n}, X{n + 1})" for n in range(60)]]) + ")",
]


@pytest.mark.parametrize("performative", ["askOne", "askAll"])
@pytest.mark.parametrize("question", WITHOUT_END)
def test_a_question_that_takes_too_much_work_is_ended_and_answered(question: str, performative: str) -> None:
    _, answers, warnings = asked(performative, question)
    assert answers == ["false" if performative == "askOne" else "[]"]
    assert len(warnings) == 1
    assert "amy" in warnings[0]
    assert "steps" in warnings[0]


def test_answers_that_would_be_too_large_together_are_refused() -> None:
    question = f"(.range(X, 1, 9000) & Y = {LARGE})"
    assert asked("askAll", question)[1] == ["[]"]
    assert asked("askOne", question)[1] != ["false"]


def test_a_question_that_is_too_deep_is_answered() -> None:
    _, answers, [warning] = asked("askOne", "(p(X) & deep(Y))")
    assert answers == ["false"]
    assert "too deep" in warning


def test_a_refused_question_that_nobody_waits_for_gets_no_answer() -> None:
    _, answers, warnings = asked("askOne", "(p(X) & .stopMAS)", "mid1.amy")
    assert answers == []
    assert len(warnings) == 1


@pytest.mark.parametrize("question", ["many(X)", "(many(X) & X > 0)", "(.range(X, 1, 1000000000000) & X > 0)"])
def test_more_answers_than_ten_thousand_are_left_out_and_reported(question: str) -> None:
    world, _, warnings = asked("askAll", question)
    [sent] = world.of(Mail)
    assert len(sent.content.items) == 10_000
    assert len(warnings) == 1
    assert "amy" in warnings[0]
    assert "10000" in warnings[0]


@pytest.mark.parametrize(
    ("performative", "question", "answer"),
    [
        ("askOne", "(p(X) & X < 2)", "(p(1) & (1 < 2))"),
        ("askOne", "(.range(X, 1, 1000000000000) & X > 2)", "(.range(3,1,1000000000000) & (3 > 2))"),
        ("askOne", "(X = math.max(1, 2) & p(X))", None),
        ("askOne", "(.findall(X, p(X), L) & .length(L, 2))", None),
        ("askOne", "(p(X) & .delete(a, [a,b], L))", None),
        ("askOne", "many(X)", "many(1)[source(bob)]"),
        ("askOne", "plan(X)", "plan(5)[source(bob)]"),
        ("askOne", "holds(p(2))", "holds(p(2))[source(bob)]"),
        ("askAll", "p(_)", "[p(1)[source(bob)],p(2)[source(bob)]]"),
    ],
)
def test_a_question_that_only_looks_is_answered(performative: str, question: str, answer: str | None) -> None:
    _, answers, warnings = asked(performative, question)
    assert warnings == []
    assert len(answers) == 1
    assert answers[0] not in ("false", "[]")
    assert answer is None or answers == [answer]


@pytest.mark.parametrize("question", ["loud(2)", "(loud(X) & X > 1)"])
def test_what_a_rule_of_the_asked_agent_names_itself_is_allowed(question: str) -> None:
    world, answers, warnings = asked("askOne", question)
    assert warnings == []
    assert answers != ["false"]
    assert world.of(Print)


def test_what_another_package_provides_is_not_known_to_be_free_of_effects() -> None:
    calls: list[Any] = []

    @internal_action("asked_package.act", 0)
    def act(mind: Any, trail: Any) -> bool:
        calls.append("act")
        return True

    @function("asked_package.value", 0)
    def compute(mind: Any) -> float:
        calls.append("value")
        return 1.0

    try:
        for question in ("(p(X) & asked_package.act)", "(X = asked_package.value & p(X))"):
            _, answers, warnings = asked("askOne", question)
            assert answers == ["false"]
            assert "asked_package" in warnings[0]
    finally:
        del ACTIONS["asked_package.act"], FUNCTIONS[("asked_package.value", 0)]
    assert calls == []


def test_an_agent_goes_on_after_a_question_that_was_refused() -> None:
    world, _, _ = asked("askAll", "(p(X) & .stopMAS)")
    world.effects.clear()
    world.feed(Mail("amy", "askAll", term("(p(X) & X > 0)"), "sync2.amy"))
    assert text(world.of(Mail)[0].content) == "[(p(1) & (1 > 0)),(p(2) & (2 > 0))]"
    assert world.mind.asked is None
