"""What is said of a view of a mind: where a question is, what is asked about, and texts of any kind."""

import pytest
from msgspec.structs import replace

from argosy.why import Explanation, Line, MailFacts, Paragraph, explain_view, plain
from argosy.why.question import subject_of, taken_apart
from argosy.why.wording import without_annotations
from schemas.humanize import span
from schemas.wire.mind_records import (
    BeliefView,
    DecisionView,
    DropView,
    FailureView,
    IntentionView,
    MindView,
    PlanView,
    QuestionView,
    WaitView,
)
from schemas.wire.records import DeadLetter, Mailboxes, Message, Queue, Refusal

ASKING = MindView(
    agent="uav",
    time=20.0,
    questions=(
        QuestionView(
            id="sync1.uav", receiver="base", performative="askOne", content="depth(_)", asked=8.0, position="u.asl:3"
        ),
    ),
)
LETTER = Message(id="sync1.uav.life", sender="uav", performative="askOne", receiver="base", content="x")


def where(facts: MailFacts) -> list[str]:
    """The lines that say where the question is."""
    facts.asked = True
    (paragraph,) = [one for one in explain_view(ASKING, facts=facts).paragraphs if one.kind == "question"]
    assert paragraph.lines[0].text == (
        "12 s ago (mission second 8.0): asked base at u.asl:3: askOne depth(_). No answer yet."
    )
    assert paragraph.lines[1].text == "The plan waits for the answer without a time limit."
    return [line.text for line in paragraph.lines[2:]]


def board(name: str, *queues: Queue, dead: tuple[DeadLetter, ...] = ()) -> Mailboxes:
    return Mailboxes(board=name, queues=queues, dead=dead)


def queue(box: str, sender: str, receiver: str, messages: int = 1, state: str = "") -> Queue:
    return Queue(box=box, sender=sender, receiver=receiver, messages=messages, state=state)  # type: ignore[arg-type]


def decided(outcome: str, **more: object) -> MindView:
    """The mind of `base` with its decision about the question."""
    made = {
        "cycle": 1,
        "time": 1.0,
        "event": "+?depth(_)[source(uav)]",
        "kind": "+?",
        "name": "depth/1",
        "source": "uav",
    }
    plan = PlanView(trigger="+?depth(D)", position="base.asl:2")
    decision = DecisionView(**made, chosen=plan, outcome=outcome, intention=4, **more)  # type: ignore[arg-type]
    waiting = IntentionView(id=4, state="waiting", waits_for=WaitView(kind="action", name="dive"), at="base.asl:3")
    return MindView(agent="base", decisions=(decision,), intentions=(waiting,))


