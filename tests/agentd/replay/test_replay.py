"""A mind that lives again from its recorded course decides and does the same; an edited one shows where it parts."""

import tracemalloc
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any
from zlib import compress

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agentd.conversion.term_conversion import perceived
from agentd.language.parse import parse_formula
from agentd.language.terms.terms import EMPTY, Literal, atom, make_list
from agentd.mind.data.effects import Effect, PerformAction, TeamRequest
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import (
    ActionDone,
    BeliefAdded,
    GoalAdded,
    Input,
    Mail,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    PerceptsChanged,
    SignalRaised,
    TeamReply,
    TimeRead,
    TooDeep,
)
from agentd.replay.replay import CannotReplay, acts, compare, replay
from agentd.trace.initial_state import MOST_UNPACKED
from agentd.trace.input_log import MOST_BYTES
from agentd.trace.input_records import (
    UNWRITTEN,
    CameBack,
    Interrupted,
    MailRefused,
    NamesRead,
    Unreadable,
    read,
    written,
)
from schemas.wire.codec import codec
from schemas.wire.mind_records import DecisionView, MindDecisions, MindInput
from schemas.wire.records import Perception
from tests.agentd.minds import term
from tests.agentd.traced import Traced
from tests.support.amount import some_of

Schedule = list[tuple[float, list[Input]]]
"""Seconds that go by, and what is fed then."""


def live(traced: Traced, schedule: Iterable[tuple[float, list[Input]]], cycles: int = 7) -> None:
    """Let a mind live: in each turn it runs until there is nothing to do, some cycles at a time."""
    now = [traced.start]
    traced.mind.clock = lambda: now[0]
    for turn, (seconds, items) in enumerate(schedule):
        for item in items:
            traced.mind.feed(item)
        for _ in range(200):
            now[0] += 0.0007
            traced.run(now[0], cycles)
            if not traced.mind.ready:
                break
        if turn % 5 == 0:
            traced.course.flush()
        now[0] += seconds


PROGRAMS = {
    "random numbers": "!s. +!s <- .random(R); .random([a,b,c],M); .shuffle([1,2,3,4],L); .print(R,M,L); .wait(40); !s.",
    "a seed of its own": "!s. +!s <- .set_random_seed(7); .random(R); .print(R); .wait(90); !s.",
    "nanoseconds": "!s. +!s <- .nano_time(T); .wait(30); .nano_time(U); .print(U-T); !s.",
    "date and time": "!s. +!s <- .date(Y,M,D); .time(H,I,S,L); .print(Y,M,D,H,I,S,L); .wait(100); !s.",
    "time as a function": "born(system.time). !s. +!s : born(B) <- .print(system.time - B); .wait(30); !s.",
    "time in a context": "late :- system.time > 300. !s. +!s : late <- .print(late). +!s <- .wait(20); !s.",
    "its name": "!s. +!s <- .my_name(N); .print(N).",
    "timeouts": "!s. +!s <- .wait({+never}, 50, E); .print(E); !s. -!s[error(E)] <- .print(E); !s.",
    "how long a wait took": "!s. +!s <- .wait({+p(_)}, 5000, E); .print(E); !s.",
    "a formula to wait for": "!s. +!s <- .wait(p(X) & X > 3, 5000, E); .print(X, E); -+p(0); !s.",
    "events at a later time": '!s. +!s <- .at("now +70 ms", {+!go}). +!go <- .print(go); !s.',
    "all names": "!s. +!s <- .all_names(L); .print(L); .wait(45); !s.",
    "who is not there": "!s. +!s <- .send(eve, tell, x); .print(sent); .wait(30); !s. "
    "-!s[error(E)] <- .print(E); .wait(30); !s.",
    "mail": "+hello(X)[source(S)] <- .send(S, tell, hello(X+1)); .print(X, S).",
    "questions": "!s. p(1). +!s <- .send(ann, askOne, v(X), A, 60); .print(A); !s.",
    "broadcasts": "!s. +!s <- .broadcast(tell, n(1)); .wait(35); !s.",
    "actions": "!s. +!s <- fly(1); .print(ok); !s. -!s[error(E), reason(R)] <- .print(E, R); .wait(20); !s.",
    "drops": "!s. !t. +!s <- fly(2). +!t <- .wait(60); .drop_intention(s); .print(dropped); !!s; !t.",
    "the team": '!s. +!s <- .create_agent(N, "x.asl"); .print(N); .kill_agent(N); .wait(25); !s. '
    "-!s[error_msg(M)] <- .print(M); .wait(25); !s.",
    "services": '!s. +!s <- .df_search("fly", L); .print(L); .wait(25); !s. -!s <- .print(none); .wait(25); !s.',
    "percepts": "+p(X) : X > 2 <- .print(high, X). +p(X) <- .print(low, X). -p(X) <- .print(gone, X).",
    "signals": "+s(X) <- .print(X). +!g(X) <- .print(goal, X). +b(X)[source(S)] <- .print(S, X).",
    "an atomic plan": "@a[atomic] +p(X) <- .print(1); .print(2); .wait(10); .print(3). +hello(X) <- .print(X).",
    "beliefs with annotations": "+hello(X)[source(S), t(T)] <- +seen(X)[at(T)]; ?seen(X)[at(Y)]; .print(X, Y, S).",
    "variables in mail": "+ask(X, Y)[source(S)] <- .print(X, Y); .send(S, tell, ask(Y, X)). "
    "+!kqml_received(A,B,C,D) <- .print(A,B,C,D).",
}


