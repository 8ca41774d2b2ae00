"""The action log on disk: ids of the last hour, the holder of the robot, the operator's order.

A new bridge continues by it: an id is executed once, also if the bridge is killed in between. The log is a file of
lines: SQLite takes 1.5 MB of a bridge's memory, and syncs in the thread that sends heartbeats.
"""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from errno import ENOSPC
from io import FileIO
from pathlib import Path
from zlib import crc32

import msgspec
from msgspec.structs import replace

from bridged.drivers.api import Order
from commd.process.state_dir import make_private_file, make_private_folder
from schemas.files.text_files import DISK_FAILS
from schemas.wire.records import FINAL_STATES, Action, ActionStatus, Cause, Header, Note, State

KEEP = 3600.0
"""Wall seconds for which an id is remembered."""
LAST = 100
"""Ids remembered however old: the clock of a board without a battery is set forward after its start."""
MAX_ENTRIES = 20_000
"""Ids remembered at most; the oldest goes first. An hour of five actions a second."""
REWRITE_AT = 4 * 1024 * 1024
"""Bytes of the file below which it is not worth leaving out what is older than an hour; then it is when the file has
doubled."""
TRY_AGAIN = 1.0
"""Wall seconds between two attempts to write a file that could not be written."""
_STANDING = ""
"""The id of lines that say who has the robot, agent and operator. The last such line counts."""
NOT_SYNCED = "action ids may not outlive a power loss: %s"
log = logging.getLogger("action_log")


class Entry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line of the file: an id that was begun, and later how it ended."""

    id: str
    at: float
    """Unix time in seconds."""
    agent: str = ""
    name: str = ""
    """Name of the action."""
    state: State = "accepted"
    """`accepted` = begun; else how it ended."""
    cause: Cause | None = None
    reason: str = ""
    after: int | None = None
    """Seq of the last percept before its end, of the run of the bridge that `boot` names."""
    boot: str = ""
    """Boot of the bridge."""
    holder: str = ""
    """Of a line without an id: which agent answers for the robot, since `at`."""
    free: bool = False
    """Whether any other agent may take it."""
    order: Order | None = None
    """The operator's order until `release`; in a line with an id: the order that overrode it."""
    paused: bool = False
    """Whether the operator has paused the robot."""

    @property
    def final(self) -> ActionStatus | None:
        """How it ended, None if it was begun and its end is not known."""
        if self.state not in FINAL_STATES:
            return None
        return ActionStatus(
            header=Header(boot=self.boot),
            id=self.id,
            state=self.state,
            result=self.state == "succeeded",
            cause=self.cause,
            order=self.order,
            reason=self.reason,
            after=self.after,
            name=self.name,
        )


_NOBODY = Entry(_STANDING, 0.0)


