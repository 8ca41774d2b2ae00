"""Keep the agents of a daemon on disk: their minds, mail and actions, written together in one transaction.

One SQLite database per daemon; each table has the agent as its first column. Everything here blocks: `Checkpoint.save`
is for a writer thread. The next life of an agent reads exactly what the last one had saved. A corrupt file is renamed
and a new one is made; a file of a newer version or in use by another process is refused.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

from msgspec import Struct, field

from agentd.mind.persistence.rows import MindRows
from commd.process.sqlite_file import ENDING, SqliteFile, code_of
from commd.process.state_dir import make_private_folder
from schemas.wire.records import Note

NUMBERINGS: Final = 1_000
"""Numberings of one sender whose last number is kept; older ones are those of lives that are long over."""
DAMAGED: Final = "state_damaged"
"""Code of the notes about missing parts of a file."""
CACHE: Final = 1024
"""Kibibytes of pages that SQLite keeps in memory."""
APPLICATION: Final = 0x4172_676F
"""SQLite's application id of a checkpoint of Argosy."""
PAGE: Final = 1024
"""Bytes of a page: the cost of a small change on disk."""
MIGRATIONS: Final = (
    """
    CREATE TABLE agent (
        number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, numbering TEXT NOT NULL DEFAULT '',
        lives INTEGER NOT NULL DEFAULT 0, program BLOB NOT NULL DEFAULT x''
    );
    CREATE TABLE belief (agent INTEGER, rank INTEGER, entry BLOB NOT NULL, PRIMARY KEY (agent, rank)) WITHOUT ROWID;
    CREATE TABLE predicate (
        agent INTEGER, number INTEGER, signature BLOB NOT NULL, PRIMARY KEY (agent, number)
    ) WITHOUT ROWID;
    CREATE TABLE plan (agent INTEGER, rank INTEGER, entry BLOB NOT NULL, PRIMARY KEY (agent, rank)) WITHOUT ROWID;
    CREATE TABLE pending (
        agent INTEGER, queued INTEGER, number INTEGER, origin INTEGER NOT NULL, event BLOB NOT NULL,
        PRIMARY KEY (agent, queued, number)
    ) WITHOUT ROWID;
    CREATE TABLE value (agent INTEGER, name TEXT, value BLOB NOT NULL, PRIMARY KEY (agent, name)) WITHOUT ROWID;
    CREATE TABLE absorbed (
        agent INTEGER, sender TEXT, numbering TEXT, seq INTEGER NOT NULL, used INTEGER NOT NULL,
        PRIMARY KEY (agent, sender, numbering)
    ) WITHOUT ROWID;
    CREATE TABLE incoming (
        agent INTEGER, number INTEGER, message BLOB NOT NULL, PRIMARY KEY (agent, number)
    ) WITHOUT ROWID;
    CREATE TABLE outgoing (
        agent INTEGER, number INTEGER, receiver TEXT NOT NULL, seq INTEGER NOT NULL, message BLOB NOT NULL,
        PRIMARY KEY (agent, number)
    ) WITHOUT ROWID;
    CREATE TABLE receiver (
        agent INTEGER, name TEXT, next_seq INTEGER NOT NULL, PRIMARY KEY (agent, name)
    ) WITHOUT ROWID;
    CREATE TABLE action (
        agent INTEGER, id TEXT, name TEXT NOT NULL, parameters BLOB NOT NULL, PRIMARY KEY (agent, id)
    );
    """,
)
"""The scripts that bring a database from version N to N + 1; the first one begins with an empty file."""
TABLES: Final = {
    "belief": (3, "rank"),
    "predicate": (3, "number"),
    "plan": (3, "rank"),
    "pending": (5, "queued number"),
    "value": (3, "name"),
    "absorbed": (5, "sender numbering"),
    "incoming": (3, "number"),
    "outgoing": (5, "number"),
    "receiver": (3, "name"),
    "action": (4, "id"),
}
"""Those with rows of each agent: the number of columns, and the names of the key's columns after `agent`."""
_PUT: Final = {
    table: f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * columns)})"  # noqa: S608
    for table, (columns, _) in TABLES.items()
}
_REMOVE: Final = {
    table: f"DELETE FROM {table} WHERE agent = ? AND " + " AND ".join(f"{column} = ?" for column in key.split())  # noqa: S608
    for table, (_, key) in TABLES.items()
}

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


