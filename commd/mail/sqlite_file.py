"""Open a mail file for one process, check it, set it aside if it is corrupt; classify SQLite's errors."""

from __future__ import annotations

import fcntl
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from commd.mail.page_checksums import ENDING
from commd.process.state_dir import make_private_file, make_private_folder
from schemas.files.findings import Findings
from schemas.files.text_files import MAY_PASS

CACHE_KIB = 256
"""KiB of pages that each of the two connections caches."""
LOG_BYTES = 4 * 1024 * 1024
"""Bytes of the write-ahead log before it is moved into the file."""
WAL_BYTES = 8 * 1024 * 1024
"""Bytes of the write-ahead log to which it is truncated."""
CORRUPT = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}
DISK = CORRUPT | {
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_NOMEM,
}
"""Errors of the disk or the file; any other error is a defect of the transaction."""
PASSING = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_NOMEM}
"""Errors that may pass without opening the file again."""


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Lock a mail file for this process. Raises Findings if another process has it, OSError of `MAY_PASS`."""
    try:
        make_private_folder(path.parent)
        lock = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        if error.errno in MAY_PASS:
            raise
        raise Findings.about(path, f"cannot store mail in this file: {error}") from None
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            text = "another commd stores its mail in this file: give each its own --state"
            raise Findings.about(path, text) from None
        yield
    finally:
        os.close(lock)


def connect(path: Path, synchronous: str) -> sqlite3.Connection:
    """Open the database. Raises sqlite3.Error."""
    with suppress(OSError):  # SQLite reports it
        make_private_file(path)
    db = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=1.0)
    try:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute(f"PRAGMA cache_size = -{CACHE_KIB}")
        db.execute(f"PRAGMA synchronous = {synchronous}")
        db.execute("PRAGMA wal_autocheckpoint = 0")  # `PageChecksums.carry_over` does it
        db.execute(f"PRAGMA journal_size_limit = {WAL_BYTES}")
    except sqlite3.Error:
        db.close()
        raise
    return db


def check(db: sqlite3.Connection) -> None:
    """Raise DatabaseError (corrupt) unless the whole file passes SQLite's check."""
    (found,) = db.execute("PRAGMA quick_check(1)").fetchone()
    if found != "ok":
        raise corrupt(found)


def corrupt(why: str) -> sqlite3.DatabaseError:
    """Return the error of a corrupt file."""
    error = sqlite3.DatabaseError(why)
    error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
    return error


def set_aside(path: Path) -> Path:
    """Rename a corrupt file and the files beside it, so that people may examine them. Returns its new path."""
    number = 1
    while (aside := path.with_name(f"{path.name}.corrupt-{number}")).exists():
        number += 1
    for end in ("-wal", "-shm", ENDING, ""):
        with suppress(FileNotFoundError):
            path.with_name(path.name + end).rename(aside.with_name(aside.name + end))
    return aside


def code_of(error: BaseException) -> int:
    """Return SQLite's primary error code; 0 if there is none."""
    if isinstance(error, UnicodeDecodeError):  # of SQLite's message, which quotes a corrupt schema
        return sqlite3.SQLITE_CORRUPT
    return int(getattr(error, "sqlite_errorcode", None) or 0) & 0xFF


def may_pass(path: Path, error: Exception) -> bool:
    """Whether a file that cannot be opened now may be opened later: its disk is full or failing."""
    if code_of(error) in DISK - {sqlite3.SQLITE_PERM, sqlite3.SQLITE_READONLY}:
        return not path.is_dir() and os.access(path if path.exists() else path.parent, os.R_OK | os.W_OK)
    return isinstance(error, OSError) and error.errno in MAY_PASS


def words_for(error: Exception) -> str:
    """Return what is wrong with the disk or the file, for people."""
    return "the disk is full" if code_of(error) == sqlite3.SQLITE_FULL else str(error)
