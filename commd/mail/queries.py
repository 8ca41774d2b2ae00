"""The tables of a board's mail file, and the SQL operations on them; each is part of a transaction on the given
connection.

Times are in seconds of the mail clock.
"""

from __future__ import annotations

import itertools
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from sqlite3 import Connection

import msgspec

from commd.mail.message import StoredMessage, read, stored, undelivered
from schemas.mission.model import RESERVED
from schemas.wire.records import Refusal

BATCH, BATCH_BYTES = 500, 256 * 1024
"""Messages of a batch at most, and bytes unless it is a single message."""
REMOTE_BYTES = 64 * 1024
"""Bytes of a batch to another board: links between boards may be slow."""
NUMBERINGS = 2 * BATCH
"""Numberings of a pair whose last numbers are kept; a further one replaces the oldest. A batch has fewer: each of its
messages may have another numbering, and the whole batch may be sent again."""
MAILBOX_BYTES = 256 * 1024 * 1024
"""Bytes that may wait for one receiver."""
DEAD, DEAD_BYTES = 10_000, 64 * 1024 * 1024
"""Dead letters that are kept, and their bytes; the oldest are removed first."""
TAKEN, AGAIN, FULL = "taken", "again", "mailbox_full"
"""Outcomes of a message: stored, known already, to be sent again."""
MIGRATIONS = (
    """
    -- Waiting messages in the order of delivery. A `line` is delivered from its front: `b` has the messages to agent b
    -- of this board, `a>b` those from a to b on another board. Times are those of the mail clock.
    CREATE TABLE mail(
        place INTEGER PRIMARY KEY,
        line TEXT NOT NULL,
        sender TEXT NOT NULL,
        receiver TEXT NOT NULL,
        numbering TEXT NOT NULL,
        number INTEGER NOT NULL,
        posted REAL NOT NULL,
        expires REAL,
        size INTEGER NOT NULL,
        message BLOB NOT NULL
    );
    CREATE INDEX mail_line ON mail(line);
    CREATE INDEX mail_expires ON mail(expires) WHERE expires IS NOT NULL;

    -- The last number taken of each numbering of a pair; `age` orders the numberings of a pair by their first message.
    CREATE TABLE numbers(
        age INTEGER PRIMARY KEY,
        sender TEXT NOT NULL,
        receiver TEXT NOT NULL,
        numbering TEXT NOT NULL,
        number INTEGER NOT NULL,
        UNIQUE(sender, receiver, numbering)
    );

    -- Dead letters, the newest last.
    CREATE TABLE dead(
        place INTEGER PRIMARY KEY,
        code TEXT NOT NULL,
        text TEXT NOT NULL,
        stamp INTEGER NOT NULL,
        size INTEGER NOT NULL,
        message BLOB NOT NULL
    );

    CREATE TABLE facts(kind TEXT NOT NULL, name TEXT NOT NULL, value BLOB NOT NULL, PRIMARY KEY(kind, name))
        WITHOUT ROWID;
    """,
)
"""One script for each version; `PRAGMA user_version` of a file counts those that were run."""


def keep(db: Connection, kind: str, name: str, value: bytes) -> None:
    """Store a fact, in place of the one with this kind and name."""
    db.execute("INSERT OR REPLACE INTO facts(kind, name, value) VALUES(?, ?, ?)", (kind, name, value))


def drop(db: Connection, kind: str, name: str) -> None:
    """Delete a fact, if there is one."""
    db.execute("DELETE FROM facts WHERE kind = ? AND name = ?", (kind, name))


def kept(db: Connection, kind: str) -> dict[str, bytes]:
    """Return the facts of a kind by their names, sorted."""
    return dict(db.execute("SELECT name, value FROM facts WHERE kind = ? ORDER BY name", (kind,)))


class Tally:
    """Counts of what waits, updated in the writer's thread with each change, and counted again after a rollback."""

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
        """The place of the next message; no place is used twice by one process."""
        self.numbering = os.urandom(8).hex()
        """This board's own, for messages without number. Each process has a new one: a file that has gone back in time
        (a power cut, a backup) would repeat numbers that receivers know."""

    def count(self, db: Connection) -> None:
        """Count the file's contents."""
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
        """Count a message of `size` bytes that is added, or with `sign` -1 removed."""
        for counter, key, amount in (
            (self.lines, line, sign),
            (self.messages, receiver, sign),
            (self.bytes, receiver, sign * size),
        ):
            counter[key] += amount
            if counter[key] <= 0:
                del counter[key]


