"""Messages as commd keeps them: numbered, dated, encoded once, and sent on without a look at their content."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, TypeVar

import msgspec

from schemas.wire.codec import codec
from schemas.wire.records import Header, Receipt, Record, Refusal
from schemas.wire.records import Mail as ReadMail
from schemas.wire.records import Message as ReadMessage
from schemas.wire.terms import Atom, Map, OpenList, Queue, Set, Structure, Term, Variable

M = TypeVar("M", bound="ReadMessage | Message")

LARGEST = 1024 * 1024
"""Bytes of the largest message, as it travels."""
SLACK = 4_096
"""Bytes that a notice may have besides the content of the largest message."""
OFFICE = "mail"
"""The sender of notices."""
DEEPEST = 200
"""Terms within terms that a content may have. How deep a decoder goes depends on where it is called: far less than it
ever bears, so that whoever takes a message can also hand it on, wrap it into a notice and list it."""
WRAPPED = 2
"""Terms around it in a notice."""
LARGEST_NUMBER = 2**53
"""No number of a message is above; 64 bits are more than the file takes."""
LONGEST_NUMBERING = 64
"""Characters."""


class Message(Record, frozen=True, kw_only=True):
    """`schemas.wire.records.Message` with a content that is carried, not read: it was checked where it came in."""

    header: Header = Header()
    id: str
    sender: str
    performative: str
    receiver: str
    content: Any
    in_reply_to: str = ""
    ttl: float | None = None


class Mail(Record, frozen=True, kw_only=True):
    """A batch of them; on the wire the same as `schemas.wire.records.Mail`."""

    messages: tuple[Message, ...] = ()


class StoredMessage(msgspec.Struct, kw_only=True, gc=False):
    """A message on its way into the file."""

    line: str
    """Where it waits (`commd.mail.schema`)."""
    sender: str
    receiver: str
    numbering: str = ""
    number: int = 0
    """0: it gets the next number of this board's own numbering."""
    expires: float | None = None
    """By the mail clock."""
    message: bytes


class QueuedMessage(msgspec.Struct, kw_only=True, gc=False):
    """A message that has come to the front of its line."""

    place: int
    sender: str
    receiver: str
    numbering: str
    number: int
    expires: float | None
    message: bytes

    def read(self) -> ReadMessage:
        """Return the message with its content."""
        return self._numbered(codec(ReadMessage).decode(self.message, MSGPACK))

    def carried(self, now: float) -> Message:
        """Return the message as it goes on: with its number, and the time that it has left."""
        message = self._numbered(_CARRIED.decode(self.message))
        if self.expires is not None:
            message = msgspec.structs.replace(message, ttl=max(0.0, self.expires - now))
        return message

    def _numbered(self, message: M) -> M:
        if message.header.seq == self.number and message.header.boot == self.numbering:
            return message
        header = msgspec.structs.replace(message.header, boot=self.numbering, seq=self.number)
        return msgspec.structs.replace(message, header=header)


def letter(message: ReadMessage, line: str, expires: float | None) -> StoredMessage:
    """Return a message as it is kept. Raises ValueError for one that cannot be kept, BadRecord among them."""
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
        message=codec(ReadMessage).encode(message, "msgpack"),
    )


def too_deep(content: Term, most: int) -> bool:
    """Whether a content has more than `most` terms within terms."""
    level: list[Any] = [content]
    for _ in range(most):
        level = [part for term in level for part in _parts(term) if not isinstance(part, (str, int, float))]
        if not level:
            return False
    return True


def _parts(term: Any) -> Sequence[Any]:
    """Return the terms that stand directly in a term."""
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


def shown(message: ReadMessage) -> ReadMessage:
    """Return a message as it can be told of: without its content if that is too deep to be wrapped into anything."""
    if too_deep(message.content, DEEPEST + 1):
        return msgspec.structs.replace(message, content="(nested too deeply to be shown)")
    return message


def undelivered(message: ReadMessage, reason: Refusal) -> ReadMessage:
    """Return the notice that tells a sender what became of its message."""
    what = (_name(message.receiver), _name(message.performative), shown(message).content, reason.code)
    detail = (Structure("detail", (reason.text,)),) if reason.text else ()
    return ReadMessage(
        id=f"undelivered.{message.id}",
        sender=OFFICE,
        performative="signal",
        receiver=message.sender,
        content=Structure("undelivered", what, detail),
    )


def adds_up(receipt: Receipt, messages: int) -> bool:
    """Whether a receipt says what became of each message of a batch."""
    places = {*receipt.refused, *receipt.later}
    counted = receipt.taken + len(receipt.refused) + len(receipt.later)
    return (
        counted == messages
        and len(places) == len(receipt.refused) + len(receipt.later)
        and all(0 <= place < messages for place in places)
    )


def opened(batch: Mail) -> tuple[ReadMessage, ...]:
    """Return the messages of a batch with their contents, for a receiver in this process."""
    return codec(ReadMail).decode(codec(Mail).encode(batch, "msgpack"), codec(ReadMail).encoding("msgpack")).messages


def _name(text: str) -> Term:
    """Return a name as an atom, if it can be one."""
    return Atom(text) if re.fullmatch(r"[a-z]\w*", text, re.ASCII) else text


MSGPACK = codec(ReadMessage).encoding("msgpack")
_CARRIED = msgspec.msgpack.Decoder(Message)
