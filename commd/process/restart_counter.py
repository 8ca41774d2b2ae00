"""How often a daemon was started again: a note on disk that a life opens, and closes if it ends as it was told to.

What was killed, or ended by an error, leaves its note open: the next life counts it. A machine that started anew begins
at nought. A life begins when the daemon has joined the bus; one that fails before is for its supervisor to count.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec

from commd.process.state_dir import make_private_file, make_private_folder

log = logging.getLogger("lives")

_BOOT = Path("/proc/sys/kernel/random/boot_id")
MUTE = "its former life ended without a word: killed, or out of memory"
_open: list[RestartCounter] = []


class _Note(msgspec.Struct, omit_defaults=True):
    machine: str = ""
    """Which life of the machine."""
    restarts: int = 0
    running: bool = False
    words: str = ""
    """By what it failed."""


class RestartCounter:
    """A life of a daemon; `restarts` of None: how many were before it is not known."""

    def __init__(self, path: Path, machine: str | None = None) -> None:
        self.restarts: int | None = None
        """Lives before this one, since the machine started, that did not end as they were told to."""
        self.before = ""
        """How the life before ended, in words, if nobody had told it to."""
        self._path = path
        self._note = _Note(machine_life() if machine is None else machine, running=True)
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
        """Note how it ends: as it was told to, or in words by what it failed."""
        self._note.running, self._note.words = bool(words), words
        try:
            self._write()
        except OSError as error:
            log.warning("how this ends is not noted: %s: %s", self._path, error.strerror)

    def _former(self) -> _Note | None:
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=_Note)
        except FileNotFoundError:
            return None
        except msgspec.MsgspecError as error:
            log.warning("restarts are counted anew: %s is not readable: %s", self._path, error)
            return None

    def _write(self) -> None:
        """Write the note whole or not at all. It is not forced to the disk: without power nothing is counted anyway."""
        new = self._path.with_name(f".{self._path.name}.new")
        make_private_file(new)
        new.write_bytes(msgspec.json.encode(self._note))
        os.replace(new, self._path)


def begin_life(folder: Path, daemon: str, name: str) -> tuple[int | None, str]:
    """Note in `folder` that a daemon, which has just claimed its name, runs; `end_lives` notes its end.

    Returns how often it was restarted after a failure since the machine started (None: not known), and how the process
    before it failed, if it did.
    """
    life = RestartCounter(folder / f"{name}.{daemon}.life")
    if life.before:
        log.warning("restarts=%s %s", life.restarts, life.before)
    _open.append(life)
    return life.restarts, life.before


def end_lives(words: str = "") -> None:
    """End the lives that began in this process: as told, or in words by what they failed."""
    while _open:
        _open.pop().end(words)


def machine_life() -> str:
    """Return which life of the machine this is, as its unit says, which may not see it itself; nothing if unknown."""
    if told := os.environ.get("ARGOSY_BOOT"):
        return told
    try:
        return _BOOT.read_text().strip()
    except OSError:
        return ""
