"""List the queues and the newest dead letters of a mail file: for `{board}/mailboxes`, or from the file without its
daemon."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from sqlite3 import Connection

import msgspec
from msgspec.structs import replace

from commd.mail.age_clock import MailClock
from commd.mail.message import read, shown
from commd.mail.queries import MIGRATIONS
from commd.process.sqlite_file import migrate
from schemas.files.findings import Findings
from schemas.wire.codec import BadRecord
from schemas.wire.records import DeadLetter, Mailboxes, Queue, Refusal

QUEUES = 1_000
"""Listed queues, those with the most messages."""
DEAD, DEAD_BYTES = 100, 256 * 1024
"""Listed dead letters, the newest, and their bytes."""


def list_mailboxes(db: Connection, now: float, state: Callable[[str], str]) -> Mailboxes:
    """Return the queues at `now` of the mail clock, with `state(line)` of each, and the dead letters."""
    rows = db.execute(
        """SELECT line, sender, receiver, count(*), sum(size), min(posted) FROM mail
           GROUP BY line, sender, receiver ORDER BY count(*) DESC, sender, receiver LIMIT ?""",
        (QUEUES,),
    )
    queues = tuple(
        Queue(
            box="outbox" if ">" in line else "inbox",
            sender=sender,
            receiver=receiver,
            messages=count,
            bytes=size,
            oldest=max(0.0, round(now - posted, 1)),
            state=state(line),
        )
        for line, sender, receiver, count, size, posted in rows
    )
    return Mailboxes(queues=queues, dead=tuple(_newest_dead(db)))


def _newest_dead(db: Connection) -> list[DeadLetter]:
    found: list[DeadLetter] = []
    left = DEAD_BYTES
    rows = db.execute("SELECT code, text, stamp, size, message FROM dead ORDER BY place DESC LIMIT ?", (DEAD,))
    for code, text, stamp, size, message in rows:
        left -= size
        if found and left < 0:
            break
        reason = Refusal(code=code, text=text)
        found.append(DeadLetter(message=shown(read(message)), reason=reason, stamp=stamp))
    rows.close()
    return found[::-1]


_DAMAGE = (sqlite3.Error, OSError, BadRecord, msgspec.MsgspecError, ValueError, TypeError)
"""What reading a damaged file raises: its texts and SQLite's messages may not be UTF-8, its values of any type."""


def mailboxes_of_file(path: Path) -> Mailboxes:
    """Return what waits in a mail file, even while its daemon writes it; nothing is written or locked. Raises
    Findings."""
    try:
        if not path.is_file():
            raise Findings.about(path, "there is no such file")
        # Without a log beside it nobody writes, and no lock is needed.
        alone = not path.with_name(f"{path.name}-wal").exists()
        options = f"mode=ro{'&immutable=1' if alone else ''}"
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?{options}", uri=True)) as db:
            return _read(db, path)
    except _DAMAGE as error:
        raise Findings.about(path, f"it cannot be read as a board's mail: {error}") from None


def _schema(db: Connection) -> list[tuple[str, str]]:
    return db.execute("SELECT name, sql FROM sqlite_schema WHERE sql IS NOT NULL ORDER BY name").fetchall()


def _read(db: sqlite3.Connection, path: Path) -> Mailboxes:
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version != len(MIGRATIONS):
        found = "no board's mail" if version == 0 else f"of version {version}, this is version {len(MIGRATIONS)}"
        raise Findings.about(path, f"it is {found}")
    db.execute("BEGIN")  # one state of the file for all queries
    with closing(sqlite3.connect(":memory:")) as own:
        migrate(own, MIGRATIONS)
        if _schema(db) != _schema(own):  # a view could compute for ever
            raise Findings.about(path, "it is no board's mail: it has other tables")
    clock = MailClock()
    clock.load(db)
    listed = list_mailboxes(db, clock.now(), lambda line: "")
    (dead,) = db.execute("SELECT count(*) FROM dead").fetchone()
    return replace(listed, board=path.stem, store=str(path), dead_count=dead)
