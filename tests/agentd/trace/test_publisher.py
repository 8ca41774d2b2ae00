"""What an agent tells of its course on a real bus, and that it lives again by that: also after a restart."""

import asyncio
import signal
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest

from agentd.mind.data.inputs import Mail
from agentd.replay.replay import CannotReplay, compare, replay
from agentd.trace import input_log as courses
from agentd.trace import publisher as tracings
from agentd.trace.publisher import Channel, TraceSubscribers
from commd.bus.bus import Bus, open_bus
from schemas.wire import keys
from tests.agentd.daemons import mission
from tests.agentd.hosts import Board, Hosted
from tests.agentd.minds import term
from tests.agentd.recorders import Recorder
from tests.agentd.runtime.test_agent_group import KID, ONE
from tests.support.buses import FLEET, Connect, session, until
from tests.support.processes import running

GREETS = """\
count(0).
!tick.
+!tick <- .random(R); .nano_time(T); .wait(20); -+last(R, T); !tick.
+hello(X)[source(S)] : X > 3 <- .print(S, " says ", X); .send(S, tell, hello(X)).
+hello(X) <- .print("low ", X).
+!fly(H) <- takeoff(H).
-!fly(H)[reason(R)] <- .print("not flown: ", R).
"""


async def traced(board: Board) -> tuple[Hosted, Bus]:
    """An agent that greets, and the bus of an observer."""
    return await board.host("uav", GREETS, others=("ann",)), await board.connect("recorder", "tool")


def hello(number: int) -> Mail:
    return Mail("ann", "tell", term(f"hello({number})"), f"mid{number}.ann.1")


async def greeted(agent: Hosted, *numbers: int) -> None:
    """Greet an agent and wait until it has said something to each."""
    before = len(agent.prints)
    for number in numbers:
        agent.tell(hello(number))
    await until(lambda: len(agent.prints) >= min(20, before + len(numbers)), "it has heard of each")


async def test_who_begins_to_record_late_gets_everything_since_birth(board: Board) -> None:
    agent, bus = await traced(board)
    await greeted(agent, 1, 5)
    late = Recorder(bus, "uav")
    assert await late.catch_up() == ""
    assert list(late.batches) == list(range(len(late.batches)))
    await greeted(agent, 2, 6)
    await late.until_cycle(agent.host._mind.cycle)
    assert [batch.number for batch in late.inputs] == list(range(len(late.batches)))
    kinds = {item.kind for batch in late.inputs for item in batch.inputs}
    assert {"Mail", "TimeRead", "NamesRead"} <= kinds
    result = replay(late.inputs, late.decided)
    assert result.agrees, result.difference
    assert result.unheard <= 1 < result.batches
    edited = compare(late.inputs, program=GREETS.replace("X > 3", "X > 1"))
    assert edited.difference.inputs[-1].endswith("tell hello(2) from ann")


async def test_once_the_beginning_is_dropped_who_is_late_is_warned_and_nothing_is_kept(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracings, "MOST_BYTES", 20 * courses.INPUT_BYTES)
    monkeypatch.setattr(courses, "BATCH_BYTES", 10 * courses.INPUT_BYTES)
    agent, bus = await traced(board)
    course = agent.host._tracing.inputs
    await until(lambda: not course.on, "the beginning is dropped")
    await greeted(agent, 1, 2)
    assert agent.host._mind.on_input is None  # no input is published any more
    assert course.dropped > 10
    assert agent.host.health().counters["trace_dropped"] == course.dropped
    late = Recorder(bus, "uav")
    assert "the inputs since the agent's start exceed the limit" in await late.catch_up()
    await until(lambda: len(late.batches) > 1, "what goes in is published from now on")
    assert min(late.batches) > 0
    with pytest.raises(CannotReplay, match="its initial is missing"):
        replay(late.inputs)


