"""Messages in a team on virtual time: floods, their bounds, and the order of what arrives."""

from agentd.mind.data.effects import Log
from agentd.mind.data.inputs import Mail
from agentd.mind.state import MOST_MAIL
from tests.agentd.minds import World, mind_of, term
from tests.agentd.teams import played
from tests.support.amount import some_of


def test_thousands_of_messages_to_an_agent_that_is_busy_arrive_in_their_order() -> None:
    count = some_of(10_000)
    assert played(
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
            +!go <- for (.range(I, 1, COUNT)) { .send(bob, tell, m(I)) }; .wait(1000); .send(bob, tell, done).
            """.replace("COUNT", str(count)),
        }
    ) == [f"[bob] {count}"]


def test_messages_beyond_the_bound_are_dropped_counted_and_reported_once() -> None:
    world = World(mind_of("+!go <- .wait(never). @a[atomic] +!busy <- .wait(1000)."))
    mail = Mail("amy", "tell", term("m(1)"))
    for _ in range(MOST_MAIL + 5):
        world.mind.feed(mail)
    assert world.mind.drops.counts == {"messages": 5}
    told = [effect for effect in world.mind.run(0.0, 1) if isinstance(effect, Log)]
    assert len(told) == 1
    assert str(MOST_MAIL) in told[0].text


def test_a_question_is_dropped_with_its_intention_and_its_answer_is_no_belief() -> None:
    assert played(
        {
            "bob": """
            !go.
            +v(X) <- .print("not here ", X).
            +!ask <- .send(amy, askOne, v(_), A); .print("not here ", A).
            +!go <- !!ask; .wait(10); .drop_intention(ask); .wait(100); .send(amy, askOne, w(_), A); .print(A).
            """,
            "amy": "w(1). +?v(X) <- .wait(50); X = 2.",
        }
    ) == ["[bob] w(1)[source(amy)]"]


def test_an_answer_counts_only_from_who_was_asked() -> None:
    world = World(mind_of("!go. +!go <- .send(amy, askOne, v(_), A); .print(A)."))
    world.settle()
    (question,) = world.mind.questions
    world.mind.feed(Mail("joe", "tell", term("v(1)"), "1", question))
    world.mind.feed(Mail("joe", "tellHow", "+!told.", "2", question))
    world.settle()
    assert list(world.mind.questions) == [question]
    world.mind.feed(Mail("amy", "tell", term("v(2)"), "1", question))
    world.settle()
    assert world.prints == ["v(2)[source(amy)]"]


def test_an_answer_names_who_gave_it_once_whether_or_not_it_named_itself() -> None:
    for given in ("v(2)", "v(2)[source(self)]", "v(2)[source(amy)]"):
        world = World(mind_of("!go. +!go <- .send(amy, askOne, v(_), A); .print(A)."))
        world.settle()
        (question,) = world.mind.questions
        world.feed(Mail("amy", "tell", term(given), "1", question))
        assert world.prints == ["v(2)[source(amy)]"]


def test_a_question_without_an_answer_is_for_the_plan_of_the_one_asked_for_messages_that_fail() -> None:
    ask = "!go. +!go <- .send(bob, askOne, {}, A); .print(A)."
    own = "-!kqml_received(S, askOne, C, M)[error(E)] : C = v(_) | C = w(_) <- .send(S, tell, sorry(E), M)."
    bob = f"+?v(X) <- .fail(error_msg(no)). +?u(X) : false. {own}"
    answers = {
        "v(_)": "sorry(internal_action)[source(bob)]",
        "w(_)": "sorry(test_goal_failed)[source(bob)]",
        "x(_)": "false",
    }
    for question, answer in answers.items():
        assert played({"bob": bob, "amy": ask.format(question)}) == [f"[amy] {answer}"]


def test_two_who_tell_the_same_plan_are_its_sources_and_each_takes_back_its_own() -> None:
    tells = '.send(bob, tellHow, "@shared +!told <- .print(told)."); .wait({}); .send(bob, untellHow, shared)'
    assert played(
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
    ) == [f"[bob] {number}" for number in (2, 2, 2, 1)]
