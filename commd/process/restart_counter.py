"""Count a daemon's restarts after failures, by a note on disk that is open while it runs.

A process that was killed or failed leaves its note open, and the next one counts it. A boot of the machine resets the
count. The note is opened when the daemon has joined the bus; earlier failures are its supervisor's to count.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec

from commd.process.state_dir import make_private_folder, replace_file

log = logging.getLogger("restarts")

_BOOT = Path("/proc/sys/kernel/random/boot_id")
MUTE = "the process before it ended without a message: killed, or out of memory"
_open: list[RestartCounter] = []


class _Note(msgspec.Struct, omit_defaults=True):
    machine: str = ""
    """Boot of the machine."""
    restarts: int = 0
    running: bool = False
    words: str = ""
    """How it failed."""


class RestartCounter:
    """The note of one process of a daemon; `restarts` is None if it is not known."""

    def __init__(self, path: Path, machine: str | None = None) -> None:
        self.restarts: int | None = None
        """Failed processes before this one since the machine's boot."""
        self.before = ""
        """How the process before this one failed, if it did."""
        self._path = path
        self._note = _Note(machine_boot() if machine is None else machine, running=True)
        try:
            make_private_folder(path.parent)
            former = self._former()
            if former is not None and former.machine == self._note.machine:
                self._note.restarts = former.restarts + former.running
                if former.running:
                    self.before = former.words or MUTE
            self._write()
        except OSError as error:
            log.warning("restarts are not counted: %s: %s", path, error.strerror)
            return
        self.restarts = self._note.restarts

    def end(self, words: str = "") -> None:
        """Note the end; `words`: how it failed, empty = as ordered."""
        self._note.running, self._note.words = bool(words), words
        try:
            self._write()
        except OSError as error:
            log.warning("the end of this process cannot be recorded: %s: %s", self._path, error.strerror)

    def _former(self) -> _Note | None:
        try:
            note = self._path.read_bytes().strip(b"\0")
            # It is empty if the power failed before it reached the disk.
            return msgspec.json.decode(note, type=_Note) if note else None
        except FileNotFoundError:
            return None
        except msgspec.MsgspecError as error:
            log.warning("restarts are counted from 0: %s is not readable: %s", self._path, error)
            return None

    def _write(self) -> None:
        """Replace the note. It is not synced to disk: a power failure resets the count anyway."""
        replace_file(self._path, msgspec.json.encode(self._note), synced=False)


def note_start(folder: Path, daemon: str, name: str) -> tuple[int | None, str]:
    """Note in `folder` that a daemon runs, after it has claimed its name; `end_lives` notes its end.

    Returns its restarts after failures since the machine's boot (None: not known), and how the process before it
    failed, if it did.
    """
    counter = RestartCounter(folder / f"{name}.{daemon}.restarts")
    if counter.before:
        log.warning("restarts=%s %s", counter.restarts, counter.before)
    _open.append(counter)
    return counter.restarts, counter.before


def note_ends(words: str = "") -> None:
    """Note the end of all daemons of this process; `words`: how they failed, empty = as ordered."""
    while _open:
        _open.pop().end(words)


def machine_boot() -> str:
    """Return the machine's boot id, or ARGOSY_BOOT of its unit, which may hide it; empty if unknown."""
    if given := os.environ.get("ARGOSY_BOOT"):
        return given
    try:
        return _BOOT.read_text().strip()
    except OSError:
        return ""
