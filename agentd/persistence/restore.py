"""Restore an agent from its checkpoint: open the file, give back its mail and actions, resume its goals
(docs/guides/restart.md).
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.from_ast import Instantiation
from agentd.language.terms.terms import Literal
from agentd.mail.mail_client import MailClient
from agentd.mind import Mind
from agentd.mind.beliefs.dynamic_formulas import FunctionsOf
from agentd.mind.beliefs.term_copy import with_source
from agentd.mind.execution.goal_execution import add_goal
from agentd.mind.persistence.change_tracking import Keeper
from agentd.persistence.checkpoint import DAMAGED, LifeRow, Outgoing, Saving, Stored
from commd.client.receive_once import Numbered
from schemas.wire.codec import BadRecord, Codec, R, codec
from schemas.wire.records import Action, Message, Note

log = logging.getLogger("keeping")


@dataclass
class RestoredState:
    """The state of one agent in a checkpoint."""

    path: Path
    """The checkpoint."""
    folder: Path
    """Of the agent's other files."""
    stored: Stored | None
    """None: the agent begins for the first time."""
    notes: list[Note] = field(default_factory=list)
    """Damage that was found."""
    actions: list[Action] = field(default_factory=list)
    """Actions that the last life had begun, or was about to begin."""
    _unread: Saving = field(default_factory=Saving)
    """The rows that cannot be read, to be removed."""

    @property
    def life(self) -> int:
        """The number of restarts of the agent, this one included; 0: it begins."""
        return 0 if self.stored is None else self.stored.life.lives

    @property
    def correspondents(self) -> set[str]:
        """The agents that have received mail from this one, or sent it any."""
        stored = self.stored
        return set() if stored is None else {*stored.next_seq, *(sender for sender, _ in stored.absorbed)}

    def restore(self, mailing: MailClient) -> None:
        """Restore the unsent messages and the numbers of the received ones.

        A damaged row is logged, noted and left out: it must not prevent the daemon from starting.
        """
        stored = self.stored
        if stored is None:
            return
        messages: list[Outgoing] = []
        for one in stored.outgoing:
            try:
                message = codec(Message).encode(_read(codec(Message), one.message), mailing.outbox.wire)
                messages.append(one._replace(message=message))
            except BadRecord as bad:
                self._unread.delivered.append(one.number)
                what = f"message {one.seq} to {one.receiver}"
                self._lost(what, what, bad)
        for identity, kept in stored.actions.items():
            try:
                self.actions.append(_read(codec(Action), kept.parameters))
            except BadRecord as bad:
                self._unread.ended.append(identity)
                what = f"the action {kept.name} ({identity}), which may have begun,"
                self._lost(what, f"action {identity}", bad)
        mailing.outbox.restore(messages)
        mailing.inbox.restore({Numbered(*whose): seq for whose, seq in stored.absorbed.items()})
        for number, kept_message in stored.incoming:
            try:
                mailing.restore(number, _read(codec(Message), kept_message))
            except BadRecord as bad:
                self._unread.taken.append(number)
                self._lost(f"message {number} of another agent of the daemon", f"incoming {number}", bad)

    async def went_back(self, stored: Stored, mailing: MailClient) -> str:
        """Ask the board whether it has mail that this checkpoint does not know: return a warning, or an empty text."""
        if not stored.life.numbering:
            return ""
        ahead = await mailing.outbox.ahead(
            stored.life.numbering, {one: seq - 1 for one, seq in stored.next_seq.items()}
        )
        if not ahead:
            return ""
        whom = ", ".join(f"{count} to {receiver}" for receiver, count in sorted(ahead.items()))
        return (
            f"{self.path} is older than what the agent has done (a backup, or a damaged file): its board has"
            f" taken messages that are not known here: {whom}; the agent may do and say again what it did then"
        )

    def first_saving(self, mailing: MailClient, program: bytes) -> Saving:
        """Return the first save of this life; `program` is the digest of the agent's program."""
        saving = self._unread
        saving.life = LifeRow(mailing.outbox.numbering, self.life + 1, program)
        if self.stored is not None:
            saving.next_seq = dict.fromkeys(self.stored.next_seq, 1)
        return saving

    def _lost(self, what: str, about: str, why: BadRecord) -> None:
        note = Note(DAMAGED, f"{self.path}: {what} cannot be read and is lost: {why}", about)
        log.error("%s", note.text)
        self.notes.append(note)

    def is_of(self, program: bytes) -> bool:
        """Return whether the last life ran the program with this digest."""
        return self.stored is None or self.stored.life.program == program


def _read(made: Codec[R], kept: bytes) -> R:
    """Decode a record in the wire format in which it was saved."""
    return made.decode(kept, made.encodings["json" if kept[:1] == b"{" else "msgpack"])


# --- the restored mind ---

RESTARTED = signature("restarted", 1)


def come_back(
    mind: Mind, keeper: Keeper, life: int, interrupted: Iterable[Literal], instead: nodes.Goal | None
) -> None:
    """Raise `+restarted(N)` for restart `life` (from 1) and an event for each interrupted action, then resume goals.

    Goals that others asked for are always resumed. The agent's own pending goals are resumed unless the program has a
    plan for `+restarted(N)`, which then decides, or the mission file names a goal `instead` of them.
    """
    decides = bool(mind.plans.relevant("+", "", RESTARTED).plans)
    _raise_event(mind, Literal(RESTARTED, (float(life),)))
    for one in interrupted:
        raise_interrupted(mind, keeper, one)
    own = not decides and instead is None
    posted = keeper.resume(own=own)
    log.info("agent=%s restarted=%d resumed=%d", mind.name, life, posted)
    if not own and keeper.pending_own:
        log.info("agent=%s left to the program: %s", mind.name, "; ".join(map(str, keeper.pending_own)))
    if instead is not None and not decides:
        add_goal(mind, Instantiation({}, FunctionsOf(mind)).term(instead.literal), instead.operator)


def raise_interrupted(mind: Mind, keeper: Keeper, literal: Literal) -> None:
    """Raise the event of an action of a former life that has ended.

    The event is resumed after further restarts too, because saving it removes the action from the checkpoint.
    """
    before = len(mind.events)
    _raise_event(mind, literal)
    if len(mind.events) > before:
        keeper.give_in_any_case(mind.events[-1])


def _raise_event(mind: Mind, literal: Literal) -> None:
    """Raise an event of the agent's own without a belief."""
    mind.post(mind.plans.relevant("+", "", literal.sig), literal.args, with_source(literal.annots))
