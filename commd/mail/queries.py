"""What is done with the messages in a board's mail file: functions on a connection, each part of a transaction."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from sqlite3 import Connection

import msgspec

from commd.mail.message import QueuedMessage, StoredMessage, letter, undelivered
from schemas.mission.model import RESERVED
from schemas.wire.codec import codec
from schemas.wire.records import Message, Refusal

BATCH, BATCH_BYTES = 500, 256 * 1024
"""A batch has at most so many messages, and not more bytes than that if it has more than one."""
REMOTE_BYTES = 64 * 1024
"""The same for another board: links between boards may be slow."""
NUMBERINGS = 2 * BATCH
"""Numberings of a pair whose last numbers are kept; the oldest goes when a sender begins a further one. More than a
batch can bring: each of its messages may be of another life, and the whole batch may come again."""
MAILBOX_BYTES = 256 * 1024 * 1024
"""Bytes that may wait for one receiver."""
DEAD, DEAD_BYTES = 10_000, 64 * 1024 * 1024
"""Dead letters that are kept, and their bytes; the oldest go first."""
TAKEN, AGAIN, FULL = "taken", "again", "mailbox_full"
"""What becomes of a message that comes in: written, known already, to be sent again."""


class Tally:
    """How much waits, counted in the writer's thread with each change and anew after a change was rolled back."""

    def __init__(self) -> None:
        self.lines: Counter[str] = Counter()
        """Messages by line."""
        self.messages: Counter[str] = Counter()
        """Messages by receiver."""
        self.bytes: Counter[str] = Counter()
        """Bytes by receiver."""
        self.expiring = 0
        """Messages with a time to live."""
        self.dead = self.dead_bytes = 0
        self.next = 1
        """The place of the next message; no place is given twice while this process lives."""
        self.numbering = os.urandom(8).hex()
        """This board's own, for messages that come without number. Each life of the board has another one: a file that
        has gone back in time (a power cut, a backup) would give numbers again that receivers know."""

    def count(self, db: Connection) -> None:
        """Count what is in the file."""
        lines, messages, bytes_ = Counter[str](), Counter[str](), Counter[str]()
        rows = db.execute("SELECT line, receiver, count(*), sum(size) FROM mail GROUP BY line, receiver")
        for line, receiver, count, size in rows:
            lines[line] += count
            messages[receiver] += count
            bytes_[receiver] += size
        self.lines, self.messages, self.bytes = lines, messages, bytes_
        (self.expiring,) = db.execute("SELECT count(*) FROM mail WHERE expires IS NOT NULL").fetchone()
        self.dead, self.dead_bytes = db.execute("SELECT count(*), coalesce(sum(size), 0) FROM dead").fetchone()
        (last,) = db.execute("SELECT coalesce(max(place), 0) FROM mail").fetchone()
        self.next = max(self.next, last + 1)

    def add(self, line: str, receiver: str, size: int, sign: int = 1) -> None:
        """Count a message that comes, or with sign -1 one that goes."""
        for counter, key, amount in (
            (self.lines, line, sign),
            (self.messages, receiver, sign),
            (self.bytes, receiver, sign * size),
        ):
            counter[key] += amount
            if counter[key] <= 0:
                del counter[key]


