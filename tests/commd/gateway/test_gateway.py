"""The gateway and Comm nodes of the paper, by real datagrams on loopback."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from commd.gateway import gateway as module
from commd.gateway.gateway import Allowance, Gateway, Node, open_gateway
from commd.mail.store import StoreFailed
from schemas.files.findings import Findings
from schemas.mission.model import Mission, read_mission
from schemas.wire.records import Message, Refusal
from schemas.wire.terms import Atom, Structure, Term
from tests.commd.old_comm import OldCommNode, PostOffice
from tests.support.buses import under_way, until

MISSION = """
mission: mixed
agents: {{uav: {{program: u.asl}}, ugv: {{program: u.asl}}}}
gateway:
  listen: "{listen}"
  nodes: {{old1: "{one}", old2: "{other}"}}
"""


class Field:
    """Two old nodes, the gateway and the mail behind it."""

    def __init__(self, one: OldCommNode, other: OldCommNode, listen: str) -> None:
        self.one, self.other, self.listen = one, other, listen
        self.post = PostOffice("uav", "ugv", "old1", "old2")
        self.gateway: Gateway

    def mission(self) -> Mission:
        text = MISSION.format(listen=self.listen, one=self.one.address, other=self.other.address)
        return read_mission(text, Path("mixed.yaml"))

    def say(self, datagram: str | bytes) -> None:
        """The first node sends to the gateway."""
        self.one.send(datagram, self.listen)

    async def counted(self, counter: str, count: int) -> None:
        await until(lambda: self.gateway.counters[f"gateway_{counter}"] == count, f"{count} datagrams are {counter}")


@contextlib.asynccontextmanager
async def nodes(listen: str) -> AsyncIterator[Field]:
    one, other = OldCommNode(), OldCommNode()
    try:
        yield Field(one, other, listen)
    finally:
        await one.close()
        await other.close()


def opened(field: Field) -> AbstractAsyncContextManager[Gateway]:
    mission = field.mission()
    assert mission.gateway is not None
    return open_gateway(mission, mission.gateway)


@pytest.fixture
def limits() -> dict[str, float]:
    """Limits of the gateway: what a test gives as `with_limits`."""
    return {}


def with_limits(**limits: float) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("limits", [limits], ids=["limits"])


@pytest.fixture
@asynccontextmanager
async def field(
    free_port: Callable[[], int], limits: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[Field]:
    """The field of a gateway that is open."""
    for name, value in limits.items():
        monkeypatch.setattr(f"commd.gateway.gateway.{name}", value)
    async with (
        nodes(f"127.0.0.1:{free_port()}") as field,
        opened(field) as field.gateway,
        under_way(field.gateway.run(field.post)),
    ):
        yield field


def message(content: Term, receiver: str = "old1", identity: str = "m1", **more: Any) -> Message:
    return Message(id=identity, sender="uav", performative="tell", receiver=receiver, content=content, **more)


async def test_what_an_old_node_sends_is_mail(field: Field) -> None:
    field.say("<mid1,old1,tell,uav,victim_in_need(1,-27.603683,-48.518052)>")
    field.say("<mid2->m7,old1,achieve,ugv,go>\n")
    await until(lambda: len(field.post.taken) == 2, "both are taken")
    assert field.post.taken == [
        Message(
            id="mid1",
            sender="old1",
            performative="tell",
            receiver="uav",
            content=Structure("victim_in_need", (1, -27.603683, -48.518052)),
        ),
        Message(id="mid2", sender="old1", performative="achieve", receiver="ugv", content=Atom("go"), in_reply_to="m7"),
    ]


async def test_mail_reaches_an_old_node_as_it_reads_it(field: Field) -> None:
    batch = (message(Structure("at", (1, Atom("north")))), message("a, b", identity="m2", in_reply_to="mid1"))
    receipt = await field.post.deliver["old1"](batch)
    assert (receipt.taken, receipt.refused, receipt.later) == (2, {}, {})
    await until(lambda: len(field.one.heard) == 2, "the node hears both")
    assert field.one.heard == ["<m1,uav,tell,old1,at(1,north)>", '<m2->mid1,uav,tell,old1,"a, b">']
    assert field.other.heard == []
    assert field.gateway.counters["gateway_out"] == 2


async def test_the_receiver_null_is_everybody_else(field: Field) -> None:
    field.say("<mid1,old1,tell,null,ready>")
    await until(lambda: len(field.post.taken) == 3, "all have it")
    assert [one.receiver for one in field.post.taken] == ["uav", "ugv", "old2"]


async def test_what_would_not_fit_into_what_an_old_node_reads_is_refused_whole(field: Field) -> None:
    room = module.MAX_DATAGRAM - len('<m1,uav,tell,old1,"">')
    batch = (message("x" * room), message("é" * room, identity="m2"), message("last", identity="m3"))
    receipt = await field.post.deliver["old1"](batch)
    assert receipt.refused == {
        1: Refusal(code="not_sendable", text=f"a datagram of {1024 + room} bytes: Comm nodes read 1024")
    }
    assert receipt.taken == 2
    await until(lambda: len(field.one.heard) == 2, "the others arrive")
    assert [len(text) for text in field.one.heard] == [1024, len('<m3,uav,tell,old1,"last">')]


async def test_a_message_that_no_datagram_can_carry_is_refused_with_the_reason(field: Field) -> None:
    receipt = await field.post.deliver["old1"]((message(1, identity="a b"),))
    refusal = receipt.refused[0]
    assert refusal.code == "not_sendable"
    assert refusal.text.startswith("cannot be written as a datagram: id: expected a text without blanks")


async def test_a_node_hears_that_its_message_will_not_arrive(field: Field) -> None:
    field.post.full.add("ugv")
    field.say("<mid1,old1,tell,Nobody,ready(1)>")
    field.say("<mid2,old1,tell,ugv,ready(2)>")
    await until(lambda: len(field.one.heard) == 2, "the node is told")
    assert field.one.heard == [
        '<undelivered.mid1,mail,signal,old1,undelivered("Nobody",tell,ready(1),"receiver_not_found")>',
        '<undelivered.mid2,mail,signal,old1,undelivered(ugv,tell,ready(2),"mailbox_full")>',
    ]
    assert field.gateway.counters["gateway_refused"] == 2


async def test_only_nodes_of_the_mission_are_heard_and_each_stranger_is_told_once(
    field: Field, caplog: pytest.LogCaptureFixture
) -> None:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as elsewhere:
        elsewhere.bind(("127.0.0.2", 0))
        for number in range(5):
            elsewhere.sendto(f"<m{number},old1,tell,uav,lie>".encode(), ("127.0.0.1", int(field.listen[10:])))
    field.say("<mid1,spy,tell,uav,lie>")
    await field.counted("strangers", 6)
    field.say("<mid2,old1,tell,uav,truth>")
    await until(lambda: len(field.post.taken) == 1, "the node is heard")
    assert field.post.taken[0].content == Atom("truth")
    told = [record.getMessage() for record in caplog.records if record.getMessage().startswith("refused")]
    assert told == [
        "refused datagrams from 127.0.0.2: no node of the mission is there",
        "refused sender=spy from 127.0.0.1: no node of the mission",
    ]


async def test_a_repeated_datagram_is_one_message_and_an_id_used_anew_is_another(field: Field) -> None:
    for _ in range(3):
        field.say("<mid1,old1,tell,uav,a>")
    field.say("<mid1,old1,tell,uav,b>")
    await until(lambda: len(field.post.taken) == 2, "two are taken")
    assert [one.content for one in field.post.taken] == [Atom("a"), Atom("b")]
    await field.counted("repeated", 2)


def test_a_node_that_starts_again_and_says_the_same_later_is_heard() -> None:
    node = Node("old1", "127.0.0.1:1")
    assert [node.repeats(b"x", at) for at in (0.0, 59.0, 61.0, 62.0)] == [False, True, False, True]


def test_a_node_that_repeats_itself_for_ever_does_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.gateway.gateway.REMEMBERED", 100)
    node = Node("old1", "127.0.0.1:1")
    assert not any(node.repeats(b"%d" % number, 1.0) for number in range(1000))
    assert len(node._heard) <= 101


def test_a_host_that_floods_is_held_to_the_rate_of_its_nodes() -> None:
    allowance = Allowance()
    assert sum(allowance.take(10.0) for _ in range(1000)) == module.BURST
    assert sum(allowance.take(11.0) for _ in range(1000)) == module.RATE
    allowance.nodes = 2
    assert sum(allowance.take(12.0) for _ in range(1000)) == 2 * module.RATE


@with_limits(BURST=2.0, RATE=0.0)
async def test_what_exceeds_the_rate_is_dropped_unread_and_counted(field: Field) -> None:
    for number in range(10):
        field.say(f"<m{number},old1,tell,uav,{number}>")
    await field.counted("in", 10)
    assert field.gateway.counters["gateway_dropped"] == 8
    assert field.gateway.health().drops == 8


@with_limits(QUEUE=5, BATCH=1)
async def test_what_waits_for_mail_is_bounded_its_excess_counted(field: Field, monkeypatch: pytest.MonkeyPatch) -> None:
    taking = asyncio.Event()
    take = field.post.take

    async def slowly(messages: Any) -> Any:
        await taking.wait()
        return await take(messages)

    monkeypatch.setattr(field.post, "take", slowly)
    for number in range(20):
        field.say(f"<m{number},old1,tell,uav,{number}>")
        await field.counted("in", number + 1)
    assert field.gateway.counters["gateway_dropped"] == 14  # one is being taken, five wait
    taking.set()
    await until(lambda: len(field.post.taken) == 6, "those that waited are taken")
    field.say("<m6,old1,tell,uav,6>")  # dropped before, so no repetition
    await until(lambda: len(field.post.taken) == 7, "what was dropped may be said again")


async def test_failed_mail_is_told_to_the_node_and_ends_nothing(field: Field, monkeypatch: pytest.MonkeyPatch) -> None:
    take = field.post.take

    async def fails_once(messages: Any) -> Any:
        monkeypatch.setattr(field.post, "take", take)
        raise RuntimeError("closed")

    monkeypatch.setattr(field.post, "take", fails_once)
    field.say("<mid1,old1,tell,uav,a>")
    await until(lambda: len(field.one.heard) == 1, "the node is told")
    assert field.one.heard[0].endswith('undelivered(uav,tell,a,"defect")[detail("RuntimeError: closed")]>')
    field.say("<mid2,old1,tell,uav,b>")
    await until(lambda: len(field.post.taken) == 1, "the next one is taken")


@with_limits(DISK_RETRY=0.05)
async def test_what_a_full_disk_does_not_take_waits_for_it(field: Field, monkeypatch: pytest.MonkeyPatch) -> None:
    take, failures = field.post.take, 3

    async def fails_for_a_while(messages: Any) -> Any:
        nonlocal failures
        failures -= 1
        if failures >= 0:
            raise StoreFailed("disk is full")
        return await take(messages)

    monkeypatch.setattr(field.post, "take", fails_for_a_while)
    field.say("<mid1,old1,tell,uav,a>")
    await until(lambda: len(field.post.taken) == 1, "it is taken in the end")
    assert field.one.heard == []
    assert failures == -1


@with_limits(SEEK_EVERY=0.1)
async def test_a_node_of_an_unknown_host_keeps_its_mail_waiting(field: Field, caplog: pytest.LogCaptureFixture) -> None:
    node = field.gateway.nodes["old1"]
    address, node.at, node.address = field.one.address, None, "no-such-host.invalid:9000"
    assert await field.post.deliver["old1"]((message(1),)) is None
    told = "node old1 at no-such-host.invalid:9000 is not found"
    await until(lambda: told in caplog.text, "it is said")
    node.address = address.replace("127.0.0.1", "localhost")
    await until(lambda: node.at is not None, "it is found")
    assert await field.post.deliver["old1"]((message(1),)) is not None
    await until(lambda: len(field.one.heard) == 1, "it is sent then")


async def test_an_address_that_is_not_to_be_had_is_said_at_its_place_in_the_mission(field: Field) -> None:
    with pytest.raises(Findings) as raised:
        async with opened(field):
            pass
    why = f"gateway.listen: cannot listen at {field.listen}: "
    assert str(raised.value).startswith(f"mixed.yaml:5:11: error: {why}")
