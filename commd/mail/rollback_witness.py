"""Whether a board's mail file went back in time, as the other boards have seen it.

A restored backup looks to its own board like the file that it was. So each board remembers how far the mail files of
the others had come, by the time kept in them (`commd.mail.age_clock`), before the present lives of their daemons, and
tells it with what it says of itself. A board whose file is older than that has lost mail that it had taken.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from sqlite3 import Connection

import msgspec
from msgspec.structs import replace

from commd.mail import kv_table
from commd.mail.age_clock import MailClock
from schemas.wire.records import BoardServices, MailSeen, Note

TOLERANCE = 0.5
"""Seconds by which two readings of one clock may differ."""
WENT_BACK = "mail_went_back"
"""Code of the note about it."""
_KIND = "mail_seen"
log = logging.getLogger("mail")


class RollbackWitness:
    """What a board has seen of the mail files of others, and what they have seen of its own."""

    def __init__(self, board: str, boot: str, clock: MailClock) -> None:
        """`boot` names this life of the board's daemon, `clock` is that of its mail file."""
        self.seen: Mapping[str, MailSeen] = {}
        self.note: Note | None = None
        """That the own file went back in time."""
        self._board, self._boot, self._clock = board, boot, clock

    def load(self, db: Connection) -> None:
        """Read what is on disk; a record that cannot be read is left out."""
        found: dict[str, MailSeen] = {}
        for board, value in kv_table.kept(db, _KIND).items():
            try:
                found[board] = msgspec.json.decode(value, type=MailSeen)
            except msgspec.DecodeError as bad:
                log.warning("mail_seen_unreadable board=%s why=%s", board, bad)
        self.seen = {**found, **self.seen}

    def news(self, said: BoardServices) -> MailSeen | None:
        """Return what is now seen of the mail file of the board that says this; None if that is known."""
        known = self.seen.get(said.board, MailSeen())
        if not said.mail_time:
            return None
        if said.header.boot != known.boot:
            return MailSeen(boot=said.header.boot, time=said.mail_time, former=known.time)
        return replace(known, time=said.mail_time) if said.mail_time > known.time else None

    def keep(self, db: Connection, board: str, seen: MailSeen) -> None:
        """Write down what is seen of a board's file."""
        kv_table.keep(db, _KIND, board, msgspec.json.encode(seen))

    def judge(self, said: BoardServices) -> None:
        """Compare the own file with what another board has seen of it before this life, and tell once."""
        seen = said.mail_seen.get(self._board)
        if seen is None or self._clock.found is None or self.note is not None:
            return
        behind = (seen.former if seen.boot == self._boot else seen.time) - self._clock.found
        if behind <= TOLERANCE:
            return
        text = (
            f"the mail file of board {self._board} went back in time by {behind:.0f} s, as board {said.board} has seen "
            "it: mail taken since then is lost here, what it holds goes out again"
        )
        log.error("event=%s board=%s by=%.0fs seen_by=%s: %s", WENT_BACK, self._board, behind, said.board, text)
        self.note = Note(WENT_BACK, text, value=behind)