class ActionLog:
    """Append-only file of ids; a line that a power loss cut off is skipped when the file is read.

    A line outlives the process when it is written. A thread syncs it for power losses, at most one sync running and one
    waiting: a slow card must not delay heartbeats. The thread also rewrites the file without old lines.

    While its disk is full or broken, everything is in memory alone: that is logged, `begin` raises OSError, and `step`
    rewrites the file when that is possible again.
    """

    def __init__(self, path: Path, wall: Callable[[], float] = time.time) -> None:
        """Open the file, or make it with its directory.

        Raises OSError, but not for a disk that is full or broken: a robot is not left alone for that.
        """
        self.path = path
        self._damaged: Note | None = None
        """What was wrong with the file at the start."""
        self._failure: OSError | None = None
        """Why the file cannot be written now."""
        self._wall = wall
        self._standing = _NOBODY
        """Who has the robot."""
        self.entries: dict[str, Entry] = {}
        """The record of each id that was begun within the last hour, or is one of the `LAST`."""
        self._syncer = ThreadPoolExecutor(1, thread_name_prefix="action-log")
        self._sync: Future[None] | None = None
        self._unsynced = False
        """Something was written since a sync was asked for."""
        self._fresh = path.with_suffix(".new")
        self._file: FileIO | None = None
        """None while it cannot be written."""
        self._rewriting: Future[None] | None = None
        self._meanwhile: list[Entry] = []
        """Entries made since a rewriting that is under way began."""
        self._rewrite_at = REWRITE_AT
        self._try_at = -math.inf
        try:
            self._read()
            _write(self._fresh, self._kept())
            self._take_over()
        except OSError as error:
            if error.errno not in DISK_FAILS:
                raise
            self._failed(error)

    @property
    def damaged(self) -> bool:
        """Whether the file could not be read as a whole: who had the robot may be forgotten."""
        return self._damaged is not None

    def notes(self) -> list[Note]:
        """Return the warnings that hold now."""
        failing = None
        if self._failure is not None:
            text = (
                f"{self.path} cannot be written: {self._failure.strerror}; ids of actions, who has the robot and the"
                " operator's order are in memory alone, and only actions that bring the robot down are accepted"
            )
            failing = Note("ledger_failing", text)
        return [note for note in (self._damaged, failing) if note is not None]

    def step(self, now: float) -> None:
        """Let time pass: write a file that could not be written again. `now` in wall seconds."""
        if self._rewriting is not None:
            if self._rewriting.done():
                self._replace(self._rewriting)
        elif self._file is None and now >= self._try_at:
            self._try_at = now + TRY_AGAIN
            self._rewrite()

    def begin(self, action: Action) -> None:
        """Record that an id is about to be executed; the record outlives this process. Raises OSError.

        `keep` is to be called soon.
        """
        self._append(Entry(action.id, self._wall(), action.agent, action.name))

    def keep(self) -> None:
        """Sync soon what has been written, so that it outlives a power loss."""
        if self._unsynced:
            self._unsynced = False
            waits = self._sync is not None and not (self._sync.running() or self._sync.done())  # one that will do that
            try:
                if self._file is not None and not waits:
                    self._sync = self._syncer.submit(_sync, os.dup(self._file.fileno()))
            except OSError as error:
                log.error(NOT_SYNCED, error.strerror)

    def finish(self, agent: str, status: ActionStatus) -> None:
        """Record how an id ended, as much as the answer to a repeated request needs, and sync it.

        Lost in a power failure, it would be answered in another way: that the bridge was restarted.
        """
        entry = Entry(
            status.id,
            self._wall(),
            agent,
            status.name,
            status.state,
            status.cause,
            status.reason,
            status.after,
            status.header.boot,
            order=status.order,
        )
        self._record(entry, f"how {status.id} ended")
        self.keep()

    def hold(self, agent: str, free: bool) -> None:
        """Record which agent answers for the robot, and whether another may take it."""
        standing = replace(self._standing, at=self._wall(), holder=agent, free=free)
        self._record(standing, "who has it")

    def held(self) -> tuple[str, bool]:
        """Return what `hold` recorded last, else the agent whose action was begun last.

        However old it is: a wall clock may be wrong, and a robot that is left ends the lease when it is heard.
        """
        if self._standing.at:
            return self._standing.holder, self._standing.free
        begun = (one.agent for one in reversed(self.entries.values()) if one.state != "refused")
        return next(begun, ""), False

    @property
    def ordered(self) -> Order | None:
        """The operator's order until `release`, of this run of the bridge or one before, however old."""
        return self._standing.order

    @property
    def paused(self) -> bool:
        """Whether the operator has paused the robot, in this run of the bridge or one before."""
        return self._standing.paused

    def order(self, order: Order | None) -> None:
        """Record the operator's order, None = none: it outlives a bridge that is killed."""
        if order != self.ordered:
            self._record(replace(self._standing, order=order), "the operator's order")
            self.keep()

    def pause(self, paused: bool) -> None:
        """Record whether the operator has paused the robot."""
        if paused != self.paused:
            self._record(replace(self._standing, paused=paused), "the operator's pause")
            self.keep()

    def close(self) -> None:
        """Close the file; a sync under way ends by itself."""
        self._syncer.shutdown(wait=False)
        if self._file is None:
            log.error("robot=%s %s ends without what could not be written", self.path.stem, self.path)
        else:
            self._file.close()

    def _record(self, entry: Entry, what: str) -> None:
        """Append an entry, `what` for people; if the disk fails it is kept in memory, and that is logged."""
        try:
            self._append(entry)
        except OSError as error:
            log.error("robot=%s %s cannot be kept on disk: %s", self.path.stem, what, error.strerror)

    def _append(self, entry: Entry) -> None:
        self._remember(entry)
        if self._rewriting is not None:
            self._meanwhile.append(entry)
        if self._failure is not None:
            raise OSError(*self._failure.args)
        assert self._file is not None
        try:
            _add(self._file, [entry])
        except OSError as error:
            self._failed(error)
            raise
        self._unsynced = True
        if self._rewriting is None and self._file.tell() > self._rewrite_at:
            self._rewrite()
        elif self._rewriting is not None and self._rewriting.done():
            self._replace(self._rewriting)

    def _rewrite(self) -> None:
        """Have the thread write a new file of what is to be kept."""
        self._meanwhile = []
        self._rewriting = self._syncer.submit(_write, self._fresh, self._kept())

    def _failed(self, error: OSError) -> None:
        """Go on without the file, which may end in half a line: it is rewritten when that is possible."""
        if self._failure is None:
            log.error("robot=%s %s cannot be written: %s", self.path.stem, self.path, error.strerror)
        if self._file is not None:
            self._file.close()
        self._file, self._failure = None, error

    def _kept(self) -> list[Entry]:
        return [*self.entries.values(), *([] if self._standing == _NOBODY else [self._standing])]

    def _remember(self, entry: Entry) -> None:
        if entry.id == _STANDING:
            self._standing = entry
            return
        self.entries.pop(entry.id, None)
        self.entries[entry.id] = entry
        oldest = self._wall() - KEEP
        while len(self.entries) > LAST:
            first = next(iter(self.entries.values()))
            if first.at >= oldest and len(self.entries) <= MAX_ENTRIES:
                break
            del self.entries[first.id]

    def _read(self) -> None:
        try:
            lines = self.path.read_bytes().split(b"\n")
        except FileNotFoundError:
            return
        except OSError as error:
            if error.errno not in DISK_FAILS:
                raise
            self._is_damaged(f"it cannot be read ({error.strerror})", None)
            return
        damaged = 0
        for line in filter(None, lines):
            try:
                self._remember(decoded(line))
            except (ValueError, msgspec.MsgspecError):
                damaged += 1
        if damaged:
            self._is_damaged(f"{damaged} lines are damaged, or were cut off by a power failure", damaged)

    def _is_damaged(self, what: str, lines: float | None) -> None:
        text = (
            f"{self.path}: {what}: an action that is asked for again may be done twice, and an order of the operator"
            " may be forgotten"
        )
        self._damaged = Note("ledger_damaged", text, value=lines)
        log.error("ledger_damaged %s", text)

    def _replace(self, rewriting: Future[None]) -> None:
        """Replace the old file by the new one with the records made meanwhile; on an error keep the old one."""
        self._rewriting = None
        try:
            rewriting.result()
            self._take_over()
        except OSError as error:
            if self._file is None:
                self._failure = error
            else:
                log.error("%s cannot be made smaller: %s", self.path, error.strerror)
                self._rewrite_at = max(REWRITE_AT, 2 * self._file.tell())
        else:
            self._sync, self._unsynced = None, True
            self.keep()

    def _take_over(self) -> None:
        """Go on with the new file, in the place of the old one. Raises OSError."""
        file = FileIO(self._fresh, "ab")
        try:
            _add(file, self._meanwhile)
            self._fresh.replace(self.path)
        except OSError:
            file.close()
            raise
        if self._file is not None:
            self._file.close()
        if self._failure is not None:
            log.warning("robot=%s %s can be written again", self.path.stem, self.path)
        self._file, self._failure = file, None
        self._rewrite_at = max(REWRITE_AT, 2 * file.tell())


def _add(file: FileIO, entries: list[Entry]) -> None:
    """Append entries, each as a line with its checksum. Raises OSError, also if the disk takes only a part."""
    lines = b"".join(b"%s %08x\n" % (data, crc32(data)) for data in map(msgspec.json.encode, entries))
    if file.write(lines) != len(lines):
        raise OSError(ENOSPC, os.strerror(ENOSPC))


def decoded(line: bytes) -> Entry:
    """Read a line. Raises ValueError for one that is damaged."""
    data, _, check = line.rpartition(b" ")
    if check != b"%08x" % crc32(data):
        raise ValueError("its checksum is wrong")
    return msgspec.json.decode(data, type=Entry)


def _write(path: Path, entries: list[Entry]) -> None:
    """Write a new file, in a folder that may be missing."""
    make_private_folder(path.parent)
    make_private_file(path)
    with FileIO(path, "wb") as file:
        _add(file, entries)
        os.fsync(file.fileno())


def _sync(file: int) -> None:
    """Sync a descriptor of our own, which outlives the file being closed or replaced meanwhile, and close it."""
    try:
        os.fsync(file)
    except OSError as error:
        log.error(NOT_SYNCED, error.strerror)
    finally:
        os.close(file)