FAILED = FailureView(
    cycle=1, time=1.0, formula="dive(3)", position="base.asl:3", error="action_failed", reason="too cold"
)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        (
            MailFacts(
                boards=[board("pi1", dead=(DeadLetter(message=LETTER, reason=Refusal(code="expired"), stamp=1),))]
            ),
            ["The message is a dead letter: expired."],
        ),
        (
            MailFacts(boards=[board("pi2", queue("inbox", "uav", "base", 3))]),
            ["It is one of 3 messages that wait in base's mailbox at pi2: base does not take its mail."],
        ),
        (MailFacts(homes={"bass": "pi1", "uav": "pi1"}), ["No board knows an agent `base`, did you mean `bass`?"]),
        (
            MailFacts(homes={"base": "pi2"}, silent={"pi2": "no rights"}),
            ["base belongs to pi2, which does not answer: no rights."],
        ),
        (MailFacts(homes={"base": "pi2"}), ["No board holds the message, and base does not answer queries."]),
        (
            MailFacts(minds={"base": MindView(agent="base", state="paused", mailbox=2)}),
            ["base is paused by an operator.", "base has received it and not read it yet: 2 messages are unread."],
        ),
        (
            MailFacts(
                boards=[board("pi1", queue("outbox", "base", "uav", state="pi1 is away"))],
                minds={"base": MindView(agent="base")},
            ),
            ["base has answered. Its answer waits in the outbox of pi1: pi1 is away."],
        ),
        (
            MailFacts(minds={"base": MindView(agent="base", plans=(PlanView(trigger="+!go"),))}),
            [
                "base has no plan for +?depth: it answers from its beliefs.",
                "base has no trace of it: the answer is on its way, or was lost in a restart.",
            ],
        ),
        (
            MailFacts(minds={"base": decided("running")}),
            [
                "base received it and chose the plan +?depth(D) (base.asl:2), which still runs: it is at base.asl:3, "
                "and waits for the action dive."
            ],
        ),
        (
            MailFacts(minds={"base": decided("failed", failure=FAILED)}),
            [
                "base received it and chose the plan +?depth(D) (base.asl:2), which failed at base.asl:3: the action "
                "dive(3) failed: too cold.",
                "This failure sends no answer.",
            ],
        ),
        (
            MailFacts(minds={"base": decided("dropped")}),
            ["base received it and chose the plan +?depth(D) (base.asl:2), which was dropped: no answer will come."],
        ),
        (
            MailFacts(minds={"base": decided("ended")}),
            ["base has answered with the plan +?depth(D) (base.asl:2): the answer is on its way."],
        ),
    ],
)
def test_it_is_told_where_a_question_is(facts: MailFacts, said: list[str]) -> None:
    assert where(facts) == said


@pytest.mark.parametrize(
    ("asked", "text", "fits"),
    [
        ("go", "+!go(3,4)[source(bob)]", True),
        ("go/2", "+!go(3,4)", True),
        ("go/1", "+!go(3,4)", False),
        ("!go(3,_)", "+!go(3,4)", True),
        ("!go(3.0,X)", "+!go(3,f(4,5))", True),
        ("!go(4,_)", "+!go(3,4)", False),
        ("!go", "+go(3)", False),
        ("?go", "+?go(3)", True),
        ("-go", "-go(3)", True),
        ("-go", "+go(3)", False),
        ("~landed", "+~landed", True),
        ("landed", "+~landed", False),
        ('say("a, b)")', '+!say( "a, b)" )', True),
        ("ns::go", "+!ns::go", True),
        (".send", ".send(bob,tell,x)", True),
        ("goto", "goto(1,2)", True),
    ],
)
def test_what_is_asked_about_fits(asked: str, text: str, fits: bool) -> None:
    assert subject_of(asked).is_of(text) is fits


def test_annotations_and_arguments_are_taken_apart_whatever_stands_in_them() -> None:
    assert without_annotations('-!fly("a]b[c",[1,2])[error_msg("x \\" ](["),source(self)]') == '-!fly("a]b[c",[1,2])'
    assert without_annotations("+!go") == "+!go"
    assert without_annotations('+say("open[') == '+say("open['
    assert taken_apart("f(\"a,b\",[c,d],g(h,'i,j'))") == ("f", ('"a,b"', "[c,d]", "g(h,'i,j')"))
    assert taken_apart("f") == ("f", ())


def test_times_are_told_as_people_read_them() -> None:
    assert [span(seconds) for seconds in (0.04, 9.9, 10.4, 119, 125, 3700)] == [
        "0.0 s",
        "9.9 s",
        "10 s",
        "119 s",
        "2 min 5 s",
        "1 h 1 min",
    ]


def test_what_is_dropped_of_messages_and_questions_is_told() -> None:
    drops = (
        DropView(what="messages", name="bob", count=2, first=1.0, last=2.0, reason="more than 3 messages wait"),
        DropView(what="questions", name="ann", count=1, first=3.0, last=3.0),
    )
    told = explain_view(
        MindView(agent="uav", time=5.0, drops=drops, dropped={"messages": 2, "questions": 1, "events": 7})
    )
    assert [line.text for one in told.paragraphs if one.kind == "dropped" for line in one.lines] == [
        "7 events were dropped because their queue was full.",
        "3.0 s ago (mission second 2.0): 2 messages of bob were dropped unread, the first 4.0 s ago (mission second "
        "1.0).",
        "Why: more than 3 messages wait.",
        "2.0 s ago (mission second 3.0): 1 question of ann got no answer.",
    ]


