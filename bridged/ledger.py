"""The action ids of the last hour, on disk: an id is executed once, whatever happens to the bridge in between."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import msgspec

from schemas.codec import BadRecord, codec
from schemas.records import ActionStatus

KEEP = 3600.0
"""Wall seconds for which an id is remembered."""
MAX_ENTRIES = 20_000
"""Ids remembered at most; the oldest goes first. An hour of five actions a second."""
REWRITE_AT = 4 * 1024 * 1024
"""Bytes of the file at which what is older than an hour is left out of it."""
_LEASE = ""
"""In the place of an id: the line tells who has the robot."""
log = logging.getLogger("ledger")


class Entry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line of the file: an id that was begun, and later how it ended."""

    id: str
    at: float
    """Unix time in seconds."""
    final: str = ""
    """The final status as JSON; empty = begun."""
    holder: str = ""
    """Of the one line without an id: which agent answers for the robot."""
    free: bool = False
    """Whether any other agent may take it."""


class Ledger:
    """Append-only file of ids; a line that was cut off by a power loss is left out when it is read.

    What is written outlives the process at once. The disk is told to keep it through a power loss by a thread, of which
    at most one sync runs and one waits: a slow card must not hold up heartbeats.
    """

    def __init__(self, path: Path, wall: Callable[[], float] = time.time) -> None:
        """Open the file, or make it with its directory. Raises OSError."""
        self.path = path
        self._wall = wall
        self._entries: dict[str, Entry] = {}
        self._syncer = ThreadPoolExecutor(1, thread_name_prefix="ledger")
        self._sync: Future[None] | None = None
        path.parent.mkdir(parents=True, exist_ok=True)
        self._read()
        self._rewrite()

    def begin(self, action: str) -> None:
        """Note that an id is about to be executed; it outlives this process when this returns. Raises OSError."""
        self._append(Entry(action, self._wall()), sync=True)

    def finish(self, status: ActionStatus) -> None:
        """Note how an id ended. Raises OSError."""
        self._append(Entry(status.id, self._wall(), codec(ActionStatus).encode(status).decode()), sync=False)

    def knows(self, action: str) -> bool:
        """Whether the id was begun within the last hour."""
        return action in self._entries

    def final(self, action: str) -> ActionStatus | None:
        """Return how an id ended, None if it was begun and its end is not known."""
        entry = self._entries.get(action)
        if entry is None or not entry.final:
            return None
        try:
            return codec(ActionStatus).decode(entry.final.encode())
        except BadRecord:
            return None

    def hold(self, agent: str, free: bool) -> None:
        """Note which agent answers for the robot from now on, and whether another may take it. Raises OSError."""
        self._append(Entry(_LEASE, self._wall(), holder=agent, free=free), sync=False)

    def held(self) -> tuple[str, bool]:
        """Return what was noted by `hold`; if that is older than an hour, whose action was begun last."""
        if lease := self._entries.get(_LEASE):
            return lease.holder, lease.free
        for action in reversed(self._entries):
            final = self.final(action)
            if final is None or final.state != "refused":
                return action.partition(":")[0], False
        return "", False

    def close(self) -> None:
        """Close the file; a sync under way ends by itself."""
        self._syncer.shutdown(wait=False)
        self._file.close()

    def _append(self, entry: Entry, *, sync: bool) -> None:
        self._remember(entry)
        self._file.write(msgspec.json.encode(entry) + b"\n")
        self._file.flush()
        if sync:
            self._keep_through_power_loss()
        if self._file.tell() > REWRITE_AT:
            before = self._file
            self._rewrite()
            before.close()

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

    def _rewrite(self) -> None:
        """Write what is remembered into a new file and put it in the place of the old one, which stays on an error."""
        fresh = self.path.with_suffix(".new")
        with fresh.open("wb") as file:
            for entry in self._entries.values():
                file.write(msgspec.json.encode(entry) + b"\n")
            file.flush()
            os.fsync(file.fileno())
        now = fresh.open("ab")
        fresh.replace(self.path)
        self._file, self._sync = now, None


def _sync(file: int) -> None:
    """Sync a descriptor of our own, which outlives the file being closed or replaced meanwhile, and close it."""
    try:
        os.fsync(file)
    except OSError as error:
        log.error("action ids may not outlive a power loss: %s", error.strerror)
    finally:
        os.close(file)