class World:
    """What the world answers to what a mind does: actions end, the team replies, some mail is refused."""

    def __init__(self, source: str, **arguments: Any) -> None:
        self.names = ["bob", "ann"]
        self.traced = Traced.of(source, start=0.1, seed=3, epoch=1.7e9, agents=self.names, **arguments)
        self._run = self.traced.run
        self.traced.run = self.run  # type: ignore[method-assign]
        self.traced.mind.post_office = self.post
        self._answers: list[Input] = []
        self._count = 0

    def run(self, now: float, cycles: int) -> list[Effect]:
        effects = self._run(now, cycles)
        for effect in effects:
            self._count += 1
            match effect:
                case PerformAction(id=number):
                    ok = self._count % 3 != 0
                    self._answers.append(ActionDone(number, ok, "" if ok else "wind", "" if ok else "failed"))
                case TeamRequest(id=number, what="create"):
                    self._answers.append(TeamReply(number, f"x_{self._count}"))
                case TeamRequest(id=number, what="df_search"):
                    self._answers.append(TeamReply(number, make_list([atom("ann"), atom("x")])))
                case TeamRequest(id=number) if self._count % 2:
                    self._answers.append(TeamReply(number, None, "action_failed", "no"))
                case TeamRequest(id=number):
                    self._answers.append(TeamReply(number, EMPTY))
        return effects

    def post(self, mail: Mail) -> None:
        self._count += 1
        course, cycle = self.traced.course, self.traced.mind.cycle
        if self._count % 4 == 0:
            course.given(cycle, MailRefused(mail.msg_id, "mailbox_full", "the message cannot be sent: full"))
            raise Failed("mailbox_full", "the message cannot be sent: full")
        course.did(cycle, mail)
        if mail.performative == "askOne" and self._count % 3 == 0:
            self._answers.append(Mail("ann", "tell", term("v(3)"), f"m{self._count}", mail.msg_id))

    def turns(self, schedule: Schedule) -> Iterator[tuple[float, list[Input]]]:
        for turn, (seconds, items) in enumerate(schedule):
            answers, self._answers = self._answers, []
            yield seconds, [*items, *answers]
            if turn == 20:
                self.names.append("eve")


def _lived(source: str, schedule: Schedule, cycles: int = 7, **arguments: Any) -> Traced:
    world = World(source, **arguments)
    live(world.traced, world.turns(schedule), cycles)
    return world.traced


