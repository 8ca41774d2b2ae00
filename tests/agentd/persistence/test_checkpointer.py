"""When an agent is kept: mail and actions wait for the disk, the mind does not."""

import asyncio
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from agentd.language.terms.terms import atom
from agentd.mind.data.inputs import Mail as Told
from agentd.persistence.checkpoint import AgentRows, CheckpointError, LifeRow
from agentd.persistence.checkpointer import Checkpointer
from agentd.persistence.group_commit import Batch
from agentd.persistence.restore import open_state
from commd.bus.bus import Bus
from schemas.wire import keys
from schemas.wire.records import Action, Mail, Message, Receipt, Refusal
from schemas.wire.terms import Structure
from tests.agentd.hosts import Board, Hosted
from tests.agentd.mail.test_mail_client import a_desk, numbered
from tests.support.buses import FLEET, arrived, served, until
from tests.support.notes import identities

HEARS = "+!kqml_received(S, tell, N, _) <- +got(N); .print(got(N)).\n"


async def hand_over(backfill: Bus, *messages: Message) -> Receipt:
    async for reply in backfill.query(keys.inbox(FLEET, "b"), Mail(messages=messages), Receipt, 60):
        assert reply.record is not None, reply.error
        return reply.record
    raise AssertionError("nobody serves the inbox")


async def a_life(board: Board, program: str, backfill: Bus, others: tuple[str, ...] = ()) -> Hosted:
    """Begin a life of agent b, to which `backfill` can hand over mail."""
    agent = await board.host("b", program, others=others)
    await served(backfill, keys.inbox(FLEET, "b"))
    return agent


async def test_a_message_is_acknowledged_when_what_came_of_it_is_on_disk(board: Board) -> None:
    backfill = await board.connect("board", "commd")
    agent = await a_life(board, HEARS, backfill)
    await until(lambda: bool(agent.disk.savings), "the agent is kept once")
    agent.disk.open.clear()
    answer = asyncio.create_task(hand_over(backfill, numbered(1), numbered(2)))
    await until(lambda: agent.prints == ["got(1)", "got(2)"], "the mind has both")
    await arrived(agent.host._bus, backfill)
    assert not answer.done()
    agent.disk.open.set()
    assert await answer == Receipt(taken=2)
    await agent.die()
    again = await a_life(board, HEARS, backfill)
    assert await hand_over(backfill, numbered(1), numbered(2)) == Receipt(taken=2)
    assert await hand_over(backfill, numbered(3)) == Receipt(taken=1)
    assert again.prints == ["got(3)"]
    assert {"got(1)[source(self)]", "got(2)[source(self)]"} < set(again.beliefs)


async def test_what_is_told_while_an_atomic_plan_waits_is_acknowledged_and_outlives_a_death(board: Board) -> None:
    program = "!go. @busy[atomic] +!go <- .print(waits); .wait(60000). +n(N) <- .print(heard(N))."
    backfill = await board.connect("board", "commd")
    agent = await a_life(board, program, backfill)
    await until(lambda: agent.prints == ["waits"], "the atomic plan waits")
    told = [numbered(seq, Structure("n", (seq,))) for seq in (1, 2)]
    assert await hand_over(backfill, *told) == Receipt(taken=2)
    assert {"n(1)[source(a)]", "n(2)[source(a)]"} <= set(agent.beliefs)
    assert agent.prints == ["waits"]
    await agent.die()
    again = await a_life(board, program, backfill)
    await until(lambda: again.prints == ["heard(1)", "heard(2)"], "the events come once, in their order")
    assert await hand_over(backfill, *told) == Receipt(taken=2)
    assert again.prints == ["heard(1)", "heard(2)"]


