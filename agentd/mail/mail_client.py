"""An agent's mail, between its mind and the board's commd (docs/guides/mail.md)."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable

from msgspec.structs import replace

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.terms import Literal, atom
from agentd.mail.inbox import AgentInbox
from agentd.mail.outbox import Outbox, Unsendable
from agentd.mind import Mind
from agentd.mind.data.effects import SendMail
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.execution.messages import is_answer, told_annots
from commd.bus.bus import Bus, boot_id
from commd.client.receive_once import MessageRefused
from commd.mail.message import undelivered
from schemas.mission.access_rules import NOT_ACCEPTED
from schemas.wire.records import Message, Refusal

log = logging.getLogger("mail")

INPUTS = 20_000
"""Messages that may wait for the mind; further ones wait at commd."""
TOLD, TOLD_AGAIN = 10, 1000
"""Messages not accepted that are logged: the first ones, and then each 1000th."""
OFFICE = "mail"
"""The sender of notices about mail (`+undelivered(...)[source(mail)]`)."""


class MailClient:
    """The mail of one agent."""

    def __init__(
        self,
        bus: Bus,
        agent: str,
        mind: Mind,
        feed: Callable[[Mail], None],
        names: Callable[[], Iterable[str]],
        accept: Callable[[Message], bool],
    ) -> None:
        """`feed` hands a message to the mind and wakes it; `names` are all that can be sent to.

        `accept` says whether the agent takes a message from its sender.
        """
        self.outbox = Outbox(bus, agent, self._undelivered)
        self.inbox = AgentInbox(bus, agent, self._room, self._read, self._missing)
        self._agent, self._mind, self._feed, self._names, self._accept = agent, mind, feed, names, accept
        self.is_set_aside: Callable[[tuple[str, str, int], Callable[[], str]], bool] = lambda mail, event: False
        """Whether a message, by sender, numbering and number, and by its event, is not to be taken any more."""
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

    def in_hand(self) -> tuple[str, str, int] | None:
        """Sender, numbering and number of the last message that the mind has taken and that is not kept yet."""
        return self.inbox.taken_last(len(self._mind.mailbox))

    def absorbed(self) -> bool:
        """Look at what the mind has taken. Returns whether commd waits for a save."""
        return self.inbox.absorb(len(self._mind.mailbox))

    def forget(self) -> None:
        """Nothing is kept: what was sent may leave, and what the mind has taken is taken."""
        self.absorbed()
        self.inbox.kept(self.inbox.take_absorbed())
        self.outbox.saved(self.outbox.take_unsaved())
        self.outbox.take_gone()

    def _room(self) -> bool:
        return len(self._mind.mailbox) < INPUTS

    def _read(self, message: Message) -> Callable[[], None]:
        # The answer to a question of a former life keeps its whole id: nobody waits for it.
        answered = message.in_reply_to.removesuffix(f".{self.life}")
        if not (is_answer(answered) or self._accept(message)):
            self._not_accepted(message)
        try:
            content = from_wire(message.content)
        except BadTerm as bad:
            self._bad["bad"] += 1
            log.warning("agent=%s bad_mail sender=%s why=%s", self._agent, message.sender, bad)
            raise MessageRefused(Refusal(code="unreadable", text=f"it cannot be read: {bad}")) from None
        number = message.sender, message.header.boot, message.header.seq
        if self.is_set_aside(number, lambda: event_of(self._mind, message, content)):
            text = "set aside: the receiver's process has died at it several times"
            raise MessageRefused(Refusal(code="set_aside", text=text))
        mail = Mail(message.sender, message.performative, content, message.id, answered)
        return lambda: self._feed(mail)

    def _missing(self, sender: str, count: int) -> None:
        """Tell the mind of messages that have not come."""
        log.warning("agent=%s mail_missing sender=%s messages=%d", self._agent, sender, count)
        self.signal("mail_missing", atom(sender), float(count))

    def signal(self, functor: str, *args: object) -> None:
        """Tell the mind something about mail, as an event."""
        self.tell(Mail(OFFICE, "signal", Literal(signature(functor, len(args)), args), f"{functor}.{boot_id()}"))

    def _not_accepted(self, message: Message) -> None:
        """Refuse a message that its sender may not send to this agent. Raises MessageRefused."""
        self._bad[NOT_ACCEPTED] += 1
        count = self._bad[NOT_ACCEPTED]
        if count <= TOLD or count % TOLD_AGAIN == 0:
            told = self._agent, count, message.sender, message.performative[:64]
            log.warning("agent=%s mail_not_accepted count=%d sender=%r performative=%r", *told)
        raise MessageRefused(Refusal(code=NOT_ACCEPTED))

    def _undelivered(self, message: Message, why: Refusal) -> None:
        """Tell the mind of a message that commd has refused for good."""
        notice = undelivered(message, why)
        try:
            content = from_wire(notice.content)
        except BadTerm:  # the notice matters more than what the message was
            notice = undelivered(replace(message, content=str(message.content)), why)
            content = from_wire(notice.content)
        self.tell(Mail(OFFICE, "signal", content, notice.id))


def event_of(mind: Mind, message: Message, content: object) -> str:
    """The event that a message raises, as it is written; nothing where that is not known."""
    prefix = {"achieve": "+!", "tell": "+", "signal": "+"}.get(message.performative)
    if prefix is None or type(content) is not Literal:
        return ""
    return f"{prefix}{text(content.with_annots(told_annots(mind, content, message.sender)))}"
