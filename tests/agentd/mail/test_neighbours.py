"""Mail between agents of one daemon: it stays in the process, and a commit has it with all that its sender did."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from agentd.mind.data.inputs import Mail as Told
from commd.bus.bus import Bus
from schemas.mission.access_rules import MailRights
from schemas.mission.model import load_mission
from schemas.wire import keys
from schemas.wire.records import Mail, Queue, Receipt
from tests.agentd.hosts import Board, Hosted, Hosts
from tests.agentd.mail.test_mail_client import Desk, a_desk
from tests.agentd.minds import term
from tests.support.buses import FLEET, arrived, served, until

SENDS = "+!kqml_received(_, tell, go(N), _) <- for (.range(I, 1, N)) { .send(b, tell, I) }; +sent(N).\n"
HEARS = "+!kqml_received(_, tell, N, _) <- +got(N); .print(N).\n"


class Pair:
    """Agents a and b of one daemon, and the board's desk of a."""

    def __init__(self, board: Board, bus: Bus, desk: Desk) -> None:
        self.board, self.bus, self.desk = board, bus, desk

    async def begin(self, a: str = SENDS, b: str = HEARS, *, kept: str = "ab", b_begins: bool = True) -> None:
        self.daemon = await Hosts.open(self.board.folder, *kept)
        there: dict[str, Any] = {"bus": self.bus, "others": ("a", "b", "c"), "daemon": self.daemon}
        self.a = await self.board.host("a", a, **there)
        self.b = await self.board.host("b", b, begins=b_begins, **there)
        await served(self.bus, keys.inbox(FLEET, "b"))

    async def end(self) -> None:
        await self.a.leave()
        await self.b.leave()
        await self.daemon.close()

    async def die(self) -> None:
        await self.a.die()
        await self.b.die()


def go(agent: Hosted, number: int) -> None:
    agent.tell(Told("x", "tell", term(f"go({number})")))


@pytest.fixture
@asynccontextmanager
async def pair(board: AbstractAsyncContextManager[Board]) -> AsyncIterator[Pair]:
    async with board as opened:
        yield Pair(opened, await opened.connect("a"), await a_desk(opened.connect))


async def test_a_message_reaches_its_neighbour_in_order_without_leaving_the_process(pair: Pair) -> None:
    await pair.begin()
    go(pair.a, 200)
    await until(lambda: pair.b.prints[-1:] == ["200"], "all are there")
    assert [int(line) for line in pair.b.prints] == list(range(181, 201))
    assert pair.desk.taken == []
    assert pair.a.host.health().counters["mail_near"] == 200
    assert pair.b.host.health().counters["mail_received"] == 200


async def test_a_neighbour_has_a_message_before_the_disk_and_nothing_after_it_leaves_the_process(pair: Pair) -> None:
    desk = await a_desk(pair.board.connect, "b")
    await pair.begin(b="+!kqml_received(_, tell, N, _) <- .print(N); .send(c, tell, N).\n")
    await until(lambda: bool(pair.daemon.disk.savings), "they are kept once")
    pair.daemon.disk.open.clear()
    go(pair.a, 2)
    await until(lambda: pair.b.prints == ["1", "2"], "the neighbour has both")
    await arrived(pair.bus, desk.bus)
    assert desk.taken == []
    pair.daemon.disk.open.set()
    await until(lambda: desk.told("c") == [1, 2], "what follows leaves when it is kept")


async def test_what_a_neighbour_has_not_taken_is_on_disk_and_comes_again_once_and_in_order(pair: Pair) -> None:
    await pair.begin(b_begins=False)
    go(pair.a, 3)
    await until(lambda: any(saving.incoming for saving in pair.daemon.disk.savings), "they are written")
    assert pair.daemon.neighbours.queues() == [Queue(box="mind", sender="a", receiver="b", messages=3)]
    go(pair.a, 2)
    await until(lambda: sum(len(saving.incoming) for saving in pair.daemon.disk.savings) == 5, "all are written")
    await pair.die()
    for expected in (["1", "2", "3", "1", "2"], []):
        await pair.begin()
        await until(lambda seen=expected: pair.b.prints == seen, "they come once")
        go(pair.a, 1)
        await until(lambda seen=expected: pair.b.prints == [*seen, "1"], "and what is sent later comes behind them")
        await until(lambda: "got(1)[source(self)]" in pair.b.beliefs, "it is believed")
        assert pair.daemon.neighbours.queues() == []
        await pair.end()
    assert pair.desk.taken == []