def test_long_lines_are_broken_for_a_terminal_and_nothing_of_a_program_reaches_it_as_a_command() -> None:
    line = Line("one two three four five six seven eight nine ten", 1)
    assert plain(Explanation("a", paragraphs=(Paragraph("now", (line,)),)), 40) == (
        "  one two three four five six seven\n      eight nine ten"
    )
    event = '+!say("\x1b[2J")'
    made = DecisionView(cycle=1, time=0.0, event=event, kind="+!", name="say/1")
    assert plain(explain_view(MindView(agent="a", decisions=(made,)), "say")).isprintable() is False  # line feeds
    assert "\x1b" not in plain(explain_view(MindView(agent="a", decisions=(made,)), "say"))


PLAN = PlanView(trigger='+!go("go/1")', position="go/uav.asl:4", uses={"!go/1": "go/uav.asl:5", "tell/1": "lib.asl:1"})
BAD = FailureView(
    cycle=2,
    time=2.0,
    formula='takeoff("go/uav")',
    position="go/uav.asl:5",
    error="action_failed",
    reason='"go/1" is bad',
)
INNER = IntentionView(
    id=1, state="waiting", stack=("+!go/1",), waits_for=WaitView(kind="action", name="takeoff"), at="go/uav.asl:5"
)
AT_HOME = MindView(
    agent="uav",
    program="go/uav.asl",
    time=3.0,
    plans=(PLAN,),
    intentions=(INNER,),
    decisions=(
        DecisionView(
            cycle=1,
            time=1.0,
            event='+!go("go/1")',
            kind="+!",
            name="go/1",
            chosen=PLAN,
            outcome="dropped",
            asked_at="go/uav.asl:9",
            dropped_by='.drop_desire(go("go/1"))',
            dropped_at="go/uav.asl:7",
        ),
    ),
    failures=(BAD,),
)


def test_the_folder_of_a_program_is_cut_out_of_places_and_of_nothing_else() -> None:
    explanation = explain_view(AT_HOME)
    text = plain(explanation)
    assert 'at uav.asl:5 the action takeoff("go/uav") failed: "go/1" is bad.' in text
    assert 'for the goal !go("go/1") the plan +!go("go/1") (uav.asl:4) was chosen' in text
    assert 'It was dropped by .drop_desire(go("go/1")) (uav.asl:7).' in text
    assert "go/uav.asl" not in text
    positions = {line.position for one in explanation.paragraphs for line in one.lines}
    assert positions == {"", "go/uav.asl:4", "go/uav.asl:5", "go/uav.asl:7", "go/uav.asl:9"}, "data has them whole"
    assert "!go/1 is at uav.asl:5, in the plan" in plain(
        explain_view(replace(AT_HOME, decisions=(), failures=()), "!go/1")
    )


def test_of_a_paused_mind_it_is_said_that_more_may_wait() -> None:
    text = plain(explain_view(MindView(agent="a", state="paused", paused_for=12.0)))
    assert "Percepts, messages and goals that arrive meanwhile wait until it resumes." in text
    assert "It has no intentions" not in text


def test_of_many_names_ten_are_told() -> None:
    beliefs = tuple(BeliefView(text=f"b{number}(1)") for number in range(30))
    told = explain_view(MindView(agent="a", beliefs=beliefs), "zzzz")
    assert not told.known
    assert told.paragraphs[0].lines[0].text == (
        "a has nothing called `zzzz`; known are b0, b1, b10, b11, b12, b13, b14, b15, b16, b17 and 20 more."
    )
    assert explain_view(MindView(agent="a", beliefs=beliefs), "b3").known
