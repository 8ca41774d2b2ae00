"""The mail of one agent between its mind and commd: numbered, in batches, acknowledged, never doubled."""

import asyncio
from collections import Counter
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from agentd.mail.mail_client import AgentInbox
from agentd.mail.outbox import Outbox
from agentd.persistence.checkpoint import Outgoing
from commd.bus.bus import Bus, Query
from commd.client.receive_once import MessageRefused, Numbered
from commd.client.send_mail import LARGEST, Unsendable
from commd.mail.message import adds_up
from schemas.wire import keys
from schemas.wire.records import Header, Mail, Message, Receipt, Refusal
from tests.support.buses import FLEET, Connect, arrived, served, until


class Desk:
    """Serves the outbox of agent a as commd does: takes each message once, or answers a batch as the test says."""

    bus: Bus

    def __init__(self) -> None:
        self.taken: list[Message] = []
        self.batches: list[int] = []
        self.answer: Callable[[tuple[Message, ...]], Receipt | None] | None = None

    async def serve(self, query: Query[Mail]) -> None:
        messages = query.record.messages
        self.batches.append(len(messages))
        told = self.answer(messages) if self.answer is not None else Receipt(taken=len(messages))
        if told is None:
            query.reply_error("not now")
            return
        for place, message in enumerate(messages):
            known = {(one.receiver, one.header.boot, one.header.seq) for one in self.taken}
            number = (message.receiver, message.header.boot, message.header.seq)
            if place not in {*told.refused, *told.later} and number not in known:
                self.taken.append(message)
        query.reply(told)

    def told(self, receiver: str) -> list[object]:
        return [one.content for one in self.taken if one.receiver == receiver]


def an_outbox(bus: Bus) -> tuple[Outbox, list[tuple[Message, str]]]:
    refused: list[tuple[Message, str]] = []
    return Outbox(bus, "a", lambda message, why: refused.append((message, why)), Counter()), refused


def send(outbox: Outbox, number: int, *receivers: str) -> None:
    outbox.post(receivers or ("b",), "tell", number, f"mid{number}", "")


def keep(outbox: Outbox) -> None:
    """What the agent does when a checkpoint is on disk."""
    outbox.saved(unsaved(outbox))


def unsaved(outbox: Outbox) -> list[Outgoing]:
    """What a checkpoint takes."""
    found, outbox.unsaved = outbox.unsaved, []
    return found


async def a_desk(connect: Connect, agent: str = "a") -> Desk:
    desk = Desk()
    desk.bus = await connect("board", "commd")
    desk.bus.serve(keys.outbox(FLEET, agent), Mail, desk.serve)
    return desk


async def test_messages_leave_numbered_in_batches_and_in_order_per_receiver(connect: Connect) -> None:
    desk = await a_desk(connect)
    outbox, _ = an_outbox(await connect("a"))
    for number in range(1200):
        send(outbox, number, "b" if number % 3 else "c")
    keep(outbox)
    await until(lambda: outbox.counters["sent"] == 1200, "all are handed over")
    assert desk.told("b") == [number for number in range(1200) if number % 3]
    assert desk.told("c") == list(range(0, 1200, 3))
    assert [one.header.seq for one in desk.taken if one.receiver == "c"] == list(range(1, 401))
    assert len(desk.batches) < 10
    assert len(outbox) == 0
    assert sorted(outbox.gone) == list(range(1, 1201))


async def test_nothing_leaves_before_it_is_on_disk(connect: Connect) -> None:
    desk = await a_desk(connect)
    bus = await connect("a")
    outbox, _ = an_outbox(bus)
    await served(bus, keys.outbox(FLEET, "a"))
    send(outbox, 1)
    held = unsaved(outbox)
    send(outbox, 2)
    keep(outbox)
    await until(lambda: desk.told("b") == [2], "what is kept leaves")
    outbox.saved(held)
    await until(lambda: desk.told("b") == [2, 1], "the other one leaves when it is kept")


async def test_mail_waits_for_a_commd_that_is_not_there_yet_and_leaves_when_it_comes(connect: Connect) -> None:
    outbox, _ = an_outbox(await connect("a"))
    send(outbox, 1)
    keep(outbox)
    send(outbox, 2)
    keep(outbox)
    await until(lambda: outbox.counters["not_answered"] > 0, "nobody answers")
    desk = await a_desk(connect)
    outbox.retry_now()
    await until(lambda: desk.told("b") == [1, 2], "both leave, in order")