class AgentRows(Struct):
    """The changes of one agent in a transaction, where what is not given stays unchanged; or its state, which is read:
    nothing is gone then, and its life is known."""

    mind: MindRows = field(default_factory=MindRows)
    absorbed: dict[tuple[str, str], int] = {}
    """The number of the last message that the mind has taken, by sender and numbering."""
    incoming: list[tuple[int, bytes]] = []
    """Messages of other agents of the daemon that the mind has not taken, by their place."""
    taken: list[int] = []
    """Places of those that it has taken."""
    outgoing: list[Outgoing] = []
    """New messages."""
    delivered: list[int] = []
    """Numbers of the messages to remove."""
    next_seq: dict[str, int] = {}
    """The number of the next message, by receiver."""
    actions: dict[str, ActionInFlight] = {}
    """New actions, by id."""
    ended: list[str] = []
    """Ids of the actions to remove."""
    life: LifeRow | None = None


class LifeRow(NamedTuple):
    """What is different in each life of an agent: a row of the table, without its name."""

    numbering: str
    """The identity of its own numbering."""
    lives: int
    program: bytes
    """The digest of its program."""


class Checkpoint:
    """The file of a daemon, made by `open`. Any thread may save; saves are serialized."""

    def __init__(self, path: Path, synchronous: Synchronous) -> None:
        self.path = path
        self._file = SqliteFile(
            path,
            MIGRATIONS,
            synchronous,
            # one process only, and no file of shared memory
            (f"page_size={PAGE}", "locking_mode=EXCLUSIVE", f"cache_size=-{CACHE}"),
            APPLICATION,
        )
        self._synchronous = synchronous
        self._lock = threading.Lock()
        self._database: sqlite3.Connection | None = None
        self._soft = False
        self._numbers: dict[str, int] = {}
        """The numbers of the agents in the file."""
        self._used = 0
        """The highest number in the column of the same name."""

    @classmethod
    def open(cls, path: Path, synchronous: Synchronous = "FULL") -> Checkpoint:
        """Open a file, or make it; a corrupt one is renamed. Raises CheckpointError."""
        made = cls(path, synchronous)
        with _as_checkpoint_error(path, "opened"):
            make_private_folder(path.parent)
            made._opened(made._file.open_or_replace())
        return made

    @property
    def notes(self) -> list[Note]:
        """Damage of the file that was found."""
        notes = [Note(DAMAGED, f"{self.path}: {why}", "log") for why in self._file.damaged]
        for name, why in self._file.set_aside.items():
            text = f"{self.path} is corrupt ({why}) and was set aside as {name}: its agents start without it"
            notes.append(Note(DAMAGED, text, "file"))
        return notes

    def _opened(self, database: sqlite3.Connection) -> sqlite3.Connection:
        database.text_factory = lambda data: data.decode(errors="replace")  # the text of a damaged row
        self._database, self._soft = database, False
        self._look_up()
        return database

    def _look_up(self) -> None:
        """Read the numbers that rows refer to."""
        self._numbers = dict(self._rows("SELECT name, number FROM agent"))
        ((self._used,),) = self._rows("SELECT coalesce(max(used), 0) FROM absorbed")

    @property
    def agents(self) -> frozenset[str]:
        """The agents whose state is in the file."""
        return frozenset(self._numbers)

    def read(self) -> dict[str, AgentRows]:
        """Return the state of each agent that was ever saved. Raises CheckpointError."""
        with self._lock, _as_checkpoint_error(self.path, "read"):
            lives = list(self._rows("SELECT number, name, numbering, lives, program FROM agent ORDER BY name"))
            found = {number: AgentRows(life=LifeRow(*life)) for number, _, *life in lives}
            for n, rank, entry in self._rows("SELECT * FROM belief ORDER BY 1, 2"):
                found[n].mind.beliefs.append((rank, entry))
            for n, number, signature in self._rows("SELECT * FROM predicate ORDER BY 1, 2"):
                found[n].mind.predicates.append((number, signature))
            for n, rank, entry in self._rows("SELECT * FROM plan ORDER BY 1, 2"):
                found[n].mind.plans.append((rank, entry))
            for n, queued, number, origin, event in self._rows("SELECT * FROM pending ORDER BY 1, 2, 3"):
                found[n].mind.pending.append(((queued, number), origin, event))
            for n, name, value in self._rows("SELECT * FROM value"):
                found[n].mind.values[name] = value
            for n, sender, numbering, seq in self._rows("SELECT agent, sender, numbering, seq FROM absorbed"):
                found[n].absorbed[sender, numbering] = seq
            for n, *row in self._rows("SELECT * FROM incoming ORDER BY 1, 2"):
                found[n].incoming.append(tuple(row))
            for n, *row in self._rows("SELECT * FROM outgoing ORDER BY 1, 2"):
                found[n].outgoing.append(Outgoing(*row))
            for n, name, next_seq in self._rows("SELECT * FROM receiver"):
                found[n].next_seq[name] = next_seq
            for n, identity, *row in self._rows("SELECT * FROM action ORDER BY rowid"):
                found[n].actions[identity] = ActionInFlight(*row)
            return {name: found[number] for number, name, *_ in lives}

    def _rows(self, query: str) -> Iterator[Any]:
        assert self._database is not None
        return self._database.execute(query)

    def save(self, savings: Mapping[str, AgentRows], soft: bool = False) -> None:
        """Write the changes of agents, by name: all of it or nothing. Raises CheckpointError; then save it again.

        It is on disk when this returns. If `soft` it survives the end of the process only, not a power cut: nobody else
        has heard of it.
        """
        with self._transaction(soft) as database:
            self._write(database, savings)

    @contextmanager
    def _transaction(self, soft: bool = False) -> Iterator[sqlite3.Connection]:
        with self._lock, _as_checkpoint_error(self.path, "written"):
            database = self._database or self._opened(self._file.open())
            if soft != self._soft:
                database.execute(f"PRAGMA synchronous={'NORMAL' if soft else self._synchronous}")
                self._soft = soft
            try:
                database.execute("BEGIN IMMEDIATE")
                yield database
                database.execute("COMMIT")
            except BaseException:
                self._undo()
                raise

    def shorten_log(self) -> None:
        """Move a long log into the database; errors are left to the next save."""
        with self._lock:
            if self._database is not None:
                self._file.shorten_log(self._database)

    def _write(self, database: sqlite3.Connection, savings: Mapping[str, AgentRows]) -> None:
        """Execute each statement once, with the rows of all agents."""
        for name in savings:
            if name not in self._numbers:
                (number,) = database.execute("INSERT INTO agent (name) VALUES (?) RETURNING number", (name,)).fetchone()
                self._numbers[name] = number
        each = [(self._numbers[name], saving) for name, saving in savings.items()]
        minds = [(n, saving.mind) for n, saving in each]
        absorbed = [(n, *whose, seq) for n, s in each for whose, seq in s.absorbed.items()]
        self._used += bool(absorbed)
        for statement, rows in (
            (_REMOVE["belief"], [(n, rank) for n, m in minds for rank in m.beliefs_gone]),
            (_PUT["belief"], [(n, *row) for n, m in minds for row in m.beliefs]),
            (_PUT["predicate"], [(n, *row) for n, m in minds for row in m.predicates]),
            (_REMOVE["plan"], [(n, rank) for n, m in minds for rank in m.plans_gone]),
            (_PUT["plan"], [(n, *row) for n, m in minds for row in m.plans]),
            (_REMOVE["pending"], [(n, *key) for n, m in minds for key in m.pending_gone]),
            (_PUT["pending"], [(n, *key, int(origin), event) for n, m in minds for key, origin, event in m.pending]),
            (_PUT["value"], [(n, *row) for n, m in minds for row in m.values.items()]),
            (_PUT["incoming"], [(n, *row) for n, s in each for row in s.incoming]),
            (_REMOVE["incoming"], [(n, number) for n, s in each for number in s.taken]),
            (_PUT["outgoing"], [(n, *row) for n, s in each for row in s.outgoing]),
            (_REMOVE["outgoing"], [(n, number) for n, s in each for number in s.delivered]),
            (_PUT["receiver"], [(n, *row) for n, s in each for row in s.next_seq.items()]),
            (_PUT["action"], [(n, i, *a) for n, s in each for i, a in s.actions.items()]),
            (_REMOVE["action"], [(n, identity) for n, s in each for identity in s.ended]),
            (_LIFE, [(*s.life, n) for n, s in each if s.life is not None]),
            (_PUT_ABSORBED, [(*row, self._used) for row in absorbed]),
            (_PRUNE_ABSORBED, [(*one, *one, NUMBERINGS) for one in {(n, sender) for n, sender, *_ in absorbed}]),
        ):
            if rows:  # a statement without rows takes time too, while an action waits
                database.executemany(statement, rows)

    def _undo(self) -> None:
        """Roll back a transaction that failed; if that fails too, the next save opens the file again."""
        assert self._database is not None
        try:
            self._file.roll_back(self._database)
            self._look_up()
        except (sqlite3.Error, OSError):
            database, self._database = self._database, None
            with suppress(sqlite3.Error):
                database.close()

    def forget(self, agents: Iterable[str]) -> None:
        """Remove the state of agents. Raises CheckpointError."""
        with self._transaction() as database:
            rows = [(self._numbers.pop(name),) for name in agents if name in self._numbers]
            for table in TABLES:
                database.executemany(f"DELETE FROM {table} WHERE agent = ?", rows)  # noqa: S608
            database.executemany("DELETE FROM agent WHERE number = ?", rows)

    def close(self) -> None:
        """Close the file and keep it; one without agents is removed. Raises CheckpointError."""
        with self._lock, _as_checkpoint_error(self.path, "closed"):
            database, self._database = self._database, None
            if database is not None:
                self._file.close(database)
        if database is not None and not self._numbers:
            remove(self.path)


