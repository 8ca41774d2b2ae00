"""A board's mail file: SQLite with a writer thread and a reader thread.

Concurrent writes share one commit. The event loop never waits for the disk; a caller waits until its transaction is on
disk, or gets an error.
"""

from __future__ import annotations

import asyncio
import fcntl
import logging
import os
import sqlite3
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Literal, TypeAlias, TypeVar

from commd.bus.errors import CannotServe
from commd.mail import queries
from commd.process.sqlite_file import CORRUPT, SqliteFile, check, code_of
from commd.process.state_dir import make_private_folder
from schemas.files.findings import Findings
from schemas.files.text_files import MAY_PASS

T = TypeVar("T")
Transaction: TypeAlias = Callable[[sqlite3.Connection], T]
log = logging.getLogger("store")

QUEUE = 1_000
"""Transactions that may wait for the writer; further ones fail."""
GROUP = 256
"""Transactions of one commit at most."""
OPEN_AGAIN = 1.0
"""Wall seconds between two attempts to open a file."""
PATIENCE = 30.0
"""Wall seconds that a caller waits for the disk."""
CACHE_KIB = 256
"""KiB of pages that each of the two connections caches."""
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


class StoreFailed(CannotServe, OSError):
    """A transaction is not on disk, and nothing of it is kept: the disk is full or broken, or the store is closing."""


class Store:
    """A board's mail file. Make it with `open_store`."""

    def __init__(self, path: Path, synchronous: Literal["full", "normal"], count: Transaction[None] | None) -> None:
        self.path, self.synchronous = path, synchronous
        self.counters: Counter[str] = Counter()
        """`commits`, and `db_errors`: commits that failed."""
        self.note = ""
        """What is wrong with the file now, for people."""
        self.file = SqliteFile(path, queries.MIGRATIONS, synchronous, (f"cache_size=-{CACHE_KIB}",))
        self._count = count
        self._loop = asyncio.get_running_loop()
        self._waiting: SimpleQueue[tuple[Transaction[Any], asyncio.Future[Any]] | None] = SimpleQueue()
        """Transactions for the writer; None: it looks at the rest."""
        self._closing = False
        self._suspect = False
        """Whether the reader found corruption, which the writer must check."""
        self._uncounted = True
        self._generation = 0
        """Number of times the file was opened; the reader opens it again after a change."""
        self._reader = ThreadPoolExecutor(1, "mail-reader")
        self._reading: tuple[int, sqlite3.Connection] | None = None
        self._db: sqlite3.Connection | None = None
        """The writer's; None while the file cannot be opened."""
        self._writer = Thread(target=self._work, name="mail-writer", daemon=True)

    async def write(self, transaction: Transaction[T]) -> T:
        """Run `transaction(connection)` in the writer's thread and return its result when it is on disk.

        Raises StoreFailed, and what the transaction itself raises; nothing of it is kept then, except that a write
        which the disk had begun when `PATIENCE` ended may still succeed.
        """
        future: asyncio.Future[T] = self._loop.create_future()
        if self._closing:
            raise StoreFailed("the mail file is closed")
        if self._waiting.qsize() >= QUEUE:
            raise StoreFailed(f"busy: {QUEUE} transactions wait for the disk")
        self._waiting.put((transaction, future))
        try:
            async with asyncio.timeout(PATIENCE):
                return await future
        except TimeoutError:
            raise StoreFailed(f"the disk has not answered for {PATIENCE:g} s") from None

    async def read(self, question: Transaction[T]) -> T:
        """Run `question(connection)` in the reader's thread, on what is on disk. Raises StoreFailed."""
        if self._closing:
            raise StoreFailed("the mail file is closed")
        return await self._loop.run_in_executor(self._reader, self._read, question)

    def _read(self, question: Transaction[T]) -> T:
        if not self._generation:
            raise StoreFailed(self.note)
        try:
            if self._reading is None or self._reading[0] != self._generation:
                if self._reading is not None:
                    self._reading[1].close()
                self._reading = self._generation, self.file.connect()
            return question(self._reading[1])
        except (sqlite3.Error, UnicodeDecodeError) as error:
            code = code_of(error)
            if code not in DISK:
                raise
            if code not in PASSING and self._reading is not None:
                self._reading[1].close()
                self._reading = None
            if code in CORRUPT:
                self._suspect = True
                self._waiting.put(None)
            raise StoreFailed(words_for(error)) from None

    def _work(self) -> None:
        """Write the waiting transactions until the store closes."""
        while not (self._closing and self._waiting.empty()):
            self._write_group()
        self._close()

    def _write_group(self) -> None:
        """Wait for transactions, and write those that wait together in one commit."""
        group = []
        with suppress(Empty):
            group.append(self._waiting.get(timeout=OPEN_AGAIN if self._db is None else None))
            while len(group) < GROUP:
                group.append(self._waiting.get_nowait())
        # A transaction whose caller got an error, or has stopped waiting, is not written.
        left = [one for one in group if one is not None and not one[1].done()]
        if left or not self._closing:  # an empty group opens or checks the file
            outcomes = self._commit([transaction for transaction, _ in left])
            with suppress(RuntimeError):  # the loop is closed: nobody waits
                self._loop.call_soon_threadsafe(_settle, [future for _, future in left], outcomes)

    def _commit(self, group: list[Transaction[Any]]) -> list[Any]:
        """Run a group of transactions as one. Returns the result, or the exception, of each."""
        try:
            db = self._db or self._opened(self.file.open_or_replace())
            if self._suspect:
                self._suspect = False
                check(db)
            if self._uncounted:
                self._recount(db)
            db.execute("BEGIN IMMEDIATE")
            outcomes = [self._run(db, transaction) for transaction in group]
            db.execute("COMMIT")
            self.file.shorten_log(db)
        except (sqlite3.Error, OSError) as error:
            self._failed(error)
            return [StoreFailed(words_for(error))] * len(group)
        except Exception as error:  # the writer thread must survive it
            log.exception("defect in argosy: writing %s", self.path)
            self._failed(error)
            return [StoreFailed(f"defect in argosy: {error}")] * len(group)
        self.counters["commits"] += 1
        if self.note:
            log.warning("mail_store_well file=%s", self.path)
            self.note = ""
        return outcomes

    def _run(self, db: sqlite3.Connection, transaction: Transaction[Any]) -> Any:
        db.execute("SAVEPOINT one")
        try:
            outcome = transaction(db)
        except Exception as error:
            if code_of(error) in DISK:
                raise
            outcome = error
            db.execute("ROLLBACK TO one")
            self._uncounted = True
            self._recount(db)
        db.execute("RELEASE one")
        return outcome

    def _recount(self, db: sqlite3.Connection) -> None:
        """Count the file's contents again, as after a rollback."""
        if self._count is not None:
            self._count(db)
        self._uncounted = False

    def _failed(self, error: Exception) -> None:
        """Roll back, log the reason once, and close the file if it must be opened again."""
        self.counters["db_errors"] += 1
        self._uncounted = True
        if not self.note:
            log.error("mail_store_failing file=%s why=%s: no mail is accepted until this ends", self.path, error)
        self.note = f"no mail is accepted: {words_for(error)} ({self.path})"
        try:
            if self._db is not None:
                with suppress(sqlite3.Error, OSError):
                    self.file.roll_back(self._db)
            if self._db is not None and code_of(error) in DISK - PASSING:
                self._close()
                if code_of(error) in CORRUPT:
                    self._opened(self.file.replace(str(error)))
            if self._db is not None:
                self._recount(self._db)
        except (sqlite3.Error, OSError) as another:
            log.error("mail_store_failing file=%s why=%s", self.path, another)

    def _opened(self, db: sqlite3.Connection) -> sqlite3.Connection:
        self._db = db
        self._generation += 1
        self._uncounted = True
        self._recount(db)
        return db

    def _close(self) -> None:
        if self._db is not None:
            self.file.close(self._db)
        self._db = None

    async def open(self) -> None:
        """Open the file, check it and bring it to this version; a corrupt one is set aside.

        With a full or failing disk the store starts without its file, and opens it later: a board without mail is still
        a router. Raises Findings for a file that can never be used: of a newer version, or without write permission.
        """
        try:
            await asyncio.to_thread(lambda: self._opened(self.file.open_or_replace()))
        except (OSError, sqlite3.Error) as error:
            if not may_pass(self.path, error):
                raise Findings.about(self.path, f"cannot store mail in this file: {error}") from None
            self._failed(error)
        self._writer.start()

    async def close(self) -> None:
        """Write the waiting transactions and close the file."""
        self._closing = True
        self._waiting.put(None)
        await asyncio.to_thread(self._writer.join, PATIENCE)
        if self._reading is not None:
            self._reader.submit(self._reading[1].close)
        await asyncio.to_thread(self._reader.shutdown)


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


