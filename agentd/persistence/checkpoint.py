"""The file that an agent survives in: its mind, its mail and its actions, written together in one transaction.

One SQLite database per agent. All of it blocks: `Checkpoint.save` is for a writer thread. What was saved when a process
dies is what its next life reads, neither more nor less. A corrupt file is set aside and a new one made; a file of a
newer version, of another agent or in use by another process is refused.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from agentd.mind.persistence.rows import MindChanges, StoredMind
from agentd.persistence.sqlite_file import (
    LOG_PAGES,
    PAGE,
    CheckpointError,
    NotWhole,
    Synchronous,
    is_corrupt,
    open_database,
    remove,
    set_aside,
    told,
)
from commd.mail.page_checksums import PageChecksums, log_damage
from commd.process.state_dir import make_private_folder
from schemas.wire.records import Note

NUMBERINGS: Final = 1_000
"""Of so many numberings of a sender the last number taken is remembered: more are those of lives long over."""
DAMAGED: Final = "state_damaged"
"""Code of the notes about what is missing of a file."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message that has not reached the board's `commd`."""

    number: int
    """Its place among all of them."""
    receiver: str
    seq: int
    message: bytes


@dataclass(frozen=True, slots=True)
class ActionInFlight:
    """An action whose end is not known."""

    name: str
    parameters: bytes


@dataclass(slots=True)
class Saving:
    """What is written in one transaction; what is not given stays as it is."""

    mind: MindChanges | None = None
    absorbed: dict[tuple[str, str], int] = field(default_factory=dict)
    """By sender and numbering the number of the last message that the mind has taken."""
    outgoing: list[Outgoing] = field(default_factory=list)
    """Messages that are new."""
    delivered: list[int] = field(default_factory=list)
    """Numbers of messages that need not be kept any more."""
    next_seq: dict[str, int] = field(default_factory=dict)
    """The number that the next message gets, by receiver."""
    numbering: str | None = None
    """The identity of the agent's own counting."""
    actions: dict[str, ActionInFlight] = field(default_factory=dict)
    """Actions that are new, by their id."""
    ended: list[str] = field(default_factory=list)
    """Ids of actions that need not be kept any more."""
    lives: int | None = None
    extra: dict[str, bytes] = field(default_factory=dict)
    soft: bool = False
    """It need survive the death of the process only, not that of the board: that costs no wait for the disk."""


@dataclass(slots=True)
class Stored:
    """What was saved."""

    mind: StoredMind
    absorbed: dict[tuple[str, str], int]
    outgoing: tuple[Outgoing, ...]
    next_seq: dict[str, int]
    numbering: str
    actions: dict[str, ActionInFlight]
    lives: int
    extra: dict[str, bytes]


