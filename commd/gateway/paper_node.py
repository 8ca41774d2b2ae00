"""Old Comm nodes as the gateway knows them: where they are, how much they may say, what they said a short time ago."""

from __future__ import annotations

import hashlib
import re
from collections import OrderedDict

from schemas.wire.records import Message
from schemas.wire.term_text import BadTerm, read, write

_FIELD = re.compile(r"[^,<>\s]+")


class BadDatagram(ValueError):
    """Text that is not a message; says which part and what was expected."""


def write_message(message: Message) -> str:
    """Return a message in the paper's form. Raises BadDatagram for names that the form cannot carry."""
    head = f"{message.id}->{message.in_reply_to}" if message.in_reply_to else message.id
    fields = {"sender": message.sender, "performative": message.performative, "receiver": message.receiver}
    for what, text in {"id": message.id, **fields}.items():
        if not _FIELD.fullmatch(text) or "->" in text:
            raise BadDatagram(f"{what}: expected a text without blanks, `,`, `<` or `>`, got `{text}`")
    return "<" + ",".join([head, *fields.values(), write(message.content)]) + ">"


def read_message(text: str) -> Message:
    """Return the message that `text` is. Raises BadDatagram that says what was expected."""
    text = text.strip()
    if not (text.startswith("<") and text.endswith(">")):
        raise BadDatagram("expected `<id,sender,itlforce,receiver,data>`")
    parts = text[1:-1].split(",", 4)
    if len(parts) != 5:
        raise BadDatagram(f"expected five fields `<id,sender,itlforce,receiver,data>`, got {len(parts)}")
    head, sender, performative, receiver = (part.strip() for part in parts[:4])
    identity, _, in_reply_to = head.partition("->")
    named = {"id": identity, "sender": sender, "performative": performative, "receiver": receiver}
    for what, value in named.items():
        if not _FIELD.fullmatch(value):
            raise BadDatagram(f"{what}: expected a name, got `{value}`")
    try:
        content = read(parts[4].strip())
    except BadTerm as error:
        raise BadDatagram(f"data: {error}") from None
    return Message(
        id=identity,
        sender=sender,
        performative=performative,
        receiver=receiver,
        content=content,
        in_reply_to=in_reply_to,
    )


RATE, BURST = 200.0, 400.0
"""Datagrams of one node: per second, and at once; further ones are dropped unread and counted."""
REPEATED_WITHIN = 60.0
"""Seconds within which an equal datagram is a repetition; not longer, as Jason's ids restart with each process."""
REMEMBERED = 10_000


class Allowance:
    """A token bucket of datagrams from one host, by the number of its nodes."""

    def __init__(self) -> None:
        self.nodes = 1
        self._left, self._since = BURST, 0.0

    def take(self, now: float) -> bool:
        """Take one datagram from it at `now`, in monotonic seconds. Returns whether it was left."""
        self._left = min(BURST * self.nodes, self._left + (now - self._since) * RATE * self.nodes)
        self._since = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Node:
    """An agent behind an old Comm node."""

    def __init__(self, name: str, address: str) -> None:
        self.name, self.address = name, address
        self.at: tuple[str, int] | None = None
        """IP address and port, once its host is found."""
        self.missed = False
        """Whether it was logged that its host is not found."""
        self._heard: OrderedDict[bytes, float] = OrderedDict()

    def repeats(self, payload: bytes, now: float) -> bool:
        """Whether it sent the same datagram, with its id, within `REPEATED_WITHIN`; `now` in monotonic seconds."""
        heard, digest = self._heard, hashlib.blake2b(payload, digest_size=16).digest()
        while heard and (len(heard) > REMEMBERED or now - next(iter(heard.values())) > REPEATED_WITHIN):
            heard.popitem(last=False)
        known = digest in heard
        heard.setdefault(digest, now)
        return known
