"""The tables of a board's mail file, their migrations, and its table of facts."""

from __future__ import annotations

from sqlite3 import Connection

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


class TooNew(Exception):
    """A file of a newer version of this program."""


def migrate(db: Connection) -> None:
    """Bring a file to this version, each step in a transaction. Raises TooNew."""
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version > len(MIGRATIONS):
        raise TooNew(f"it is of version {version}, this commd knows versions up to {len(MIGRATIONS)}")
    for step in range(version, len(MIGRATIONS)):
        db.executescript(f"BEGIN IMMEDIATE; {MIGRATIONS[step]} PRAGMA user_version = {step + 1}; COMMIT;")


def keep(db: Connection, kind: str, name: str, value: bytes) -> None:
    """Store a fact, in place of the one with this kind and name."""
    db.execute("INSERT OR REPLACE INTO facts(kind, name, value) VALUES(?, ?, ?)", (kind, name, value))


def drop(db: Connection, kind: str, name: str) -> None:
    """Delete a fact, if there is one."""
    db.execute("DELETE FROM facts WHERE kind = ? AND name = ?", (kind, name))


def kept(db: Connection, kind: str) -> dict[str, bytes]:
    """Return the facts of a kind by their names, sorted."""
    return dict(db.execute("SELECT name, value FROM facts WHERE kind = ? ORDER BY name", (kind,)))
