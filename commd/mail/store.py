"""A board's mail file: SQLite with a writer thread and a reader thread.

Concurrent writes share one commit. The event loop never waits for the disk; a caller waits until its transaction is on
disk, or gets an error.
"""

from __future__ import annotations

import asyncio
import logging
import sqlite3
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from threading import Condition, Thread
from typing import Any, Literal, TypeAlias, TypeVar

from commd.bus.errors import CannotServe
from commd.mail.page_checksums import PageChecksums, log_damage
from commd.mail.queries import TooNew, migrate
from commd.mail.sqlite_file import (
    CORRUPT,
    DISK,
    LOG_BYTES,
    PASSING,
    alone,
    check,
    code_of,
    connect,
    corrupt,
    may_pass,
    set_aside,
    words_for,
)
from schemas.files.findings import Findings

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
        self.set_aside: list[str] = []
        """Names of the corrupt files that were set aside since the start."""
        self.damaged: list[str] = []
        """What the file had lost at the start, for people."""
        self._sums = PageChecksums(path)
        self._count = count
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[Transaction[Any], asyncio.Future[Any]]] = deque()
        self._ready = Condition()
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
        if len(self._waiting) >= QUEUE:
            raise StoreFailed(f"busy: {QUEUE} transactions wait for the disk")
        self._waiting.append((transaction, future))
        self._wake()
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
                self._reading = self._generation, connect(self.path, self.synchronous)
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
                self._wake()
            raise StoreFailed(words_for(error)) from None

    def _wake(self) -> None:
        """Have the writer look at what waits."""
        with self._ready:
            self._ready.notify()

    def _work(self) -> None:
        """Write the waiting transactions, one commit after the other, until the store closes."""
        while True:
            with self._ready:
                while not (self._waiting or self._closing or self._suspect):
                    if not self._ready.wait(OPEN_AGAIN if self._db is None else None) and self._db is None:
                        break  # an empty group opens the file
                if not self._waiting and self._closing:
                    break
            self._write_group()
        self._close()

    def _write_group(self) -> None:
        """Write the transactions that wait now, at most `GROUP` of them, in one commit."""
        group = [self._waiting.popleft() for _ in range(min(GROUP, len(self._waiting)))]
        # A transaction whose caller got an error, or has stopped waiting, is not written.
        group = [one for one in group if not one[1].done()]
        outcomes = self._commit([transaction for transaction, _ in group])
        with suppress(RuntimeError):  # the loop is closed: nobody waits
            self._loop.call_soon_threadsafe(_settle, [future for _, future in group], outcomes)

    def _commit(self, group: list[Transaction[Any]]) -> list[Any]:
        """Run a group of transactions as one. Returns the result, or the exception, of each."""
        try:
            db = self._db or self._open()
            if self._suspect:
                self._suspect = False
                check(db)
            if self._uncounted:
                self._recount(db)
            db.execute("BEGIN IMMEDIATE")
            outcomes = [self._run(db, transaction) for transaction in group]
            db.execute("COMMIT")
            if self._sums.due(LOG_BYTES):
                self._carry_over(db)
        except (sqlite3.Error, OSError, TooNew) as error:
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
            if self._db is not None and self._db.in_transaction:
                self._db.execute("ROLLBACK")
                self._carry_over(self._db)  # the log may hold a part of it
            if self._db is not None and code_of(error) in DISK - PASSING:
                self._close()
                if code_of(error) in CORRUPT:
                    self._replace_corrupt(str(error))
            if self._db is not None:
                self._recount(self._db)
        except (sqlite3.Error, OSError, TooNew) as another:
            log.error("mail_store_failing file=%s why=%s", self.path, another)

    def _open(self) -> sqlite3.Connection:
        """Open the file, or a new one if it is corrupt. Raises sqlite3.Error, OSError and TooNew."""
        try:
            damage = self._sums.damage()
            if told_of_log := log_damage(self.path):
                self.damaged.append(told_of_log)
                log.error("mail_store_damaged file=%s why=%s", self.path, told_of_log)
            self._sums.begin()
            db = connect(self.path, self.synchronous)
            try:
                check(db)
                migrate(db)  # which refuses a newer version
                if damage:
                    raise corrupt(damage)
            except BaseException:
                db.close()
                raise
        except (sqlite3.Error, UnicodeDecodeError) as error:
            if code_of(error) not in CORRUPT:
                raise
            return self._replace_corrupt(str(error))
        return self._opened(db)

    def _replace_corrupt(self, why: str) -> sqlite3.Connection:
        """Set the corrupt file aside and make a new one."""
        aside = set_aside(self.path)
        text = "mail_store_corrupt file=%s why=%s set_aside=%s: its mail is lost, a new file is made"
        log.error(text, self.path, why, aside)
        self.set_aside.append(aside.name)
        self._sums.begin()
        db = connect(self.path, self.synchronous)
        migrate(db)
        return self._opened(db)

    def _opened(self, db: sqlite3.Connection) -> sqlite3.Connection:
        self._sums.carry_over(db)
        self._db = db
        self._generation += 1
        self._uncounted = True
        self._recount(db)
        return db

    def _carry_over(self, db: sqlite3.Connection) -> None:
        """Move the log into the file; if that fails now, it is done later."""
        with suppress(sqlite3.Error, OSError):
            self._sums.carry_over(db)

    def _close(self) -> None:
        if self._db is not None:
            self._carry_over(self._db)
            self._db.close()
        self._db = None

    async def open(self) -> None:
        """Open the file, check it and bring it to this version; a corrupt one is set aside.

        With a full or failing disk the store starts without its file, and opens it later: a board without mail is still
        a router. Raises Findings for a file that can never be used: of a newer version, or without write permission.
        """
        try:
            await asyncio.to_thread(self._open)
        except (TooNew, OSError, sqlite3.Error) as error:
            if not may_pass(self.path, error):
                raise Findings.about(self.path, f"cannot store mail in this file: {error}") from None
            self._failed(error)
        self._writer.start()

    async def close(self) -> None:
        """Write the waiting transactions and close the file."""
        self._closing = True
        self._wake()
        await asyncio.to_thread(self._writer.join, PATIENCE)
        if self._reading is not None:
            self._reader.submit(self._reading[1].close)
        await asyncio.to_thread(self._reader.shutdown)
        self._sums.close()


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