def _inputs(turn: int) -> list[Input]:
    found: list[Input] = []
    if turn % 3 == 0:
        found.append(PerceptReplaced(perceived(Perception(name="p", parameters=(turn % 7,)))))
    if turn % 5 == 0:
        found.append(Mail("ann", "tell", term(f"hello({turn})[t({turn})]"), f"m{turn}"))
        found.append(Mail("ann", "tell", term(f"ask(X, f(X, Y, {turn}))"), f"n{turn}"))
    if turn % 7 == 0:
        found += [GoalAdded(term(f"g({turn})")), BeliefAdded(term(f"b({turn})[source(operator)]"))]
        found.append(SignalRaised(term(f"s({turn})")))
    return found


@pytest.mark.parametrize("source", PROGRAMS.values(), ids=PROGRAMS.keys())
def test_what_a_program_learns_from_the_world_it_learns_again(source: str) -> None:
    traced = _lived(source, [(0.013, _inputs(turn)) for turn in range(60)])
    batches = traced.batches
    result = replay(batches)
    assert result.agrees, result.difference
    assert (result.unheard, result.batches) == (0, len(batches))
    assert len(batches) > 10
    assert result.decisions + result.effects > 0
    assert result.cycles == traced.mind.cycle


_parts = st.lists(st.sampled_from(list(PROGRAMS.values())), min_size=1, max_size=4)
_items = st.one_of(
    st.integers(0, 9).map(lambda n: PerceptReplaced(perceived(Perception(name="p", parameters=(n,))))),
    st.integers(0, 9).map(lambda n: PerceptAdded(perceived(Perception(name="p", parameters=(n,))))),
    st.integers(0, 9).map(lambda n: PerceptRemoved(term(f"p({n})"), (0,))),
    st.integers(0, 9).map(lambda n: Mail("ann", "tell", term(f"hello({n})[t({n})]"), f"m{n}")),
    st.integers(0, 9).map(lambda n: Mail("ann", "achieve", term(f"g({n})"), f"a{n}")),
    st.integers(0, 9).map(lambda n: SignalRaised(term(f"s({n})"))),
    st.sampled_from(["s", "t", "g(1)"]).map(lambda text: GoalAdded(term(text))),
)
_schedules = st.lists(st.tuples(st.floats(0, 0.2), st.lists(_items, max_size=4)), min_size=1, max_size=25)


@settings(max_examples=some_of(50, 2))
@given(_parts, _schedules, st.integers(1, 40))
def test_any_programs_on_any_inputs_live_again_the_same(parts: list[str], schedule: Schedule, cycles: int) -> None:
    traced = _lived("\n".join(parts), schedule, cycles)
    result = replay(traced.batches)
    assert result.agrees, result.difference


def test_a_life_whose_decisions_were_not_noted_is_compared_by_its_effects() -> None:
    traced = _lived(PROGRAMS["percepts"], [(0.01, _inputs(turn)) for turn in range(40)], decisions=0)
    assert replay(traced.batches).agrees


def test_a_look_at_formulas_with_rules_of_any_kind_changes_nothing() -> None:
    source = PROGRAMS["random numbers"] + " odd :- .random(R) & R > 0.5 & .print(R) & system.time > 0."
    traced, other = (Traced.of(source, seed=5) for _ in range(2))
    formula = parse_formula("odd")
    for turn in range(200):
        traced.run(turn * 0.01, 3)
        other.run(turn * 0.01, 3)
        if turn == 0:
            other.mind.query(formula)  # what it names is known to both
        traced.mind.query(formula)
    ours, theirs = traced.batches, other.batches
    assert [(b.decided, b.digest) for b in ours] == [(b.decided, b.digest) for b in theirs]
    assert not any(item.kind == "TimeRead" for b in ours for item in b.inputs)


