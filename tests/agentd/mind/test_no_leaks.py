"""Whatever ends an intention that waits, nothing of it is left: no wait, timer, question, request or branch."""

from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from agentd.mind import Mind
from agentd.mind.data.inputs import ActionDone, GoalAdded, Mail, TeamReply
from tests.agentd.minds import World, mind_of, term
from tests.support.amount import some_of

PROGRAM = """
+!g(0, N) <- .wait(50 * N + 1).
+!g(1, _) <- .wait(b(1)).
+!g(2, N) <- .wait({ +ev(N) }, 100 * N + 1).
+!g(3, N) <- { .wait(40) } |&| { !g(1, N) } |&| { .wait({ +ev(N) }) }.
+!g(4, N) <- { !g(6, N) } ||| { .wait(b(2), 70, E) } ||| { .wait(never) }.
+!g(5, N) <- .send(amy, askOne, v(N), A, 60); !g(0, N).
+!g(6, N) <- .send([amy,joe], askOne, v(N), A).
+!g(7, N) <- fly(N); !g(0, 1).
+!g(8, N) <- .create_agent(kid); !g(1, N).
+!g(9, N) <: b(3) <- !g(2, N). {
   +!g(2, N) <- .wait(30); !h(N).
}
+!g(10, N) <- !h(N); !g(3, N).
@atomic[atomic] +!g(11, N) <- .wait(25).
+!g(12, N) <- .at("now +80", { +!g(0, N) }); !!g(1, N); !g(2, N).
+!h(N) <- .wait(not b(N), 90).
-!g(4, N) <- .wait(20).
-!h(N) <- .wait({ -b(N) }, 30, E).
^!g(10, N)[state(S)] <- +seen(S).
+!drop(G) <- .drop_intention(G).
+!desire(G) <- .drop_desire(G).
+!event(G) <- .drop_event(G).
+!future(G) <- .drop_future_intention(G).
+!end(G) <- .succeed_goal(G).
+!lose(G) <- .fail_goal(G).
+!halt(G) <- .suspend(G).
+!go(G) <- .resume(G).
+!all <- .drop_all_intentions.
+!clear <- .resume(g(_,_)); .resume(h(_)); .drop_all_desires.
+!raise(N) <- .signal({ +ev(N) }).
+!believe(N) <- if (b(N)) { -b(N) } else { +b(N) }.
"""
KINDS = st.integers(0, 12)
NUMBERS = st.integers(1, 3)
GOALS = st.one_of(
    st.builds("g({},{})".format, KINDS, NUMBERS), st.builds("g({},_)".format, KINDS), st.builds("h({})".format, NUMBERS)
)
CONTROLS = ("drop", "desire", "event", "future", "end", "lose", "halt", "go")
STEPS = st.one_of(
    st.builds("goal g({},{})".format, KINDS, NUMBERS),
    st.builds("goal g({},{})".format, KINDS, NUMBERS),
    st.builds("goal {}({})".format, st.sampled_from(CONTROLS), GOALS),
    st.builds("goal {}({})".format, st.sampled_from(("raise", "believe")), NUMBERS),
    st.builds("answer {}".format, st.integers(0, 5)),
    st.builds("time {}".format, st.integers(1, 120)),
    st.just("goal all"),
)


def answer(mind: Mind, which: int) -> None:
    """Answer one of the questions, actions and requests that are under way."""
    asked = list(mind.questions)
    if asked and which % 3 == 0:
        mind.feed(Mail("amy", "tell", term("v(1)"), in_reply_to=asked[which % len(asked)]))
    for number in list(mind.requests)[: which % 2]:
        mind.feed(TeamReply(number, "kid"))
    for intention, _ in list(mind.waiting.values()):
        if intention.action is not None and which % 2:
            mind.feed(ActionDone(intention.action, bool(which % 4 == 1), "no"))


def places(mind: Mind) -> dict[int, list[str]]:
    """Where each intention stands."""
    found: dict[int, list[str]] = {}
    for intention in mind.running:
        found.setdefault(intention.id, []).append("running")
    for event in mind.events:
        if event[3] is not None:
            found.setdefault(event[3].id, []).append("event")
    for number in mind.waiting:
        found.setdefault(number, []).append("waiting")
    for number in mind.suspended:
        found.setdefault(number, []).append("suspended")
    return found


def left(mind: Mind) -> dict[str, Any]:
    """All that is left of intentions."""
    return {
        "running": list(mind.running),
        "events": [event[0] for event in mind.events],
        "waiting": dict(mind.waiting),
        "suspended": dict(mind.suspended),
        "questions": dict(mind.questions),
        "requests": dict(mind.requests),
        "listeners": list(mind.listeners),
        "conditions": list(mind.conditions),
        "atomic": [] if mind.atomic is None else [mind.atomic],
        "timers": [timer for timer in mind.timers.heap if not timer.over],
    }


@settings(max_examples=some_of(150), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(STEPS, max_size=25))
def test_each_intention_stands_in_one_place_and_leaves_nothing_behind(steps: list[str]) -> None:
    mind = mind_of(PROGRAM, has_team=True, agents=lambda: ("bob", "amy", "joe"))
    world = World(mind).settle()
    for step in steps:
        what, _, argument = step.partition(" ")
        if what == "goal":
            world.feed(GoalAdded(term(argument)))
        elif what == "answer":
            answer(mind, int(argument))
            world.settle()
        else:
            world.at(world.now + int(argument) / 1000)
        crowded = {number: where for number, where in places(mind).items() if len(where) > 1}
        assert not crowded, step
        assert all(intention.waiting is not None for intention, _ in mind.waiting.values()), step
    world.at(world.now + 10)
    world.feed(GoalAdded(term("clear")))
    world.at(world.now + 10)
    world.feed(GoalAdded(term("clear")))
    assert {name: found for name, found in left(mind).items() if found} == {}
    assert len(mind.goal_conditions) <= len(steps)


def test_goals_with_conditions_that_are_dropped_are_forgotten_without_any_change_of_beliefs() -> None:
    world = World(mind_of("+!g <: never <- .wait(10). +!d <- .drop_intention(g)."))
    for _ in range(300):
        world.feed(GoalAdded(term("g")))
        world.feed(GoalAdded(term("d")))
    assert len(world.mind.goal_conditions) < 100


def test_an_agent_that_asks_on_and_on_keeps_no_timers_of_the_questions_that_were_answered() -> None:
    program = """
        +!ask(N) : N > 0 <- .send(amy, askOne, v(_), v(_), 60000); !ask(N - 1).
        +!ask(0).
        +!rest <- .wait(50000).
    """
    mind = mind_of(program, agents=lambda: ("bob", "amy"))
    world = World(mind)
    world.feed(GoalAdded(term("rest")))
    world.feed(GoalAdded(term("ask(1000)")))
    most = 0
    while mind.questions:
        answer(mind, 0)
        world.settle()
        most = max(most, len(mind.timers.heap))
    assert (mind.message_count, most < 40) == (1000, True)
    assert mind.wake_at == 50.0


def test_the_events_of_at_are_forgotten_when_they_were_raised() -> None:
    world = World(mind_of('+!often(N) : N > 0 <- .at("now +1 s", {+!often(N - 1)}). +!often(0).'))
    world.feed(GoalAdded(term("often(30)")))
    for second in range(40):
        world.at(second)
    assert (world.mind.future_events, world.mind.timers.heap) == ([], [])
