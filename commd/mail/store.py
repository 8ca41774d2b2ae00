"""The file in which a board keeps its mail: SQLite with one thread that writes and one that reads.

What several callers ask to be written at the same time shares one commit. The event loop never waits for the disk; a
caller waits until what it asked for is on disk, or learns that it is not.
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

from commd.mail.page_checksums import PageChecksums, log_damage
from commd.mail.schema import TooNew, migrate
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
from schemas.files.findings import Finding, Findings

T = TypeVar("T")
Transaction: TypeAlias = Callable[[sqlite3.Connection], T]
log = logging.getLogger("store")

QUEUE = 1_000
"""Transactions that may wait for the writer; further ones fail at once."""
GROUP = 256
"""Transactions that share one commit at most."""
OPEN_AGAIN = 1.0
"""Wall seconds until a file that could not be opened at the start is tried again."""
PATIENCE = 30.0
"""Wall seconds that a caller waits for the disk."""


class StoreFailed(OSError):
    """What was asked for is not on disk: the disk is full or broken, or the store is closing. Nothing of it is kept."""


class Store:
    """A board's mail file. Make it with `open_store`."""

    def __init__(self, path: Path, synchronous: Literal["full", "normal"], count: Transaction[None] | None) -> None:
        self.path, self.synchronous = path, synchronous
        self.counters: Counter[str] = Counter()
        """`commits`, and `db_errors`: commits that failed."""
        self.note = ""
        """What is wrong with the file now, in words."""
        self.set_aside: list[str] = []
        """Names of the corrupt files that were set aside, since the start."""
        self.damaged: list[str] = []
        """What is missing of the file that was found at the start, in words."""
        self._sums = PageChecksums(path)
        self._count = count
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[Transaction[Any], asyncio.Future[Any]]] = deque()
        self._ready = Condition()
        self._closing = False
        self._suspect = False
        """The reader has met something corrupt: the writer must look."""
        self._uncounted = True
        self._generation = 0
        """Counts how often the file was opened: the reader follows."""
        self._reader = ThreadPoolExecutor(1, "mail-reader")
        self._reading: tuple[int, sqlite3.Connection] | None = None
        self._db: sqlite3.Connection | None = None
        """The writer's; none while the file cannot be opened."""
        self._writer = Thread(target=self._work, name="mail-writer", daemon=True)

    async def write(self, transaction: Transaction[T]) -> T:
        """Run `transaction(connection)` in the writer's thread and return its result when it is on disk.

        Raises StoreFailed if it is not, and what the transaction itself raises; nothing of it is kept then, unless the
        disk takes at last what it had begun to write when `PATIENCE` was over.
        """
        future: asyncio.Future[T] = self._loop.create_future()
        with self._ready:
            if self._closing:
                raise StoreFailed("the mail file is closed")
            if len(self._waiting) >= QUEUE:
                raise StoreFailed(f"busy: {QUEUE} transactions wait for the disk")
            self._waiting.append((transaction, future))
            self._ready.notify()
        try:
            async with asyncio.timeout(PATIENCE):
                return await future
        except TimeoutError:
            raise StoreFailed(f"the disk has not answered for {PATIENCE:g} s") from None

    async def read(self, question: Transaction[T]) -> T:
        """Run `question(connection)` in the reader's thread: it sees what is on disk. Raises StoreFailed."""
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
                with self._ready:
                    self._suspect = True
                    self._ready.notify()
            raise StoreFailed(words_for(error)) from None

    def _work(self) -> None:
        """Write what waits, one commit after the other, until the store closes."""
        while True:
            with self._ready:
                while not (self._waiting or self._closing or self._suspect):
                    if not self._ready.wait(OPEN_AGAIN if self._db is None else None) and self._db is None:
                        break  # an empty group opens it
                if not self._waiting and self._closing:
                    break
                group = [self._waiting.popleft() for _ in range(min(GROUP, len(self._waiting)))]
                # What a caller was told to have failed, or waits for no longer, is not written after all.
                group = [one for one in group if not one[1].done()]
            outcomes = self._commit([transaction for transaction, _ in group])
            with suppress(RuntimeError):  # the loop is closed: nobody waits any more
                self._loop.call_soon_threadsafe(_settle, [future for _, future in group], outcomes)
        self._close()

    def _commit(self, group: list[Transaction[Any]]) -> list[Any]:
        """Run a group of transactions as one. Returns each one's result, or the exception instead of it."""
        try:
            db = self._db or self._open()
            if self._suspect:
                self._suspect = False
                check(db)
            self._recount(db)
            db.execute("BEGIN IMMEDIATE")
            outcomes = [self._run(db, transaction) for transaction in group]
            db.execute("COMMIT")
            if self._sums.due(LOG_BYTES):
                self._carry_over(db)
        except (sqlite3.Error, OSError, TooNew) as error:
            self._failed(error)
            return [StoreFailed(words_for(error))] * len(group)
        except Exception as error:  # the thread must outlive it: without it nobody could write any more
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
        """Count anew what is kept in memory about the file, after something was rolled back."""
        if self._uncounted and self._count is not None:
            self._count(db)
        self._uncounted = False

    def _failed(self, error: Exception) -> None:
        """Forget what was not committed, tell once why, and open the file anew if it is not just full."""
        self.counters["db_errors"] += 1
        self._uncounted = True
        if not self.note:
            log.error("mail_store_failing file=%s why=%s: no mail is taken until it is well again", self.path, error)
        self.note = f"no mail is taken: {words_for(error)} ({self.path})"
        try:
            if self._db is not None and self._db.in_transaction:
                self._db.execute("ROLLBACK")
                self._carry_over(self._db)  # the log may hold some of it
            if self._db is not None and code_of(error) in DISK - PASSING:
                self._close()
                if code_of(error) in CORRUPT:
                    self._begin_anew(str(error))
            if self._db is not None:
                self._recount(self._db)
        except (sqlite3.Error, OSError, TooNew) as another:
            log.error("mail_store_failing file=%s why=%s", self.path, another)

    def _open(self) -> sqlite3.Connection:
        """Open the file, or a new one if it is corrupt. Raises what SQLite and the file system say, and TooNew."""
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
            return self._begin_anew(str(error))
        return self._opened(db)

    def _begin_anew(self, why: str) -> sqlite3.Connection:
        """Set the file aside and make a new one."""
        self.set_aside.append(set_aside(self.path, why).name)
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
        """Carry the log over into the file; what cannot be done now is done later."""
        with suppress(sqlite3.Error, OSError):
            self._sums.carry_over(db)

    def _close(self) -> None:
        if self._db is not None:
            self._carry_over(self._db)
            self._db.close()
        self._db = None

    async def open(self) -> None:
        """Open the file, check it and bring it to this version; a corrupt one is set aside.

        With a disk that is full or failing the store begins without its file, and opens it when the disk allows: a
        board without mail is still a router. Raises Findings for a file that can never be used: of a newer version, or
        where nothing may be written.
        """
        try:
            await asyncio.to_thread(self._open)
        except (TooNew, OSError, sqlite3.Error) as error:
            if not may_pass(self.path, error):
                raise Findings([Finding(str(self.path), 0, 0, f"cannot keep mail in this file: {error}")]) from None
            self._failed(error)
        self._writer.start()

    async def close(self) -> None:
        """Write what waits and close the file."""
        with self._ready:
            self._closing = True
            self._ready.notify()
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

    `count(connection)` runs in the writer's thread before the first transaction, and again after any was rolled back:
    what is kept in memory about the file is to be counted there.
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
        if future.done():  # its caller waits no longer
            continue
        if isinstance(outcome, Exception):
            future.set_exception(outcome)
        else:
            future.set_result(outcome)
