"""Messages in a team on virtual time: floods, their bounds, and the order of what arrives."""

from __future__ import annotations

from agentd.mind.effects import Log
from agentd.mind.inputs import Mail
from agentd.mind.mind import MOST_MAIL
from tests.agentd.minds import World, mind_of, term
from tests.agentd.teams import Stage


def test_ten_thousand_messages_to_an_agent_that_is_busy_arrive_in_their_order() -> None:
    stage = Stage(
        {
            "bob": """
            !go. n(0).
            @a[atomic] +!go <- .wait(500).
            +m(N) : n(M) & N == M + 1 <- -+n(N).
            +m(N) <- .print("out of order ", N).
            +done <- ?n(N); .print(N).
            """,
            "amy": """
            !go.
            +!go <- for (.range(I, 1, 10000)) { .send(bob, tell, m(I)) }; .wait(1000); .send(bob, tell, done).
            """,
        }
    )
    stage.run()
    assert stage.lines == ["[bob] 10000"]


def test_messages_beyond_the_bound_are_dropped_counted_and_told_once() -> None:
    world = World(mind_of("+!go <- .wait(never). @a[atomic] +!busy <- .wait(1000)."))
    mail = Mail("amy", "tell", term("m(1)"))
    for _ in range(MOST_MAIL + 5):
        world.mind.feed(mail)
    assert world.mind.drops.counts == {"messages": 5}
    told = [effect for effect in world.mind.run(0.0, 1) if isinstance(effect, Log)]
    assert len(told) == 1
    assert str(MOST_MAIL) in told[0].text


def test_a_question_is_dropped_with_its_intention_and_its_answer_is_no_belief() -> None:
    stage = Stage(
        {
            "bob": """
            !go.
            +v(X) <- .print("not here ", X).
            +!ask <- .send(amy, askOne, v(_), A); .print("not here ", A).
            +!go <- !!ask; .wait(10); .drop_intention(ask); .wait(100); .send(amy, askOne, w(_), A); .print(A).
            """,
            "amy": "w(1). +?v(X) <- .wait(50); X = 2.",
        }
    )
    stage.run()
    assert stage.lines == ["[bob] w(1)[source(amy)]"]


def test_two_who_tell_the_same_plan_are_its_sources_and_each_takes_back_its_own() -> None:
    tells = '.send(bob, tellHow, "@shared +!told <- .print(told)."); .wait({}); .send(bob, untellHow, shared)'
    stage = Stage(
        {
            "bob": """
            +!told <- .print("never reached").
            !go.
            +!go
               <- for (.member(T, [5,40,40,40])) {
                     .wait(T); .relevant_plans({ +!told }, _, L); .length(L, N); .print(N)
                  }.
            """,
            "amy": f"!go. +!go <- {tells.format(60)}.",
            "joe": f"!go. +!go <- {tells.format(100)}.",
        }
    )
    stage.run()
    assert stage.lines == [f"[bob] {number}" for number in (2, 2, 2, 1)]