def put(db: Connection, tally: Tally, letters: Iterable[StoredMessage], now: float, bound: int | None) -> list[str]:
    """Write messages at the ends of their lines. Returns what becomes of each.

    A number that is not above the last one of its numbering was taken before. One that is too late is taken too: it is
    given up here, once, whatever becomes of the answer. When `bound` messages wait for a receiver, no more are taken
    for it; None = all are.
    """
    last: dict[tuple[str, str, str], int] = {}
    changed: set[tuple[str, str, str]] = set()
    full: set[tuple[str, str]] = set()
    rows: list[tuple[int, str, str, str, str, int, float, float | None, int, bytes]] = []
    outcomes: list[str] = []
    for one in letters:
        sender, receiver = one.sender, one.receiver
        if (sender, receiver) in full:  # what follows in order may not overtake
            outcomes.append(FULL)
            continue
        key = (sender, receiver, one.numbering or tally.numbering)
        if (known := last.get(key)) is None:
            known = last[key] = _last(db, key)
        number = one.number or known + 1
        size = len(one.message)
        if number <= known:
            outcomes.append(AGAIN)
        elif bound is not None and (tally.messages[receiver] >= bound or tally.bytes[receiver] + size > MAILBOX_BYTES):
            full.add((sender, receiver))
            outcomes.append(FULL)
        else:
            row = (tally.next, one.line, sender, receiver, key[2], number, now, one.expires, size, one.message)
            rows.append(row)
            tally.next += 1
            tally.add(one.line, receiver, size)
            tally.expiring += one.expires is not None
            last[key] = number
            changed.add(key)
            outcomes.append(TAKEN)
    db.executemany("INSERT INTO mail VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
    for key in changed:
        _set_last(db, tally, key, last[key])
    return outcomes


def numbers_of(db: Connection, sender: str, former: str, left_out: Sequence[str] = ()) -> dict[str, int]:
    """Return how much was taken of a sender's numbering and of those that it has begun later, by receiver."""
    query = "SELECT receiver, numbering, number, age FROM numbers WHERE sender = ? ORDER BY age"
    rows = db.execute(query, (sender,)).fetchall()
    began: dict[str, int] = {}
    for _, numbering, _, age in rows:
        began.setdefault(numbering, age)
    taken: Counter[str] = Counter()
    for receiver, numbering, number, _ in rows:
        if former in began and began[numbering] >= began[former] and numbering not in left_out:
            taken[receiver] += number
    return dict(taken)


def _last(db: Connection, key: tuple[str, str, str]) -> int:
    query = "SELECT number FROM numbers WHERE sender = ? AND receiver = ? AND numbering = ?"
    found = db.execute(query, key).fetchone()
    return int(found[0]) if found else 0


def _set_last(db: Connection, tally: Tally, key: tuple[str, str, str], number: int) -> None:
    update = "UPDATE numbers SET number = ? WHERE sender = ? AND receiver = ? AND numbering = ?"
    if db.execute(update, (number, *key)).rowcount:
        return
    db.execute("INSERT INTO numbers(sender, receiver, numbering, number) VALUES(?, ?, ?, ?)", (*key, number))
    db.execute(  # this board's own numbering stays: begun anew its numbers would pass for old ones
        """DELETE FROM numbers WHERE sender = ?1 AND receiver = ?2 AND numbering <> ?3 AND age NOT IN (
               SELECT age FROM numbers WHERE sender = ?1 AND receiver = ?2 AND numbering <> ?3
               ORDER BY age DESC LIMIT ?4)""",
        (key[0], key[1], tally.numbering, NUMBERINGS),
    )


def front(db: Connection, line: str, after: int, most: int = BATCH) -> tuple[list[QueuedMessage], bool]:
    """Return the next batch of a line, at most `most` messages behind place `after`, and whether more stand behind."""
    most_bytes = REMOTE_BYTES if ">" in line else BATCH_BYTES
    found: list[QueuedMessage] = []
    size = 0
    rows = db.execute(
        """SELECT place, sender, receiver, numbering, number, expires, message FROM mail
           WHERE line = ? AND place > ? ORDER BY place LIMIT ?""",
        (line, after, most + 1),
    )
    more = False
    for place, sender, receiver, numbering, number, expires, message in rows:
        size += len(message)
        if len(found) == most or (found and size > most_bytes):
            more = True
            break
        found.append(
            QueuedMessage(
                place=place,
                sender=sender,
                receiver=receiver,
                numbering=numbering,
                number=number,
                expires=expires,
                message=message,
            )
        )
    rows.close()
    return found, more


def move(db: Connection, tally: Tally, line: str, home: bool) -> None:
    """Let the messages of a line wait for their receivers here (`home`), or for the boards of these.

    Those that go back to other boards go on with numbers of this board: their senders' boards know the old ones.
    """
    if home:
        db.execute("UPDATE mail SET line = receiver WHERE line = ?", (line,))
    else:
        rows = db.execute("SELECT place, sender, receiver FROM mail WHERE line = ? ORDER BY place", (line,)).fetchall()
        for place, sender, receiver in rows:
            key = (sender, receiver, tally.numbering)
            number = _last(db, key) + 1
            _set_last(db, tally, key, number)
            change = "UPDATE mail SET line = ?, numbering = ?, number = ? WHERE place = ?"
            db.execute(change, (f"{sender}>{receiver}", tally.numbering, number, place))
    tally.count(db)


def remove(db: Connection, tally: Tally, places: Sequence[int]) -> list[tuple[int, str, bytes]]:
    """Take messages out of the file. Returns place, sender and message of those that were still there."""
    rows = db.execute(
        """DELETE FROM mail WHERE place IN (SELECT value FROM json_each(?))
           RETURNING place, line, sender, receiver, expires, size, message""",
        (msgspec.json.encode(places).decode(),),
    ).fetchall()
    for _, line, _, receiver, expires, size, _ in rows:
        tally.add(line, receiver, size, -1)
        tally.expiring -= expires is not None
    return sorted((place, sender, message) for place, _, sender, _, _, _, message in rows)


def bury(
    db: Connection, tally: Tally, reasons: Mapping[int, Refusal], lines: Mapping[str, str], now: float
) -> list[str]:
    """Give messages up: keep them as dead letters and write the notices to their senders.

    `reasons` by place; `lines` says where notices to each sender wait, whoever has none gets none. Returns the lines
    that notices were written to.
    """
    notices: list[StoredMessage] = []
    for place, sender, message in remove(db, tally, list(reasons)):
        reason = reasons[place]
        db.execute(
            "INSERT INTO dead(code, text, stamp, size, message) VALUES(?, ?, ?, ?, ?)",
            (reason.code, reason.text, time.time_ns(), len(message), message),
        )
        tally.dead += 1
        tally.dead_bytes += len(message)
        if sender in lines and sender not in RESERVED:
            notice = undelivered(codec(Message).decode(message, _MSGPACK), reason)
            notices.append(letter(notice, lines[sender], None))
    _bound_dead(db, tally)
    put(db, tally, notices, now, None)
    return sorted({notice.line for notice in notices})


def _bound_dead(db: Connection, tally: Tally) -> None:
    while tally.dead > DEAD or tally.dead_bytes > DEAD_BYTES:
        ((size,),) = db.execute(
            "DELETE FROM dead WHERE place = (SELECT min(place) FROM dead) RETURNING size"
        ).fetchall()
        tally.dead -= 1
        tally.dead_bytes -= size


def expired(db: Connection, now: float, most: int) -> list[tuple[int, str, str, float]]:
    """Return place, line, sender and end of the messages whose time is over, the first over first."""
    query = "SELECT place, line, sender, expires FROM mail WHERE expires <= ? ORDER BY expires LIMIT ?"
    return db.execute(query, (now, most)).fetchall()


def places_for(db: Connection, receiver: str, most: int) -> list[tuple[int, str]]:
    """Return place and sender of messages that wait for a receiver."""
    query = "SELECT place, sender FROM mail WHERE receiver = ? ORDER BY place LIMIT ?"
    return db.execute(query, (receiver, most)).fetchall()


_MSGPACK = codec(Message).encoding("msgpack")
