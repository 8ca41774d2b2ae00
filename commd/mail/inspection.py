"""What `{board}/mailboxes` tells: the queues with their ages, and the newest dead letters."""

from __future__ import annotations

from collections.abc import Callable
from sqlite3 import Connection

from commd.mail.message import shown
from schemas.wire.codec import codec
from schemas.wire.records import DeadLetter, Mailboxes, Message, Queue, Refusal

QUEUES = 1_000
"""Queues that are listed, those with the most messages."""
DEAD, DEAD_BYTES = 100, 256 * 1024
"""Dead letters that are listed, the newest, and their bytes."""


def list_mailboxes(db: Connection, now: float, state: Callable[[str], str]) -> Mailboxes:
    """Return the queues at `now` of the mail clock, with what `state(line)` says of each, and the dead letters."""
    rows = db.execute(
        """SELECT line, sender, receiver, count(*), sum(size), min(posted) FROM mail
           GROUP BY line, sender, receiver ORDER BY count(*) DESC, sender, receiver LIMIT ?""",
        (QUEUES,),
    )
    queues = tuple(
        Queue(
            box="outbox" if ">" in line else "inbox",
            sender=sender,
            receiver=receiver,
            messages=count,
            bytes=size,
            oldest=max(0.0, round(now - posted, 1)),
            state=state(line),
        )
        for line, sender, receiver, count, size, posted in rows
    )
    return Mailboxes(queues=queues, dead=tuple(_newest_dead(db)))


def _newest_dead(db: Connection) -> list[DeadLetter]:
    read, encoding = codec(Message).decode, codec(Message).encoding("msgpack")
    found: list[DeadLetter] = []
    left = DEAD_BYTES
    rows = db.execute("SELECT code, text, stamp, size, message FROM dead ORDER BY place DESC LIMIT ?", (DEAD,))
    for code, text, stamp, size, message in rows:
        left -= size
        if found and left < 0:
            break
        reason = Refusal(code=code, text=text)
        found.append(DeadLetter(message=shown(read(message, encoding)), reason=reason, stamp=stamp))
    rows.close()
    return found[::-1]
