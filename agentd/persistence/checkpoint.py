"""Keep an agent on disk: its mind, its mail and its actions, written together in one transaction.

One SQLite database per agent. Everything here blocks: `Checkpoint.save` is for a writer thread. The next life of an
agent reads exactly what the last one had saved. A corrupt file is renamed and a new one is made; a file of a newer
version, of another agent or in use by another process is refused.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

from agentd.mind.persistence.rows import MindChanges, StoredMind
from commd.mail.page_checksums import ENDING, PageChecksums, log_damage
from commd.mail.sqlite_file import CORRUPT, check, code_of, corrupt, set_aside
from commd.process.state_dir import make_private_file, make_private_folder
from schemas.wire.records import Note

NUMBERINGS: Final = 1_000
"""Numberings of one sender whose last number is kept; older ones are those of lives that are long over."""
DAMAGED: Final = "state_damaged"
"""Code of the notes about missing parts of a file."""
CACHE: Final = 64
"""Kibibytes of pages that SQLite keeps in memory for each agent."""
STATEMENTS: Final = 24
"""Compiled statements that SQLite keeps for each agent: more than this module has."""
LOCK_PATIENCE: Final = 3.0
"""Wall seconds to wait for a file that another process has open: that process may be about to end."""
APPLICATION: Final = 0x4172_676F
"""SQLite's application id of a checkpoint of Argosy."""
PAGE: Final = 1024
"""Bytes of a page: the cost of a small change on disk, and of each open file in memory."""
LOG_PAGES: Final = 1024
"""Pages in the write-ahead log before they are moved into the database."""
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
"""The scripts that bring a database from version N to N + 1; the first one begins with an empty file."""

Synchronous = Literal["FULL", "NORMAL"]
_ENDINGS: Final = ("", "-wal", "-shm", ENDING)


class CheckpointError(Exception):
    """A checkpoint cannot be opened, read or written; the text says why and what to do."""


class Outgoing(NamedTuple):
    """A message that `commd` has not accepted yet: a row of the table."""

    number: int
    """Its place among all messages of the agent."""
    receiver: str
    seq: int
    message: bytes


class ActionInFlight(NamedTuple):
    """An action whose end is not known: a row of the table, without its id."""

    name: str
    parameters: bytes


@dataclass(slots=True)
class Saving:
    """The changes of one transaction; whatever is not given stays unchanged."""

    mind: MindChanges | None = None
    absorbed: dict[tuple[str, str], int] = field(default_factory=dict)
    """The number of the last message that the mind has taken, by sender and numbering."""
    outgoing: list[Outgoing] = field(default_factory=list)
    """New messages."""
    delivered: list[int] = field(default_factory=list)
    """Numbers of the messages to remove."""
    next_seq: dict[str, int] = field(default_factory=dict)
    """The number of the next message, by receiver."""
    numbering: str | None = None
    """The identity of the agent's own numbering."""
    actions: dict[str, ActionInFlight] = field(default_factory=dict)
    """New actions, by id."""
    ended: list[str] = field(default_factory=list)
    """Ids of the actions to remove."""
    lives: int | None = None
    extra: dict[str, bytes] = field(default_factory=dict)
    soft: bool = False
    """Whether it must survive the end of the process only, not a power cut: nobody else has heard of what it keeps."""


@dataclass(slots=True)
class Stored:
    """The content of a checkpoint."""

    mind: StoredMind
    absorbed: dict[tuple[str, str], int]
    outgoing: tuple[Outgoing, ...]
    next_seq: dict[str, int]
    numbering: str
    actions: dict[str, ActionInFlight]
    lives: int
    extra: dict[str, bytes]


