"""What is done with messages in a board's mail file, without a board."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from commd.mail import queries
from commd.mail.inspection import list_mailboxes
from commd.mail.message import DEEPEST, stored, undelivered
from commd.mail.schema import migrate
from commd.mail.sqlite_file import connect
from schemas.wire.codec import codec
from schemas.wire.records import Mail, Mailboxes, Message, Refusal
from schemas.wire.terms import Structure, Term
from tests.commd.offices import message


def memory() -> tuple[sqlite3.Connection, queries.Tally]:
    db, tally = sqlite3.connect(":memory:", isolation_level=None), queries.Tally()
    migrate(db)
    tally.count(db)
    return db, tally


def nested(depth: int) -> Term:
    content: Term = 1
    for _ in range(depth):
        content = (content,)
    return content


def test_a_batch_in_which_each_message_is_of_another_life_is_known_when_it_comes_again() -> None:
    db, tally = memory()
    batch = [stored(message(1, life=f"life{number}"), "b", None) for number in range(queries.BATCH)]
    assert queries.put(db, tally, batch, 0.0, None) == [queries.TAKEN] * queries.BATCH
    assert queries.put(db, tally, batch, 0.0, None) == [queries.AGAIN] * queries.BATCH


def test_what_goes_back_to_a_board_that_has_sent_it_goes_with_new_numbers_in_its_order() -> None:
    """Board pi1 has sent 1 to 8 to pi2, where b lived; b moves to pi1, and what it has not fetched there goes back."""
    (first, tally1), (second, tally2) = memory(), memory()
    sent = [stored(message(number), "a>b", None) for number in range(1, 9)]
    queries.put(first, tally1, sent, 0.0, None)
    queries.remove(first, tally1, list(range(1, 9)))
    queries.put(second, tally2, [stored(message(number), "b", None) for number in range(5, 9)], 0.0, None)
    queries.move(second, tally2, "b", home=False)
    found, _ = queries.front(second, "a>b", 0)
    back = [one.carried(0.0) for one in found]
    assert [(one.header.boot, one.header.seq) for one in back] == [(tally2.numbering, n) for n in range(1, 5)]
    mail = codec(Mail).decode(codec(Mail).encode(Mail(messages=tuple(one.read(0.0) for one in found))))
    kept = [stored(one, "b", None) for one in mail.messages]
    assert queries.put(first, tally1, kept, 0.0, None) == [queries.TAKEN] * 4
    assert queries.put(first, tally1, kept, 0.0, None) == [queries.AGAIN] * 4
    assert [one.read(0.0).content for one in queries.front(first, "b", 0)[0]] == [5, 6, 7, 8]


@pytest.mark.parametrize("header", [{"number": 2**63}, {"number": 2**53 + 1}, {"number": 1, "life": "x" * 65}])
def test_a_number_that_no_file_takes_is_refused_message_by_message(header: dict[str, int | str]) -> None:
    with pytest.raises(ValueError, match="its number is above"):
        stored(message(**header), "b", None)  # type: ignore[arg-type]


def test_the_deepest_content_that_is_taken_can_be_wrapped_listed_and_sent_on() -> None:
    db, tally = memory()
    with pytest.raises(ValueError, match="nested too deeply"):
        stored(message(1, content=nested(DEEPEST + 1)), "a>b", None)
    deepest = stored(message(1, content=nested(DEEPEST)), "a>b", None)
    queries.put(db, tally, [deepest], 0.0, None)
    assert queries.move_to_dead_letters(db, tally, {1: Refusal(code="expired")}, {"a": "a"}, 0.0) == ["a"]
    (notice,), _ = queries.front(db, "a", 0)
    assert isinstance(notice.read(0.0).content, Structure)
    told = codec(Mailboxes).decode(codec(Mailboxes).encode(list_mailboxes(db, 0.0, lambda _: "")))
    assert isinstance(told.dead[0].message.content, (list, tuple)), "it is shown as it was"


def test_what_is_too_deep_in_an_older_file_is_told_of_without_its_content() -> None:
    deep = message(1, content=nested(DEEPEST + 50))
    db, tally = memory()
    db.execute("INSERT INTO dead VALUES(1, 'expired', '', 0, 1, ?)", (codec(Message).encode(deep, "msgpack"),))
    assert list_mailboxes(db, 0.0, lambda _: "").dead[0].message.content == "(nested too deeply to be shown)"
    assert "nested too deeply" in str(undelivered(deep, Refusal(code="expired")).content)
    assert tally.dead == 0


def test_a_board_numbers_anew_in_each_life_for_its_file_may_have_gone_back(tmp_path: Path) -> None:
    own = set()
    for _ in range(2):
        db, tally = connect(tmp_path / "b.mail", "full"), queries.Tally()
        migrate(db)
        tally.count(db)
        own.add(tally.numbering)
        db.close()
    assert len(own) == 2
