"""An agent's mail, between its mind and the board's commd (docs/mail.md)."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable

from agentd.inbox import Inbox, Refused
from agentd.language.signatures import signature
from agentd.language.terms import Literal, atom
from agentd.mind import Mind
from agentd.mind.effects import SendMail
from agentd.mind.failed import Failed
from agentd.mind.inputs import Mail
from agentd.outbox import Outbox, Unsendable
from agentd.wire import BadTerm, from_wire, to_wire
from commd.bus import Bus, boot_id
from schemas.records import Message

log = logging.getLogger("mail")

INPUTS = 20_000
"""Messages that may wait for the mind; further ones wait at commd."""
OFFICE = "mail"
"""The sender of notices about mail (`+undelivered(...)[source(mail)]`)."""


class Mailing:
    """The mail of one agent."""

    def __init__(
        self, bus: Bus, agent: str, mind: Mind, feed: Callable[[Mail], None], names: Callable[[], Iterable[str]]
    ) -> None:
        """`feed` hands a message to the mind and wakes it; `names` are all that can be sent to."""
        self.outbox = Outbox(bus, agent, self._undelivered)
        self.inbox = Inbox(bus, agent, self._room, self._read)
        self._agent, self._mind, self._feed, self._names = agent, mind, feed, names
        self.life = boot_id()
        """Tells the answers to questions of this life of the agent from those to a former one's."""
        self._bad: Counter[str] = Counter()
        mind.post_office = self.send

    @property
    def counters(self) -> Counter[str]:
        """What became of messages so far."""
        return self.outbox.counters + self.inbox.counters + self._bad

    def send(self, mail: SendMail) -> None:
        """Take a message, or a broadcast, that leaves when it is on disk. Raises Failed, as the plan that sends it."""
        receivers = self.receivers(mail)
        try:
            content = to_wire(mail.content)
            self.outbox.post(receivers, mail.performative, content, f"{mail.msg_id}.{self.life}", mail.in_reply_to)
        except BadTerm as bad:
            raise Failed("not_sendable", f"the message cannot be sent: {bad}") from None
        except Unsendable as bad:
            raise Failed(bad.error, f"the message cannot be sent: {bad}") from None

    def receivers(self, mail: SendMail) -> list[str]:
        """Return to whom a message goes: a broadcast to each that is known, there or away, but oneself."""
        if mail.receiver is not None:
            return [mail.receiver]
        return [name for name in self._names() if name != self._agent]

    def tell(self, mail: Mail) -> None:
        """Hand the mind a message that does not come from commd."""
        self._feed(mail)
        self.inbox.unnumbered()

    def absorbed(self) -> bool:
        """Look at what the mind has taken. Returns whether commd waits for a save."""
        return self.inbox.absorb(len(self._mind.mailbox))

    def forget(self) -> None:
        """Nothing is kept: what was sent may leave, and what the mind has taken is taken."""
        self.absorbed()
        self.inbox.kept(self.inbox.take_absorbed())
        self.outbox.saved(self.outbox.take_unsaved())
        self.outbox.take_gone()

    def _room(self) -> str:
        return "the mailbox of the mind is full" if len(self._mind.mailbox) >= INPUTS else ""

    def _read(self, message: Message) -> Callable[[], None]:
        try:
            content = from_wire(message.content)
        except BadTerm as bad:
            self._bad["bad"] += 1
            log.warning("agent=%s bad_mail sender=%s why=%s", self._agent, message.sender, bad)
            raise Refused(f"it cannot be read: {bad}") from None
        # The answer to a question of a former life keeps its whole id: nobody waits for it.
        answered = message.in_reply_to.removesuffix(f".{self.life}")
        mail = Mail(message.sender, message.performative, content, message.id, answered)
        return lambda: self._feed(mail)

    def _undelivered(self, message: Message, why: str) -> None:
        """Tell the mind of a message that commd has refused for good."""
        try:
            content = from_wire(message.content)
        except BadTerm:
            content = str(message.content)
        told = (atom(message.receiver), atom(message.performative), content, why)
        identity = f"undelivered.{message.id}"
        self.tell(Mail(OFFICE, "signal", Literal(signature("undelivered", 4), told), identity))
