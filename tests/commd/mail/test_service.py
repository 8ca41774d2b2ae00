"""The mail of boards: on disk before it is acknowledged, in order, once, and handed on as soon as somebody takes it."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import zenoh

from commd.bus.bus import Bus
from commd.mail import queries, service
from commd.mail.service import MailService
from schemas.mission.model import MailRules
from schemas.wire import keys
from schemas.wire.records import Header, Mail, Message, Receipt, Refusal
from schemas.wire.terms import Atom, Structure
from tests.commd.offices import TWO_BOARDS, Receiver, Time, ask, board, listed, message, post
from tests.support.buses import FLEET, Connect, served, until

ONE_BOARD = {"a": "pi1", "b": "pi1"}


@asynccontextmanager
async def two_boards(
    connect: Connect, folder: Path, **options: object
) -> AsyncIterator[tuple[MailService, MailService]]:
    async with (
        board(connect, "pi1", folder, **options) as first,  # type: ignore[arg-type]
        board(connect, "pi2", folder, **options) as second,  # type: ignore[arg-type]
    ):
        yield first, second


async def sent(mail_service: MailService, count: int) -> None:
    """Wait until a board has got rid of `count` messages, in its file too."""
    await until(lambda: mail_service.counters_now["sent"] == count, f"{count} messages are handed on")
    await until(lambda: mail_service.waiting == 0, "nothing waits any more")


@pytest.mark.parametrize("homes", [ONE_BOARD, TWO_BOARDS], ids=["of one board", "between boards"])
async def test_messages_arrive_once_and_in_order(connect: Connect, tmp_path: Path, homes: dict[str, str]) -> None:
    async with two_boards(connect, tmp_path, homes=homes) as (first, second):
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        for start in range(1, 1001, 100):
            assert await post(sender, *map(message, range(start, start + 100))) == Receipt(taken=100)
        await until(lambda: len(receiver.got) == 1000, "all arrive")
        assert receiver.contents == list(range(1, 1001))
        for one in (first, second) if homes is TWO_BOARDS else (first,):
            await sent(one, 1000)


async def test_a_message_arrives_as_it_was_sent(connect: Connect, tmp_path: Path) -> None:
    async with two_boards(connect, tmp_path):
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        one = message(7, content=[1.5, "text", Structure("p", (Atom("q"),))], in_reply_to="q1", performative="askOne")
        await post(sender, one)
        await until(lambda: bool(receiver.got), "it arrives")
        assert receiver.got == [one]


async def test_a_batch_that_is_posted_again_because_its_answer_was_lost_is_taken_and_not_delivered_again(
    connect: Connect, tmp_path: Path
) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        assert await post(sender, message(1), message(2)) == Receipt(taken=2)
        await until(lambda: len(receiver.got) == 2, "both arrive")
        assert await post(sender, message(1), message(2), message(3)) == Receipt(taken=3)
        assert await post(sender, message(2)) == Receipt(taken=1)
        await until(lambda: len(receiver.got) == 3, "the new one arrives")
        await sent(mail_service, 3)
        assert [len(batch) for batch in receiver.batches] in ([2, 1], [1, 1, 1])
        assert mail_service.counters["duplicates"] == 3


async def test_a_sender_that_begins_anew_has_numbers_of_its_own(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD):
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        await post(sender, message(1), message(2), message(1, life="life2", content="anew"))
        await post(sender, message(2), message(1, life="life2"))
        await post(sender, message(2, life="life2", content="on"))
        await until(lambda: len(receiver.got) == 4, "all new ones arrive")
        assert receiver.contents == [1, 2, "anew", "on"]


class Losing:
    """Air that loses what a list of fates says, one after the other; then it loses nothing."""

    def __init__(self, *fates: bool) -> None:
        self.fates = list(fates)
        self.asked: list[tuple[str, str]] = []

    async def __call__(self, sender: str, receiver: str, size: int) -> bool:
        self.asked.append((sender, receiver))
        return self.fates.pop(0) if self.fates else True


async def test_what_the_other_board_took_before_its_answer_was_lost_is_sent_again_and_known_there(
    connect: Connect, tmp_path: Path
) -> None:
    air = Losing(True, False)  # it arrives, the receipt does not
    async with board(connect, "pi1", tmp_path, air=air) as first, board(connect, "pi2", tmp_path) as second:
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        await post(sender, message(1), message(2))
        await sent(first, 2)
        assert air.asked == [("a", "b"), ("b", "a")] * 2
        assert second.counters["duplicates"] == 2
        assert receiver.contents == [1, 2]
        assert first.counters_now["unanswered"] == 1


async def test_an_agent_that_took_a_batch_and_died_before_its_answer_gets_the_same_numbers_again(
    connect: Connect, tmp_path: Path
) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        sender, bus = await connect("a"), await connect("b")
        dying = Receiver(bus, "b", lambda _: None)
        await post(sender, message(1), message(2))
        await until(lambda: bool(dying.batches), "it is handed the batch")
        dying.leave()
        receiver = Receiver(bus, "b")
        await sent(mail_service, 2)
        assert [one.header for one in receiver.got] == [one.header for one in dying.batches[0]]


def never(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no timer try again: what goes on then goes on because somebody has come."""
    monkeypatch.setattr("commd.mail.delivery.RETRY_FIRST", 3600.0)
    monkeypatch.setattr("commd.mail.delivery.RETRY_MOST", 3600.0)


