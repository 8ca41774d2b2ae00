"""Messages as commd stores them: numbered, dated, encoded once, and sent on with their content unread."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from schemas.wire.codec import codec
from schemas.wire.records import Message, Receipt, Refusal
from schemas.wire.terms import Atom, Map, OpenList, Queue, Set, Structure, Term, Variable

LARGEST = 1024 * 1024
"""Bytes of the largest message on the bus."""
SLACK = 4_096
"""Bytes of a notice besides the content of the largest message."""
OFFICE = "mail"
"""The sender of notices."""
DEEPEST = 200
"""Nesting of terms in a content. A decoder's limit depends on its caller's depth: this is far below it, so that a
message that was accepted can also be sent on, wrapped into a notice and listed."""
WRAPPED = 2
"""Levels that a notice adds."""
LARGEST_NUMBER = 2**53
"""The largest number of a message: the file does not take all of 64 bits."""
LONGEST_NUMBERING = 64
"""Characters."""


class StoredMessage(msgspec.Struct, gc=False):
    """A message as a row of the mail file."""

    line: str
    """Where it waits (`MIGRATIONS` of `commd.mail.queries`)."""
    sender: str
    receiver: str
    message: bytes
    """MessagePack."""
    numbering: str = ""
    number: int = 0
    """0: it gets the next number of this board's own numbering."""
    expires: float | None = None
    """By the mail clock."""
    place: int = 0
    """0: it gets the next place."""

    def current(self, now: float, decode: Callable[[bytes], Message]) -> Message:
        """Return the message with the number of the row, and the time to live that is left at `now` of the mail clock.

        `decode` is `read` or `read_plain`.
        """
        message = decode(self.message)
        if message.header.seq != self.number or message.header.boot != self.numbering:
            header = msgspec.structs.replace(message.header, boot=self.numbering, seq=self.number)
            message = msgspec.structs.replace(message, header=header)
        if self.expires is not None:
            message = msgspec.structs.replace(message, ttl=max(0.0, self.expires - now))
        return message


def stored(message: Message, line: str, expires: float | None) -> StoredMessage:
    """Return the row of a message that `expires` by the mail clock, None = never.

    Raises ValueError, such as BadRecord, for one that cannot be stored.
    """
    header = message.header
    numbered = header.seq > 0 and bool(header.boot)
    if header.seq > LARGEST_NUMBER or len(header.boot) > LONGEST_NUMBERING:
        raise ValueError(f"its number is above {LARGEST_NUMBER}, or its numbering longer than {LONGEST_NUMBERING}")
    if too_deep(message.content, DEEPEST + WRAPPED if message.sender == OFFICE else DEEPEST):
        raise ValueError(f"nested too deeply: more than {DEEPEST} terms within terms")
    return StoredMessage(
        line=line,
        sender=message.sender,
        receiver=message.receiver,
        numbering=header.boot if numbered else "",
        number=header.seq if numbered else 0,
        expires=expires,
        message=codec(Message).encode(message, "msgpack"),
    )


def too_deep(content: Term, most: int) -> bool:
    """Whether a content has more than `most` levels of terms."""
    level: list[Any] = [content]
    for _ in range(most):
        level = [part for term in level for part in _parts(term) if not isinstance(part, (str, int, float))]
        if not level:
            return False
    return True


def _parts(term: Any) -> Sequence[Any]:
    """Return the terms directly within a term."""
    match term:
        case list() | tuple():
            return term
        case Structure():
            return (*term.args, *term.annotations)
        case Variable():
            return term.annotations
        case OpenList():
            return (*term.items, term.tail)
        case Map():
            return [part for entry in term.entries for part in entry]
        case Set() | Queue():
            return term.items
    return ()


def shown(message: Message) -> Message:
    """Return a message to be listed or wrapped: without its content if that is nested too deeply."""
    if too_deep(message.content, DEEPEST + 1):
        return msgspec.structs.replace(message, content="(nested too deeply to be shown)")
    return message


def undelivered(message: Message, reason: Refusal) -> Message:
    """Return the notice for the sender of a message that is not delivered."""
    what = (named(message.receiver), named(message.performative), shown(message).content, reason.code)
    detail = (Structure("detail", (reason.text,)),) if reason.text else ()
    return Message(
        id=f"undelivered.{message.id}",
        sender=OFFICE,
        performative="signal",
        receiver=message.sender,
        content=Structure("undelivered", what, detail),
    )


def adds_up(receipt: Receipt, messages: int) -> bool:
    """Whether a receipt accounts for each of the `messages` of a batch."""
    places = {*receipt.refused, *receipt.later}
    counted = receipt.taken + len(receipt.refused) + len(receipt.later)
    return (
        counted == messages
        and len(places) == len(receipt.refused) + len(receipt.later)
        and all(0 <= place < messages for place in places)
    )


def named(text: str) -> Term:
    """Return a name as a program writes it: an atom if possible, else a string."""
    return Atom(text) if re.fullmatch(r"[a-z]\w*", text, re.ASCII) else text


def read(data: bytes) -> Message:
    """Return a message of the file, with its content."""
    return codec(Message).decode(data, _MSGPACK)


_MSGPACK = codec(Message).encodings["msgpack"]
read_plain = msgspec.msgpack.Decoder(Message).decode
"""Returns a message to send on: its content stays plain data, no term, as it was checked on arrival."""
