"""What an agent has on disk when it begins: its checkpoint, and what it was when that was written."""

from __future__ import annotations

import asyncio
import logging
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from agentd.extensions.file_access import KEPT
from agentd.mail.mail_client import MailClient
from agentd.mail.outbox import OutgoingMessage
from agentd.persistence.checkpoint import DAMAGED, Checkpoint, CheckpointError, Saving, Stored
from agentd.persistence.sqlite_file import remove
from commd.client.receive_once import Numbered
from commd.process.state_dir import make_private_folder
from schemas.wire.codec import BadRecord, Codec, R, codec
from schemas.wire.records import Action, Message, Note

log = logging.getLogger("keeping")

FILE = KEPT
"""In the agent's folder of state."""


@dataclass
class RestoredState:
    """The checkpoint of one agent."""

    checkpoint: Checkpoint
    stored: Stored | None
    """None: the agent begins for the first time."""
    writer: Executor
    """Has the one thread in which the checkpoints of a daemon are written."""
    synchronous: Literal["full", "normal"]
    actions: list[Action] = field(default_factory=list)
    """What the last life had begun, or was about to begin."""
    _unread: Saving = field(default_factory=Saving)
    """The rows that cannot be read, to be removed."""

    @property
    def life(self) -> int:
        """How often the agent has been started again, this time included; 0: it begins."""
        return 0 if self.stored is None else self.stored.lives

    @property
    def correspondents(self) -> set[str]:
        """Whom the agent has written to, and who has written to it."""
        stored = self.stored
        return set() if stored is None else {*stored.next_seq, *(sender for sender, _ in stored.absorbed)}

    def restore(self, mailing: MailClient) -> None:
        """Give the mail of the agent what the last life had not handed over, and what it has taken.

        A row that is damaged is told and left out: it must not keep a daemon from beginning.
        """
        stored = self.stored
        if stored is None:
            return
        messages: list[OutgoingMessage] = []
        for one in stored.outgoing:
            try:
                messages.append(OutgoingMessage(one.number, _read(codec(Message), one.message), len(one.message)))
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

    async def went_back(self, stored: Stored, mailing: MailClient) -> str:
        """Ask the board whether it has taken mail that this state knows nothing of: say how much, or nothing."""
        if not stored.numbering:
            return ""
        ahead = await mailing.outbox.ahead(stored.numbering, {one: seq - 1 for one, seq in stored.next_seq.items()})
        if not ahead:
            return ""
        whom = ", ".join(f"{count} to {receiver}" for receiver, count in sorted(ahead.items()))
        return (
            f"{self.checkpoint.path} is older than what the agent has done (a backup, or a damaged file): its board has"
            f" taken messages that are not known here: {whom}; the agent may do and say again what it did then"
        )

    def first_saving(self, mailing: MailClient, program: bytes) -> Saving:
        """Return what the first save of this life holds in any case; `program` stands for what the agent runs."""
        extra = {"program": program}
        begun = {} if self.stored is None else dict.fromkeys(self.stored.next_seq, 1)
        return replace(
            self._unread, next_seq=begun, numbering=mailing.outbox.numbering, lives=self.life + 1, extra=extra
        )

    def _lost(self, what: str, about: str, why: BadRecord) -> None:
        note = Note(DAMAGED, f"{self.checkpoint.path}: {what} cannot be read and is lost: {why}", about)
        log.error("%s", note.text)
        self.checkpoint.notes.append(note)

    def is_of(self, program: bytes) -> bool:
        """Whether the last life has run the same program."""
        return self.stored is None or self.stored.extra.get("program", program) == program


async def open_memory(
    folder: Path, agent: str, writer: Executor, synchronous: Literal["full", "normal"], *, fresh: bool
) -> RestoredState:
    """Open an agent's checkpoint, or make it. Raises CheckpointError.

    `fresh` forgets what is there, mail that has not left included, and says so.
    """
    path = folder / FILE

    def work() -> RestoredState:
        make_private_folder(path.parent)
        mode: Literal["FULL", "NORMAL"] = "FULL" if synchronous == "full" else "NORMAL"
        try:
            checkpoint = Checkpoint.open(path, agent, mode)
        except CheckpointError as error:
            if not fresh or error.__cause__ is not None:  # somebody has it open, or the disk does not do it
                raise
            log.warning("agent=%s what is kept is removed unread: %s", agent, error)
            remove(path)
            checkpoint = Checkpoint.open(path, agent, mode)
        stored = checkpoint.read()
        if fresh and stored is not None:
            log.warning("agent=%s forgets what it was; messages=%d are lost", agent, len(stored.outgoing))
            checkpoint.forget()
            checkpoint, stored = Checkpoint.open(path, agent, mode), None
        return RestoredState(checkpoint, stored, writer, synchronous)

    try:
        memory = await asyncio.get_running_loop().run_in_executor(writer, work)
    except OSError as error:
        raise CheckpointError(f"{path}: {error.strerror or error}") from None
    for note in memory.checkpoint.notes:
        log.error("agent=%s %s", agent, note.text)
    return memory


def _read(made: Codec[R], kept: bytes) -> R:
    """Decode a record that was written in the wire format of then."""
    return made.decode(kept, made.encoding("json" if kept[:1] == b"{" else "msgpack"))