async def test_a_receipt_that_does_not_add_up_counts_as_none_and_the_batch_is_sent_again(connect: Connect) -> None:
    desk = await a_desk(connect)
    outbox, _ = an_outbox(await connect("a"))
    wrong = [Receipt(), Receipt(taken=3), Receipt(taken=1, later={7: Refusal(code="full")}), None]
    desk.answer = lambda messages: wrong.pop() if wrong else Receipt(taken=len(messages))
    send(outbox, 1)
    send(outbox, 2)
    keep(outbox)
    await until(lambda: outbox.counters["sent"] == 2, "it is sent again until the receipt is right")
    assert outbox.counters["not_answered"] == 4
    assert desk.told("b") == [1, 2]


async def test_a_full_mailbox_holds_up_its_own_pair_only(connect: Connect) -> None:
    desk = await a_desk(connect)
    outbox, _ = an_outbox(await connect("a"))
    full = True

    def answer(messages: tuple[Message, ...]) -> Receipt:
        later = {
            place: Refusal(code="mailbox_full") for place, one in enumerate(messages) if full and one.receiver == "b"
        }
        return Receipt(taken=len(messages) - len(later), later=later)

    desk.answer = answer
    for number in range(10):
        send(outbox, number, "b" if number % 2 else "c")
    keep(outbox)
    await until(lambda: len(desk.told("c")) == 5, "the others get theirs")
    send(outbox, 10, "c")
    keep(outbox)
    await until(lambda: len(desk.told("c")) == 6, "also later ones")
    assert desk.told("b") == []
    full = False
    await until(lambda: desk.told("b") == [1, 3, 5, 7, 9], "the mailbox has room again, in order")


async def test_a_receiver_with_much_mail_does_not_keep_the_others_from_theirs(connect: Connect) -> None:
    desk = await a_desk(connect)
    outbox, _ = an_outbox(await connect("a"))
    for number in range(1000):
        send(outbox, number)
    send(outbox, 0, "c")
    keep(outbox)
    await until(lambda: outbox.counters["sent"] == 1001, "all are handed over")
    assert [one.receiver for one in desk.taken].index("c") <= 500
    assert desk.told("b") == list(range(1000))


