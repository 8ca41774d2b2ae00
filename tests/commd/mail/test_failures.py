"""Mail that cannot arrive: it is refused at once, waits, or is given up with a dead stored and a notice."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from commd.bus.bus import Bus, Query
from commd.mail.message import LARGEST
from commd.mail.service import MailService
from schemas.mission.model import MailRules
from schemas.wire import keys
from schemas.wire.codec import TooDeep
from schemas.wire.records import Mail, Message, Receipt, Refusal
from schemas.wire.terms import Atom, Structure
from tests.commd.mail.test_service import Losing
from tests.commd.offices import Receiver, Time, ask, board, listed, message, post
from tests.support.buses import FLEET, Connect, served, until

ONE_BOARD = {"a": "pi1", "b": "pi1"}


async def sweep(mail_service: MailService) -> None:
    """Let it judge expired mail now, as it does four times a second."""
    await mail_service._give_up_late()


def notice(receiver: str, content: object, code: str, detail: str = "") -> Structure:
    annotations = (Structure("detail", (detail,)),) if detail else ()
    return Structure("undelivered", (Atom(receiver), Atom("tell"), content, code), annotations)  # type: ignore[arg-type]


async def test_a_receiver_that_nobody_knows_is_refused_at_once(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        batch = (message(1, receiver="nobody"), message(1), message(2, receiver="nobody"))
        assert await post(sender, *batch) == Receipt(
            taken=1, refused={0: Refusal(code="receiver_not_found"), 2: Refusal(code="receiver_not_found")}
        )
        await until(lambda: receiver.contents == [1], "the other one arrives")
        await until(lambda: mail_service.waiting == 0, "nothing is left")
        assert (await listed(sender, "pi1")).dead == (), "the sender knows: it holds the message itself"


async def test_a_message_of_more_than_a_megabyte_is_refused_and_one_of_a_megabyte_arrives(
    connect: Connect, tmp_path: Path
) -> None:
    async with board(connect, "pi1", tmp_path) as first, board(connect, "pi2", tmp_path):
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        fits = message(1, content="x" * (LARGEST - 200))
        too_large = message(2, content="x" * LARGEST)
        assert await post(sender, fits, too_large, message(3)) == Receipt(
            taken=2, refused={1: Refusal(code="message_too_large")}
        )
        numbers = message(4, content=[1.5] * 200_000)  # 800 kB of JSON, 1.8 MB of MessagePack
        assert await post(sender, numbers) == Receipt(taken=1)
        await until(lambda: len(receiver.got) == 3, "the others arrive")
        assert receiver.got[0] == fits
        assert receiver.got[2] == numbers
        assert first.counters["turned_away"] == 1


async def test_a_full_mailbox_takes_the_newest_later_and_keeps_the_order(connect: Connect, tmp_path: Path) -> None:
    homes = {"a": "pi1", "b": "pi1", "c": "pi1"}
    async with board(connect, "pi1", tmp_path, homes=homes, rules=MailRules(mailbox=5)) as mail_service:
        a, c, bus = await connect("a"), await connect("c"), await connect("b")
        full = Refusal(code="mailbox_full")
        assert await post(a, *map(message, range(1, 8))) == Receipt(taken=5, later={5: full, 6: full})
        assert await post(c, message(1, "c")) == Receipt(later={0: full})
        assert await post(c, message(1, "c", "a")) == Receipt(taken=1), "another mailbox has room"
        assert await post(a, message(5), message(6)) == Receipt(taken=1, later={1: full}), "the 5th is taken already"
        receiver = Receiver(bus, "b")
        await until(lambda: receiver.contents == [1, 2, 3, 4, 5], "what was taken arrives")
        await until(lambda: mail_service.waiting == 1, "only the message to a is left")
        assert await post(a, message(6), message(7)) == Receipt(taken=2)
        await until(lambda: receiver.contents == [1, 2, 3, 4, 5, 6, 7], "the others arrive too")


async def test_mail_for_a_full_mailbox_of_another_board_waits_at_its_own(connect: Connect, tmp_path: Path) -> None:
    async with (
        board(connect, "pi1", tmp_path) as first,
        board(connect, "pi2", tmp_path, rules=MailRules(mailbox=3)) as second,
    ):
        sender, bus = await connect("a"), await connect("b")
        assert await post(sender, *map(message, range(1, 9))) == Receipt(taken=8)
        await until(lambda: second.waiting == 3, "the other mailbox is full")
        await until(lambda: "mailbox_full" in first.state_of("a", "b"), "and its board says so")
        receiver = Receiver(bus, "b")
        await until(lambda: receiver.contents == list(range(1, 9)), "all arrive in order")


async def test_a_message_whose_time_is_over_is_given_up_and_told_once(connect: Connect, tmp_path: Path) -> None:
    now = Time()
    async with board(connect, "pi1", tmp_path, now=now) as first:
        sender = await connect("a")
        told = Receiver(sender, "a")
        await post(sender, message(1, ttl=10.0), message(2, ttl=30.0), message(3), message(4, ttl=10.0))
        await until(lambda: "pi2 is away" in first.state_of("a", "b"), "they wait")
        now.seconds += 11
        await until(lambda: len(told.got) == 2, "the sender is told")
        assert [one.content for one in told.got] == [notice("b", 1, "expired"), notice("b", 4, "expired")]
        assert {(one.sender, one.performative) for one in told.got} == {("mail", "signal")}
        boxes_ = await listed(sender, "pi1")
        assert [(one.message.content, one.reason.code) for one in boxes_.dead] == [(1, "expired"), (4, "expired")]
        assert boxes_.dead_count == 2
        receiver = Receiver(await connect("b"), "b")
        async with board(connect, "pi2", tmp_path, now=now):
            await until(lambda: receiver.contents == [2, 3], "the others arrive")
        assert len(told.got) == 2
        assert first.counters_now["expired"] == 2


async def test_a_message_expires_at_the_receivers_board_too_and_is_reported(connect: Connect, tmp_path: Path) -> None:
    now = Time()
    async with board(connect, "pi1", tmp_path, now=now), board(connect, "pi2", tmp_path, now=now) as second:
        sender = await connect("a")
        told = Receiver(sender, "a")
        await post(sender, message(1, ttl=10.0))
        await until(lambda: second.waiting == 1 and "away" in second.state_of("a", "b"), "it waits for its agent")
        now.seconds += 11
        await until(lambda: len(told.got) == 1, "the sender is told")
        assert told.got[0].content == notice("b", 1, "expired")
        await until(lambda: second.waiting == 0, "nothing waits any more, the notice was the last")


async def test_the_missions_time_to_live_is_for_messages_that_bring_none(connect: Connect, tmp_path: Path) -> None:
    now = Time()
    rules = MailRules(ttl=5.0)  # type: ignore[arg-type]
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD, now=now, rules=rules) as mail_service:
        sender = await connect("a")
        await post(sender, message(1), message(2, ttl=60.0))
        await until(lambda: "away" in mail_service.state_of("a", "b"), "they wait")
        now.seconds += 6
        await until(lambda: mail_service.counters_now["expired"] == 1, "one is given up")
        receiver = Receiver(await connect("b"), "b")
        await until(lambda: receiver.contents == [2], "the other one arrives")


async def test_what_may_have_arrived_in_time_is_asked_for_before_it_is_given_up(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first batch is taken and its receipt lost; the second one never arrives. Both are too late by then."""
    monkeypatch.setattr("commd.mail.delivery.RETRY_MOST", 0.3)
    now = Time()
    air = Losing(True, False, *[False] * 6)
    async with board(connect, "pi1", tmp_path, now=now, air=air) as first, board(connect, "pi2", tmp_path, now=now):
        sender, receiver = await connect("a"), Receiver(await connect("b"), "b")
        told = Receiver(sender, "a")
        await post(sender, message(1, ttl=10.0))
        await until(lambda: receiver.contents == [1], "it arrives")
        now.seconds += 11
        await until(lambda: first.waiting == 0, "its board learns that it had arrived")
        assert first.counters_now["expired"] == 0
        assert told.got == []
        assert receiver.contents == [1]


