"""Restore the agents of a daemon: find and open their checkpoint, give back their mail and actions, resume their goals
(docs/guides/restart.md).

The checkpoint is the file `STATE/FLEET/DAEMON.minds`, by the name of the daemon. The folder of each agent names the
file that has its state, so that a mission may give its agents to other daemons: their state moves with them.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from msgspec import structs

from agentd.extensions.file_access import KEPT
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
from agentd.mind.persistence.pending_events import Origin
from agentd.persistence.checkpoint import (
    DAMAGED,
    AgentRows,
    Checkpoint,
    CheckpointError,
    LifeRow,
    Outgoing,
    Synchronous,
    remove,
)
from commd.client.receive_once import Numbered
from commd.process.sqlite_file import TooNew
from commd.process.state_dir import make_private_folder, replace_file
from schemas.wire.codec import BadRecord, Codec, R, codec
from schemas.wire.records import Action, Message, Note

log = logging.getLogger("keeping")

ENDING: Final = ".minds"


@dataclass
class RestoredState:
    """The state of one agent in a checkpoint."""

    path: Path
    """The checkpoint."""
    folder: Path
    """Of the agent's other files."""
    stored: AgentRows | None
    """None: the agent begins for the first time."""
    notes: list[Note] = field(default_factory=list)
    """Damage that was found."""
    actions: list[Action] = field(default_factory=list)
    """Actions that the last life had begun, or was about to begin."""
    _unread: AgentRows = field(default_factory=AgentRows)
    """The rows that cannot be read, to be removed."""

    @property
    def life(self) -> int:
        """The number of restarts of the agent, this one included; 0: it begins."""
        return 0 if self.stored is None or self.stored.life is None else self.stored.life.lives

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

    async def went_back(self, stored: AgentRows, mailing: MailClient) -> str:
        """Ask the board whether it has mail that this checkpoint does not know: return a warning, or an empty text."""
        if stored.life is None or not stored.life.numbering:
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

    def first_saving(self, mailing: MailClient, program: bytes) -> AgentRows:
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
        return self.stored is None or self.stored.life is None or self.stored.life.program == program


def _read(made: Codec[R], kept: bytes) -> R:
    """Decode a record in the wire format in which it was saved."""
    return made.decode(kept, made.encodings["json" if kept[:1] == b"{" else "msgpack"])


# --- the files ---


def open_state(
    folder: Path, daemon: str, kept: Iterable[str], fresh: Iterable[str], synchronous: Synchronous
) -> tuple[Checkpoint | None, dict[str, RestoredState]]:
    """Open the checkpoint of a daemon, or make it. Return it, and the state of each agent that is `kept`.

    The old state of `fresh` agents is removed, unsent mail included, and that is logged. Without agents to keep there
    is no checkpoint. Blocks. Raises CheckpointError.
    """
    kept, fresh = list(kept), set(fresh)
    path = folder / f"{daemon}{ENDING}"
    if not (kept or path.exists() or any(_named(folder, agent) for agent in fresh)):
        return None, {}
    try:
        return _opened(folder, path, kept, fresh, synchronous)
    except OSError as error:
        raise CheckpointError(f"{path}: {error.strerror or error}") from None


def _opened(
    folder: Path, path: Path, kept: list[str], fresh: set[str], synchronous: Synchronous
) -> tuple[Checkpoint | None, dict[str, RestoredState]]:
    notes: list[Note] = []
    checkpoint = _open(path, synchronous, replace=fresh.issuperset(kept))
    try:
        notes += _move_in(folder, checkpoint, [agent for agent in kept if agent not in fresh], synchronous)
        found = checkpoint.read()
        for agent in fresh & found.keys():
            log.warning("agent=%s forgets what it was; messages=%d are lost", agent, len(found[agent].outgoing))
        if fresh:
            checkpoint.forget(fresh)
        states = {}
        for agent in kept:
            make_private_folder(folder / agent)
            if _named(folder, agent) != path.name:
                _name(folder, agent, path.name, sync=False)
            stored = None if agent in fresh else found.get(agent)
            states[agent] = RestoredState(path, folder / agent, stored, [*checkpoint.notes])
    except BaseException:
        checkpoint.close()
        raise
    for agent in fresh.difference(kept):
        forget_name(folder, agent)
    for note in notes:
        log.error("%s", note.text)
        states[note.about].notes.append(note)
    if kept:
        return checkpoint, states
    checkpoint.close()
    return None, {}


def _open(path: Path, synchronous: Synchronous, replace: bool) -> Checkpoint:
    """Open a file; `replace` one of a newer version. Raises CheckpointError."""
    try:
        return Checkpoint.open(path, synchronous)
    except CheckpointError as error:
        if not (replace and isinstance(error.__cause__, TooNew)):
            raise
        log.warning("what is kept is removed unread: %s", error)
        remove(path)
        return Checkpoint.open(path, synchronous)


def _move_in(folder: Path, into: Checkpoint, agents: Iterable[str], synchronous: Synchronous) -> list[Note]:
    """Move the state of agents that another file has. Return what is missing. Raises CheckpointError.

    Until the agent's folder names the new file, the old one counts.
    """
    elsewhere: dict[str, list[str]] = {}
    for agent in agents:
        name = _named(folder, agent)
        if name and name != into.path.name:
            elsewhere.setdefault(name, []).append(agent)
    notes: list[Note] = []
    for name, moved in elsewhere.items():
        path = folder / name
        if not path.exists():
            text = "{agent} starts without its state: the file {path} that had it is gone"
            notes += [Note(DAMAGED, text.format(agent=agent, path=path), agent) for agent in moved]
            continue
        try:
            other = Checkpoint.open(path, synchronous)
        except CheckpointError as error:
            whose = f"it has the state of {', '.join(moved)}"
            raise CheckpointError(f"{error}; {whose}: end the agentd that had them before, or use --fresh") from error
        try:
            found = other.read()
            into.forget(moved)  # an earlier move may have been cut short
            into.save({agent: found[agent] for agent in moved if agent in found})
            for agent in moved:
                _name(folder, agent, into.path.name, sync=True)
            other.forget(moved)
        finally:
            other.close()
        notes += [structs.replace(note, about=agent) for note in other.notes for agent in moved]
        log.info("moved=%s from=%s to=%s", ",".join(moved), name, into.path.name)
    return notes


def _named(folder: Path, agent: str) -> str:
    """Return the name of the file that has the state of an agent; empty if none is named."""
    try:
        text = (folder / agent / KEPT).read_text(errors="replace")
    except (FileNotFoundError, NotADirectoryError):
        return ""
    name = text.removesuffix("\n")
    whole = text.endswith(f"{ENDING}\n") and "/" not in name  # a power failure may have cut it
    return name if whole else ""


def _name(folder: Path, agent: str, name: str, *, sync: bool) -> None:
    """Name the file that has the state of an agent. Raises OSError."""
    replace_file(folder / agent / KEPT, f"{name}\n".encode(), synced=sync)


def forget_name(folder: Path, agent: str) -> None:
    """Name no file: the agent begins without a past."""
    with suppress(OSError):
        (folder / agent / KEPT).unlink()


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
        keeper.origins.mark(mind.events[-1], Origin.OTHERS)


def _raise_event(mind: Mind, literal: Literal) -> None:
    """Raise an event of the agent's own without a belief."""
    mind.post(mind.plans.relevant("+", "", literal.sig), literal.args, with_source(literal.annots))
