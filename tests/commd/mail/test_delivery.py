"""Which line gets a worker when, with peers that are away, full, hanging or cannot read what they get."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from commd.client.receive_mail import ProgramInbox
from commd.mail import queries
from commd.mail.age_clock import MailClock
from commd.mail.delivery import MAX_CODE, MAX_TEXT, OF_ONE, RETRY_FIRST, DeliveryQueues, NotTaken
from commd.mail.message import StoredMessage, stored
from commd.mail.store import Store, open_store
from schemas.wire.records import Receipt, Refusal
from tests.commd.offices import message
from tests.support.buses import until

Carry = Callable[[str, Sequence[StoredMessage]], Awaitable[Receipt | NotTaken]]


class FakePeers:
    """Sends by `carry`; a line's peer and group is the last letter of its name."""

    def __init__(self, carry: Carry) -> None:
        self.carry = carry

    def of(self, line: str) -> str:
        return line[-1]

    group_of = of


class Refused(dict[int, Refusal]):
    """Collects what was given up."""

    def __init__(self, store: Store, tally: queries.Tally) -> None:
        self._store, self._tally = store, tally

    async def give_up(self, reasons: Mapping[int, Refusal], senders: set[str]) -> None:
        self.update(reasons)
        await self._store.write(lambda db: queries.remove(db, self._tally, list(reasons)))


@asynccontextmanager
async def lanes_of(
    folder: Path, lines: Sequence[str], carry: Carry, each: int = 1
) -> AsyncIterator[tuple[DeliveryQueues, queries.Tally, dict[int, Refusal]]]:
    """Deliver lines with `each` messages."""
    tally = queries.Tally()
    async with open_store(folder / "x.mail", "normal", tally.count) as store:
        letters = [
            stored(message(number, line.partition(">")[0], line.rpartition(">")[2]), line, None)
            for line in lines
            for number in range(1, each + 1)
        ]
        await store.write(lambda db: queries.put(db, tally, letters, 0.0, None))
        refused = Refused(store, tally)
        delivery_queues = DeliveryQueues(store, tally, MailClock(), FakePeers(carry), refused.give_up)  # type: ignore[arg-type]
        delivery_queues.begin()
        try:
            yield delivery_queues, tally, refused
        finally:
            await delivery_queues.end()


async def test_lines_of_a_full_peer_do_not_wake_one_another_while_a_third_board_is_away(tmp_path: Path) -> None:
    tries: Counter[str] = Counter()

    async def carry(line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        tries[line] += 1
        if line.endswith("z"):
            return NotTaken("z is away", certain=True, away=True)
        return Receipt(later=dict.fromkeys(range(len(batch)), Refusal(code="mailbox_full")))

    async with lanes_of(tmp_path, ["a>b", "c>b", "a>z"], carry):
        await until(lambda: tries["a>b"] >= 4, "it is tried again, with pauses that double")
        assert tries["c>b"] <= 6


async def test_a_program_that_is_busy_with_one_message_is_soon_offered_more_after_what_is_new(tmp_path: Path) -> None:
    pauses: dict[int, list[float]] = {1: [], 2: []}

    async def carry(line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        pauses[len(batch)].append(delivery_queues._lines[line].pause)
        return Receipt(later=dict.fromkeys(range(len(batch)), ProgramInbox.NOT_DONE))

    async with lanes_of(tmp_path, ["b"], carry) as (delivery_queues, tally, _):
        await until(lambda: len(pauses[1]) == 4, "it is offered again, with pauses that double")
        more = [stored(message(2, "a", "b"), "b", None)]
        await delivery_queues._store.write(lambda db: queries.put(db, tally, more, 0.0, None))
        delivery_queues.added("b")
        await until(lambda: len(pauses[2]) >= 3, "what is new is offered with it")
    assert pauses[2][:3] == [pauses[1][-1] * 2, RETRY_FIRST * 2, RETRY_FIRST * 4]


async def test_a_line_that_is_empty_when_it_tries_for_an_absent_peer_leaves_the_others_trying(tmp_path: Path) -> None:
    tries: Counter[str] = Counter()
    there = asyncio.Event()

    async def carry(line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        tries[line] += 1
        return Receipt(taken=len(batch)) if there.is_set() else NotTaken("z is away", certain=True, away=True)

    async with lanes_of(tmp_path, ["a>z", "c>z"], carry) as (delivery_queues, tally, _):
        await until(lambda: tries["a>z"] > 0 < tries["c>z"], "both know that it is away")
        first = next(iter(delivery_queues._away["z"].queues))
        empty = [place for place, line in ((1, "a>z"), (2, "c>z")) if line == first]
        await delivery_queues._store.write(lambda db: queries.remove(db, tally, empty))
        there.set()  # without a token that would tell
        await until(lambda: not tally.lines, "the other one is tried again")


async def test_a_process_that_hangs_with_many_receivers_leaves_couriers_for_others(tmp_path: Path) -> None:
    hanging: set[str] = set()
    got: list[str] = []

    async def carry(line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        if line.endswith("h"):
            hanging.add(line)
            await asyncio.Event().wait()
        got.append(line)
        return Receipt(taken=len(batch))

    lines = [f"n{number}h" for number in range(150)] + ["b"]
    async with lanes_of(tmp_path, lines, carry):
        await until(lambda: got == ["b"], "it is served beside them")
        assert len(hanging) == OF_ONE


async def test_lines_that_wait_for_a_courier_of_their_process_all_go_in_the_end(tmp_path: Path) -> None:
    got: list[str] = []

    async def carry(line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        await asyncio.sleep(0)
        got.append(line)
        return Receipt(taken=len(batch))

    lines = [f"n{number}h" for number in range(100)]
    async with lanes_of(tmp_path, lines, carry) as (_, tally, _):
        await until(lambda: not tally.lines, "all lines are empty")
        assert sorted(got) == sorted(lines)


async def test_a_refusal_of_any_length_is_kept_cut(tmp_path: Path) -> None:
    async def carry(line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        return Receipt(taken=0, refused={0: Refusal(code="c" * 1000, text="t" * 1_000_000)})

    async with lanes_of(tmp_path, ["b"], carry, each=1) as (_, tally, refused):
        await until(lambda: not tally.lines, "the line is empty")
        assert refused == {1: Refusal(code="c" * MAX_CODE, text="t" * MAX_TEXT)}


@pytest.mark.parametrize(
    "wrong", [Receipt(taken=1, refused={9: Refusal(code="x")}), Receipt(taken=1, later={-1: Refusal(code="x")})]
)
async def test_a_receipt_for_messages_that_were_not_in_the_batch_is_no_answer(tmp_path: Path, wrong: Receipt) -> None:
    answers = [wrong]

    async def carry(line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        return answers.pop() if answers else Receipt(taken=len(batch))

    async with lanes_of(tmp_path, ["b"], carry, each=2) as (delivery_queues, tally, _):
        await until(lambda: not tally.lines, "it is sent again")
        assert delivery_queues.counters["bad_receipts"] == 1