async def test_what_comes_too_late_is_given_up_once_by_the_receivers_board_whatever_becomes_of_the_answer(
    connect: Connect, tmp_path: Path
) -> None:
    async with board(connect, "pi2", tmp_path) as mail_service:
        bus, between = await connect("pi1"), keys.mail(FLEET, "b", "a")
        await served(bus, between)
        late = (message(1, ttl=0.0), message(2))
        assert await ask(bus, between, *late) == Receipt(taken=2)
        assert await ask(bus, between, *late) == Receipt(taken=2), "its answer was lost, it comes again"
        await until(lambda: mail_service.counters_now["given_up"] == 1, "it is given up")
        told = await listed(bus, "pi2")
        assert [(one.message.content, one.reason.code) for one in told.dead] == [(1, "expired")]
        assert {(queue.sender, queue.receiver) for queue in told.queues} == {("a", "b"), ("mail", "a")}


async def test_what_may_have_arrived_and_nobody_says_is_given_up_as_unknown(connect: Connect, tmp_path: Path) -> None:
    now = Time()
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD, now=now) as mail_service:
        sender, bus = await connect("a"), await connect("b")
        told, silent = Receiver(sender, "a"), Receiver(bus, "b", lambda _: None)
        await post(sender, message(1, ttl=10.0))
        await until(lambda: bool(silent.batches), "it is handed over, and no word comes")
        silent.leave()
        now.seconds += 30
        await sweep(mail_service)
        assert mail_service.waiting == 1, "a moment is left to its receiver to say"
        now.seconds += 60
        await until(lambda: len(told.got) == 1, "the sender is told")
        assert told.got[0].content == notice("b", 1, "unknown")