async def test_mail_for_an_agent_that_is_away_waits_and_goes_at_once_when_it_comes(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    never(monkeypatch)
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        sender = await connect("a")
        await post(sender, message(1))
        await post(sender, message(2))
        for round_ in range(2):
            await until(lambda: "b is away" in mail_service.state_of("a", "b"), "their mail waits")
            bus = await connect("b")
            bus.serve(keys.inbox(FLEET, "b"), Mail, (receiver := _Quiet()).take)
            await served(sender, keys.inbox(FLEET, "b"))
            token = bus.token(keys.alive(FLEET, "b", "agentd", bus.boot))
            await until(lambda: len(receiver.contents) == 2, "both arrive, in order")
            assert receiver.contents == [1 + 2 * round_, 2 + 2 * round_]
            bus.withdraw(token)
            await bus.close()
            await post(sender, message(3), message(4))


class _Quiet:
    """A receiver without token."""

    def __init__(self) -> None:
        self.contents: list[object] = []

    async def take(self, query: object) -> None:
        self.contents += [one.content for one in query.record.messages]  # type: ignore[attr-defined]
        query.reply(Receipt(taken=len(query.record.messages)))  # type: ignore[attr-defined]


async def test_mail_for_a_board_that_is_away_waits_and_goes_at_once_when_it_comes_back(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    never(monkeypatch)
    async with board(connect, "pi1", tmp_path) as first:
        a, c, receiver = await connect("a"), await connect("c"), Receiver(await connect("b"), "b")
        number = 0
        for _ in range(2):
            for _ in range(2):
                number += 1
                await post(a, message(number, "a"))
                await post(c, message(number, "c"))
            await until(lambda: "pi2 is away" in first.state_of("a", "b"), "the board is missed")
            assert (await listed(a, "pi1")).queues[0].state == "pi2 is away"
            async with board(connect, "pi2", tmp_path):
                await until(lambda: len(receiver.got) == 2 * number, "all arrive")  # noqa: B023
        for name in ("a", "c"):
            assert [one.content for one in receiver.got if one.sender == name] == list(range(1, number + 1))


async def test_a_board_that_ended_between_any_two_steps_goes_on_where_it_was(connect: Connect, tmp_path: Path) -> None:
    a = await connect("a")
    async with board(connect, "pi1", tmp_path):
        assert await post(a, message(1), message(2)) == Receipt(taken=2)
    async with board(connect, "pi1", tmp_path):  # its answer was lost: the sender posts again
        assert await post(a, message(1), message(2), message(3)) == Receipt(taken=3)
        async with board(connect, "pi2", tmp_path) as second:
            await until(lambda: second.waiting == 3, "all are at the other board")
    receiver = Receiver(await connect("b"), "b")
    async with board(connect, "pi2", tmp_path):
        await until(lambda: len(receiver.got) == 3, "all arrive")
        assert receiver.contents == [1, 2, 3]
    async with board(connect, "pi1", tmp_path) as first, board(connect, "pi2", tmp_path) as second:
        assert await post(a, message(3), message(4)) == Receipt(taken=2)
        await until(lambda: len(receiver.got) == 4, "the last one arrives")
        await until(lambda: first.waiting == second.waiting == 0, "nothing is left")
        assert receiver.contents == [1, 2, 3, 4]


async def test_mail_is_delivered_in_batches_of_bounded_length_and_size(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD):
        sender = await connect("a")
        await post(sender, *map(message, range(1, 801)))
        await post(sender, *(message(800 + n, content="x" * 100_000) for n in range(1, 6)))
        await post(sender, message(806, content="x" * 900_000))
        receiver = Receiver(await connect("b"), "b")
        await until(lambda: len(receiver.got) == 806, "all arrive")
        assert [len(batch) for batch in receiver.batches] == [500, 302, 2, 1, 1]


async def test_hanging_receivers_delay_none(connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.mail.delivery.WORKERS", 2)
    monkeypatch.setattr("commd.mail.delivery.PROBES", 1)
    monkeypatch.setattr("commd.mail.delivery.ABSORB_TIMEOUT", 0.2)
    hung = [f"hung{number}" for number in range(6)]
    homes = dict.fromkeys(("a", "b", *hung), "pi1")
    async with board(connect, "pi1", tmp_path, homes=homes):
        sender, others = await connect("a"), await connect("others")
        hanging = [Receiver(others, name, lambda _: None) for name in hung]
        for name in hung:
            await post(sender, message(1, receiver=name))
        await until(lambda: all(one.batches for one in hanging), "all of them hang")
        receiver = Receiver(await connect("b"), "b")
        for number in range(1, 101):
            await post(sender, message(number))
        await until(lambda: len(receiver.got) == 100, "the one that answers gets its mail")
        assert sum(len(one.batches) for one in hanging) < 200


async def test_a_receiver_that_is_attached_in_the_process_is_handed_its_mail(connect: Connect, tmp_path: Path) -> None:
    got: list[Message] = []
    answers = [None, Receipt(later={0: Refusal(code="not yet")}), Receipt(taken=1)]

    async def deliver(batch: tuple[Message, ...]) -> Receipt | None:
        answer = answers.pop(0)
        if answer is not None and answer.taken:
            got.extend(batch)
        return answer

    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        mail_service.attach("b", deliver)
        assert await mail_service.take([message(1, content=[1, "x"])]) == Receipt(taken=1)
        await sent(mail_service, 1)
        assert [one.content for one in got] == [[1, "x"]]


async def test_what_is_taken_in_the_process_shares_a_transaction_with_its_own(connect: Connect, tmp_path: Path) -> None:
    def fails(db: object) -> None:
        raise ValueError("a defect")

    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        receiver = Receiver(await connect("b"), "b")
        with pytest.raises(ValueError, match="a defect"):
            await mail_service.take([message(1)], also=fails)
        await mail_service.take([message(1)], also=lambda db: queries.keep(db, "test", "a", b"1"))
        await until(lambda: len(receiver.got) == 1, "it arrives, once")
        assert await mail_service.store.read(lambda db: queries.kept(db, "test")) == {"a": b"1"}


def put_by_hand(bus: Bus, key: str, text: str) -> None:
    """Ask as a command line does: JSON without a word on what it is."""
    bus._session.get(key, zenoh.handlers.DefaultHandler(), payload=text.encode(), target=zenoh.QueryTarget.ALL)


async def test_a_message_that_is_typed_by_hand_is_numbered_and_delivered(connect: Connect, tmp_path: Path) -> None:
    async with two_boards(connect, tmp_path) as (first, second):
        operator, receiver = await connect("operator"), Receiver(await connect("b"), "b")
        await served(operator, keys.outbox(FLEET, "a"))
        for content in ("one", "two"):
            typed = {"id": "1", "sender": "a", "performative": "tell", "receiver": "b", "content": content}
            put_by_hand(operator, keys.outbox(FLEET, "a"), json.dumps({"messages": [typed]}))
            await until(lambda: content in receiver.contents, "it arrives")  # noqa: B023
        headers = [one.header for one in receiver.got]
        assert [one.seq for one in headers] == [1, 2]
        assert headers[0].boot == headers[1].boot != ""
        await sent(first, 2)
        await sent(second, 2)


async def test_what_is_no_mail_is_answered_in_words_and_has_no_effect(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path) as mail_service:
        a, b = await connect("a"), await connect("b")
        outbox, between = keys.outbox(FLEET, "a"), keys.mail(FLEET, "a", "b")
        await served(a, outbox)
        await served(b, between)
        assert await _ask_raw(a, outbox, b'{"messages": [{"id": 1}]}') == (
            "Mail: Expected `str`, got `int` - at `$.messages[0].id`"
        )
        assert await _ask_raw(a, outbox, b"") == "expected a Mail record on a concrete key"
        everywhere = await _ask_raw(a, outbox.replace("/a/", "/*/"), b'{"messages": []}')
        assert everywhere == " ".join(["expected a Mail record on a concrete key"] * 2)
        assert await ask(a, outbox, message(1, "c")) == Receipt(
            refused={0: Refusal(code="wrong_address", text="its sender is not a")}
        )
        assert await ask(b, between, message(1, "c", "a"), message(1, "b", "a")) == Receipt(
            taken=1, refused={0: Refusal(code="wrong_address", text="it came as mail from b to a")}
        )
        assert mail_service.waiting == 1


async def _ask_raw(bus: Bus, key: str, payload: bytes) -> str:
    replies = await asyncio.to_thread(
        lambda: list(bus._session.get(key, payload=payload, target=zenoh.QueryTarget.ALL, timeout=5.0))
    )
    return " ".join(one.err.payload.to_bytes().decode() if one.err else "a record" for one in replies)


async def test_an_agent_that_moved_to_another_board_gets_there_what_waited(connect: Connect, tmp_path: Path) -> None:
    sender = await connect("a")
    async with board(connect, "pi1", tmp_path, homes={"a": "pi1", "b": "pi1", "c": "pi2"}) as mail_service:
        await post(sender, message(1), message(1, receiver="c"))
        assert mail_service.waiting == 2
    moved = {"a": "pi1", "b": "pi2", "c": "pi1"}
    async with board(connect, "pi1", tmp_path, homes=moved), board(connect, "pi2", tmp_path, homes=moved):
        b, c = Receiver(await connect("b"), "b"), Receiver(await connect("c"), "c")
        await until(lambda: b.contents == c.contents == [1], "both get their mail")


async def test_the_time_that_a_message_has_left_goes_with_it(connect: Connect, tmp_path: Path) -> None:
    now = Time()
    async with two_boards(connect, tmp_path, now=now, rules=MailRules(ttl=500.0)) as (_, second):  # type: ignore[arg-type]
        sender, bus = await connect("a"), await connect("b")
        await post(sender, message(1, ttl=60.0), message(2))
        await until(lambda: second.waiting == 2, "both are at the other board")
        now.seconds += 20
        receiver = Receiver(bus, "b")
        await until(lambda: len(receiver.got) == 2, "both arrive")
        assert receiver.got[0].ttl == pytest.approx(40.0)
        assert receiver.got[1].ttl == pytest.approx(480.0)
        assert receiver.got[0].header == Header(seq=1, boot="life1", source="a", stamp=receiver.got[0].header.stamp)


async def test_a_board_that_makes_up_names_is_remembered_by_so_many_and_the_others_go_on(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(service, "MOST_SENDERS", 2)
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD):
        bus = await connect("pi3", "commd")

        async def refused(sender: str, number: int = 1) -> set[str]:
            receipt = await ask(bus, keys.mail(FLEET, "b", sender), message(number, sender))
            assert isinstance(receipt, Receipt), receipt
            return {one.code for one in receipt.refused.values()}

        await served(bus, keys.mail(FLEET, "b", "pi3_1"))
        for sender in ("pi3_1", "pi3_2", "c"):
            assert await refused(sender) == set()
        assert await refused("pi3_3") == await refused("pi3_4") == {"too_many_senders"}
        for sender in ("pi3_1", "pi2_kid", "c"):
            assert await refused(sender, 2) == set()
    assert caplog.text.count("further ones are refused") == 1