class Checkpoint:
    """The file of one agent, made by `open`. Any thread may save; saves are serialized."""

    def __init__(self, path: Path, agent: str, synchronous: Synchronous) -> None:
        self.path = path
        self.notes: list[Note] = []
        """Damage of the file that was found."""
        self._agent, self._synchronous = agent, synchronous
        self._sums = PageChecksums(path)
        self._lock = threading.Lock()
        self._database: sqlite3.Connection | None = None
        self._soft = False
        self._marked = False
        """Whether the row `saved` was written by this process."""

    @classmethod
    def open(cls, path: Path, agent: str, synchronous: Synchronous = "FULL") -> Checkpoint:
        """Open the file of an agent, or make it; a corrupt one is renamed. Raises CheckpointError."""
        made = cls(path, agent, synchronous)
        with _as_checkpoint_error(path, "opened"):
            make_private_folder(path.parent)
            try:
                damage = made._sums.damage()
                damage_of_log = log_damage(path)
                made._open()  # which refuses one of a newer version
                if damage:
                    made.close()
                    raise corrupt(damage)
                if damage_of_log:
                    made.notes.append(Note(DAMAGED, f"{path}: {damage_of_log}", "log"))
            except sqlite3.DatabaseError as error:
                if code_of(error) not in CORRUPT:
                    raise
                aside = set_aside(path)
                text = f"{path} is corrupt ({error}) and was set aside as {aside.name}: {agent} starts without it"
                made.notes.append(Note(DAMAGED, text, "file"))
                made._open()
        return made

    def _open(self) -> None:
        """Open the database at the present version, or make it.

        Raises CheckpointError for a database of another agent or a newer version, and sqlite3.DatabaseError for a
        corrupt one.
        """
        self._sums.begin()
        try:
            _check_and_migrate(self.path, self._agent, self._synchronous)
        except UnicodeDecodeError as error:  # SQLite's message quotes a damaged schema
            raise corrupt(str(error)) from None
        self._database = _connected(self.path, self._synchronous, STATEMENTS)
        self._sums.carry_over(self._database)

    def read(self) -> Stored | None:
        """Return the content; None if nothing was ever saved. Raises CheckpointError."""
        with self._lock, _as_checkpoint_error(self.path, "read"):
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

    def save(self, saving: Saving) -> None:
        """Write all of it or nothing; it is on disk when this returns. Raises CheckpointError; then save it again."""
        with self._lock, _as_checkpoint_error(self.path, "written"):
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
        """Release the memory of a save, for a daemon may have hundreds of agents, and shorten a long log."""
        with self._lock, suppress(sqlite3.Error, OSError):
            if self._database is not None:
                if self._sums.due(LOG_PAGES * PAGE):
                    self._sums.carry_over(self._database)
                self._database.execute("PRAGMA shrink_memory")

    def _write(self, database: sqlite3.Connection, saving: Saving) -> None:
        mind = saving.mind or MindChanges()
        about = {"saved": None if self._marked else 1, "numbering": saving.numbering, "lives": saving.lives}
        for statement, rows in (
            ("DELETE FROM belief WHERE rank = ?", _each(mind.beliefs_gone)),
            ("INSERT OR REPLACE INTO belief VALUES (?, ?)", mind.beliefs),
            ("INSERT OR REPLACE INTO predicate VALUES (?, ?)", mind.predicates),
            ("DELETE FROM plan WHERE rank = ?", _each(mind.plans_gone)),
            ("INSERT OR REPLACE INTO plan VALUES (?, ?)", mind.plans),
            ("DELETE FROM pending WHERE queued = ? AND number = ?", mind.pending_gone),
            ("INSERT OR REPLACE INTO pending VALUES (?, ?, ?, ?)", [(*at, int(o), e) for at, o, e in mind.pending]),
            ("INSERT OR REPLACE INTO value VALUES (?, ?)", list(mind.values.items())),
            ("INSERT OR REPLACE INTO outgoing VALUES (?, ?, ?, ?)", saving.outgoing),
            ("DELETE FROM outgoing WHERE number = ?", _each(saving.delivered)),
            ("INSERT OR REPLACE INTO receiver VALUES (?, ?)", list(saving.next_seq.items())),
            ("INSERT OR REPLACE INTO action VALUES (?, ?, ?)", [(i, *one) for i, one in saving.actions.items()]),
            ("DELETE FROM action WHERE id = ?", _each(saving.ended)),
            ("INSERT OR REPLACE INTO extra VALUES (?, ?)", list(saving.extra.items())),
            (_PUT_ABOUT, [(name, value) for name, value in about.items() if value is not None]),
        ):
            if rows:  # a statement without rows takes time too, while an action waits
                database.executemany(statement, rows)
        if saving.absorbed:
            _write_absorbed(database, saving.absorbed)

    def _undo(self) -> None:
        """Roll back a transaction that failed; if that fails too, the next save opens the file again."""
        assert self._database is not None
        try:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
                self._sums.carry_over(self._database)  # the log may hold some of it
        except (sqlite3.Error, OSError):
            database, self._database = self._database, None
            with suppress(sqlite3.Error):
                database.close()

    def forget(self) -> None:
        """Close and remove the file. Raises CheckpointError."""
        self.close()
        remove(self.path)

    def close(self) -> None:
        """Close the file and keep it. Raises CheckpointError."""
        with self._lock, _as_checkpoint_error(self.path, "closed"):
            database, self._database = self._database, None
            if database is not None:
                with suppress(sqlite3.Error, OSError):
                    self._sums.carry_over(database)
                database.close()
            self._sums.close()