def put(
    db: Connection,
    tally: Tally,
    messages: Iterable[StoredMessage],
    now: float,
    bound: int | None,
    also: Callable[[Connection], None] | None = None,
) -> list[str]:
    """Append messages to their lines. Returns the outcome of each.

    A message whose number is not above the last one of its numbering was taken before. An expired message is taken too:
    it is given up here, once, even if the reply is lost. At most `bound` messages may wait for a receiver; None = any
    number. `also` is done before.
    """
    if also is not None:
        also(db)
    last: dict[tuple[str, str, str], int] = {}
    changed: set[tuple[str, str, str]] = set()
    full: set[tuple[str, str]] = set()
    rows: list[tuple[int, str, str, str, str, int, float, float | None, int, bytes]] = []
    outcomes: list[str] = []
    for one in messages:
        sender, receiver = one.sender, one.receiver
        if (sender, receiver) in full:  # later ones must not overtake it
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
    """Return the messages taken of a sender's numbering and of its later ones, by receiver."""
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
    db.execute(  # this board's own numbering stays: restarted, its numbers would count as old ones
        """DELETE FROM numbers WHERE sender = ?1 AND receiver = ?2 AND numbering <> ?3 AND age NOT IN (
               SELECT age FROM numbers WHERE sender = ?1 AND receiver = ?2 AND numbering <> ?3
               ORDER BY age DESC LIMIT ?4)""",
        (key[0], key[1], tally.numbering, NUMBERINGS),
    )


def front(db: Connection, line: str, after: int, most: int = BATCH) -> tuple[list[StoredMessage], bool]:
    """Return the next batch of a line, at most `most` messages behind place `after`, and whether more follow."""
    most_bytes = REMOTE_BYTES if ">" in line else BATCH_BYTES
    found: list[StoredMessage] = []
    size = 0
    rows = db.execute(
        """SELECT line, sender, receiver, message, numbering, number, expires, place FROM mail
           WHERE line = ? AND place > ? ORDER BY place LIMIT ?""",
        (line, after, most + 1),
    )
    more = False
    for one in itertools.starmap(StoredMessage, rows):
        size += len(one.message)
        if len(found) == most or (found and size > most_bytes):
            more = True
            break
        found.append(one)
    rows.close()
    return found, more


def move(db: Connection, tally: Tally, line: str, home: bool) -> None:
    """Move the messages of a line to their receivers' lines here (`home`), or to those of their receivers' boards.

    Messages to other boards get numbers of this board: their senders' boards know the old ones.
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
    """Remove messages. Returns place, sender and message of each that was still there."""
    rows = db.execute(
        """DELETE FROM mail WHERE place IN (SELECT value FROM json_each(?))
           RETURNING place, line, sender, receiver, expires, size, message""",
        (msgspec.json.encode(places).decode(),),
    ).fetchall()
    for _, line, _, receiver, expires, size, _ in rows:
        tally.add(line, receiver, size, -1)
        tally.expiring -= expires is not None
    return sorted((place, sender, message) for place, _, sender, _, _, _, message in rows)


def move_to_dead_letters(
    db: Connection, tally: Tally, reasons: Mapping[int, Refusal], lines: Mapping[str, str], now: float
) -> list[str]:
    """Move messages to the dead letters, and write the notices to their senders.

    `reasons` by place; `lines` has the line of notices to each sender that gets one. Returns the lines of the notices
    written.
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
            notice = undelivered(read(message), reason)
            notices.append(stored(notice, lines[sender], None))
    while tally.dead > DEAD or tally.dead_bytes > DEAD_BYTES:
        ((size,),) = db.execute(
            "DELETE FROM dead WHERE place = (SELECT min(place) FROM dead) RETURNING size"
        ).fetchall()
        tally.dead -= 1
        tally.dead_bytes -= size
    put(db, tally, notices, now, None)
    return sorted({notice.line for notice in notices})


def expired(db: Connection, now: float, most: int) -> list[tuple[int, str, str, float]]:
    """Return place, line, sender and end of at most `most` expired messages, in the order of their ends."""
    query = "SELECT place, line, sender, expires FROM mail WHERE expires <= ? ORDER BY expires LIMIT ?"
    return db.execute(query, (now, most)).fetchall()


def places_for(db: Connection, receiver: str, most: int) -> list[tuple[int, str]]:
    """Return place and sender of at most `most` messages to a receiver."""
    query = "SELECT place, sender FROM mail WHERE receiver = ? ORDER BY place LIMIT ?"
    return db.execute(query, (receiver, most)).fetchall()