async def test_what_a_receiver_refuses_is_a_dead_letter_and_its_sender_told(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path), board(connect, "pi2", tmp_path) as second:
        sender, bus = await connect("a"), await connect("b")
        told = Receiver(sender, "a")
        answers = [Receipt(taken=2, refused={1: Refusal(code="unreadable", text="it cannot be read")})]
        Receiver(bus, "b", lambda mail: answers.pop() if answers else Receipt(taken=len(mail.messages)))
        await post(sender, message(1), message(2), message(3))
        await until(lambda: len(told.got) == 1, "the sender is told")
        assert told.got[0].content == notice("b", 2, "unreadable", "it cannot be read")
        await until(lambda: second.waiting == 0, "nothing is left")
        dead = (await listed(sender, "pi2")).dead
        assert [(one.message, one.reason) for one in dead] == [
            (message_as(2, dead[0].message), Refusal(code="unreadable", text="it cannot be read"))
        ]


async def test_what_a_receiver_will_never_read_is_given_up_and_what_stands_behind_it_arrives(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD):
        sender, bus = await connect("a"), await connect("b")
        told, decode = Receiver(sender, "a"), bus._decode

        def cannot(*what: Any) -> Any:
            found = decode(*what)
            if isinstance(found, Mail) and any(one.content == 2 for one in found.messages):
                raise TooDeep("Mail: nested too deeply")
            return found

        monkeypatch.setattr(bus, "_decode", cannot)
        receiver = Receiver(bus, "b")
        await post(sender, message(1), message(2), message(3))
        await until(lambda: receiver.contents == [1, 3], "the others arrive")
        await until(lambda: len(told.got) == 1, "the sender is told")
        (dead,) = (await listed(sender, "pi1")).dead
        assert (dead.message.content, dead.reason.code) == (2, "unreadable")


def message_as(number: int, like: Message) -> Message:
    """The message of a number with the time stamp of another one."""
    made = message(number)
    return Message(
        header=like.header,
        id=made.id,
        sender=made.sender,
        performative=made.performative,
        receiver=made.receiver,
        content=made.content,
    )


