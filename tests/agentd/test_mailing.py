"""Mail between agents of one board, through a real commd mailroom."""

from __future__ import annotations

import asyncio

import pytest

from agentd.mailing import Mailing
from commd.bus import Bus
from commd.mailroom import Mailroom
from schemas import keys
from schemas.records import Mail, Message
from tests.support.buses import FLEET, Connect, on_a_bus, until


async def open_mailroom(connect: Connect) -> Mailroom:
    """Serve the outboxes of the agents a and b, as commd does."""
    bus = await connect("board", "commd")
    mailroom = Mailroom(bus, {"a", "b"})
    bus.serve(keys.outbox(FLEET, "*"), Mail, mailroom.post)
    return mailroom


def message(number: int, receiver: str = "b") -> Message:
    return Message(id=f"m{number}", sender="a", performative="tell", receiver=receiver, content=number)


def mailing(bus: Bus, agent: str) -> tuple[Mailing, list[Message]]:
    got: list[Message] = []

    def take(one: Message) -> str:
        got.append(one)
        return ""

    return Mailing(bus, agent, take), got


def test_messages_arrive_once_and_in_order(endpoint: str) -> None:
    async def body(connect: Connect) -> None:
        await open_mailroom(connect)
        sender, _ = mailing(await connect("a"), "a")
        _, got = mailing(await connect("b"), "b")
        for number in range(100):
            sender.send(message(number))
        await until(lambda: len(got) == 100, "all messages arrive")
        assert [one.content for one in got] == list(range(100))
        await until(lambda: sender.counters["sent"] == 100, "each was acknowledged")

    on_a_bus(endpoint, body)


def test_mail_waits_for_a_receiver_that_is_not_there_yet(endpoint: str) -> None:
    async def body(connect: Connect) -> None:
        await open_mailroom(connect)
        sender, _ = mailing(await connect("a"), "a")
        sender.send(message(1))
        sender.send(message(2))
        await asyncio.sleep(0.5)
        _, got = mailing(await connect("b"), "b")
        await until(lambda: [one.content for one in got] == [1, 2], "both arrive, in order")

    on_a_bus(endpoint, body)


def test_mail_to_an_agent_of_no_mission_is_given_up_and_said(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    async def body(connect: Connect) -> None:
        mailroom = await open_mailroom(connect)
        sender, _ = mailing(await connect("a"), "a")
        sender.send(message(1, "nobody"))
        await until(lambda: sender.counters["undelivered"] == 1, "the sender learns of it")
        assert mailroom.counters["refused"] == 1
        assert "mail_undelivered id=m1 receiver=nobody why=receiver_not_found" in caplog.text

    on_a_bus(endpoint, body)


def test_a_repeated_message_is_acknowledged_and_not_delivered_again(endpoint: str) -> None:
    async def body(connect: Connect) -> None:
        await open_mailroom(connect)
        sender, _ = mailing(await connect("a"), "a")
        receiver, got = mailing(await connect("b"), "b")
        sender.send(message(1))
        sender.send(message(1))
        sender.send(message(2))
        await until(lambda: sender.counters["sent"] == 3, "all are acknowledged")
        assert [one.content for one in got] == [1, 2]
        assert receiver.counters["received"] == 2

    on_a_bus(endpoint, body)


def test_too_much_mail_for_one_receiver_is_dropped_counted_and_said(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("agentd.mailing.QUEUE", 10)

    async def body(connect: Connect) -> None:
        sender, _ = mailing(await connect("a"), "a")
        for number in range(20):
            sender.send(message(number))
        assert sender.counters["dropped"] == 10
        assert "mail_dropped receiver=b count=1" in caplog.text

    on_a_bus(endpoint, body)
