"""Poison inputs: an input at which the process of an agent ends several times in a row is set aside.

A turn of a mind is short. During a long one a thread writes down what the mind is working on: the event of the running
intention and the last message taken. If the process ends in that turn (a watchdog, out of memory), the next life finds
the note. A turn pays two assignments for this. A hang in C code that keeps the interpreter lock cannot be seen.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final
from weakref import WeakSet

import msgspec

from commd.process.state_dir import replace_file

log = logging.getLogger("keeping")

DEATHS: Final = 3
"""Lives in a row that end at the same work until it is set aside."""
LONG: Final = 1.0
"""Wall seconds of a turn after which its work is written down."""
LOOK: Final = 1.0
"""Wall seconds between two checks by the thread."""
FILE: Final = "in_hand.json"
"""In the agent's folder of state."""
KEPT: Final = "set_aside.jsonl"
"""Beside it: the work that was set aside, one `Held` per line."""


class Held(msgspec.Struct, frozen=True, omit_defaults=True):
    """The work of a mind at one moment."""

    event: str = ""
    """The event of the outermost plan, as text."""
    mail: tuple[str, str, int] | None = None
    """Sender, numbering and number of a message that was taken and is not saved yet."""

    def is_same(self, other: Held | None) -> bool:
        """Return whether both are the same work. The message counts without an event only: it may be saved by now."""
        if other is None:
            return False
        return self.event == other.event if self.event else self.mail == other.mail


class _Note(msgspec.Struct, omit_defaults=True):
    held: Held | None = None
    """The present work; at a start that of the process that ended."""
    suspect: Held | None = None
    deaths: int = 0
    """Lives in a row that ended at the suspect."""
    refused: list[tuple[str, str, int]] = []
    """Messages that were set aside: they are refused when they are offered again."""


class PoisonInputs:
    """The work of one agent, and the inputs that it skips."""

    def __init__(self, folder: Path, look: Callable[[], Held]) -> None:
        """`look` returns the present work; another thread calls it."""
        self._path, self.kept, self._look = folder / FILE, folder / KEPT, look
        self.since: float | None = None
        """When the present turn began, as `time.monotonic`; None between turns."""
        self.written = False
        """Whether its work is written down, so that `end` is to be called."""
        self._lock = threading.Lock()
        self._note = self._read()
        self.poison: Held | None = None
        """The work to set aside that has not come yet."""
        self.died_at: Held | None = None
        """The work at which the last lives have ended."""
        if (held := self._note.held) is not None:
            self._note.deaths = self._note.deaths + 1 if held.is_same(self._note.suspect) else 1
            self._note.suspect, self._note.held = held, None
            log.warning("died_at what=%s deaths=%d", text_of(held), self._note.deaths)
            if self._note.deaths >= DEATHS:
                self.poison = self.died_at = held
                self._note.suspect, self._note.deaths = None, 0
            self._write()
        else:
            self._note.suspect, self._note.deaths = None, 0
        _watch(self)

    @property
    def is_watchful(self) -> bool:
        """Whether a message may have to be refused."""
        return self.poison is not None or bool(self._note.refused)

    def is_set_aside(self, mail: tuple[str, str, int], event: Callable[[], str]) -> bool:
        """Return whether a message is to be refused: it was set aside, or its `event` is the work to set aside."""
        if self._note.refused and mail in self._note.refused:
            return True
        poison = self.poison
        if poison is None or (mail != poison.mail if not poison.event else event() != poison.event):
            return False
        self.poison = None  # later messages may ask for the same
        with self._lock:
            self._note.refused.append(mail)
            self._write()
        return True

    def keep(self, what: Held) -> None:
        """Keep the work that is set aside, so that people may examine it."""
        try:
            with self.kept.open("ab") as file:
                file.write(msgspec.json.encode(what) + b"\n")
        except OSError as error:
            log.warning("not kept what=%s why=%s", text_of(what), error.strerror)

    def end(self) -> None:
        """Take back what was written down of a turn that has ended."""
        with self._lock:
            self.written, self._note.held = False, None
            self._write()

    def look(self, now: float) -> None:
        """Write down the work of a turn that is long at ``now``, in monotonic seconds; called on the thread."""
        since = self.since
        if since is None or now - since < LONG:
            return
        held = self._look()
        with self._lock:
            if self.since == since and held != self._note.held and held != Held():
                self.written, self._note.held = True, held
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
        """Write the note without forcing it to disk: it is for the end of the process, not for a power cut."""
        try:
            replace_file(self._path, msgspec.json.encode(self._note), private=False, synced=False)
        except OSError as error:
            log.warning("what is being processed cannot be recorded: %s: %s", self._path, error.strerror)


def text_of(held: Held) -> str:
    """Return the work as text."""
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
            except Exception as error:  # the mind changes meanwhile
                log.debug("not seen: %s", error)


_THREAD: Final = "in-hand"
_all: Final[WeakSet[PoisonInputs]] = WeakSet()
