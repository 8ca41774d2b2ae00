"""Reads a board's mail file without its daemon: nothing is written, locked or brought to another version."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import msgspec
from msgspec.structs import replace

from commd.mail.age_clock import MailClock
from commd.mail.inspection import list_mailboxes
from commd.mail.schema import MIGRATIONS
from schemas.files.findings import Finding, Findings
from schemas.wire.codec import BadRecord
from schemas.wire.records import Mailboxes

_DAMAGE = (sqlite3.Error, OSError, BadRecord, msgspec.MsgspecError, ValueError, TypeError)
"""What reading a damaged file raises: its texts, and SQLite's own about it, may be no UTF-8, its values of any type."""


def mailboxes_of_file(path: Path) -> Mailboxes:
    """Return what waits in a mail file, also beside the daemon that writes it. Raises Findings in words."""
    try:
        if not path.is_file():
            raise _unreadable(path, "there is no such file")
        with closing(_open(path)) as db:
            return _read(db, path)
    except _DAMAGE as error:
        raise _unreadable(path, f"it cannot be read as a board's mail: {error}") from None


def _open(path: Path) -> sqlite3.Connection:
    """Open it to read. Without a log beside it nobody writes, and not even a lock is taken."""
    alone = not path.with_name(f"{path.name}-wal").exists()
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}", uri=True)


def _read(db: sqlite3.Connection, path: Path) -> Mailboxes:
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version != len(MIGRATIONS):
        told = "no board's mail" if version == 0 else f"of version {version}, this is version {len(MIGRATIONS)}"
        raise _unreadable(path, f"it is {told}")
    db.execute("BEGIN")  # one state of the file for all that is asked
    clock = MailClock()
    clock.load(db)
    listed = list_mailboxes(db, clock.now(), lambda line: "")
    (dead,) = db.execute("SELECT count(*) FROM dead").fetchone()
    return replace(listed, board=path.stem, store=str(path), dead_count=dead)


def _unreadable(path: Path, why: str) -> Findings:
    return Findings([Finding(str(path), 0, 0, why)])
