"""The age of mail, without trust in the wall clock; and whether a mail file went back in time.

A board without battery-backed clock starts in 1970 and jumps when it gets the time. So a message's `ttl` is counted by
the kernel's clock since boot, which is saved in the mail file and continues from there after a boot.

A restored backup looks to its own board like the file that it was. So each board remembers how far the mail clocks of
the others had come before the present processes of their daemons, and publishes it with its services. A board whose
file is older than that has lost mail that it had taken.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from functools import partial
from sqlite3 import Connection

import msgspec
from msgspec.structs import replace

from commd.mail import queries
from commd.process.restart_counter import machine_boot
from schemas.wire.records import BoardServices, MailSeen, Note

SAVE_EVERY = 10.0
"""Seconds between two saves of the clock while mail waits that expires."""
SINCE_BOOT = partial(time.clock_gettime, getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))
"""Returns the seconds since the kernel started, time in suspend included."""


class _Shown(msgspec.Struct, frozen=True):
    """A saved reading of the clock."""

    time: float
    since_boot: float
    boot: str


class MailClock:
    """Seconds that never go back."""

    def __init__(self, since_boot: Callable[[], float] = SINCE_BOOT, boot: str | None = None) -> None:
        self._since_boot, self._boot = since_boot, machine_boot() if boot is None else boot
        self._zero = since_boot()
        """Reading of the kernel's clock at 0 of this one."""
        self.found: float | None = None
        """Reading in the file at the start, 0 for a new file; None = no file was read yet."""
        self.saved = 0.0
        """Reading that is on disk."""

    def now(self) -> float:
        """Return the time of the mail clock, in seconds."""
        return self._since_boot() - self._zero

    def load(self, db: Connection) -> None:
        """Continue from the reading in a file. In a new boot at least the time since its start has passed."""
        found = queries.kept(db, "clock").get("mail")
        self.found = 0.0
        if found is None:
            return
        shown = msgspec.json.decode(found, type=_Shown)
        same = bool(self._boot) and shown.boot == self._boot
        self.found = shown.time
        self._zero = (shown.since_boot if same else 0.0) - shown.time

    def save(self, db: Connection) -> float:
        """Save the present reading. Returns it, for `saved` once it is on disk."""
        now = self._since_boot()
        queries.keep(db, "clock", "mail", msgspec.json.encode(_Shown(now - self._zero, now, self._boot)))
        return now - self._zero


TOLERANCE = 0.5
"""Seconds by which two readings of one clock may differ."""
WENT_BACK = "mail_went_back"
"""Code of the note about it."""
_KIND = "mail_seen"
log = logging.getLogger("mail")


class RollbackWitness:
    """What a board has seen of the mail clocks of others, and they of its own."""

    def __init__(self, board: str, boot: str, clock: MailClock) -> None:
        """`boot`: of the board's daemon; `clock`: of its mail file."""
        self.seen: Mapping[str, MailSeen] = {}
        self.note: Note | None = None
        """The warning that the own file went back in time."""
        self._board, self._boot, self._clock = board, boot, clock

    def load(self, db: Connection) -> None:
        """Read what is on disk, without unreadable records."""
        found: dict[str, MailSeen] = {}
        for board, value in queries.kept(db, _KIND).items():
            try:
                found[board] = msgspec.json.decode(value, type=MailSeen)
            except msgspec.DecodeError as bad:
                log.warning("mail_seen_unreadable board=%s why=%s", board, bad)
        self.seen = {**found, **self.seen}

    def news(self, services: BoardServices) -> MailSeen | None:
        """Return what a board's record shows of its mail clock; None if that is known."""
        known = self.seen.get(services.board, MailSeen())
        if not services.mail_time:
            return None
        if services.header.boot != known.boot:
            return MailSeen(boot=services.header.boot, time=services.mail_time, former=known.time)
        return replace(known, time=services.mail_time) if services.mail_time > known.time else None

    def keep(self, db: Connection, board: str, seen: MailSeen) -> None:
        """Save what was seen of a board's mail clock."""
        queries.keep(db, _KIND, board, msgspec.json.encode(seen))

    def judge(self, services: BoardServices) -> None:
        """Compare the own file with what another board has seen of it before this process, and warn once."""
        seen = services.mail_seen.get(self._board)
        if seen is None or self._clock.found is None or self.note is not None:
            return
        behind = (seen.former if seen.boot == self._boot else seen.time) - self._clock.found
        if behind <= TOLERANCE:
            return
        text = (
            f"the mail file of board {self._board} is {behind:.0f} s older than board {services.board} has "
            "seen it: mail accepted since then is lost here, and its old mail is sent again"
        )
        log.error("event=%s board=%s by=%.0fs seen_by=%s: %s", WENT_BACK, self._board, behind, services.board, text)
        self.note = Note(WENT_BACK, text, value=behind)
