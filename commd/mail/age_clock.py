"""How old mail is, without trust in the wall clock: seconds during which this computer ran, counted across its boots.

A board without battery-backed clock starts in 1970 and jumps when it finds the time. So a message's `ttl` is counted by
the kernel's clock since boot, and what it showed last is written down now and then: after a boot it goes on from there.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from sqlite3 import Connection

import msgspec

from commd.mail import kv_table

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
SAVE_EVERY = 10.0
"""Seconds between two notes of the time, while mail waits that expires."""
_SINCE_BOOT = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


class _Shown(msgspec.Struct, frozen=True):
    """What the clock showed at a moment of one boot of the kernel."""

    time: float
    since_boot: float
    boot: str


def since_boot() -> float:
    """Return the seconds since the kernel started; they go on while the computer sleeps."""
    return time.clock_gettime(_SINCE_BOOT)


def kernel_boot() -> str:
    """Return which boot of the kernel this is."""
    try:
        return BOOT_ID.read_text().strip()
    except OSError:
        return ""


class MailClock:
    """Seconds that never go back."""

    def __init__(self, since_boot: Callable[[], float] = since_boot, boot: str | None = None) -> None:
        self._since_boot, self._boot = since_boot, kernel_boot() if boot is None else boot
        self._zero = since_boot()
        """What the kernel's clock shows when this one shows 0."""
        self.found: float | None = None
        """What the file showed that it went on from, 0 for a new one; none = no file is open yet."""
        self.saved = 0.0
        """What the file shows now."""

    def now(self) -> float:
        """Return the time by which mail is dated."""
        return self._since_boot() - self._zero

    def load_once(self, db: Connection) -> None:
        """Go on from what a file says, unless that was done before."""
        if self.found is None:
            self.load(db)

    def load(self, db: Connection) -> None:
        """Go on from what a file says. In another boot at least the time since it began has passed in between."""
        found = kv_table.kept(db, "clock").get("mail")
        self.found = 0.0
        if found is None:
            return
        shown = msgspec.json.decode(found, type=_Shown)
        same = bool(self._boot) and shown.boot == self._boot
        self.found = shown.time
        self._zero = (shown.since_boot if same else 0.0) - shown.time

    def save(self, db: Connection) -> float:
        """Write down what the clock shows now. Returns it, for `saved` once it is on disk."""
        now = self._since_boot()
        kv_table.keep(db, "clock", "mail", msgspec.json.encode(_Shown(now - self._zero, now, self._boot)))
        return now - self._zero