def test_an_intention_that_grows_too_deep_fails_at_the_same_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mind.mind.MOST_FRAMES", 50)
    source = "!s. +!s <- !d(0); .print(no). +!d(N) <- !d(N+1); .print(up). -!s <- .print(over)."
    for cycles in (1, 3, 17):
        traced = Traced.of(source)
        live(traced, [(0.1, [])] * 5, cycles)
        batches = traced.batches
        assert any(item.kind == "TooDeep" for b in batches for item in b.inputs)
        assert replay(batches).agrees


# --- an edited program ---

LANDS = """\
+altitude(A) : A > 10 <- .print(high, A); land.
+altitude(A) : A > 4 <- .print(low, A).
+altitude(A).
"""


def _flown() -> Traced:
    traced = Traced.of(LANDS)
    levels = [1, 5, 9, 11, 8, 2]
    live(traced, [(0.1, [PerceptReplaced(term(f"altitude({level})"))]) for level in levels])
    return traced


def test_an_edited_program_shows_its_first_difference_and_what_each_did_next() -> None:
    result = compare(_flown().batches, program=LANDS.replace("A > 10", "A > 8"))
    found = result.difference
    assert found.exact
    assert found.recorded is not None
    assert found.replayed is not None
    assert found.recorded.text == "+altitude(9)[source(percept)]: +altitude(A) (bob.asl:2)"
    assert found.replayed.text == "+altitude(9)[source(percept)]: +altitude(A) (bob.asl:1)"
    assert found.recorded.decision is not None
    assert [one.message for one in found.recorded.decision.rejected] == ["9 > 10 does not hold"]
    assert found.inputs[-1].endswith("percept altitude(9)")
    assert next(act.text for act in found.recorded_next if act.kind == "effect") == "print low9"
    assert [act.text for act in found.replayed_next if act.kind == "effect"][:2] == ["print high9", "action land #1"]
    assert (result.decisions, result.effects) == (2, 1)


@pytest.mark.parametrize(
    "edited",
    [
        LANDS,
        "// a comment\n\n" + LANDS.replace("+altitude(A) :", "@label +altitude(A) :", 1),
        LANDS.replace("A > 4", "A > 3"),
        LANDS + "+never(X) <- .print(X).\nrule(X) :- X > 2.\n",
    ],
    ids=["the same", "other lines", "a bound that makes no difference", "more that is not used"],
)
def test_an_edit_that_changes_nothing_agrees(edited: str) -> None:
    result = compare(_flown().batches, program=edited)
    assert result.agrees, result.difference


def test_an_edited_plan_differs_where_it_is_first_used() -> None:
    result = compare(_flown().batches, program=LANDS.replace(".print(low, A)", ".print(lower, A)"))
    assert result.difference.inputs[-1].endswith("percept altitude(5)")
    assert [act.text for act in result.difference.replayed_next[:1]] == ["print lower5"]


def test_a_goal_that_the_edited_program_has_besides_differs_immediately() -> None:
    result = compare(_flown().batches, program=LANDS + "!more. +!more <- .print(more).")
    assert result.difference is not None
    assert result.difference.recorded is None or result.difference.recorded.cycle <= 1
    assert result.difference.replayed.text.startswith("+!more")


def test_acts_tell_a_life_with_its_decisions_up_to_a_cycle(tmp_path: Path) -> None:
    batches = _flown().batches
    everything = list(acts(batches))
    assert [act.text for act in everything if act.kind == "effect"][:2] == ["print low5", "print low9"]
    until = everything[3].cycle
    assert list(acts(batches, until=until)) == [act for act in everything if act.cycle <= until]
    edited = tmp_path / "edited.asl"
    edited.write_text(LANDS.replace("low", "lower"))
    assert any(act.text == "print lower5" for act in acts(batches, program=edited))


# --- what cannot be ---


def _with(batches: list[Any], number: int, **fields: Any) -> list[Any]:
    return [msgspec.structs.replace(b, **fields) if b.number == number else b for b in batches]


