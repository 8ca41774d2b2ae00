"""The database file of a checkpoint: made, brought to the present version, looked through, set aside, removed."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal

from commd.mail.page_checksums import ENDING
from commd.process.state_dir import make_private_file

CACHE: Final = 64
"""Kibibytes of pages that SQLite keeps in memory for each agent."""
STATEMENTS: Final = 24
"""So many statements are kept compiled for each agent: those of `agentd.persistence.checkpoint`, which are fewer."""
LOCK_PATIENCE: Final = 3.0
"""Wall seconds for which a file that another process has open is waited for: it may be about to end."""
APPLICATION: Final = 0x4172_676F
"""What says in the head of the file that it is a checkpoint of Argosy."""
PAGE: Final = 1024
"""Bytes of a page: what a small change costs the disk, and each open file the memory."""
LOG_PAGES: Final = 1024
"""Pages in the write-ahead log before they are carried over into the database."""
MIGRATIONS: Final = (
    """
    CREATE TABLE belief (rank INTEGER PRIMARY KEY, entry BLOB NOT NULL);
    CREATE TABLE predicate (number INTEGER PRIMARY KEY, signature BLOB NOT NULL);
    CREATE TABLE plan (rank INTEGER PRIMARY KEY, entry BLOB NOT NULL);
    CREATE TABLE pending (
        queued INTEGER, number INTEGER, origin INTEGER NOT NULL, event BLOB NOT NULL, PRIMARY KEY (queued, number)
    ) WITHOUT ROWID;
    CREATE TABLE value (name TEXT PRIMARY KEY, value BLOB NOT NULL) WITHOUT ROWID;
    CREATE TABLE agent (name TEXT PRIMARY KEY, value NOT NULL) WITHOUT ROWID;
    CREATE TABLE extra (name TEXT PRIMARY KEY, value BLOB NOT NULL) WITHOUT ROWID;
    CREATE TABLE absorbed (
        sender TEXT, numbering TEXT, seq INTEGER NOT NULL, used INTEGER NOT NULL, PRIMARY KEY (sender, numbering)
    ) WITHOUT ROWID;
    CREATE TABLE outgoing (
        number INTEGER PRIMARY KEY, receiver TEXT NOT NULL, seq INTEGER NOT NULL, message BLOB NOT NULL
    );
    CREATE TABLE receiver (name TEXT PRIMARY KEY, next_seq INTEGER NOT NULL) WITHOUT ROWID;
    CREATE TABLE action (id TEXT PRIMARY KEY, name TEXT NOT NULL, parameters BLOB NOT NULL);
    """,
)
"""What makes a database of version N into one of version N + 1, the first from an empty file."""

Synchronous = Literal["FULL", "NORMAL"]
_ENDINGS: Final = ("", "-wal", "-shm", ENDING)


class CheckpointError(Exception):
    """A checkpoint cannot be opened, read or written; says why and what to do."""


class NotWhole(sqlite3.DatabaseError):
    """The file is a database but not as it should be."""


@contextmanager
def told(path: Path, what: str) -> Iterator[None]:
    """Turn what the disk or the database raises into a CheckpointError for people."""
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        locked = getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
        why = "another process has it open" if locked else str(error)
        raise CheckpointError(f"{path} cannot be {what}: {why}") from error


def open_database(path: Path, agent: str, synchronous: Synchronous) -> sqlite3.Connection:
    """Open the database of an agent at the present version; it is made if there is none.

    Raises CheckpointError for one that is not for us, `NotWhole` or another sqlite3.DatabaseError for a corrupt one.
    """
    try:
        _check_and_migrate(path, agent, synchronous)
    except UnicodeDecodeError as error:  # of SQLite's message, which quotes a damaged schema
        raise NotWhole(str(error)) from None
    return _connected(path, synchronous, STATEMENTS)


def _check_and_migrate(path: Path, agent: str, synchronous: Synchronous) -> None:
    database = _connected(path, synchronous, 0)
    try:
        (version,) = database.execute("PRAGMA user_version").fetchone()
        if version > len(MIGRATIONS):
            raise CheckpointError(
                f"{path} was written by a newer Argosy (its version is {version}, this one knows up to"
                f" {len(MIGRATIONS)}): run that, or begin anew without what is kept there"
            )
        _look_through(database)
        _migrate(database, version, agent)
        (owner,) = database.execute("SELECT value FROM agent WHERE name = 'name'").fetchone()
        if owner != agent:
            raise CheckpointError(f"{path} belongs to the agent {owner}, not to {agent}")
    finally:
        database.close()


def _connected(path: Path, synchronous: Synchronous, statements: int) -> sqlite3.Connection:
    """A connection that holds the file for itself."""
    make_private_file(path)
    database = sqlite3.connect(
        path, timeout=LOCK_PATIENCE, isolation_level=None, check_same_thread=False, cached_statements=statements
    )
    database.text_factory = lambda data: data.decode(errors="replace")  # a damaged row is one that is not ours
    try:
        for statement in (
            f"PRAGMA page_size={PAGE}",
            "PRAGMA locking_mode=EXCLUSIVE",  # for one process, and without a file of shared memory
            "PRAGMA journal_mode=WAL",
            f"PRAGMA synchronous={synchronous}",
            f"PRAGMA cache_size=-{CACHE}",
            "PRAGMA wal_autocheckpoint=0",  # `PageChecksums.carry_over` does it
            f"PRAGMA journal_size_limit={LOG_PAGES * PAGE}",
            "BEGIN EXCLUSIVE",
            "COMMIT",
        ):
            database.execute(statement).close()
    except BaseException:
        database.close()
        raise
    return database


def _look_through(database: sqlite3.Connection) -> None:
    """Raise NotWhole unless the file is empty or a checkpoint without damage."""
    (whole,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if whole != "ok":
        raise NotWhole(whole)
    (kind,) = database.execute("PRAGMA application_id").fetchone()
    (tables,) = database.execute("SELECT count(*) FROM sqlite_schema").fetchone()
    if tables and kind != APPLICATION:
        raise NotWhole("it is a database of something else")


def _migrate(database: sqlite3.Connection, version: int, agent: str) -> None:
    """Bring the database to the present version and lock it, in one transaction."""
    database.execute("BEGIN EXCLUSIVE")
    if version < len(MIGRATIONS):
        for script in MIGRATIONS[version:]:
            for statement in script.split(";"):
                database.execute(statement)
        database.execute(f"PRAGMA user_version={len(MIGRATIONS)}")
    if not version:
        database.execute(f"PRAGMA application_id={APPLICATION}")
        database.execute("INSERT INTO agent VALUES ('name', ?)", (agent,))
    database.execute("COMMIT")


def is_corrupt(error: sqlite3.Error) -> bool:
    """Whether an error says that the file is damaged, rather than that it cannot be used now."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    return isinstance(error, NotWhole) or code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def set_aside(path: Path) -> Path:
    """Give a corrupt file another name, under which people may look at it; returns that."""
    number = 1
    while (aside := path.with_name(f"{path.name}.corrupt-{number}")).exists():
        number += 1
    for ending in _ENDINGS:
        file = path.with_name(path.name + ending)
        if file.exists():
            file.rename(aside.with_name(aside.name + ending))
    return aside


def remove(path: Path) -> None:
    """Remove the file of an agent, if there is one, whatever is in it. Raises CheckpointError."""
    with told(path, "removed"):
        for ending in _ENDINGS:
            path.with_name(path.name + ending).unlink(missing_ok=True)
