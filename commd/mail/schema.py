"""The tables of a board's mail file, and how a file of an older version becomes one of this version."""

from __future__ import annotations

from sqlite3 import Connection

MIGRATIONS = (
    """
    -- Messages that wait, in the order in which they are to go out. A `line` is emptied from its front: `b` holds what
    -- agent b of this board is to get, `a>b` what goes from a to the board of b. Times are those of the mail clock.
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

    -- Messages that were given up, the newest last.
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
"""One script for each version; `PRAGMA user_version` of a file says how many of them it has seen."""


class TooNew(Exception):
    """A file that a newer version of this program has written."""


def migrate(db: Connection) -> None:
    """Bring a file to this version, step by step, each as a whole or not at all. Raises TooNew."""
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version > len(MIGRATIONS):
        raise TooNew(f"it is of version {version}, this commd knows versions up to {len(MIGRATIONS)}")
    for step in range(version, len(MIGRATIONS)):
        db.executescript(f"BEGIN IMMEDIATE; {MIGRATIONS[step]} PRAGMA user_version = {step + 1}; COMMIT;")


def keep(db: Connection, kind: str, name: str, value: bytes) -> None:
    """Keep a fact, instead of the one of the same kind and name."""
    db.execute("INSERT OR REPLACE INTO facts(kind, name, value) VALUES(?, ?, ?)", (kind, name, value))


def drop(db: Connection, kind: str, name: str) -> None:
    """Forget a fact; nothing happens if there is none."""
    db.execute("DELETE FROM facts WHERE kind = ? AND name = ?", (kind, name))


def kept(db: Connection, kind: str) -> dict[str, bytes]:
    """Return the facts of a kind by their names, in the order of the names."""
    return dict(db.execute("SELECT name, value FROM facts WHERE kind = ? ORDER BY name", (kind,)))