async def test_a_gap_while_nobody_listened_shows_in_the_numbers_only_when_something_is_lost(
    board: Board, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent, bus = await traced(board)
    course = agent.host._tracing.inputs
    async with session(endpoint, "first", "tool") as once:
        first = Recorder(once, "uav", "inputs")
        await until(lambda: len(first.batches) > 1, "what goes in is published")
    await until(lambda: not course.listened, "nobody listens any more")
    async with session(endpoint, "second", "tool") as once:
        second = Recorder(once, "uav", "inputs")
        assert await second.catch_up() == ""
        assert replay(second.inputs).agrees
    await until(lambda: not course.listened, "nobody listens any more")
    course.drop()
    number = course._open.number
    third = Recorder(bus, "uav", "inputs")
    await until(lambda: bool(third.batches), "what goes in is published again")
    assert min(third.batches) == number + 1


async def test_activity_tells_what_an_agent_does_and_what_is_done_to_it(board: Board) -> None:
    agent, bus = await traced(board)
    activity = Recorder(bus, "uav", "activity")
    await until(lambda: agent.host._tracing.activity.listened, "the agent knows that somebody listens")
    assert not agent.host._tracing.inputs.listened
    agent.tell(hello(7))
    agent.tell(Mail("ann", "achieve", term("fly(5)"), "mid8.ann.1"))
    agent.tell(
        Mail(
            "mail",
            "signal",
            term('undelivered(bob, tell, here(1), "not_sendable")[detail("too long")]'),
            "undelivered.mid3.uav.9",
        )
    )
    agent.tell(Mail("ann", "achieve", term("nothing(1)"), "mid9.ann.1"))
    agent.host._ordered("goal !fly(3)")
    await until(lambda: any(one.kind == "log" for one in activity.activity), "the last of it is published")
    found = {one.kind: one for one in activity.activity if one.other != "ann" or "hello" in one.text}
    life = agent.host._tracing.agent_boot
    assert found["received"].text == "hello(7)"
    assert (found["received"].id, found["received"].other) == ("mid7.ann.1", "ann")
    assert (found["sent"].text, found["sent"].other, found["sent"].performative) == ("hello(7)", "ann", "tell")
    assert found["sent"].id.startswith("mid")
    assert found["sent"].id.endswith(f".uav.{life}")
    assert found["action"].text == "takeoff(5)"
    assert found["outcome"].id == found["action"].id
    assert (found["outcome"].state, found["outcome"].reason) == ("refused", "agent uav has no robot to do takeoff")
    told = found["undelivered"]
    assert (told.id, told.other, told.text, told.reason) == ("mid3.uav.9", "bob", "here(1)", "too long")
    assert found["operator"].text == "goal !fly(3)"
    prints = [one.text for one in activity.activity if one.kind == "print"]
    assert prints == ["ann says 7", "not flown: agent uav has no robot to do takeoff"]
    assert {one.state for one in activity.activity if one.kind == "log"} <= {"error", "warning"}
    actions = [(one.kind, one.text or one.state) for one in agent.host.viewer.view().actions]
    assert actions == [("action", "takeoff(5)"), ("outcome", "refused")]


async def test_an_answer_is_reported_with_the_id_of_the_question_as_it_was_sent(board: Board) -> None:
    bus, other = await board.connect("uav"), await board.connect("recorder", "tool")
    activity = Recorder(other, "uav", "activity")
    asks = "+go <- .send(ann, askOne, height(_), A); .print(A)."
    agent = await board.host("uav", asks, bus=bus, others=("ann",))
    await until(lambda: agent.host._tracing.activity.listened, "the agent knows that somebody listens")
    agent.tell(Mail("ann", "tell", term("go"), "mid1.ann.1"))
    await until(lambda: any(one.kind == "sent" for one in activity.activity), "it has asked")
    sent = next(one for one in activity.activity if one.kind == "sent")
    agent.tell(Mail("ann", "tell", term("height(9)"), "mid2.ann.1", sent.id.rpartition(".")[0]))
    await until(lambda: any(one.text == "height(9)" for one in activity.activity), "it has the answer")
    answer = next(one for one in activity.activity if one.kind == "received" and one.text == "height(9)")
    assert answer.in_reply_to == sent.id


async def test_a_flood_is_bounded_and_what_is_left_out_is_counted(board: Board) -> None:
    bus, other = await board.connect("uav"), await board.connect("recorder", "tool")
    flood = "+go <- !go(0). +!go(3000). +!go(N) <- .print(N); !p(N); !go(N+1). +!p(N)."
    recorder = Recorder(other, "uav", "decisions", "activity")
    agent = await board.host("uav", flood, bus=bus)
    tracing = agent.host._tracing
    await until(lambda: tracing.activity.listened and "decisions" in tracing._heard, "somebody listens")
    agent.tell(Mail("ann", "tell", term("go"), "m1"))
    await until(lambda: agent.prints[-1:] == ["2999"], "it has come to its end")
    await agent.end()
    await until(lambda: any(one.kind == "received" for one in recorder.activity), "the first is published")
    await until(
        lambda: len(recorder.activity) + sum(some.left_out for some in recorder.told) == 3001, "all events count"
    )
    assert all(len(some.events) <= 400 for some in recorder.told)
    assert all(len(some.decisions) <= 200 for some in recorder.decided)
    await until(
        lambda: len(recorder.decisions) + sum(some.left_out for some in recorder.decided) == 6002, "all decisions count"
    )
    assert all(some.speed == 1.0 and some.now > 0 for some in recorder.told)


async def test_who_asks_for_everything_there_is_does_not_get_whole_lives(board: Board) -> None:
    _, bus = await traced(board)
    got: list[str] = []
    for key in (f"argosy/{bus.fleet}/**", f"argosy/{bus.fleet}/*/trace/inputs"):
        replies = await asyncio.to_thread(lambda key=key: list(bus._session.get(key, timeout=5.0)))  # type: ignore[misc]
        got.append(" ".join(str(reply.ok.key_expr) for reply in replies if reply.ok is not None))
    assert "trace" not in got[0]
    assert got[1].startswith(keys.trace(bus.fleet, "uav", "inputs"))


# --- further lives ---

KEPT = """\
count(0).
!begin.
+!begin <- +begun; .random(R); +chance(R); !!keep(1).
+!keep(N) <- .print("keeps ", N); .wait(60000).
+hello(X)[source(S)] : count(N) <- -+count(N+1); .random(R); .nano_time(T); -+last(R); .print("hello ", X, " ", N).
+!slow(X)[source(S)] <- .print("slow ", X, " for ", S); .wait(60000).
+!plan(X) <- .add_plan({ +late(Y) <- .print("late ", Y) }); .print(planned).
"""
BACK = '+restarted(N) <- .findall(C, count(C), L); .print("back ", N, " ", L).\n'


async def lives_on(agent: Hosted, number: int) -> None:
    """Let an agent do what is different in each of its lives."""
    await until(lambda: agent.host._tracing.inputs.listened, "somebody listens")
    await greeted(agent, number, number + 10)
    agent.tell(Mail("ann", "achieve", term(f"slow({number})"), f"a{number}"))
    agent.tell(Mail("ann", "achieve", term(f"plan({number})"), f"p{number}"))
    await until(lambda: "planned" in agent.prints, "it has another plan")
    saved = len(agent.disk.savings)
    agent.tell(Mail("ann", "tell", term(f"late({number})"), f"l{number}"))
    await until(lambda: f"late {number}" in agent.prints, "it has used the plan")
    await until(lambda: len(agent.disk.savings) > saved, "it is kept")


@pytest.mark.parametrize("back", ["", BACK], ids=["goes on", "decides itself"])
async def test_each_life_of_an_agent_that_is_kept_lives_again(board: Board, back: str) -> None:
    lives: list[Recorder] = []
    for number in range(3):
        bus, other = await board.connect("uav"), await board.connect("recorder", "tool")
        recorder = Recorder(other, "uav", "inputs")
        agent = await board.host("uav", KEPT + back, bus=bus, others=("ann",))
        await lives_on(agent, number)
        await recorder.catch_up()
        await (agent.die() if number == 0 else agent.end())
        if number > 0:
            await until(lambda one=recorder: one.inputs[-1].final, "its end is published")
        lives.append(recorder)
    for number, recorder in enumerate(lives):
        born = recorder.inputs[0].initial
        assert bool(born.memory) == (number > 0)
        assert born.kept
        back_again = [item for batch in recorder.inputs for item in batch.inputs if item.kind == "CameBack"]
        assert [item.fields["life"] for item in back_again] == ([number] if number else [])
        ends = [batch.final for batch in recorder.inputs]
        assert ends == [False] * (len(ends) - 1) + [number > 0]  # who was killed has no end
        result = replay(recorder.inputs)
        assert result.agrees, result.difference
        assert result.decisions > 5


# --- real daemons ---

MAKES = """\
!go.
+!go
   <- .create_agent(kid, "kid.asl"); .wait(born(kid)); .create_agent(Helper, "kid.asl"); .wait(born(helper));
      .all_names(L); .print("names ", L); .send(kid, tell, toy(ball)); .wait(thanks(kid, ball));
      .send(helper, askOne, age(_), A); .print("age ", A); .broadcast(tell, toy(rope)); .wait(thanks(helper, rope));
      .kill_agent(kid); .all_names(L2); .print("now ", L2); !t; .clone("twin"); .include("lib.asl"); !said(1);
      .include("none.asl"); .df_register(cook); .df_search(cook, F); .print(F); .save_agent("self.asl");
      .kill_agent(helper); .print("end"); .wait(2000); .stopMAS.
+!t <- .send(kid, tell, toy(doll)).
-!t[error(E), error_msg(M)] <- .print(E, " ", M).
"""
LIB = "+!said(X) <- .print(said(X)).\nread(1).\n"


def test_a_daemon_that_makes_clones_reads_and_ends_agents_lives_again(tmp_path: Path, endpoint: str) -> None:
    path = mission(
        tmp_path, ONE.replace("a.asl}", "a.asl, goals: [extra], beliefs: [told(1)]}"), a=MAKES, kid=KID, lib=LIB
    )
    (tmp_path / "a.asl").write_text(MAKES + "+!extra : told(X) <- .print(extra, X).\n")

    async def record(stack: ExitStack) -> dict[str, Recorder]:
        async with open_bus(endpoint, fleet="one", name="recorder", daemon="tool") as bus:
            recorders = {name: Recorder(bus, name) for name in ("a", "kid", "helper", "twin")}
            daemon = stack.enter_context(running("agentd", "serve", path, "--router", endpoint, "--speed", "2"))
            assert await asyncio.to_thread(daemon.ends) == 0
            assert "defect" not in daemon.text
            await until(lambda: any(one.kind == "stopped" for one in recorders["a"].activity), "all is published")
            await until(lambda: bool(recorders["twin"].batches), "all is published")
            return recorders

    with ExitStack() as stack:
        commd = stack.enter_context(running("commd", "serve", path, "--router", endpoint))
        commd.says("endpoint=")
        recorders = asyncio.run(record(stack))
        commd.signal(signal.SIGTERM)
        commd.ends()
    for name in ("a", "kid", "helper"):
        batches = recorders[name].inputs
        result = replay(batches, recorders[name].decided)
        assert result.agrees, (name, result.difference)
        assert result.unheard <= 1
    born = recorders["a"].inputs[0].initial
    assert (born.goals, born.beliefs) == (("extra",), ("told(1)",))
    assert list(born.files) == [str(tmp_path / "a.asl")]
    said = [one.text for one in recorders["a"].activity if one.kind == "print"]
    assert {"extra1", "said(1)", "end"} <= set(said)
    sent = {one.id for one in recorders["a"].activity if one.kind == "sent"}
    heard = {one.id for one in recorders["kid"].activity if one.kind == "received"}
    assert heard
    assert heard <= sent
    with pytest.raises(CannotReplay, match="twin cannot be replayed: it is a clone of a, and what that had become"):
        replay(recorders["twin"].inputs)


Told = tuple[str, Channel, bool]


def followed(subscribers: TraceSubscribers, told: list[Told], *agents: str) -> None:
    """Add agents that note what they are told."""
    for agent in agents:
        subscribers.add(agent, partial(lambda who, channel, there: told.append((who, channel, there)), agent))


async def test_only_the_agent_whose_trace_has_a_subscriber_learns_of_it_and_of_its_end(connect: Connect) -> None:
    daemon, observer = await connect("a", "agentd"), await connect("observer", "argosy")
    told: list[Told] = []
    subscribers = TraceSubscribers(daemon)
    followed(subscribers, told, "a", "b")
    ear = observer.raw.subscribe(keys.trace(FLEET, "a", "inputs"), lambda _: None)
    await until(lambda: told, "the agent learns of it")
    assert told == [("a", "inputs", True)]
    ear.close()
    await until(lambda: len(told) > 1, "it learns of the end")
    assert told == [("a", "inputs", True), ("a", "inputs", False)]


async def test_a_subscriber_to_all_traces_is_seen_by_each_agent_also_by_one_that_comes_later(connect: Connect) -> None:
    daemon, observer = await connect("a", "agentd"), await connect("observer", "argosy")
    told: list[Told] = []
    subscribers = TraceSubscribers(daemon)
    many = [f"a{number}" for number in range(50)]
    followed(subscribers, told, *many)
    observer.raw.subscribe(keys.trace(FLEET, "*", "activity"), lambda _: None)
    await until(lambda: len(told) == len(many), "each agent learns of it")
    assert sorted(told) == sorted((agent, "activity", True) for agent in many)
    followed(subscribers, told, "late")
    await until(lambda: ("late", "activity", True) in told, "the late one learns of it, too")
    subscribers.remove("late")


async def test_agents_whose_traces_nobody_listens_to_have_no_listeners_of_their_own(connect: Connect) -> None:
    daemon, observer = await connect("a", "agentd"), await connect("observer", "argosy")
    subscribers = TraceSubscribers(daemon)
    before = len(daemon._listened)
    told: list[Told] = []
    followed(subscribers, told, "a", "b")
    assert len(daemon._listened) == before
    ear = observer.raw.subscribe(keys.trace(FLEET, "b", "decisions"), lambda _: None)
    await until(lambda: told, "the agent learns of it")
    ear.close()
    await until(lambda: len(told) > 1, "it learns of the end")
    assert len(daemon._listened) == before