def test_a_recording_that_is_no_whole_life_is_refused_in_words() -> None:
    batches = _flown().batches
    born = batches[0].initial
    assert born is not None
    with pytest.raises(CannotReplay, match="there are no inputs of a mind in the recording"):
        replay([])
    with pytest.raises(CannotReplay, match="begins with batch 1: its initial is missing"):
        replay(batches[1:])
    with pytest.raises(CannotReplay, match=r"batch 1 is missing: what went in then is not known"):
        replay([batches[0], msgspec.structs.replace(batches[1], number=2)])
    with pytest.raises(CannotReplay, match=r"batch 1 to 4 are missing"):
        replay([batches[0], msgspec.structs.replace(batches[1], number=5)])
    with pytest.raises(CannotReplay, match="is of ann, not of bob"):
        replay(_with(batches, 1, agent="ann"))
    with pytest.raises(CannotReplay, match="counts cycles in which nothing can have happened"):
        replay([*batches[:-1], msgspec.structs.replace(batches[-1], last=10**30)])
    cloned = msgspec.structs.replace(born, unknown="it is a clone of ann")
    with pytest.raises(CannotReplay, match="bob cannot be replayed: it is a clone of ann"):
        replay(_with(batches, 0, initial=cloned))
    bomb = b64encode(compress(bytes(MOST_UNPACKED + 1))).decode()
    with pytest.raises(CannotReplay, match="cannot be read: it is cut off, or has more than 64000000 bytes"):
        replay(_with(batches, 0, initial=msgspec.structs.replace(born, memory=bomb)))
    with pytest.raises(CannotReplay, match=r"bob\.asl:1:1: "):
        compare(batches, program="} no program")
    with pytest.raises(CannotReplay, match=r"gone\.asl: No such file"):
        compare(batches, program=Path("gone.asl"))
    with pytest.raises(CannotReplay, match=r"has no file lib\.asl; its files are bob\.asl"):
        compare(batches, files={"lib.asl": ""})
    strange = [MindInput(cycle=3, kind="Telepathy")]
    with pytest.raises(CannotReplay, match=r"`Telepathy` of cycle 3 is not known to this version"):
        replay(_with(batches, 1, inputs=tuple(strange)))


def test_a_life_that_was_another_is_reported_with_the_decision_that_differs() -> None:
    traced = _flown()
    batches = traced.batches
    born = batches[0].initial
    assert born is not None
    views = [view for view in traced.mind.decision_views() if hasattr(view, "chosen")]
    records = tuple(msgspec.convert(view, DecisionView, from_attributes=True) for view in views)
    decisions = [MindDecisions(agent="bob", decisions=records)]
    other = msgspec.structs.replace(born, files={"bob.asl": LANDS.replace("A > 10", "A > 8")})
    changed = _with(batches, 0, initial=other)
    result = replay(changed, decisions)
    assert result.difference.exact
    assert result.difference.recorded.text == "+altitude(9)[source(percept)]: +altitude(A) (bob.asl:2)"
    assert result.difference.replayed.text == "+altitude(9)[source(percept)]: +altitude(A) (bob.asl:1)"
    without = replay(changed)
    assert not without.difference.exact
    assert without.difference.batch == result.difference.batch


def test_batches_made_while_nobody_listened_are_lived_but_not_proven() -> None:
    traced = Traced.of(LANDS, listened=False)
    live(traced, [(0.1, [PerceptReplaced(term(f"altitude({level})"))]) for level in (1, 9, 12)])
    kept = traced.course.since_start()
    assert kept is not None
    result = replay(list(kept))
    assert (result.agrees, result.unheard) == (True, result.batches)
    assert result.notes == (
        f"{result.batches} of {result.batches} batches have no digest: nobody listened when they were made",
    )


# --- what goes in, as records ---

