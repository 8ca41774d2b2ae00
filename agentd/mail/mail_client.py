"""The mail of one agent, between its mind and the board's `commd` (docs/guides/mail.md).

An incoming message is *fed* to the mind, *absorbed* when the mind has taken it in a cycle, and *saved* when a
checkpoint with its effects is on disk; only then `commd` gets the receipt. Outgoing messages are in `outbox`.
"""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Callable, Mapping

from msgspec.structs import replace

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.terms import Literal, atom
from agentd.mail.outbox import Outbox
from agentd.mind import Mind
from agentd.mind.data.effects import SendMail
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.execution.messages import is_answer, told_annots
from agentd.persistence.poison_inputs import PoisonInputs
from agentd.runtime.agent_directory import AgentDirectory
from agentd.runtime.mind_runner import MindRunner
from agentd.trace import Tracing
from commd.bus.bus import Bus, boot_id
from commd.client.receive_once import MessageRefused, Numbered, ReceiveOnce
from commd.client.send_mail import Unsendable
from commd.mail.message import undelivered
from schemas.mission.access_rules import NOT_ACCEPTED, MailRights
from schemas.wire.records import Message, Refusal

log = logging.getLogger("mail")

INPUTS = 20_000
"""Messages that may wait for the mind; further ones wait at `commd`."""
PATIENCE = 5.0
"""Wall seconds until `commd` gets an answer without those messages that are not saved; it offers them again."""
LOGGED, LOGGED_AGAIN = 10, 1000
"""Messages not accepted that are logged: the first 10, then each 1000th."""
OFFICE = "mail"
"""The sender of notices about mail (`+undelivered(...)[source(mail)]`)."""


class AgentInbox(ReceiveOnce):
    """The incoming mail of one agent."""

    FULL = Refusal(code="mailbox_full", text="the mailbox of the mind is full")
    NOT_DONE = Refusal(code="not_absorbed", text="the mind has not absorbed it")

    def __init__(
        self,
        bus: Bus,
        agent: str,
        room: Callable[[], bool],
        read: Callable[[Message], Callable[[], None]],
        missing: Callable[[str, int], None],
    ) -> None:
        """The callables are those of `ReceiveOnce`."""
        self._waiting: deque[tuple[Numbered, int]] = deque()
        """The messages in the mind's mailbox, in its order; number 0: one without a number."""
        self._absorbed: dict[Numbered, int] = {}
        """The last numbers that the mind has taken and that no save holds."""
        super().__init__(bus, agent, read, room, lambda: PATIENCE, missing)

    def _handed_over(self, whose: Numbered, seq: int) -> None:
        self._waiting.append((whose, seq))

    def unnumbered(self) -> None:
        """Note that a message which is not from `commd` was put into the mind's mailbox."""
        self._waiting.append((_NOBODY, 0))

    def absorb(self, left: int) -> bool:
        """Note that the mind has `left` messages in its mailbox. Return whether `commd` waits for a save."""
        while len(self._waiting) > left:
            whose, seq = self._waiting.popleft()
            if seq:
                self._absorbed[whose] = seq
        return bool(self._absorbed)

    def taken_last(self, left: int) -> tuple[str, str, int] | None:
        """Return the last message that a mind with `left` messages has taken and that no save holds."""
        place = len(self._waiting) - left - 1
        if place >= 0 and self._waiting[place][1]:
            whose, seq = self._waiting[place]
        elif self._absorbed:
            whose, seq = next(reversed(self._absorbed.items()))
        else:
            return None
        return whose.sender, whose.numbering, seq

    def take_absorbed(self) -> dict[Numbered, int]:
        """Return the numbers for a save that begins now; `saved` is to be called when it is on disk."""
        found, self._absorbed = self._absorbed, {}
        return found

    def saved(self, numbers: Mapping[Numbered, int]) -> None:
        """Let `commd` have the receipts: the effects of the messages up to these numbers are on disk."""
        for whose, seq in numbers.items():
            self._done(whose, seq)
        if numbers:
            self._notify()


_NOBODY = Numbered("", "")