class Checkpoint:
    """The file of one agent; made by `open`. Saves may come from any thread, one after the other."""

    def __init__(self, path: Path, agent: str, synchronous: Synchronous) -> None:
        self.path = path
        self.notes: list[Note] = []
        """What is missing of the file that was found."""
        self._agent, self._synchronous = agent, synchronous
        self._sums = PageChecksums(path)
        self._lock = threading.Lock()
        self._database: sqlite3.Connection | None = None
        self._soft = False
        self._marked = False
        """That something was saved has been written down in this life."""

    @classmethod
    def open(cls, path: Path, agent: str, synchronous: Synchronous = "FULL") -> Checkpoint:
        """Open the file of an agent, or make it; a corrupt one is set aside. Raises CheckpointError."""
        made = cls(path, agent, synchronous)
        with told(path, "opened"):
            make_private_folder(path.parent)
            try:
                damage = made._sums.damage()
                damage_of_log = log_damage(path)
                made._open()  # which refuses one of a newer version
                if damage:
                    made.close()
                    raise NotWhole(damage)
                if damage_of_log:
                    made.notes.append(Note(DAMAGED, f"{path}: {damage_of_log}", "log"))
            except sqlite3.DatabaseError as error:
                if not is_corrupt(error):
                    raise
                aside = set_aside(path)
                text = f"{path} is corrupt ({error}) and was set aside as {aside.name}: {agent} starts without it"
                made.notes.append(Note(DAMAGED, text, "file"))
                made._open()
        return made

    def _open(self) -> None:
        self._sums.begin()
        self._database = open_database(self.path, self._agent, self._synchronous)
        self._sums.carry_over(self._database)

    # --- what was saved ---

    def read(self) -> Stored | None:
        """Return what was saved; None if nothing ever was. Raises CheckpointError."""
        with self._lock, told(self.path, "read"):
            about = dict(self._rows("SELECT name, value FROM agent"))
            if "saved" not in about:
                return None
            return Stored(
                mind=StoredMind(
                    beliefs=list(self._rows("SELECT rank, entry FROM belief ORDER BY rank")),
                    predicates=list(self._rows("SELECT number, signature FROM predicate ORDER BY number")),
                    plans=list(self._rows("SELECT rank, entry FROM plan ORDER BY rank")),
                    pending=[((q, n), o, e) for q, n, o, e in self._rows("SELECT * FROM pending ORDER BY 1, 2")],
                    values=dict(self._rows("SELECT name, value FROM value")),
                ),
                absorbed={(s, n): seq for s, n, seq in self._rows("SELECT sender, numbering, seq FROM absorbed")},
                outgoing=tuple(Outgoing(*row) for row in self._rows("SELECT * FROM outgoing ORDER BY number")),
                next_seq=dict(self._rows("SELECT name, next_seq FROM receiver")),
                numbering=about.get("numbering", ""),
                actions={i: ActionInFlight(n, p) for i, n, p in self._rows("SELECT * FROM action ORDER BY rowid")},
                lives=about.get("lives", 0),
                extra=dict(self._rows("SELECT name, value FROM extra")),
            )

    def _rows(self, query: str) -> Iterator[Any]:
        assert self._database is not None
        return self._database.execute(query)

    # --- saving ---

    def save(self, saving: Saving) -> None:
        """Write it all or nothing; on disk when this returns. Raises CheckpointError: then save it again later."""
        with self._lock, told(self.path, "written"):
            if self._database is None:
                self._open()
                self._soft = False
                assert self._database is not None
                self._marked = False  # the file may be another one
            if saving.soft != self._soft:
                self._database.execute(f"PRAGMA synchronous={'NORMAL' if saving.soft else self._synchronous}")
                self._soft = saving.soft
            try:
                self._database.execute("BEGIN IMMEDIATE")
                self._write(self._database, saving)
                self._database.execute("COMMIT")
            except BaseException:
                self._undo()
                raise
            self._marked = True

    def shrink(self) -> None:
        """Give back what a save has needed: the memory, for a daemon may have hundreds of agents, and a long log."""
        with self._lock, suppress(sqlite3.Error, OSError):
            if self._database is not None:
                if self._sums.due(LOG_PAGES * PAGE):
                    self._sums.carry_over(self._database)
                self._database.execute("PRAGMA shrink_memory")

    def _write(self, database: sqlite3.Connection, saving: Saving) -> None:
        if saving.mind is not None:
            _write_mind(database, saving.mind)
        many = database.executemany
        if saving.absorbed:
            _write_absorbed(database, saving.absorbed)
        if saving.outgoing:  # a statement that has nothing to do costs time too, while an action waits
            many("INSERT OR REPLACE INTO outgoing VALUES (?, ?, ?, ?)", _outgoing(saving.outgoing))
        if saving.delivered:
            many("DELETE FROM outgoing WHERE number = ?", _each(saving.delivered))
        if saving.next_seq:
            many("INSERT OR REPLACE INTO receiver VALUES (?, ?)", saving.next_seq.items())
        if saving.actions:
            actions = ((identity, one.name, one.parameters) for identity, one in saving.actions.items())
            many("INSERT OR REPLACE INTO action VALUES (?, ?, ?)", actions)
        if saving.ended:
            many("DELETE FROM action WHERE id = ?", _each(saving.ended))
        if saving.extra:
            many("INSERT OR REPLACE INTO extra VALUES (?, ?)", saving.extra.items())
        about = {"saved": None if self._marked else 1, "numbering": saving.numbering, "lives": saving.lives}
        if known := [(name, value) for name, value in about.items() if value is not None]:
            many(_PUT_ABOUT, known)

    def _undo(self) -> None:
        """Take back a transaction that failed; where even that fails the file is opened anew for the next."""
        assert self._database is not None
        try:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
                self._sums.carry_over(self._database)  # the log may hold some of it
        except (sqlite3.Error, OSError):
            database, self._database = self._database, None
            with suppress(sqlite3.Error):
                database.close()

    # --- the file ---

    def forget(self) -> None:
        """Close and remove the file: nothing of it is to come back. Raises CheckpointError."""
        self.close()
        remove(self.path)

    def close(self) -> None:
        """Close the file; what was saved stays. Raises CheckpointError."""
        with self._lock, told(self.path, "closed"):
            database, self._database = self._database, None
            if database is not None:
                with suppress(sqlite3.Error, OSError):
                    self._sums.carry_over(database)
                database.close()
            self._sums.close()


