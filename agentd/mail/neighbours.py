"""Mail between agents of one daemon: it does not leave the process (docs/guides/mail.md).

A message is *held* until its sender's mind rests, then it is in the receiver's mailbox. A commit has it together with
all that its sender did before (`agentd.persistence.group_commit`): as what the receiver made of it, or as a row of
`incoming`. A message that cannot be handed over so goes by the board's `commd`, like mail to anybody else.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, Final

from msgspec import Struct

from agentd.conversion.term_conversion import to_wire
from agentd.language.terms.terms import Literal, Var
from agentd.mind.data.inputs import Mail
from commd.client.receive_once import Numbered
from commd.client.send_mail import encoded
from schemas.wire.codec import Wire
from schemas.wire.records import Header, Message, Queue

if TYPE_CHECKING:
    from agentd.mail.mail_client import MailClient

MOST: Final = 1_000
"""Messages of other agents of the daemon that may wait in a mailbox; further ones go by `commd`."""
MOST_BYTES: Final = 64 * 1024
"""Bytes of such a message, encoded; larger ones go by `commd`."""
_LONGEST: Final = 1_000
"""Characters of a text that need not be encoded to know that it is small."""
_PARTS: Final = 8
"""Arguments and annotations of a literal of which the same holds."""


class NearMessage(Struct, eq=False, gc=False):
    """A message of another agent of the daemon; nothing in it leads back to it, so the garbage collector skips it."""

    mail: Mail
    """What the mind gets; its `in_reply_to` may be a shorter form of that here."""
    receiver: str
    in_reply_to: str
    whose: Numbered
    seq: int
    number: int = 0
    """Its row on disk; 0: none."""
    taken: bool = False
    """Whether the mind has taken it."""
    _data: bytes = b""

    def encoded(self, wire: Wire, stamp: int) -> bytes:
        """Return it as it is written; `stamp` is in Unix nanoseconds. Raises Unsendable."""
        if not self._data:
            self._data = encoded(self.message(stamp), wire)
        return self._data

    def message(self, stamp: int) -> Message:
        """Return it as a record; `stamp` is in Unix nanoseconds."""
        mail = self.mail
        return Message(
            header=Header(seq=self.seq, stamp=stamp, source=mail.sender, boot=self.whose.numbering),
            id=mail.msg_id,
            sender=mail.sender,
            performative=mail.performative,
            receiver=self.receiver,
            content=to_wire(mail.content),
            in_reply_to=self.in_reply_to,
        )


class Neighbours(dict[str, "MailClient"]):
    """The mail clients of the agents of one daemon that can receive mail of the others, by name."""

    def queues(self) -> list[Queue]:
        """Return the messages that no mind has taken, by sender and receiver, the most first."""
        counts: Counter[tuple[str, str]] = Counter()
        for client in self.values():
            client.inbox.absorb(len(client.mind.mailbox))
            waiting = [*client.inbox.left(), *(message for _, message in client.held)]
            counts.update((message.mail.sender, message.receiver) for message in waiting)
        return [
            Queue(box="mind", sender=sender, receiver=receiver, messages=number)
            for (sender, receiver), number in counts.most_common()
        ]


def is_small(content: Any) -> bool:
    """Whether a term is flat, small, and can be given to another mind without being encoded; its variables are free."""
    kind = type(content)
    if kind is Literal:
        args, annots = content.args, content.annots
        if len(args) + len(annots) > _PARTS:
            return False
        for part in args:
            if not _is_simple(part):
                return False
        for part in annots:
            if type(part) is not Literal or part.annots or not all(map(_is_simple, part.args)):
                return False
        return True
    return _is_simple(content)


def _is_simple(term: Any) -> bool:
    kind = type(term)
    if kind is Var:
        return term.ref is None
    if kind is float:
        return bool(term - term == 0)  # JSON has no infinite numbers
    if kind is str:
        return len(term) <= _LONGEST and term.isascii()
    return kind is Literal and not term.args and not term.annots