async def test_a_defect_in_telling_of_a_refusal_is_counted_and_does_not_end_the_mail(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agentd.mail.outbox.RETRY_MOST", 0.1)

    def breaks(message: Message, why: str) -> None:
        raise KeyError(why)

    desk = await a_desk(connect)
    outbox = Outbox(await connect("a"), "a", breaks, Counter())
    desk.answer = lambda messages: (
        Receipt(refused={0: Refusal(code="no")}, taken=len(messages) - 1)
        if messages[0].header.seq == 1
        else Receipt(taken=len(messages))
    )
    for number in range(3):
        send(outbox, number)
    keep(outbox)
    await until(lambda: desk.told("b") == [1, 2] and not len(outbox), "the others leave")
    assert outbox.counters["defects"] == 1


async def test_what_commd_refuses_for_good_is_reported_with_its_content(connect: Connect) -> None:
    desk = await a_desk(connect)
    outbox, refused = an_outbox(await connect("a"))
    desk.answer = lambda messages: Receipt(taken=len(messages) - 1, refused={1: Refusal(code="receiver_not_found")})
    for number in range(3):
        send(outbox, number)
    keep(outbox)
    await until(lambda: len(refused) == 1, "the agent hears of it")
    assert (refused[0][0].content, refused[0][1]) == (1, Refusal(code="receiver_not_found"))
    assert desk.told("b") == [0, 2]
    assert len(outbox) == 0


async def test_a_message_that_is_too_large_or_cannot_be_written_is_not_taken(connect: Connect) -> None:
    outbox, _ = an_outbox(await connect("a"))
    outbox.post(["b"], "tell", "x" * (LARGEST - 1000), "mid1", "")
    for content, error in (("x" * LARGEST, "message_too_large"), ("\ud800", "not_sendable")):
        with pytest.raises(Unsendable) as raised:
            outbox.post(["b"], "tell", content, "mid2", "")
        assert raised.value.reason.code == error
    assert len(outbox) == outbox.numbers["b"] == 1


async def test_more_than_may_wait_is_not_taken_and_a_broadcast_is_taken_whole_or_not_at_all(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agentd.mail.outbox.MOST_FOR_ONE", 10)
    monkeypatch.setattr("agentd.mail.outbox.MOST_BYTES", 5000)

    outbox, _ = an_outbox(await connect("a"))
    for number in range(10):
        send(outbox, number)
    with pytest.raises(Unsendable, match="10 messages to 'b' are waiting to be sent"):
        send(outbox, 10, "c", "b")
    assert outbox.numbers["c"] == 0
    with pytest.raises(Unsendable, match="at most 0 MB may") as raised:
        outbox.post(["c"], "tell", "x" * 4000, "mid1", "")
    assert raised.value.reason.code == "mailbox_full"
    desk = await a_desk(connect)
    keep(outbox)
    outbox.retry_now()
    await until(lambda: len(desk.told("b")) == 10, "they leave")
    await until(lambda: len(outbox) == 0, "there is room again")
    send(outbox, 11)


async def test_a_new_life_hands_over_the_rest_under_its_old_numbers_and_counts_from_the_start(connect: Connect) -> None:
    bus = await connect("a")
    first, _ = an_outbox(bus)
    for number in range(3):
        send(first, number)
    rows = unsaved(first)
    await first.drain(0)
    second, _ = an_outbox(bus)
    second.restore(rows[1:])
    send(second, 3)
    keep(second)
    desk = await a_desk(connect)
    second.retry_now()
    await until(lambda: desk.told("b") == [1, 2, 3], "the rest leaves in order")
    assert [one.header.seq for one in desk.taken] == [2, 3, 1]
    assert [one.header.boot for one in desk.taken] == [first.numbering, first.numbering, second.numbering]
    await until(lambda: len(second.gone) == 3, "the receipts are read")
    assert sorted(second.gone) == [2, 3, 4]


@pytest.mark.parametrize(
    ("receipt", "right"),
    [
        (Receipt(taken=3), True),
        (Receipt(taken=1, refused={0: Refusal(code="x")}, later={2: Refusal(code="y")}), True),
        (Receipt(taken=2), False),
        (Receipt(taken=1, refused={1: Refusal(code="x")}, later={1: Refusal(code="y")}), False),
        (Receipt(taken=2, later={3: Refusal(code="y")}), False),
        (Receipt(taken=2, later={-1: Refusal(code="y")}), False),
    ],
)
def test_a_receipt_says_what_became_of_each_message(receipt: Receipt, right: bool) -> None:
    assert adds_up(receipt, 3) == right


class Reader:
    """Agent b as its inbox sees it, and commd as it hands over."""

    def __init__(self, bus: Bus, backfill: Bus) -> None:
        self.fed: list[object] = []
        self.full = False
        self.missing: list[tuple[str, int]] = []
        self.inbox = AgentInbox(bus, "b", lambda: not self.full, self.read, lambda *what: self.missing.append(what))
        self.bus, self.backfill = bus, backfill

    def read(self, message: Message) -> Callable[[], None]:
        if message.content == "bad":
            raise MessageRefused(Refusal(code="unreadable"))
        return lambda: self.take(message)

    def take(self, message: Message) -> None:
        self.fed.append(message.content)
        self.inbox.waiting.append((Numbered(message.sender, message.header.boot), message.header.seq, None))

    async def hand_over(self, *messages: Message) -> Receipt:
        mail = Mail(messages=messages)
        async for reply in self.backfill.query(keys.inbox(FLEET, "b"), mail, Receipt, 60):
            assert reply.record is not None, reply.error
            return reply.record
        raise AssertionError("nobody serves the inbox")

    def absorb(self, left: int = 0) -> None:
        """The mind takes what waits but so many, and that is on disk."""
        self.inbox.absorb(left)
        self.inbox.done(self.inbox.captured()[0])


async def a_reader(connect: Connect) -> Reader:
    backfill = await connect("board", "commd")
    reader = Reader(await connect("b"), backfill)
    await served(backfill, keys.inbox(FLEET, "b"))
    return reader


def numbered(seq: int, content: object = None, sender: str = "a", numbering: str = "n") -> Message:
    return Message(
        header=Header(seq=seq, boot=numbering),
        id=f"m{seq}",
        sender=sender,
        performative="tell",
        receiver="b",
        content=seq if content is None else content,  # type: ignore[arg-type]
    )


async def test_a_message_is_acknowledged_only_when_what_came_of_it_is_kept(connect: Connect) -> None:
    reader = await a_reader(connect)
    answer = asyncio.create_task(reader.hand_over(numbered(1), numbered(2)))
    await until(lambda: reader.fed == [1, 2], "the mind gets both")
    reader.inbox.absorb(1)
    held, *_ = reader.inbox.captured()
    reader.inbox.absorb(0)
    await arrived(reader.bus, reader.backfill)
    assert not answer.done()
    reader.inbox.done(held)
    await arrived(reader.bus, reader.backfill)
    assert not answer.done()
    reader.absorb()
    assert (await answer) == Receipt(taken=2)


async def test_what_is_not_absorbed_in_time_is_to_be_sent_again_and_is_not_fed_twice(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agentd.mail.mail_client.PATIENCE", 0.2)

    reader = await a_reader(connect)
    told = await reader.hand_over(numbered(1), numbered(2), numbered(1, sender="c"))
    assert (told.taken, sorted(told.later)) == (0, [0, 1, 2])
    reader.absorb(left=2)
    told = await reader.hand_over(numbered(1), numbered(2), numbered(1, sender="c"))
    assert (told.taken, sorted(told.later)) == (1, [1, 2])
    reader.absorb()
    assert await reader.hand_over(numbered(1), numbered(2), numbered(1, sender="c")) == Receipt(taken=3)
    assert reader.fed == [1, 2, 1]


async def test_a_new_life_takes_no_message_again_that_the_last_one_kept(connect: Connect) -> None:
    reader = await a_reader(connect)
    reader.inbox.restore({Numbered("a", "n"): 7})
    assert await reader.hand_over(numbered(6), numbered(7)) == Receipt(taken=2)
    assert reader.fed == []
    answer = asyncio.create_task(reader.hand_over(numbered(8), numbered(1, numbering="other")))
    await until(lambda: reader.fed == [8, 1], "new numbers and new numberings are new messages")
    reader.absorb()
    assert await answer == Receipt(taken=2)


async def test_numbers_that_did_not_come_are_reported(connect: Connect) -> None:
    reader = await a_reader(connect)
    reader.inbox.restore({Numbered("a", "n"): 7})
    answer = asyncio.create_task(reader.hand_over(numbered(8), numbered(12), numbered(13, "bad"), numbered(14)))
    await until(lambda: reader.fed == [8, 12, 14], "what came is taken")
    reader.absorb()
    await answer
    assert reader.missing == [("a", 3)]


async def test_what_cannot_be_taken_now_or_ever_is_said_message_by_message(connect: Connect) -> None:
    reader = await a_reader(connect)
    reader.full = True
    late = Message(
        header=Header(seq=9, boot="n"), id="m", sender="d", performative="tell", receiver="b", content=1, ttl=0
    )
    told = await reader.hand_over(numbered(1), numbered(2, "bad"), numbered(3), late)
    assert {place: why.code for place, why in told.refused.items()} == {1: "unreadable", 3: "expired"}
    assert {place: why.code for place, why in told.later.items()} == {0: "mailbox_full", 2: "mailbox_full"}
    assert reader.fed == []


async def test_a_message_behind_one_too_late_waits_for_the_refusal_though_its_answer_is_lost(connect: Connect) -> None:
    reader = await a_reader(connect)
    batch = (replace(numbered(1), ttl=0.0), numbered(2))
    for _ in range(2):  # the first answer is lost
        told = await reader.hand_over(*batch)
        assert (told.taken, told.refused, list(told.later)) == (0, {0: Refusal(code="expired")}, [1])
    answer = asyncio.create_task(reader.hand_over(numbered(2)))
    await until(lambda: reader.fed == [2], "commd knows, and goes on behind it")
    reader.absorb()
    assert await answer == Receipt(taken=1)


async def test_a_batch_in_which_each_message_is_of_another_life_is_known_when_it_comes_again(connect: Connect) -> None:
    reader = await a_reader(connect)
    batch = [numbered(1, content=life, numbering=f"n{life}") for life in range(500)]
    for _ in range(2):  # the first answer is lost
        answer = asyncio.create_task(reader.hand_over(*batch))
        await until(lambda: len(reader.fed) == 500, "it is fed")
        reader.absorb()
        assert await answer == Receipt(taken=500)
    assert reader.fed == list(range(500))


async def test_the_last_numberings_of_senders_are_remembered(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.client.receive_once.NUMBERINGS", 8)

    reader = await a_reader(connect)
    for number in range(12):
        answer = asyncio.create_task(reader.hand_over(numbered(1, numbering=f"n{number}")))
        await until(lambda n=number: len(reader.fed) == n + 1, "it is new")  # type: ignore[misc]
        reader.absorb()
        assert await answer == Receipt(taken=1)
    assert await reader.hand_over(*(numbered(1, numbering=f"n{number}") for number in range(4, 12))) == Receipt(taken=8)
    assert len(reader.fed) == 12