async def test_what_does_not_fit_goes_by_commd_in_order(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mail.mail_client.MOST", 2)
    await pair.begin(b_begins=False)
    go(pair.a, 5)
    await until(lambda: pair.desk.told("b") == [3, 4, 5], "those that do not fit go by commd")
    pair.b.begin()
    await until(lambda: pair.b.prints == ["1", "2"], "the others are there")
    go(pair.a, 1)
    await until(lambda: pair.desk.told("b") == [3, 4, 5, 1], "a later one goes behind those")
    hand_over = pair.bus.query(keys.inbox(FLEET, "b"), Mail(messages=tuple(pair.desk.taken)), Receipt, 60)
    assert [reply.record async for reply in hand_over] == [Receipt(taken=4)]
    assert pair.b.prints == ["1", "2", "3", "4", "5", "1"]
    go(pair.a, 2)
    await until(lambda: pair.b.prints[-2:] == ["1", "2"], "when commd has none left, they stay in the process")
    assert len(pair.desk.taken) == 4


async def test_a_message_commd_may_still_offer_is_not_overtaken(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mail.mail_client.MOST", 0)
    await pair.begin(b_begins=False)
    go(pair.a, 1)
    await until(lambda: len(pair.desk.taken) == 1, "the first goes by commd")
    monkeypatch.setattr("agentd.mail.mail_client.MOST", 10)
    offered = Mail(messages=tuple(pair.desk.taken))

    async def offer() -> list[Receipt | None]:
        return [reply.record async for reply in pair.bus.query(keys.inbox(FLEET, "b"), offered, Receipt, 60)]

    first = asyncio.create_task(offer())
    await until(lambda: len(pair.b.host._mind.mailbox) == 1, "it waits in the mind")
    go(pair.a, 1)
    await until(lambda: len(pair.desk.taken) == 2, "the second goes behind it")
    first.cancel()


async def test_a_message_of_an_atomic_plan_is_given_to_a_neighbour_when_the_plan_has_ended(pair: Pair) -> None:
    program = "+!kqml_received(_, tell, go(N), _) <- !!go(N).\n"
    program += "@g[atomic] +!go(N) <- .send(b, tell, N); for (.range(I, 1, N)) { .print(I) }; +ended.\n"
    await pair.begin(a=program)
    seen: list[bool] = []
    pair.b.host._mailing.given = lambda: seen.append("ended[source(self)]" in pair.a.beliefs)
    go(pair.a, 2000)
    await until(lambda: pair.b.prints == ["2000"], "it is there")
    assert seen == [True]


async def test_an_agent_that_is_not_kept_has_mail_like_others_and_what_follows_waits_for_the_disk(pair: Pair) -> None:
    desk = await a_desk(pair.board.connect, "b")
    await pair.begin(b="+!kqml_received(S, tell, N, _) <- .print(N); .send(c, tell, N).\n", kept="a")
    pair.daemon.disk.open.clear()
    go(pair.a, 1)
    await until(lambda: pair.b.prints == ["1"], "it is there")
    await arrived(pair.bus, desk.bus)
    assert desk.taken == []
    pair.daemon.disk.open.set()
    await until(lambda: desk.told("c") == [1], "what follows leaves when it is kept")
    assert not any(saving.incoming for saving in pair.daemon.disk.savings)


async def test_a_full_disk_is_reported_and_neighbours_go_on_until_it_has_room(pair: Pair) -> None:
    await pair.begin()
    await until(lambda: bool(pair.daemon.disk.savings), "they are kept once")
    pair.daemon.disk.full = "database or disk is full"
    go(pair.a, 3)
    await until(lambda: pair.b.prints == ["1", "2", "3"], "the minds go on")
    await until(lambda: bool(pair.a.host.health().notes), "it is reported")
    assert {note.code for agent in (pair.a, pair.b) for note in agent.host.health().notes} == {"state_not_kept"}
    pair.daemon.disk.full = ""
    await until(lambda: pair.a.host.health().notes == (), "it is kept again")
    await until(lambda: "sent(3)[source(self)]" in pair.a.beliefs, "it believes so")
    await pair.end()
    await pair.begin()
    assert {"got(1)[source(self)]", "got(3)[source(self)]"} < set(pair.b.beliefs)


async def test_mail_that_its_receiver_does_not_accept_is_refused_as_that_of_others(pair: Pair, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(
        "mission: m\nagents:\n  a: {program: a.asl}\n  b: {program: a.asl, accepts: {a: [achieve]}}\n"
    )
    (tmp_path / "a.asl").write_text("")
    rights = MailRights(load_mission(str(tmp_path / "m.yaml")), "b", "local")
    await pair.begin()
    pair.b.host._mailing._rights = rights
    go(pair.a, 1)
    await until(lambda: pair.desk.told("b") == [1], "it goes by commd, which the receiver answers that it does not")
    assert pair.b.prints == []


async def test_the_senders_hear_of_what_an_agent_that_leaves_for_good_has_not_taken(pair: Pair) -> None:
    await pair.begin(a=SENDS + "+undelivered(R, _, C, Why) <- .print(R, C, Why).\n", kept="a", b_begins=False)
    go(pair.a, 1)
    await until(lambda: len(pair.b.host._mind.mailbox) == 1, "it waits")
    pair.b.host._mailing.leave()
    await pair.b.leave()
    await until(lambda: pair.a.prints == ["b1receiver_left"], "its sender hears of it")