_LIFE: Final = "UPDATE agent SET numbering = ?, lives = ?, program = ? WHERE number = ?"
_PUT_ABSORBED: Final = """
    INSERT INTO absorbed VALUES (?, ?, ?, ?, ?) ON CONFLICT (agent, sender, numbering)
    DO UPDATE SET seq = max(seq, excluded.seq), used = excluded.used
"""
_PRUNE_ABSORBED: Final = """
    DELETE FROM absorbed WHERE agent = ? AND sender = ? AND numbering IN
    (SELECT numbering FROM absorbed WHERE agent = ? AND sender = ? ORDER BY used DESC LIMIT -1 OFFSET ?)
"""
"""Keeps of each sender the `NUMBERINGS` that were used last."""


# --- the database file ---


@contextmanager
def _as_checkpoint_error(path: Path, what: str) -> Iterator[None]:
    """Turn an error of the disk or the database into a CheckpointError; `what` is the participle of its text."""
    try:
        yield
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
        locked = code_of(error) in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
        why = "another process has it open" if locked else str(error)
        raise CheckpointError(f"{path} cannot be {what}: {why}") from error


def remove(path: Path) -> None:
    """Remove a file, if there is one, without reading it. Raises CheckpointError."""
    with _as_checkpoint_error(path, "removed"):
        for ending in _ENDINGS:
            path.with_name(path.name + ending).unlink(missing_ok=True)