async def test_a_notice_that_cannot_be_delivered_makes_no_further_notice(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        a, b = await connect("a"), await connect("b")
        Receiver(b, "b", lambda mail: Receipt(refused=dict.fromkeys(range(len(mail.messages)), Refusal(code="no"))))
        Receiver(
            a, "a", lambda mail: Receipt(refused=dict.fromkeys(range(len(mail.messages)), Refusal(code="no_notices")))
        )
        await post(a, message(1))
        await until(lambda: mail_service.counters_now["given_up"] == 2, "the message and its notice are given up")
        assert [one.reason.code for one in (await listed(a, "pi1")).dead] == ["no", "no_notices"]
        await until(lambda: mail_service.waiting == 0, "nothing is left")
        assert mail_service.counters_now["given_up"] == 2


async def test_who_joins_is_served_and_what_waits_when_they_leave_is_given_up(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD) as mail_service:
        sender = await connect("a")
        told = Receiver(sender, "a")
        mail_service.know_everybody(homes := dict(ONE_BOARD))
        assert await post(sender, message(1, receiver="guest")) == Receipt(
            refused={0: Refusal(code="receiver_not_found")}
        )
        homes["guest"] = "pi1"
        mail_service.host("guest")
        mail_service.host("guest")
        assert await post(sender, message(1, receiver="guest")) == Receipt(taken=1)
        guest = Receiver(await connect("guest"), "guest")
        await until(lambda: guest.contents == [1], "it arrives")
        guest.leave()
        assert await post(sender, message(2, receiver="guest")) == Receipt(taken=1)
        del homes["guest"]
        await mail_service.unhost("guest")
        await until(lambda: len(told.got) == 1, "the sender is told")
        assert told.got[0].content == notice("guest", 2, "receiver_left")
        assert await _answers(sender, keys.outbox(FLEET, "guest")) == 0

        homes["far"] = "pi9"
        assert await post(sender, message(1, receiver="far")) == Receipt(taken=1)
        del homes["far"]
        await mail_service.gone("far")
        await until(lambda: len(told.got) == 2, "the sender is told of the other one too")
        await until(lambda: mail_service.waiting == 0, "nothing is left")


async def _answers(bus: Bus, key: str) -> int:
    return len([one async for one in bus.query(key, Mail(), Receipt, 60)])


async def test_what_waits_is_listed_with_its_age_and_what_it_waits_for(connect: Connect, tmp_path: Path) -> None:
    now = Time()
    homes = {"a": "pi1", "b": "pi2", "c": "pi1"}
    async with board(connect, "pi1", tmp_path, homes=homes, now=now) as mail_service:
        sender = await connect("a")
        await post(sender, message(1), message(2), message(1, receiver="c"))
        await until(
            lambda: bool(mail_service.state_of("a", "b") and mail_service.state_of("a", "c")), "both have been tried"
        )
        now.seconds += 7
        found = await listed(sender, "pi1")
        assert (found.board, found.store, found.synchronous) == ("pi1", str(tmp_path / "pi1.mail"), "full")
        assert [(q.box, q.sender, q.receiver, q.messages, q.oldest, q.state) for q in found.queues] == [
            ("outbox", "a", "b", 2, 7.0, "pi2 is away"),
            ("inbox", "a", "c", 1, 7.0, "c is away"),
        ]
        assert 100 < found.queues[0].bytes < 400
        assert mail_service.health().counters["waiting"] == 3


async def test_the_age_of_what_waits_goes_on_over_a_restart(connect: Connect, tmp_path: Path) -> None:
    now, sender = Time(), await connect("a")
    async with board(connect, "pi1", tmp_path, now=now):
        now.seconds += 100
        await post(sender, message(1))
        now.seconds += 5
    now.seconds += 20
    async with board(connect, "pi1", tmp_path, now=now):
        await served(sender, keys.mailboxes(FLEET, "pi1"))
        assert [queue.oldest for queue in (await listed(sender, "pi1")).queues] == [25.0]


async def test_a_batch_has_as_long_for_its_receipt_as_it_needs_on_a_slow_link(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.mail.delivery.ANSWER_TIMEOUT", 0.1)
    other, batches = await connect("pi2", "commd"), list[int]()

    async def slow(query: Query[Mail]) -> None:
        batches.append(len(query.record.messages))
        await asyncio.sleep(0.5)
        query.reply(Receipt(taken=len(query.record.messages)))

    other.serve(keys.mail(FLEET, "b", "*"), Mail, slow)
    other.token(keys.alive(FLEET, "pi2", "commd", other.boot))
    async with board(connect, "pi1", tmp_path) as mail_service:
        sender = await connect("a")
        await post(sender, *(message(number, content="x" * 20_000) for number in range(1, 7)))
        await until(lambda: mail_service.waiting == 0, "all are taken")
        assert mail_service.counters_now["unanswered"] == 0
        assert batches == [3, 3], "a batch for another board is small"


async def test_mail_for_somebody_whom_nobody_knows_any_more_is_given_up_after_a_while(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.mail.service.STRANGER", 0.5)
    monkeypatch.setattr("commd.mail.service.LOOK_EVERY", 1)
    sender = await connect("a")
    async with board(connect, "pi1", tmp_path):
        await post(sender, message(1))
    told = Receiver(sender, "a")
    async with board(connect, "pi1", tmp_path, homes={"a": "pi1"}) as mail_service:
        await until(lambda: len(told.got) == 1, "the sender is told")
        assert told.got[0].content == notice("b", 1, "receiver_left")
        await until(lambda: mail_service.waiting == 0, "nothing waits for ever")


async def test_notices_of_the_board_itself_find_room_in_a_full_mailbox(connect: Connect, tmp_path: Path) -> None:
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD, rules=MailRules(mailbox=1)) as mail_service:
        await post(await connect("a"), message(1))
        told = Message(id="df.1", sender="df", performative="tell", receiver="b", content="provider")
        assert await mail_service.take([told]) == Receipt(taken=1)
        assert await mail_service.take([message(2)]) == Receipt(later={0: Refusal(code="mailbox_full")})


async def test_a_message_that_a_program_has_in_hand_when_its_time_ends_is_not_told_to_have_expired(
    connect: Connect, tmp_path: Path
) -> None:
    now, done = Time(), asyncio.Event()
    async with board(connect, "pi1", tmp_path, homes=ONE_BOARD, now=now) as mail_service:
        sender, bus = await connect("a"), await connect("b")

        def answer(batch: Mail) -> Receipt:
            taken = len(batch.messages)
            return (
                Receipt(taken=taken)
                if done.is_set()
                else Receipt(later=dict.fromkeys(range(taken), Refusal(code="in hand")))
            )

        program, told = Receiver(bus, "b", answer), Receiver(sender, "a")
        await post(sender, message(1, ttl=10.0))
        await until(lambda: bool(program.batches), "the program has it in hand")
        now.seconds += 20
        await sweep(mail_service)
        done.set()
        await until(lambda: mail_service.waiting == 0, "the program is done with it")
        assert (mail_service.counters_now["given_up"], told.got) == (0, [])
