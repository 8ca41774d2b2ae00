"""The action ids of the last hour, on disk: an id is executed once, whatever happens to the bridge in between."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import msgspec

from schemas.records import FINAL_STATES, Action, ActionStatus, Header, State

KEEP = 3600.0
"""Wall seconds for which an id is remembered."""
MAX_ENTRIES = 20_000
"""Ids remembered at most; the oldest goes first. An hour of five actions a second."""
REWRITE_AT = 4 * 1024 * 1024
"""Bytes of the file below which it is not worth leaving out what is older than an hour; then it is when the file has
doubled."""
_LEASE = ""
"""In the place of an id: the line tells who has the robot."""
log = logging.getLogger("ledger")


class Entry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line of the file: an id that was begun, and later how it ended."""

    id: str
    at: float
    """Unix time in seconds."""
    agent: str = ""
    name: str = ""
    """Of the action that the id was used for."""
    state: State = "accepted"
    """`accepted` = begun; else how it ended."""
    reason: str = ""
    after: int | None = None
    """Seq of the last percept before its end, in the life of the bridge that `boot` names."""
    boot: str = ""
    holder: str = ""
    """Of the one line without an id: which agent answers for the robot."""
    free: bool = False
    """Whether any other agent may take it."""

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
            reason=self.reason,
            after=self.after,
            name=self.name,
        )


class Ledger:
    """Append-only file of ids; a line that was cut off by a power loss is left out when it is read.

    What is written outlives the process at once. The disk is told to keep it through a power loss by a thread, of which
    at most one sync runs and one waits: a slow card must not hold up heartbeats. It leaves out what is old, too.
    """

    def __init__(self, path: Path, wall: Callable[[], float] = time.time) -> None:
        """Open the file, or make it with its directory. Raises OSError."""
        self.path = path
        self._wall = wall
        self._entries: dict[str, Entry] = {}
        self._syncer = ThreadPoolExecutor(1, thread_name_prefix="ledger")
        self._sync: Future[None] | None = None
        self._unsynced = False
        """An id was begun since a sync was asked for."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._read()
        self._fresh = path.with_suffix(".new")
        _write(self._fresh, list(self._entries.values()))
        self._fresh.replace(path)
        self._file = path.open("ab")
        self._rewriting: Future[None] | None = None
        self._copied = 0
        """Bytes of the file that a rewriting under way covers."""
        self._rewrite_at = max(REWRITE_AT, 2 * self._file.tell())

    def begin(self, action: Action) -> None:
        """Note that an id is about to be executed; it outlives this process when this returns. Raises OSError.

        `keep` is to be called soon.
        """
        self._unsynced = True
        self._append(Entry(action.id, self._wall(), action.agent, action.name))

    def keep(self) -> None:
        """Let what was noted outlive a power loss too, soon. Raises OSError."""
        if self._unsynced:
            self._unsynced = False
            self._keep_through_power_loss()

    def finish(self, agent: str, status: ActionStatus) -> None:
        """Note how an id of an agent ended: no more of it than whoever asks again must know. Raises OSError."""
        entry = Entry(
            status.id,
            self._wall(),
            agent,
            status.name,
            status.state,
            status.reason,
            status.after,
            status.header.boot,
        )
        self._append(entry)

    def find(self, action: str) -> Entry | None:
        """Return what is known of an id, None if it was not begun within the last hour."""
        return self._entries.get(action) if action else None

    def hold(self, agent: str, free: bool) -> None:
        """Note which agent answers for the robot from now on, and whether another may take it. Raises OSError."""
        self._append(Entry(_LEASE, self._wall(), holder=agent, free=free))

    def held(self) -> tuple[str, bool]:
        """Return what was noted by `hold`; if that is older than an hour, whose action was begun last."""
        if lease := self._entries.get(_LEASE):
            return lease.holder, lease.free
        for entry in reversed(self._entries.values()):
            if entry.state != "refused":
                return entry.agent, False
        return "", False

    def close(self) -> None:
        """Close the file; a sync under way ends by itself."""
        self._syncer.shutdown(wait=False)
        self._file.close()

    def _append(self, entry: Entry) -> None:
        self._remember(entry)
        self._file.write(msgspec.json.encode(entry) + b"\n")
        self._file.flush()
        if self._rewriting is None and self._file.tell() > self._rewrite_at:
            self._copied = self._file.tell()
            self._rewriting = self._syncer.submit(_write, self._fresh, list(self._entries.values()))
        elif self._rewriting is not None and self._rewriting.done():
            self._replace(self._rewriting)
            self._rewriting = None

    def _keep_through_power_loss(self) -> None:
        """Sync what has been written, unless a sync that has not begun yet will do that."""
        waits = self._sync is not None and not self._sync.running() and not self._sync.done()
        if not waits:
            self._sync = self._syncer.submit(_sync, os.dup(self._file.fileno()))

    def _remember(self, entry: Entry) -> None:
        self._entries.pop(entry.id, None)
        self._entries[entry.id] = entry
        oldest = self._wall() - KEEP
        while self._entries:
            first = next(iter(self._entries.values()))
            if first.at >= oldest and len(self._entries) <= MAX_ENTRIES:
                break
            del self._entries[first.id]

    def _read(self) -> None:
        try:
            lines = self.path.read_bytes().split(b"\n")
        except FileNotFoundError:
            return
        for line in lines:
            try:
                self._remember(msgspec.json.decode(line, type=Entry))
            except (msgspec.MsgspecError, UnicodeDecodeError):
                continue

    def _replace(self, rewriting: Future[None]) -> None:
        """Put the new file, with what was noted meanwhile, in the place of the old one, which stays on an error."""
        before = self._file
        try:
            rewriting.result()
            with self.path.open("rb") as old:
                old.seek(self._copied)
                meanwhile = old.read()
            file = self._fresh.open("ab")
            file.write(meanwhile)
            file.flush()
            self._fresh.replace(self.path)
        except OSError as error:
            log.error("%s cannot be made smaller: %s", self.path, error.strerror)
        else:
            before.close()
            self._file, self._sync = file, None
            self._keep_through_power_loss()
        self._rewrite_at = max(REWRITE_AT, 2 * self._file.tell())


def _write(path: Path, entries: list[Entry]) -> None:
    """Write a new file."""
    with path.open("wb") as file:
        for entry in entries:
            file.write(msgspec.json.encode(entry) + b"\n")
        file.flush()
        os.fsync(file.fileno())


def _sync(file: int) -> None:
    """Sync a descriptor of our own, which outlives the file being closed or replaced meanwhile, and close it."""
    try:
        os.fsync(file)
    except OSError as error:
        log.error("action ids may not outlive a power loss: %s", error.strerror)
    finally:
        os.close(file)
