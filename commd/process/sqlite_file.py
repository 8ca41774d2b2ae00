"""A SQLite file of one daemon: opened, brought to its version, checked, and set aside if it is corrupt.

SQLite detects damage to its structure, not a flipped bit in a row: a file beside the database has a checksum of each
page. The pages of a database in WAL mode change only when its log is moved into it, so that is done here
(`PageChecksums.carry_over`), at a cost by the number of changed pages. The log has checksums of its own, by which
SQLite silently ignores what follows a damaged frame: `log_damage` reports it.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import struct
import zlib
from array import array
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from commd.process.state_dir import make_private_file, replace_file

log = logging.getLogger("store")

LOCK_PATIENCE: Final = 3.0
"""Wall seconds to wait for a file that another process has locked: that process may be about to end."""
LOG_BYTES: Final = 4 * 1024 * 1024
"""Bytes of the write-ahead log before it is moved into the database, and to which its file is truncated."""
CORRUPT: Final = frozenset((sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB))
ENDING: Final = ".sums"
_HEAD: Final = struct.Struct("<4sBxxxII")
"""Magic, whether the sums are valid for the file, size of a page, checksum of the sums."""
_MAGIC: Final = b"ASUM"
_LOG_HEAD, _FRAME_HEAD = 32, 24
_LITTLE: Final = 0x377F0682
"""The magic number of a log with checksums of little-endian words; with big-endian ones it is one more."""


class TooNew(OSError):
    """A file of a newer version of this program."""


class SqliteFile:
    """A database in WAL mode that one process writes, on one connection."""

    def __init__(
        self, path: Path, migrations: Sequence[str], synchronous: str, pragmas: Sequence[str] = (), application: int = 0
    ) -> None:
        """`migrations` and `application` as in `migrate`; `pragmas` are executed first on each connection."""
        self.set_aside: dict[str, str] = {}
        """Names of the corrupt files that were set aside, and what was wrong with them."""
        self.damaged: list[str] = []
        """What the log had lost when the file was opened, for people."""
        self._path, self._migrations, self._application = path, migrations, application
        self._sums = PageChecksums(path)
        self._pragmas = (
            *pragmas,
            "journal_mode=WAL",
            f"synchronous={synchronous}",
            "wal_autocheckpoint=0",  # `PageChecksums.carry_over` does it
            f"journal_size_limit={LOG_BYTES}",
        )

    def connect(self) -> sqlite3.Connection:
        """Return another connection. Raises sqlite3.Error, UnicodeDecodeError if the file is corrupt."""
        db = sqlite3.connect(self._path, isolation_level=None, check_same_thread=False, timeout=LOCK_PATIENCE)
        try:
            for pragma in self._pragmas:
                db.execute(f"PRAGMA {pragma}").close()
        except BaseException:
            db.close()
            raise
        return db

    def open(self) -> sqlite3.Connection:
        """Return the connection that writes. Raises sqlite3.Error, UnicodeDecodeError, OSError such as TooNew."""
        damage, lost = self._sums.damage(), log_damage(self._path)
        self._sums.begin()
        make_private_file(self._path)
        db = self.connect()
        try:
            db.execute("BEGIN EXCLUSIVE")  # with `locking_mode=EXCLUSIVE` nobody else can open it from now on
            db.execute("COMMIT")
            migrate(db, self._migrations, self._application, damage)
            self._sums.carry_over(db)
        except BaseException:
            db.close()
            raise
        if lost:
            self.damaged.append(lost)
            log.error("database_damaged file=%s why=%s", self._path, lost)
        return db

    def open_or_replace(self) -> sqlite3.Connection:
        """Return the connection that writes, to a new file if this one is corrupt. Raises sqlite3.Error, OSError."""
        try:
            return self.open()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            if code_of(error) not in CORRUPT:
                raise
            return self.replace(str(error))

    def replace(self, why: str) -> sqlite3.Connection:
        """Set the corrupt file aside, and return the connection that writes a new one."""
        aside = set_aside(self._path)
        text = "database_corrupt file=%s why=%s set_aside=%s: what it kept is lost, a new file is made"
        log.error(text, self._path, why, aside)
        self.set_aside[aside.name] = why
        return self.open()

    def shorten_log(self, db: sqlite3.Connection) -> None:
        """Move a long log into the database; if that fails now, it is done later."""
        with suppress(sqlite3.Error, OSError):
            if os.stat(f"{self._path}-wal").st_size > LOG_BYTES:
                self._sums.carry_over(db)

    def roll_back(self, db: sqlite3.Connection) -> None:
        """End a transaction that failed, if there is one. Raises sqlite3.Error, OSError."""
        if db.in_transaction:
            db.execute("ROLLBACK")
            self._sums.carry_over(db)  # the log may hold a part of it

    def close(self, db: sqlite3.Connection) -> None:
        """Close the connection that writes."""
        with suppress(sqlite3.Error, OSError):
            self._sums.carry_over(db)
        db.close()
        self._sums.close()


def migrate(db: sqlite3.Connection, migrations: Sequence[str], application: int = 0, damage: str = "") -> None:
    """Check a database and bring it to the present version.

    `migrations` are the scripts that bring it from version N to N + 1, each run in a transaction; the first one begins
    with an empty file. `application` is SQLite's id of what kind of file it is, `damage` what is known to be wrong with
    it. Raises TooNew, sqlite3.DatabaseError (`CORRUPT`) unless it passes SQLite's own check.
    """
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version > len(migrations):
        known = f"its version is {version}, this one knows up to {len(migrations)}"
        raise TooNew(f"it was written by a newer Argosy ({known}): run that, or start over without what is kept there")
    check(db)
    (kind,) = db.execute("PRAGMA application_id").fetchone()
    (tables,) = db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
    if tables and kind != application:
        raise corrupt("it is a database of another program")
    if damage:
        raise corrupt(damage)
    for number, script in enumerate(migrations[version:], version + 1):
        pragmas = f"PRAGMA user_version = {number}; PRAGMA application_id = {application};"
        db.executescript(f"BEGIN EXCLUSIVE; {script}; {pragmas} COMMIT;")


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


class PageChecksums:
    """The checksums of one database, for the connection that writes it. It needs `PRAGMA wal_autocheckpoint=0`."""

    def __init__(self, path: Path) -> None:
        self._path, self._beside = path, path.with_name(path.name + ENDING)
        self._file = -1
        """Stays open as long as the database: closing it would release SQLite's locks."""
        self._page = 0
        self._sums = array("I")
        self._known = False
        """Whether the sums are valid for the file."""

    def damage(self) -> str:
        """Compare the file with its sums. Returns what is wrong; empty if it is intact or has no valid sums.

        Call it before SQLite opens the file.
        """
        try:
            data = self._beside.read_bytes()
            return self._compared(data) if self._path.stat().st_size else ""
        except FileNotFoundError:
            return ""

    def _compared(self, data: bytes) -> str:
        if len(data) < _HEAD.size:
            return f"{self._beside.name} is damaged"
        magic, known, page, check = _HEAD.unpack_from(data)
        body = data[_HEAD.size :]
        if magic != _MAGIC or known > 1 or len(body) % 4 or zlib.crc32(data[: _HEAD.size - 4] + body) != check:
            return f"{self._beside.name} is damaged"
        if not known:
            return ""  # its process died, or the power failed, while the log was moved
        self._page, self._sums = page, array("I", body)
        with self._path.open("rb") as file:
            for number, expected in enumerate(self._sums):
                if zlib.crc32(file.read(page)) != expected:
                    return f"page {number + 1} was changed after it was written"
            if file.read(1):
                return f"it has more than the {len(self._sums)} pages that were written"
        self._known = True
        return ""

    def begin(self) -> None:
        """Mark the sums as invalid until `carry_over`: SQLite is about to open the file. Raises OSError."""
        self.close()  # it may be a new file
        self._known = False
        if self._path.exists():
            self._write(False)

    def carry_over(self, database: sqlite3.Connection) -> None:
        """Move the log into the database, and sum the changed pages. Raises sqlite3.Error, OSError.

        While a reader uses the log, this is postponed to the next call.
        """
        changed = self._pages_in_log() if self._known else None
        if changed == set():
            return
        self._write(False)
        self._known = False
        (busy, *_) = database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        if busy:
            return
        if self._file < 0:
            self._file = os.open(self._path, os.O_RDONLY | os.O_CLOEXEC)
        (self._page,) = database.execute("PRAGMA page_size").fetchone()
        count = os.fstat(self._file).st_size // self._page
        if changed is None:
            changed = set(range(1, count + 1))
        self._sums = self._sums[:count]
        self._sums.extend([0] * (count - len(self._sums)))
        for number in changed:
            if number <= count:
                self._sums[number - 1] = zlib.crc32(os.pread(self._file, self._page, (number - 1) * self._page))
        self._write(True)
        self._known = True

    def close(self) -> None:
        """Close the file; call it after the database is closed."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _pages_in_log(self) -> set[int]:
        """Return the numbers of the pages in the log, read frame by frame: the whole log would stay in the heap."""
        found: set[int] = set()
        try:
            with open(f"{self._path}-wal", "rb", buffering=0) as file:
                head = file.read(_LOG_HEAD)
                if len(head) < _LOG_HEAD:
                    return found
                frame = _FRAME_HEAD + int.from_bytes(head[8:12])
                for at in range(_LOG_HEAD, os.fstat(file.fileno()).st_size, frame):
                    found.add(int.from_bytes(os.pread(file.fileno(), 4, at)))
        except FileNotFoundError:
            pass
        return found

    def _write(self, known: bool) -> None:
        body = self._sums.tobytes() if known else b""
        head = _HEAD.pack(_MAGIC, known, self._page, 0)[:-4]
        replace_file(self._beside, head + zlib.crc32(head + body).to_bytes(4, "little") + body)


def log_damage(path: Path) -> str:
    """Return what is wrong with a database's log, from where on SQLite silently ignores it; empty if it is intact.

    Call it before SQLite opens the file. An incomplete last frame is not damage.
    """
    try:
        data = Path(f"{path}-wal").read_bytes()
    except FileNotFoundError:
        return ""
    if len(data) < _LOG_HEAD:
        return ""
    magic, _, page = struct.unpack_from(">3I", data)
    order = "<" if magic == _LITTLE else ">"
    sums = _log_sum(order, data[:24], (0, 0))
    if magic & ~1 != _LITTLE or sums != struct.unpack_from(">2I", data, 24):
        return "the header of its log is damaged: the last writes are lost"
    size = _FRAME_HEAD + page
    for at in range(_LOG_HEAD, len(data) - size + 1, size):
        sums = _log_sum(order, data[at : at + 8], sums)
        sums = _log_sum(order, data[at + _FRAME_HEAD : at + size], sums)
        if data[at + 8 : at + 16] != data[16:24] or sums != struct.unpack_from(">2I", data, at + 16):
            left = (len(data) - at) // size
            return f"its log is damaged, or was cut off by a power failure: the last {left} pages written are lost"
    return ""


def _log_sum(order: str, data: bytes, sums: tuple[int, int]) -> tuple[int, int]:
    """The checksum of SQLite's write-ahead log (https://www.sqlite.org/fileformat2.html#checksum_algorithm)."""
    first, second = sums
    words = struct.unpack(f"{order}{len(data) // 4}I", data)
    for even, odd in zip(words[::2], words[1::2], strict=True):
        first = (first + even + second) & 0xFFFFFFFF
        second = (second + odd + first) & 0xFFFFFFFF
    return first, second
