"""The mail of one agent, between its mind and the board's `commd` (docs/guides/mail.md).

An incoming message is *fed* to the mind, *absorbed* when the mind has taken it in a cycle, and *saved* when a
checkpoint with its effects is on disk; only then `commd` gets the receipt. Outgoing messages are in `outbox`.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial

from msgspec.structs import replace

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.terms import Literal, atom
from agentd.mail.neighbours import MOST, MOST_BYTES, NearMessage, Neighbours, is_small
from agentd.mail.outbox import Outbox
from agentd.mind import Mind
from agentd.mind.beliefs.term_copy import detached
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.execution.messages import QUESTIONS, is_answer, told_annots
from agentd.persistence.poison_inputs import PoisonInputs
from agentd.runtime.agent_directory import AgentDirectory
from agentd.runtime.mind_runner import MindRunner
from agentd.trace import Tracing
from commd.bus.bus import Bus, boot_id
from commd.client.receive_once import MessageRefused, Numbered, Progress, ReceiveOnce
from commd.client.send_mail import Unsendable
from commd.common.repeated_log import is_logged
from commd.mail.message import OFFICE, undelivered
from schemas.mission.access_rules import NOT_ACCEPTED, MailRights
from schemas.wire.records import Message, Refusal

log = logging.getLogger("mail")

INPUTS = 20_000
"""Messages that may wait for the mind; further ones wait at `commd`."""
PATIENCE = 5.0
"""Wall seconds until `commd` gets an answer without those messages that are not saved; it offers them again."""


class AgentInbox(ReceiveOnce):
    """The incoming mail of one agent."""

    FULL = Refusal(code="mailbox_full", text="the mailbox of the mind is full")
    NOT_DONE = Refusal(code="not_absorbed", text="the agent has not processed it yet")

    def __init__(
        self,
        bus: Bus,
        agent: str,
        room: Callable[[], bool],
        read: Callable[[Message], Callable[[], None]],
        missing: Callable[[str, int], None],
    ) -> None:
        """The callables are those of `ReceiveOnce`."""
        self.near = 0
        """Messages of other agents of the daemon that wait, or are about to."""
        self.waiting: deque[tuple[Numbered, int, NearMessage | None]] = deque()
        """The messages in the mind's mailbox, in its order; number 0: one without a number."""
        self._absorbed: dict[Numbered, int] = {}
        """The last numbers that the mind has taken and that no save holds."""
        self._passed: dict[Numbered, int] = {}
        """The same for messages that were not from `commd`, in numberings that `commd` has also brought mail of."""
        self._by_commd: set[Numbered] = set()
        """Those numberings."""
        self._unstored: list[NearMessage] = []
        """Messages of other agents of the daemon that no commit has seen."""
        self._taken: list[int] = []
        """Rows of those that the mind has taken."""
        self._rows = 0
        """The last row."""
        super().__init__(bus, agent, read, room, lambda: PATIENCE, missing)

    def restore(self, done: Mapping[Numbered, int]) -> None:
        """Continue where the process before this one ended."""
        super().restore(done)
        self._by_commd |= done.keys()

    def expect(self, progress: Progress, seq: int) -> None:
        """Note that the next message of a numbering will be handed over by its sender."""
        progress.arrived = progress.handed = progress.done = seq
        self.near += 1

    def take(self, message: NearMessage) -> None:
        """Note that an expected message was put into the mind's mailbox."""
        self.waiting.append((message.whose, message.seq, message))
        self._unstored.append(message)
        self.counters["received"] += 1

    def take_again(self, message: NearMessage, refused: bool) -> None:
        """The same for a message that a former life has left in its row; `refused`: the mind does not get it."""
        self.expect(self.of(message.whose), message.seq)
        self._rows = message.number
        if refused:
            self.near -= 1
            self._taken.append(message.number)
        else:
            self.waiting[-1] = message.whose, message.seq, message

    def absorb(self, left: int) -> bool:
        """Note that the mind has `left` messages in its mailbox. Return whether `commd` waits for a save."""
        waiting = self.waiting
        while len(waiting) > left:
            whose, seq, message = waiting.popleft()
            if message is not None:
                message.taken = True
                self.near -= 1
                if message.number:
                    self._taken.append(message.number)
                if whose in self._by_commd:
                    self._passed[whose] = seq
            elif seq:
                self._absorbed[whose] = seq
        return bool(self._absorbed)

    def taken_last(self, left: int) -> tuple[str, str, int] | None:
        """Return sender, numbering and number of the last message that a mind with `left` messages has taken and that
        no save holds."""
        place = len(self.waiting) - left - 1
        if place >= 0 and self.waiting[place][1]:
            whose, seq, _ = self.waiting[place]
        elif self._absorbed:
            whose, seq = next(reversed(self._absorbed.items()))
        else:
            return None
        return whose.sender, whose.numbering, seq

    def captured(self) -> tuple[dict[Numbered, int], dict[Numbered, int], list[int]]:
        """Note that the mind is captured as it is.

        Return the last numbers that it has taken, for which `done` is to be called when they are on disk; those of
        messages which were not from `commd`, where they must be known; and the rows of those that had one.
        """
        absorbed, self._absorbed = self._absorbed, {}
        passed, self._passed = self._passed, {}
        taken, self._taken = self._taken, []
        self._by_commd |= absorbed.keys()
        self._unstored = [message for message in self._unstored if not message.taken]
        return absorbed, passed, taken

    def store(self) -> list[NearMessage]:
        """Give rows to the messages of other agents of the daemon that the mind, as it was captured, has not taken."""
        new, self._unstored = self._unstored, []
        for message in new:
            self._rows += 1
            message.number = self._rows
            if message.taken:
                self._taken.append(message.number)
        return new

    def left(self) -> list[NearMessage]:
        """Return the messages of other agents of the daemon that the mind has not taken."""
        return [message for _, _, message in self.waiting if message is not None]


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
        neighbours: Neighbours,
    ) -> None:
        """`life` is the end of the ids of this life's messages; `rights` say whose mail is accepted, None: all."""
        self.held: list[tuple[MailClient, NearMessage]] = []
        """Messages to agents of this daemon that wait until the mind rests."""
        self.given: Callable[[], None] = lambda: None
        """Called when another agent of the daemon has given it mail."""
        self._bus, self._neighbours = bus, neighbours
        self.mind, self._agent = runner.mind, runner.mind.name
        self._life, self._runner, self._directory = life, runner, directory
        self._rights, self._tracing = rights, tracing
        mailbox = self.mind.mailbox
        self.inbox = AgentInbox(bus, self._agent, lambda: len(mailbox) < INPUTS, self._read, self._missing)
        self.counters = self.inbox.counters
        """What became of messages so far."""
        self.outbox = Outbox(bus, self._agent, self._undelivered, self.counters)
        self.poison: PoisonInputs | None = None
        """Knows the messages that are not to be taken; None: there are none."""
        self._refused: list[tuple[Message, Refusal]] = []
        """Restored messages that are not accepted."""
        self._own = Numbered(self._agent, self.outbox.numbering)
        self._accepted: dict[tuple[str, str], bool] = {}
        """Whose mail of which performatives is accepted, as far as it was asked."""
        neighbours[self._agent] = self

    def send(self, mail: Mail) -> None:
        """Send a message or broadcast when it is on disk, or the mind rests. Raises Failed for its plan."""
        if mail.receiver is not None:
            receivers = [mail.receiver]
        else:  # a broadcast: to all that are known, online or not, but oneself
            receivers = [name for name in self._directory.names if name != self._agent]
        identity = f"{mail.msg_id}.{self._life}"
        far: list[str] = []
        near: list[tuple[MailClient, NearMessage, Progress]] = []
        try:
            for receiver in receivers:
                other = self._neighbours.get(receiver)
                if other is not None:
                    progress = other.inbox.of(self._own)
                    message = self._near_message(other, progress, receiver, mail, identity)
                    if message is not None:
                        near.append((other, message, progress))
                        continue
                far.append(receiver)
            if far:
                self.outbox.post(far, mail.performative, to_wire(mail.content), identity, mail.in_reply_to)
        except (BadTerm, Unsendable) as bad:
            error = bad.reason.code if isinstance(bad, Unsendable) else "not_sendable"
            failed = Failed(error, f"the message cannot be sent: {bad}")
            self._tracing.refused(mail, failed)
            raise failed from None
        for other, message, progress in near:
            other.inbox.expect(progress, message.seq)
            self.outbox.numbers[message.receiver] = message.seq
            self.held.append((other, message))
        self._tracing.sent(mail, receivers)

    # --- to and from agents of the same daemon ---

    def _near_message(
        self, other: MailClient, progress: Progress, receiver: str, mail: Mail, identity: str
    ) -> NearMessage | None:
        """Return a message to an agent of this daemon, which has made `progress` with the mail of this one.

        None if it has to go by `commd`: those before it are not on disk, or it may not be taken. Raises BadTerm and
        Unsendable.
        """
        answered = mail.in_reply_to
        if answered:
            answered = answered.removesuffix(f".{other._life}")
        seq, content = self.outbox.numbers[receiver] + 1, mail.content
        if progress.done != seq - 1 or not other._may_take(self._agent, mail.performative, answered):
            return None
        small = is_small(content)
        if not small:
            content = from_wire(to_wire(content))
        elif mail.performative not in QUESTIONS:  # its receiver copies a question, to solve it
            content = detached(content)
        given = Mail(self._agent, mail.performative, content, identity, answered)
        message = NearMessage(given, receiver, mail.in_reply_to, self._own, seq)
        if small or len(message.encoded(self._bus.wire, time.time_ns())) <= MOST_BYTES:
            return message
        return None

    def _may_take(self, sender: str, performative: str, answered: str) -> bool:
        """Whether a message of another agent of this daemon can be taken as it is."""
        if self.inbox.near >= MOST or (self.poison is not None and self.poison.is_watchful):
            return False
        if self._rights is None or is_answer(answered):
            return True
        accepted = self._accepted.get((sender, performative))
        if accepted is None:
            accepted = self._accepted[sender, performative] = self._rights.accepts(sender, performative)
        return accepted

    def release(self) -> None:
        """Give the held messages to their receivers."""
        held, self.held = self.held, []
        for other, message in held:
            if self._neighbours.get(message.receiver) is other:
                other._runner.feed(message.mail)
                other.inbox.take(message)
                other.given()
            else:  # it has left
                self.outbox.put(message.encoded(self._bus.wire, time.time_ns()), message.receiver, message.seq)
        self.counters["near"] += len(held)

    def rows(self) -> list[tuple[int, bytes]]:
        """Return the new rows of messages that the mind, as it was captured last, has not taken."""
        wire, stamp = self._bus.wire, time.time_ns()
        return [(message.number, message.encoded(wire, stamp)) for message in self.inbox.store()]

    def restore(self, number: int, message: Message) -> None:
        """Give the mind a message that a former life has left in its row."""
        kept = Mail(message.sender, message.performative, message.content, message.id)
        whose = Numbered(message.sender, message.header.boot)
        near = NearMessage(kept, self._agent, message.in_reply_to, whose, message.header.seq)
        near.number = number
        try:
            hand_over = self._read(message)
        except MessageRefused as bad:
            self._refused.append((message, bad.reason))
            self.inbox.take_again(near, refused=True)
        else:
            hand_over()
            self.inbox.take_again(near, refused=False)

    def return_refused(self) -> None:
        """Notify senders of restored messages that are not accepted."""
        for message, why in self._refused:
            self._return(message, why)
        self._refused.clear()

    def leave(self) -> None:
        """Take no mail any more; what the mind has not taken comes again in the next life."""
        self.inbox.withdraw()
        self._neighbours.pop(self._agent, None)

    def return_left(self) -> None:
        """Notify the senders in this daemon of what the mind has not taken: there is no next life."""
        for message in self.inbox.left():
            self._return(message.message(time.time_ns()), Refusal(code="receiver_left"))

    def _return(self, message: Message, why: Refusal) -> None:
        log.warning("mail_refused id=%s receiver=%s why=%s", message.id, message.receiver, why)
        if (sender := self._neighbours.get(message.sender)) is not None:
            sender._undelivered(message, why)

    def tell(self, mail: Mail, whose: Numbered = _NOBODY, seq: int = 0) -> None:
        """Give the mind a message; one that is not from `commd` has no number."""
        self._directory.met(mail.sender)
        self._runner.feed(mail)
        self.inbox.waiting.append((whose, seq, None))

    def _read(self, message: Message) -> Callable[[], None]:
        # The answer to a question of a former life keeps its whole id: nobody waits for it.
        answered = message.in_reply_to.removesuffix(f".{self._life}")
        if self._rights is not None and not (is_answer(answered) or self._rights.accept(message)):
            self._not_accepted(message)
        try:
            content = from_wire(message.content)
        except BadTerm as bad:
            self.counters["bad"] += 1
            log.warning("agent=%s bad_mail sender=%s why=%s", self._agent, message.sender, bad)
            raise MessageRefused(Refusal(code="unreadable", text=f"it cannot be read: {bad}")) from None
        whose, seq, poison = Numbered(message.sender, message.header.boot), message.header.seq, self.poison
        if poison is not None and poison.is_set_aside((*whose, seq), lambda: event_of(self.mind, message, content)):
            text = "set aside: it ended the receiver's process several times"
            raise MessageRefused(Refusal(code="set_aside", text=text))
        mail = Mail(message.sender, message.performative, content, message.id, answered)
        return partial(self.tell, mail, whose, seq)

    def _missing(self, sender: str, count: int) -> None:
        """Notify the mind that messages of a sender have not arrived."""
        log.warning("agent=%s mail_missing sender=%s messages=%d", self._agent, sender, count)
        self.signal("mail_missing", atom(sender), float(count))

    def signal(self, functor: str, *args: object) -> None:
        """Notify the mind of something about mail, as an event."""
        self.tell(Mail(OFFICE, "signal", Literal(signature(functor, len(args)), args), f"{functor}.{boot_id()}"))

    def _not_accepted(self, message: Message) -> None:
        """Refuse a message that its sender may not send to this agent. Raises MessageRefused."""
        self.counters[NOT_ACCEPTED] += 1
        if is_logged(count := self.counters[NOT_ACCEPTED]):
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