@asynccontextmanager
async def open_store(
    path: Path, synchronous: Literal["full", "normal"] = "full", count: Transaction[None] | None = None
) -> AsyncIterator[Store]:
    """Open a board's mail file for this process alone, and close it at the end.

    `count(connection)` runs in the writer's thread before the first transaction and after each rollback, to count the
    file's contents.
    """
    with alone(path):
        store = Store(path, synchronous, count)
        await store.open()
        try:
            yield store
        finally:
            await store.close()


def _settle(futures: list[asyncio.Future[Any]], outcomes: list[Any]) -> None:
    for future, outcome in zip(futures, outcomes, strict=True):
        if future.done():  # its caller has stopped waiting
            continue
        if isinstance(outcome, Exception):
            future.set_exception(outcome)
        else:
            future.set_result(outcome)


def may_pass(path: Path, error: Exception) -> bool:
    """Whether a file that cannot be opened now may be opened later: its disk is full or failing."""
    if code_of(error) in DISK - {sqlite3.SQLITE_PERM, sqlite3.SQLITE_READONLY}:
        return not path.is_dir() and os.access(path if path.exists() else path.parent, os.R_OK | os.W_OK)
    return isinstance(error, OSError) and error.errno in MAY_PASS


def words_for(error: Exception) -> str:
    """Return what is wrong with the disk or the file, for people."""
    return "the disk is full" if code_of(error) == sqlite3.SQLITE_FULL else str(error)