def _write_mind(database: sqlite3.Connection, mind: MindChanges) -> None:
    many = database.executemany
    if mind.beliefs_gone:
        many("DELETE FROM belief WHERE rank = ?", _each(mind.beliefs_gone))
    if mind.beliefs:
        many("INSERT OR REPLACE INTO belief VALUES (?, ?)", mind.beliefs)
    if mind.predicates:
        many("INSERT OR REPLACE INTO predicate VALUES (?, ?)", mind.predicates)
    if mind.plans_gone:
        many("DELETE FROM plan WHERE rank = ?", _each(mind.plans_gone))
    if mind.plans:
        many("INSERT OR REPLACE INTO plan VALUES (?, ?)", mind.plans)
    if mind.pending_gone:
        many("DELETE FROM pending WHERE queued = ? AND number = ?", mind.pending_gone)
    if mind.pending:
        pending = ((queued, number, int(origin), event) for (queued, number), origin, event in mind.pending)
        many("INSERT OR REPLACE INTO pending VALUES (?, ?, ?, ?)", pending)
    if mind.values:
        many("INSERT OR REPLACE INTO value VALUES (?, ?)", mind.values.items())


def _write_absorbed(database: sqlite3.Connection, absorbed: dict[tuple[str, str], int]) -> None:
    """Remember the last numbers taken, of each sender's numberings those that were used last."""
    (used,) = database.execute("SELECT coalesce(max(used), 0) + 1 FROM absorbed").fetchone()
    rows = ((sender, numbering, seq, used) for (sender, numbering), seq in absorbed.items())
    database.executemany(_PUT_ABSORBED, rows)
    database.executemany(
        _PRUNE_ABSORBED, [(sender, sender, NUMBERINGS) for sender in {sender for sender, _ in absorbed}]
    )


def _outgoing(messages: Iterable[Outgoing]) -> Iterator[tuple[int, str, int, bytes]]:
    return ((one.number, one.receiver, one.seq, one.message) for one in messages)


def _each(values: Iterable[Any]) -> Iterator[tuple[Any]]:
    return ((value,) for value in values)


_PUT_ABOUT: Final = """
    INSERT INTO agent VALUES (?, ?) ON CONFLICT (name) DO UPDATE SET value = excluded.value
    WHERE value != excluded.value
"""
_PUT_ABSORBED: Final = """
    INSERT INTO absorbed VALUES (?, ?, ?, ?) ON CONFLICT (sender, numbering)
    DO UPDATE SET seq = max(seq, excluded.seq), used = excluded.used
"""
_PRUNE_ABSORBED: Final = """
    DELETE FROM absorbed WHERE sender = ? AND numbering IN
    (SELECT numbering FROM absorbed WHERE sender = ? ORDER BY used DESC LIMIT -1 OFFSET ?)
"""


__all__ = ["ActionInFlight", "Checkpoint", "CheckpointError", "Outgoing", "Saving", "Stored", "Synchronous", "remove"]
