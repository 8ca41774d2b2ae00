"""What a board's files lose when its power fails: what was not synced, from a drawn point on.

A file keeps at least as much as was synced last; of what was appended since, a drawn part remains, which may end within
a record. SQLite syncs its log at each commit with `synchronous=FULL`, and when the log is moved into the file; with
`NORMAL` the commits of the last seconds may be lost, and the file stays whole. (A process that is killed loses nothing
that it has written: the kernel has it. Not modelled are lost renames, and blocks that are written out of order.)
"""

from __future__ import annotations

import os
import random
import sqlite3
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

WRITTEN_BACK: Final = 35.0
"""Seconds after which the kernel has written what nobody has synced (vm.dirty_expire_centisecs, and its period)."""
_synced: dict[str, int] = {}
"""Bytes of each file that are on the disk for certain."""
_written: dict[str, deque[tuple[float, int]]] = {}
"""When a file that is not synced had how many bytes."""
_databases: set[str] = set()
"""SQLite changes them by moving its log into them, and syncs them then."""
_KEEP = ("-shm", ".lock")
"""Endings of files whose content does not matter."""
_replace = os.replace


def synced(file: int) -> None:
    """Note that a file, named by its descriptor, is synced."""
    _note(os.readlink(f"/proc/self/fd/{file}"), True)


def replaced(old: Any, new: Any) -> None:
    """Rename a file: what is synced of it stays so. Raises OSError."""
    _replace(old, new)
    before, after = os.path.abspath(old), os.path.abspath(new)
    _forget(after)
    for noted in (_synced, _written):
        if before in noted:
            noted[after] = noted.pop(before)  # type: ignore[assignment]


def _forget(path: str) -> None:
    _synced.pop(path, None)
    _written.pop(path, None)


def _note(path: str, synced: bool) -> None:
    """Note how many bytes a file has, if it is there."""
    with suppress(FileNotFoundError):
        written, now = _written.setdefault(path, deque()), time.monotonic()
        written.append((now, os.stat(path).st_size))
        while written and (synced or written[0][0] < now - WRITTEN_BACK):
            _synced[path] = written.popleft()[1]


class Disk(sqlite3.Connection):
    """A database on the disk of a board: while that is full, no change is committed."""

    path = ""
    full: Callable[[], bool] = staticmethod(lambda: False)
    _before = 0
    """Changes before the present transaction."""
    _syncs = True
    """Whether each commit is synced."""

    def at(self, path: Path) -> None:
        """Note where it is."""
        self.path = os.path.abspath(path)
        _databases.add(self.path)

    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        """Execute a statement. Raises OperationalError (full) for a COMMIT of changes on a full disk."""
        moved = False
        if sql.startswith("BEGIN"):
            self._before = self.total_changes
        elif sql == "COMMIT" and self.total_changes != self._before and self.full():
            error = sqlite3.OperationalError("database or disk is full")
            error.sqlite_errorcode, error.sqlite_errorname = sqlite3.SQLITE_FULL, "SQLITE_FULL"
            raise error
        elif sql.startswith("PRAGMA"):
            moved = "wal_checkpoint" in sql
            if "synchronous" in sql:
                self._syncs = sql.upper().endswith("FULL")
                sql = "PRAGMA synchronous=OFF"  # to note it is enough
        done = super().execute(sql, parameters)
        if sql == "COMMIT" or moved:
            _note(f"{self.path}-wal", self._syncs or moved)
        return done

    def close(self) -> None:
        """Close it: SQLite moves the log into the file, and removes it if nobody else has it open."""
        super().close()
        if not os.path.exists(f"{self.path}-wal"):
            _forget(f"{self.path}-wal")


def lose_power(folder: Path, names: Iterable[str], dice: random.Random) -> None:
    """Take from the files of a board what is not synced; `names` are its own and those of its robots and agents."""
    for name in sorted(set(names)):
        for path in sorted((*folder.glob(f"*/{name}.*"), *folder.glob(f"*/{name}/*"))):
            file = os.path.abspath(path)
            if file in _databases or path.name.endswith(_KEEP) or not path.is_file():
                continue
            _note(file, False)
            there = os.path.getsize(file)
            least = min(_synced.get(file, 0), there)
            if least < there:
                os.truncate(file, dice.randint(least, there))
