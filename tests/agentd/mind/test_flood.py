"""An agent that floods itself: bounded, counted, told, and still there for others."""

import pytest

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.mind import Mind
from agentd.mind.data.effects import Log, Print
from agentd.mind.data.inputs import Mail, PerceptAdded
from agentd.standalone.standalone_team import Team, VirtualClock
from tests.agentd.minds import mind_of, run, term

FLOOD = """
    !a.
    +!a <- !!a; !!a; +tick; -tick; !!a[again]; !!a.
    +tick <- !!a.
    +!hello(X)[source(S)] <- .send(S, tell, heard(X)).
    +ball(X)[source(percept)] <- .print("ball ", X).
    +?height(5).
"""


@pytest.fixture(autouse=True)
def _low_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mind.state.MOST_FOCUSES", 500)
    monkeypatch.setattr("agentd.mind.state.FOR_OTHERS", 50)


def focuses(mind: Mind) -> int:
    return len(mind.events) + len(mind.all_intentions())


def test_events_without_end_are_bounded_counted_and_reported_once_in_a_while() -> None:
    mind = mind_of(FLOOD)
    told: list[str] = []
    for second in range(25):
        for _ in range(20):
            told += [e.text for e in mind.run(float(second), 100) if isinstance(e, Log)]
            assert focuses(mind) <= 1100
    first = "more than 500 events and intentions; events such as +!a/0 are dropped"
    assert told[0] == first
    assert [text.startswith(first) for text in told] == [True] * 3
    assert "so far)" in told[1]
    assert mind.drops.counts["events"] > 1000
    last = mind.drops.unlogged(mind.now)
    assert [note.text for note in last] == [f"{mind.drops.counts['events']} events were dropped in all"]
    assert mind.drops.unlogged(mind.now) == []


def test_messages_and_percepts_are_still_handled() -> None:
    mind = mind_of(FLOOD)
    effects = [e for _ in range(100) for e in mind.run(0.0, 100)]
    mind.feed(Mail("ann", "achieve", term("hello(1)")))
    mind.feed(PerceptAdded(term("ball(7)")))
    for _ in range(20_000):
        effects += mind.run(0.0, 10)
        if any(isinstance(e, Mail) for e in effects) and any(isinstance(e, Print) for e in effects):
            break
    assert [e.content for e in effects if isinstance(e, Mail)] == [term("heard(1)")]
    assert [e.text for e in effects if isinstance(e, Print)] == ["ball 7"]


def test_others_who_flood_are_bounded_too() -> None:
    mind = mind_of("+!wait <- .wait(100000).")
    for number in range(2000):
        mind.feed(Mail("eve", "achieve", term(f"wait[n({number})]")))
    for _ in range(3000):
        mind.run(0.0, 1)
    assert focuses(mind) <= 600
    assert mind.drops.counts["events"] >= 1400


def test_branches_without_end_fail_their_plan() -> None:
    world = run("!top. +!top <- !g. +!g <- (!g |&| !g). -!top[error(E)] <- .print(E).")
    assert world.prints == ["too_many_intentions"]
    assert world.mind.all_intentions() == []


def test_a_question_that_cannot_be_taken_is_counted_and_reported() -> None:
    world = run("!a. +!a <- for (.range(I,1,600)) { !!b }. +!b <- .wait(100000). +?height(5).")
    world.feed(Mail("ann", "askOne", term("height(H)"), "m1"))
    assert world.mind.drops.counts["questions"] == 1
    assert "questions such as that of ann get no answer" in world.logs[-1]


def test_suspended_intentions_count_as_well() -> None:
    world = run("!a. +!a <- for (.range(I,1,1000)) { !!b }. +!b <- .suspend.")
    assert len(world.mind.all_intentions()) <= 501


def test_the_end_of_a_run_tells_the_number(capsys: pytest.CaptureFixture[str]) -> None:
    source = "!a. +!a <- for (.range(I,1,1000)) { !!b }; .stopMAS. +!b <- .wait(1000000)."
    program = compile_program(parse_program(source, "flood.asl"))
    assert Team([("bob", program)], clock=VirtualClock()).run(60, True) == 0
    first, last = capsys.readouterr().err.splitlines()
    assert first == "[bob] warning: more than 500 events and intentions; events such as +!b/0 are dropped"
    assert last == "[bob] warning: 500 events were dropped in all"
