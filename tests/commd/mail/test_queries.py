"""What is done with messages in a board's mail file, without a board."""

import sqlite3
from copy import deepcopy
from pathlib import Path

import pytest

from commd.mail import queries
from commd.mail.inspection import list_mailboxes
from commd.mail.message import DEEPEST, read, read_plain, stored, undelivered
from commd.process.sqlite_file import SqliteFile, migrate
from schemas.wire.codec import codec
from schemas.wire.records import Mail, Mailboxes, Message, Refusal
from schemas.wire.terms import Structure, Term
from tests.commd.offices import message


def memory() -> tuple[sqlite3.Connection, queries.Tally]:
    db, tally = sqlite3.connect(":memory:", isolation_level=None), queries.Tally()
    migrate(db, queries.MIGRATIONS)
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
    back = [one.current(0.0, read_plain) for one in found]
    assert [(one.header.boot, one.header.seq) for one in back] == [(tally2.numbering, n) for n in range(1, 5)]
    mail = codec(Mail).decode(codec(Mail).encode(Mail(messages=tuple(one.current(0.0, read) for one in found))))
    kept = [stored(one, "b", None) for one in mail.messages]
    assert queries.put(first, tally1, kept, 0.0, None) == [queries.TAKEN] * 4
    assert queries.put(first, tally1, kept, 0.0, None) == [queries.AGAIN] * 4
    assert [one.current(0.0, read).content for one in queries.front(first, "b", 0)[0]] == [5, 6, 7, 8]


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
    assert isinstance(notice.current(0.0, read).content, Structure)
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
        db, tally = SqliteFile(tmp_path / "b.mail", queries.MIGRATIONS, "full").open(), queries.Tally()
        tally.count(db)
        own.add(tally.numbering)
        db.close()
    assert len(own) == 2


def test_dead_letters_are_kept_up_to_a_bound_the_newest_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(queries, "DEAD", 3)
    db, tally = memory()
    letters = [stored(message(number), "a>b", None) for number in range(1, 6)]
    assert queries.put(db, tally, letters, 0.0, None) == [queries.TAKEN] * 5
    noticed = queries.move_to_dead_letters(
        db, tally, dict.fromkeys(range(1, 6), Refusal(code="unknown")), {"a": "a"}, 0.0
    )
    assert noticed == ["a"]
    assert db.execute("SELECT count(*), min(place) FROM dead").fetchone() == (3, 3)
    assert (tally.dead, dict(tally.lines)) == (3, {"a": 5})
    monkeypatch.setattr(queries, "DEAD_BYTES", 200)
    queries.move_to_dead_letters(db, tally, {6: Refusal(code="unknown")}, {}, 0.0)
    assert tally.dead_bytes <= 200
    counted = queries.Tally()
    counted.count(db)
    assert (counted.dead, counted.dead_bytes, counted.lines) == (tally.dead, tally.dead_bytes, tally.lines)


def test_the_last_numbers_of_a_few_numberings_of_a_pair_are_kept_and_always_this_boards_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(queries, "NUMBERINGS", 8)
    db, tally = memory()

    def put(*messages: Message) -> list[str]:
        return queries.put(db, tally, [stored(one, "b", None) for one in messages], 0.0, None)

    by_hand = Message(id="1", sender="a", performative="tell", receiver="b", content=1)
    assert put(by_hand) == [queries.TAKEN]
    for life in range(20):
        assert put(message(1, life=f"life{life}"), message(3, life=f"life{life}")) == [queries.TAKEN] * 2
    assert put(message(3, life="life19"), message(2, life="life12")) == [queries.AGAIN] * 2
    assert put(message(1, life="life11")) == [queries.TAKEN], "so long ago that nobody remembers"
    assert put(by_hand) == [queries.TAKEN]
    own = db.execute("SELECT number FROM mail WHERE numbering = ?", (tally.numbering,)).fetchall()
    assert own == [(1,), (2,)]
    assert db.execute("SELECT count(*) FROM numbers").fetchone() == (queries.NUMBERINGS + 1,)


def test_a_batch_that_is_rolled_back_leaves_no_trace_in_what_is_counted() -> None:
    db, tally = memory()
    before = deepcopy(vars(tally))
    db.execute("BEGIN")
    queries.put(db, tally, [stored(message(1, ttl=5.0), "b", 5.0)], 0.0, None)
    assert (tally.messages, tally.expiring) == ({"b": 1}, 1)
    db.execute("ROLLBACK")
    tally.count(db)
    assert vars(tally) == before | {"next": 2}