def _write_absorbed(database: sqlite3.Connection, absorbed: dict[tuple[str, str], int]) -> None:
    """Keep the last numbers taken, and of each sender the `NUMBERINGS` that were used last."""
    (used,) = database.execute("SELECT coalesce(max(used), 0) + 1 FROM absorbed").fetchone()
    rows = ((sender, numbering, seq, used) for (sender, numbering), seq in absorbed.items())
    database.executemany(_PUT_ABSORBED, rows)
    database.executemany(
        _PRUNE_ABSORBED, [(sender, sender, NUMBERINGS) for sender in {sender for sender, _ in absorbed}]
    )


def _each(values: Iterable[Any]) -> list[tuple[Any]]:
    return [(value,) for value in values]


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


# --- the database file ---


@contextmanager
def _as_checkpoint_error(path: Path, what: str) -> Iterator[None]:
    """Turn an error of the disk or the database into a CheckpointError; `what` is the participle of its text."""
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        locked = code_of(error) in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
        why = "another process has it open" if locked else str(error)
        raise CheckpointError(f"{path} cannot be {what}: {why}") from error


def _check_and_migrate(path: Path, agent: str, synchronous: Synchronous) -> None:
    database = _connected(path, synchronous, 0)
    try:
        (version,) = database.execute("PRAGMA user_version").fetchone()
        if version > len(MIGRATIONS):
            raise CheckpointError(
                f"{path} was written by a newer Argosy (its version is {version}, this one knows up to"
                f" {len(MIGRATIONS)}): run that, or begin anew without what is kept there"
            )
        check(database)
        (kind,) = database.execute("PRAGMA application_id").fetchone()
        (tables,) = database.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        if tables and kind != APPLICATION:
            raise corrupt("it is a database of something else")
        _migrate(database, version, agent)
        (owner,) = database.execute("SELECT value FROM agent WHERE name = 'name'").fetchone()
        if owner != agent:
            raise CheckpointError(f"{path} belongs to the agent {owner}, not to {agent}")
    finally:
        database.close()


def _connected(path: Path, synchronous: Synchronous, statements: int) -> sqlite3.Connection:
    """Connect and lock the file."""
    make_private_file(path)
    database = sqlite3.connect(
        path, timeout=LOCK_PATIENCE, isolation_level=None, check_same_thread=False, cached_statements=statements
    )
    database.text_factory = lambda data: data.decode(errors="replace")  # the text of a damaged row
    try:
        for statement in (
            f"PRAGMA page_size={PAGE}",
            "PRAGMA locking_mode=EXCLUSIVE",  # one process only, and no file of shared memory
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


def remove(path: Path) -> None:
    """Remove the file of an agent, if there is one, without reading it. Raises CheckpointError."""
    with _as_checkpoint_error(path, "removed"):
        for ending in _ENDINGS:
            path.with_name(path.name + ending).unlink(missing_ok=True)