class MailClient:
    """The mail of one agent."""

    def __init__(
        self,
        bus: Bus,
        life: str,
        runner: MindRunner,
        directory: AgentDirectory,
        rights: MailRights | None,
        tracing: Tracing,
    ) -> None:
        """`life` is the end of the ids of this life's messages; `rights` say whose mail is accepted, None: all."""
        self._mind, self._agent = runner.mind, runner.mind.name
        self._life, self._runner, self._directory = life, runner, directory
        self._rights, self._tracing = rights, tracing
        self.outbox = Outbox(bus, self._agent, self._undelivered)
        self.inbox = AgentInbox(bus, self._agent, self._room, self._read, self._missing)
        self.poison: PoisonInputs | None = None
        """Knows the messages that are not to be taken."""
        self._bad: Counter[str] = Counter()

    @property
    def counters(self) -> Counter[str]:
        """What became of messages so far."""
        return self.outbox.counters + self.inbox.counters + self._bad

    def send(self, mail: SendMail) -> None:
        """Put a message or broadcast into the outbox; it leaves when it is on disk. Raises Failed for its plan."""
        if mail.receiver is not None:
            receivers = [mail.receiver]
        else:  # a broadcast: to all that are known, online or not, but oneself
            receivers = [name for name in self._directory.names if name != self._agent]
        try:
            content = to_wire(mail.content)
            self.outbox.post(receivers, mail.performative, content, f"{mail.msg_id}.{self._life}", mail.in_reply_to)
        except (BadTerm, Unsendable) as bad:
            error = bad.reason.code if isinstance(bad, Unsendable) else "not_sendable"
            failed = Failed(error, f"the message cannot be sent: {bad}")
            self._tracing.refused(mail, failed)
            raise failed from None
        self._tracing.sent(mail, receivers)

    def tell(self, mail: Mail) -> None:
        """Give the mind a message that is not from `commd`."""
        self._feed(mail)
        self.inbox.unnumbered()

    def _feed(self, mail: Mail) -> None:
        self._directory.met(mail.sender)
        self._runner.feed(mail)

    def in_hand(self) -> tuple[str, str, int] | None:
        """Return sender, numbering and number of the last message that the mind has taken and that is not saved."""
        return self.inbox.taken_last(len(self._mind.mailbox))

    def absorbed(self) -> bool:
        """Note what the mind has taken. Return whether `commd` waits for a save."""
        return self.inbox.absorb(len(self._mind.mailbox))

    def pass_unsaved(self) -> None:
        """Do without a checkpoint: let sent messages leave, and give receipts for those that the mind has taken."""
        self.absorbed()
        self.inbox.saved(self.inbox.take_absorbed())
        self.outbox.saved(self.outbox.take_unsaved())
        self.outbox.take_gone()

    def _room(self) -> bool:
        return len(self._mind.mailbox) < INPUTS

    def _read(self, message: Message) -> Callable[[], None]:
        # The answer to a question of a former life keeps its whole id: nobody waits for it.
        answered = message.in_reply_to.removesuffix(f".{self._life}")
        if self._rights is not None and not (is_answer(answered) or self._rights.accept(message)):
            self._not_accepted(message)
        try:
            content = from_wire(message.content)
        except BadTerm as bad:
            self._bad["bad"] += 1
            log.warning("agent=%s bad_mail sender=%s why=%s", self._agent, message.sender, bad)
            raise MessageRefused(Refusal(code="unreadable", text=f"it cannot be read: {bad}")) from None
        number = message.sender, message.header.boot, message.header.seq
        poison = self.poison
        if poison is not None and poison.is_set_aside(number, lambda: event_of(self._mind, message, content)):
            text = "set aside: the receiver's process has died at it several times"
            raise MessageRefused(Refusal(code="set_aside", text=text))
        mail = Mail(message.sender, message.performative, content, message.id, answered)
        return lambda: self._feed(mail)

    def _missing(self, sender: str, count: int) -> None:
        """Notify the mind that messages of a sender have not arrived."""
        log.warning("agent=%s mail_missing sender=%s messages=%d", self._agent, sender, count)
        self.signal("mail_missing", atom(sender), float(count))

    def signal(self, functor: str, *args: object) -> None:
        """Notify the mind of something about mail, as an event."""
        self.tell(Mail(OFFICE, "signal", Literal(signature(functor, len(args)), args), f"{functor}.{boot_id()}"))

    def _not_accepted(self, message: Message) -> None:
        """Refuse a message that its sender may not send to this agent. Raises MessageRefused."""
        self._bad[NOT_ACCEPTED] += 1
        count = self._bad[NOT_ACCEPTED]
        if count <= LOGGED or count % LOGGED_AGAIN == 0:
            facts = self._agent, count, message.sender, message.performative[:64]
            log.warning("agent=%s mail_not_accepted count=%d sender=%r performative=%r", *facts)
        raise MessageRefused(Refusal(code=NOT_ACCEPTED))

    def _undelivered(self, message: Message, why: Refusal) -> None:
        """Notify the mind of a message that `commd` has refused permanently."""
        notice = undelivered(message, why)
        try:
            content = from_wire(notice.content)
        except BadTerm:  # the notice matters more than the message in it
            notice = undelivered(replace(message, content=str(message.content)), why)
            content = from_wire(notice.content)
        self.tell(Mail(OFFICE, "signal", content, notice.id))


def event_of(mind: Mind, message: Message, content: object) -> str:
    """Return the event that a message raises, as text; empty for performatives that raise none."""
    prefix = {"achieve": "+!", "tell": "+", "signal": "+"}.get(message.performative)
    if prefix is None or type(content) is not Literal:
        return ""
    return f"{prefix}{text(content.with_annots(told_annots(mind, content, message.sender)))}"