GIVEN: list[Any] = [
    PerceptReplaced(perceived(Perception(name="p", parameters=(1.5, "x"))), (0, 1)),
    PerceptAdded(Literal(term("online(ann)").sig, term("online(ann)").args, term("x[board(b)]").annots)),
    PerceptRemoved(term("p(1)"), (0,)),
    PerceptsChanged({(term("p(1)").sig, term("p(1)").args): term("p(1)"), (term("q(2)").sig, term("q(2)").args): None}),
    Mail("ann", "tell", term('f(X, g(X, _), [1,2|T], "s", ~n::m(3)[a])'), "m1", "m0"),
    Mail("ann", "tellHow", "+!g : c <- !a.", "m1"),
    ActionDone(3, False, "wind", "failed"),
    ActionDone(4, True),
    TeamReply(1, "x_2"),
    TeamReply(2, make_list([atom("a"), atom("b")])),
    TeamReply(3, None, "unknown", "why"),
    GoalAdded(term("go(1)")),
    BeliefAdded(term("b(true, -0.0, 1.0e300)[source(operator)]")),
    SignalRaised(Literal(term("s").sig)),
    TimeRead(0.1 + 0.2),
    TooDeep(),
    NamesRead(("a", "b")),
    MailRefused("mid1.bob", "mailbox_full", "full"),
    CameBack(2, (term('interrupted(go(1), failed, "x")'),)),
    Interrupted(term('interrupted(go(1), failed, "x")')),
]


@pytest.mark.parametrize("item", GIVEN, ids=lambda item: type(item).__name__)
@pytest.mark.parametrize("wire", ["json", "msgpack"])
def test_what_goes_in_crosses_the_wire_whole(item: Any, wire: Any) -> None:
    record = written(7, item, {})
    made = codec(MindInput)
    crossed = made.decode(made.encode(record, wire), made.encodings[wire])
    again = read(crossed)
    assert type(again) is type(item)
    assert repr(again) == repr(item)
    assert written(7, again, {}) == record
    literal = getattr(item, "literal", None)
    if literal is not None:
        assert (again.literal.annots is literal.annots) or again.literal.annots == literal.annots  # type: ignore[union-attr]


def test_what_has_no_form_on_the_wire_is_reported_when_it_is_read() -> None:
    deep: Any = "x"
    for _ in range(200):
        deep = make_list([deep])
    record = written(3, Mail("ann", "tell", deep), {})
    assert record.kind == UNWRITTEN
    with pytest.raises(Unreadable, match="the input of cycle 3 could not be recorded: nested deeper than 100"):
        read(record)


# --- what is kept for who comes late ---


def scan(number: int) -> Any:
    return perceived(Perception(name="scan", parameters=[[number + place / 8 for place in range(360)]]))


def photo(number: int) -> Any:
    return perceived(Perception(name="photo", parameters=[f"{number:05}" * 4_000]))


def of_an_environment(make: Callable[[int], Any], number: int) -> Any:
    literal = make(number)
    return PerceptsChanged({(literal.sig, literal.args): literal})


@pytest.mark.parametrize(
    "given",
    [
        lambda number: PerceptReplaced(scan(number)),
        lambda number: PerceptReplaced(photo(number)),
        lambda number: of_an_environment(scan, number),
        lambda number: of_an_environment(photo, number),
        lambda number: Mail("ann", "signal", scan(number), f"mid{number}.ann"),
        lambda number: Mail("ann", "signal", photo(number), f"mid{number}.ann"),
        lambda number: TeamReply(number, photo(number)),
    ],
    ids=["scans", "texts", "scans of an environment", "texts of an environment", "mail", "mail of texts", "answers"],
)
def test_large_inputs_are_weighed_as_they_are(given: Callable[[int], Any]) -> None:
    """What is kept is bounded in the memory that it really takes, not by a number of inputs."""
    traced = Traced.of("x.", listened=False)
    course = traced.course
    tracemalloc.start()
    try:
        before, most = tracemalloc.get_traced_memory()[0], 0
        for number in range(1_000):
            course.given(number + 1, given(number))
            course.ran(number + 1, number * 0.05)
            if number % 10 == 0:
                most = max(most, tracemalloc.get_traced_memory()[0] - before)
            if not course.on:
                break
        else:
            raise AssertionError(f"all is kept, {most} bytes")
        gone = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert most < 2 * MOST_BYTES
    assert gone < MOST_BYTES / 4
