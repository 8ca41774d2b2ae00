"""The paper's text form of a message, `<id,sender,itlforce,receiver,data>` (section 4.4), read and written losslessly.

Jason writes a reply as `<id->in_reply_to,...>`; the performative is the paper's illocutionary force.
"""

from __future__ import annotations

import re

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
