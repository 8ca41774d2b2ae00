"""What an agent was at when its process died: what it dies at several times in a row is set aside, and it goes on.

A turn of a mind is short. One that is not is looked at by a thread, which writes down what the mind has in hand: the
event of the intention that runs, and the message that it has taken last. If the process ends in that turn (a watchdog,
out of memory) the next life finds it. It costs a turn two notes in memory. A hang in C code that keeps the interpreter
to itself cannot be seen.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final
from weakref import WeakSet

import msgspec

log = logging.getLogger("keeping")

DEATHS: Final = 3
"""Lives in a row that end with the same in hand until it is set aside."""
LONG: Final = 1.0
"""Wall seconds after which what a turn has in hand is written down."""
LOOK: Final = 0.25
"""Wall seconds between two looks of the thread."""
FILE: Final = "in_hand.json"
"""In the agent's folder of state."""
KEPT: Final = "set_aside.jsonl"
"""Beside it: what was set aside, one `Held` each line."""


class Held(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a mind is at."""

    event: str = ""
    """The event of the outermost plan, as it is written."""
    mail: tuple[str, str, int] | None = None
    """Sender, numbering and number of a message that was taken and is not kept yet."""

    def is_same(self, other: Held | None) -> bool:
        """Whether both are the same work: a message that was not kept in one life may be in the next."""
        if other is None:
            return False
        return self.event == other.event if self.event else self.mail == other.mail


class _Note(msgspec.Struct, omit_defaults=True):
    held: Held | None = None
    """In hand now; what is found here at a start was so when the process died."""
    suspect: Held | None = None
    deaths: int = 0
    """Lives in a row that ended with the suspect in hand."""
    refused: list[tuple[str, str, int]] = []
    """Messages that were set aside: they are not taken when they come again."""


class PoisonInputs:
    """What one agent has in hand."""

    def __init__(self, folder: Path, look: Callable[[], Held]) -> None:
        """`look` says what the mind is at; it is called by another thread."""
        self._path, self.kept, self._look = folder / FILE, folder / KEPT, look
        self._since: float | None = None
        self._lock = threading.Lock()
        self._written = False
        self._note = self._read()
        self.poison: Held | None = None
        """What is to be set aside and has not come yet."""
        self.died_at: Held | None = None
        """What the last lives have died at."""
        if (held := self._note.held) is not None:
            self._note.deaths = self._note.deaths + 1 if held.is_same(self._note.suspect) else 1
            self._note.suspect, self._note.held = held, None
            log.warning("died_at what=%s deaths=%d", said(held), self._note.deaths)
            if self._note.deaths >= DEATHS:
                self.poison = self.died_at = held
                self._note.suspect, self._note.deaths = None, 0
            self._write()
        else:
            self._note.suspect, self._note.deaths = None, 0
        _watch(self)

    def is_set_aside(self, mail: tuple[str, str, int], event: Callable[[], str]) -> bool:
        """Whether a message is not to be taken: it was set aside, or brings what is to be (`event` says what it is)."""
        if self._note.refused and mail in self._note.refused:
            return True
        poison = self.poison
        if poison is None or (mail != poison.mail if not poison.event else event() != poison.event):
            return False
        self.poison = None  # the same may be asked for again
        with self._lock:
            self._note.refused.append(mail)
            self._write()
        return True

    def keep(self, what: Held) -> None:
        """Keep what is set aside, to be looked at."""
        try:
            with self.kept.open("ab") as file:
                file.write(msgspec.json.encode(what) + b"\n")
        except OSError as error:
            log.warning("not kept what=%s why=%s", said(what), error.strerror)

    def begin(self) -> None:
        """A turn begins."""
        self._since = time.monotonic()

    def end(self) -> None:
        """The turn has ended."""
        self._since = None
        if self._written:
            with self._lock:
                self._written, self._note.held = False, None
                self._write()

    def look(self, now: float) -> None:
        """On the thread: write down what a long turn has in hand."""
        since = self._since
        if since is None or now - since < LONG:
            return
        held = self._look()
        with self._lock:
            if self._since == since and held != self._note.held and held != Held():
                self._written, self._note.held = True, held
                self._write()

    def _read(self) -> _Note:
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=_Note)
        except FileNotFoundError:
            return _Note()
        except (OSError, msgspec.MsgspecError) as error:
            log.warning("what was in hand is not known: %s: %s", self._path, error)
            return _Note()

    def _write(self) -> None:
        """Not forced to the disk: it is for the death of the process, not for that of the board."""
        new = self._path.with_name(f".{FILE}.new")
        try:
            new.write_bytes(msgspec.json.encode(self._note))
            os.replace(new, self._path)
        except OSError as error:
            log.warning("what is in hand is not noted: %s: %s", self._path, error.strerror)


def said(held: Held) -> str:
    """Say what was in hand."""
    mail = "" if held.mail is None else f"message {held.mail[2]} of {held.mail[0]}"
    return held.event or mail


def _watch(one: PoisonInputs) -> None:
    _all.add(one)
    if len(_all) == 1 and not any(thread.name == _THREAD for thread in threading.enumerate()):
        threading.Thread(target=_look_around, name=_THREAD, daemon=True).start()


def _look_around() -> None:
    while True:
        time.sleep(LOOK)
        now = time.monotonic()
        for one in list(_all):
            try:
                one.look(now)
            except Exception as error:  # the mind goes on while it is looked at
                log.debug("not seen: %s", error)


_THREAD: Final = "in-hand"
_all: Final[WeakSet[PoisonInputs]] = WeakSet()