async def test_what_a_death_kept_from_disk_comes_again_once(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.persistence.checkpointer.LAST_PATIENCE", 0.1)
    backfill = await board.connect("board", "commd")
    agent = await a_life(board, HEARS, backfill)
    assert await hand_over(backfill, numbered(1)) == Receipt(taken=1)
    agent.disk.full = "no space left"
    answer = asyncio.create_task(hand_over(backfill, numbered(2)))
    await until(lambda: agent.prints == ["got(1)", "got(2)"], "the mind has both")
    await agent.die()
    again = await a_life(board, HEARS, backfill)
    assert await hand_over(backfill, numbered(1), numbered(2)) == Receipt(taken=2)
    assert again.prints == ["got(2)"]
    answer.cancel()


async def test_a_full_disk_is_reported_holds_up_mail_and_not_the_mind_and_goes_on_when_there_is_room(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agentd.mail.mail_client.PATIENCE", 0.5)
    program = HEARS + "+!say(N) <- .send(c, tell, N); .print(said(N)).\n"
    desk, backfill = await a_desk(board.connect, "b"), await board.connect("board", "commd")
    agent = await a_life(board, program, backfill, others=("c",))
    await until(lambda: bool(agent.disk.savings), "the agent is kept once")
    agent.disk.full = "database or disk is full"
    told = await hand_over(backfill, numbered(1))
    assert (told.taken, list(told.later)) == (0, [0])
    goal = Message(
        header=numbered(2).header,
        id="g",
        sender="a",
        performative="achieve",
        receiver="b",
        content=Structure("say", (7,)),
    )
    await hand_over(backfill, numbered(1), goal)
    await until(lambda: "said(7)" in agent.prints, "the mind goes on")
    (note,) = agent.host.health().notes
    assert note.code == "state_not_kept"
    assert "database or disk is full" in note.text
    await arrived(agent.host._bus, desk.bus)
    assert desk.taken == []
    agent.disk.full = ""
    await until(lambda: desk.told("c") == [7], "the message leaves when it is kept")
    assert await hand_over(backfill, numbered(1), goal) == Receipt(taken=2)
    assert agent.host.health().notes == ()
    assert agent.prints == ["got(1)", "said(7)"]


async def test_a_save_that_does_not_end_is_reported_and_no_action_waits_for_it_or_is_remembered(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agentd.persistence.group_commit.SLOW", 0.2)
    agent = await board.host("b", HEARS)
    await until(lambda: bool(agent.disk.savings), "it is kept once")
    agent.disk.open.clear()
    agent.tell(Told("a", "tell", 1.0))
    await until(lambda: bool(agent.host.health().notes), "the hanging disk is reported")
    (note,) = agent.host.health().notes
    assert note.code == "state_not_kept"
    checkpointer, began = agent.host._checkpointer, list[bool]()
    assert checkpointer is not None
    for number in range(100):
        checkpointer.begun(Action(id=f"b:1:{number}", agent="b", name="goto"), lambda: began.append(True))
        checkpointer.ended(f"b:1:{number}")
    await asyncio.sleep(0)
    assert len(began) == 100
    assert (checkpointer._begun, checkpointer._ended) == ({}, [])
    agent.disk.open.set()
    await until(lambda: agent.host.health().notes == (), "it is kept again")


async def test_an_action_that_is_about_to_start_survives_a_power_failure(board: Board) -> None:
    agent = await board.host("b", "+!go <- +gone.\n")
    checkpointer = agent.host._checkpointer
    assert checkpointer is not None
    await until(lambda: bool(agent.disk.savings), "it is kept once")
    begun = asyncio.Event()
    checkpointer.begun(Action(id="b:1:1", agent="b", name="goto"), begun.set)
    checkpointer.look(quiet=True)
    await begun.wait()
    kept = zip(agent.disk.savings, agent.disk.soft, strict=True)
    assert [soft for saving, soft in kept if saving.actions] == [False]


async def test_saves_that_nobody_waits_for_are_few_and_those_of_mail_hold_many_messages(board: Board) -> None:
    program = "!count(0). +!count(N) : N < 60 <- -+n(N); .wait(20); !count(N+1). +!count(_) <- .print(done).\n"
    program += "+!kqml_received(_, tell, N, _) <- .send(c, tell, N).\n"
    backfill = await board.connect("board", "commd")
    agent = await board.host("b", program, others=("c",))
    await until(lambda: agent.prints == ["done"], "it has counted")
    assert 2 <= len(agent.disk.savings) <= 12
    before = len(agent.disk.savings)
    await served(backfill, keys.inbox(FLEET, "b"))
    assert await hand_over(backfill, *map(numbered, range(1, 301))) == Receipt(taken=300)
    assert len(agent.disk.savings) - before < 30
    assert sum(len(saving.outgoing) for saving in agent.disk.savings) == 300


async def test_an_atomic_plan_is_kept_whole(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.persistence.checkpointer.BUSY_PATIENCE", 0.0)
    monkeypatch.setattr("agentd.persistence.checkpointer.OTHERS_EVERY", 0.0)
    monkeypatch.setattr("agentd.runtime.mind_runner.SLICE", 1)
    program = "n(0). m(0). !go.\n@a[atomic] +!go : n(N) <- -+n(N+1); -+m(N+1); !!go.\n"
    seen: list[set[str]] = []
    capture = Checkpointer.capture

    def look(checkpointer: Checkpointer, batch: Batch, now: float) -> bool:
        captured = capture(checkpointer, batch, now)
        if captured:
            seen.append({belief.partition("(")[2] for belief in agent.beliefs if belief[:2] in ("n(", "m(")})
        return captured

    monkeypatch.setattr(Checkpointer, "capture", look)
    agent = await board.host("b", program)
    await until(lambda: len(seen) > 5, "it is kept several times while it runs")
    await agent.end()
    assert all(len(values) == 1 for values in seen)


async def test_an_unsendable_message_fails_the_plan_of_it(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mail.outbox.MOST_FOR_ONE", 3)
    program = """\
!go.
+!go <- for (.range(I, 1, 5)) { !t(I) }; .print(end).
+!t(1) <- .range(I, 1, 20) & true; !long("0123456789012345678901234567890123456789", 15, L); .send(b, tell, text(L)).
+!t(2) <- !deep(150, D); .send(b, tell, D).
+!t(3) <- .send(c, tell, hello).
+!t(4) <- .broadcast(tell, 1); .broadcast(tell, 2); .broadcast(tell, 3); .print(three); .broadcast(tell, 4).
+!t(5) <- !long("0123456789012345678901234567890123456789", 15, L); .send(b, askOne, text(L), A, 1000); .print(A).
-!t(N)[error(E), error_msg(M)] <- .print(N, " ", E, " ", M).
+!long(T, 0, T).
+!long(T, N, L) <- .concat(T, T, TT); !long(TT, N-1, L).
+!deep(0, x).
+!deep(N, f(D)) <- !deep(N-1, D).
"""
    agent = await board.host("a", program, others=("b", "d"))
    await until(lambda: "end" in agent.prints, "all are tried")
    assert agent.prints == [
        agent.prints[0],
        "2 not_sendable the message cannot be sent: nested deeper than 100",
        "3 receiver_not_found there is no agent 'c' to send to",
        "three",
        "4 mailbox_full the message cannot be sent: 3 messages to 'b' are waiting to be sent",
        agent.prints[5],
        "end",
    ]
    too_large = "message_too_large the message cannot be sent: 13"
    assert agent.prints[0].startswith(f"1 {too_large}")
    assert agent.prints[5].startswith(f"5 {too_large}")
    desk = await a_desk(board.connect)
    agent.host.retry_mail()
    await until(lambda: len(desk.taken) == 6, "what was taken leaves")
    assert desk.told("b") == desk.told("d") == [1, 2, 3]


async def test_what_commd_refuses_for_good_is_an_event_once_for_the_one_who_sent_it(board: Board) -> None:
    program = """\
!go.
+!go <- .send(c, tell, at(1,[2])).
+undelivered(R, P, C, Why)[source(S)] <- .print(R, " ", P, " ", C, " ", Why, " ", S).
"""
    desk = await a_desk(board.connect)
    desk.answer = lambda messages: Receipt(
        refused=dict.fromkeys(range(len(messages)), Refusal(code="receiver_not_found"))
    )
    bus = await board.connect("a")
    agent = await board.host("a", program, bus=bus, others=("c",))
    await until(lambda: agent.prints == ["c tell at(1,[2]) receiver_not_found mail"], "the agent hears of it")
    await until(lambda: any(saving.delivered for saving in agent.disk.savings), "it is forgotten")
    await agent.end()
    again = await board.host("a", program, others=("c",))
    await until(lambda: any(saving.mind for saving in again.disk.savings), "it goes on")
    assert (again.prints, sum(desk.batches)) == ([], 1)


def test_a_refused_file_gives_way_to_agents_that_start_fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.process.sqlite_file.LOCK_PATIENCE", 0.05)
    made, _ = open_state(tmp_path, "a", ["a"], [], "FULL")
    made.save({"a": AgentRows(life=LifeRow("n", 1, b""))})
    with pytest.raises(CheckpointError, match="another process has it open"):
        open_state(tmp_path, "a", ["a"], ["a"], "FULL")
    made.close()
    with closing(sqlite3.connect(tmp_path / "a.minds")) as database:
        database.execute("PRAGMA user_version = 99")
    with pytest.raises(CheckpointError, match="newer Argosy"):
        open_state(tmp_path, "a", ["a"], [], "FULL")
    again, states = open_state(tmp_path, "a", ["a"], ["a"], "FULL")
    assert again is not None
    assert states["a"].life == 0
    again.close()


async def test_what_cannot_be_read_of_mail_and_actions_is_reported_and_left_out_once(board: Board) -> None:
    program = "!go.\n+!go <- .send(c, tell, one); .send(c, tell, two); .print(sent).\n"
    file = board.folder / "a.minds"
    bus = await board.connect("a")
    agent = await board.host("a", program, bus=bus, others=("c",))
    await until(lambda: any(saving.outgoing for saving in agent.disk.savings), "the messages are kept")
    await agent.die()
    file.with_name("a.minds.sums").unlink()  # what is done to the rows would be found by the checksums
    with closing(sqlite3.connect(file)) as database:
        database.execute("UPDATE outgoing SET message = cast(x'83' || message AS BLOB) WHERE seq = 1")
        database.execute("INSERT INTO action SELECT number, 'a:1:1', cast(x'67ff' AS TEXT), x'83' FROM agent")
        database.commit()
    again = await board.host("a", program, bus=bus, others=("c",))
    await until(lambda: any(saving.delivered for saving in again.disk.savings), "they are removed")
    assert identities(again.host.health().notes) == [
        ("state_damaged", "message 1 to c"),
        ("state_damaged", "action a:1:1"),
    ]
    desk = await a_desk(board.connect)
    again.host.retry_mail()
    await until(lambda: len(desk.taken) == 1, "the other one leaves")
    assert desk.taken[0].header.seq == 2
    await again.end()
    third = await board.host("a", program, bus=bus, others=("c",))
    assert third.host.health().notes == ()


@pytest.mark.parametrize("ends", ["the agent leaves", "an action begins"])
async def test_an_atomic_plan_is_kept_whole_though(board: Board, ends: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.runtime.agent_host.ATOMIC_END", 20.0)
    program = """\
+!kqml_received(_, tell, go, _) <- !!go.
@p[atomic] +!go <- +begun; for (.range(I, 1, 5000)) { .print(I) }; +ended.
+restarted(_).
"""
    bus = await board.connect("a")
    agent = await board.host("a", program, bus=bus)
    await until(lambda: bool(agent.disk.savings), "it is kept once")
    agent.tell(Told("b", "tell", atom("go")))
    await until(lambda: bool(agent.prints), "the plan has begun")
    if ends == "an action begins":
        checkpointer = agent.host._checkpointer
        assert checkpointer is not None
        begun = asyncio.Event()
        checkpointer.begun(Action(id="a:1:1", agent="a", name="goto"), begun.set)
        await begun.wait()
        assert "5000" in agent.prints or checkpointer.counters["actions_unkept"]
        await agent.die()
    else:
        await agent.end()
    again = await board.host("a", program, bus=bus)
    believed = {belief.partition("[")[0] for belief in again.beliefs} & {"begun", "ended"}
    await again.end()
    assert believed in (set(), {"begun", "ended"})
    assert believed or ends == "an action begins"


async def test_a_disk_that_does_not_answer_does_not_keep_an_agent_from_ending(
    board: Board, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("agentd.persistence.checkpointer.LAST_PATIENCE", 0.3)
    monkeypatch.setattr("agentd.persistence.group_commit.CLOSE_PATIENCE", 0.3)
    agent = await board.host("a", HEARS)
    await until(lambda: bool(agent.disk.savings), "it is kept once")
    agent.disk.open.clear()
    agent.tell(Told("b", "tell", atom("x")))
    await until(lambda: agent.prints == ["got(x)"], "it has something to keep")
    agent._stop.set()
    await agent._life
    await asyncio.wait_for(agent.daemon.commits.close(), 120)
    assert "is left as it is: the disk does not answer" in caplog.text
    agent.disk.open.set()
