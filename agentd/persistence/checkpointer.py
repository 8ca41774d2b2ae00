"""Decide what of an agent a commit holds, and when: immediately when an action waits for it, else at intervals.

A commit has the changes of the mind, the mail sent and received, and the actions about to begin; what waits for it
continues when it is on disk (`group_commit`).
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

from agentd.mail.mail_client import MailClient
from agentd.mind.persistence.change_tracking import Keeper
from agentd.persistence.checkpoint import ActionInFlight, AgentRows, Outgoing
from agentd.persistence.group_commit import ATOMIC_PATIENCE, BUSY_PATIENCE, Batch, GroupCommit
from agentd.persistence.restore import RestoredState
from agentd.runtime.mind_runner import MindRunner
from commd.client.receive_once import Numbered
from commd.common.tasks import Alarm
from schemas.wire.codec import Wire, codec
from schemas.wire.records import Action, Note

log = logging.getLogger("keeping")

MAIL_EVERY = 0.005
"""Wall seconds from the beginning of a commit to that of the next for which mail or a receipt waits."""
NEAR_EVERY = 0.1
"""The same for mail between agents of the daemon, which waits for no commit."""
OTHERS_EVERY = 0.5
"""The same for all else."""
ACTION_PATIENCE = 0.3
"""Wall seconds for which an action waits for its commit; a slow disk must not keep a robot from acting."""
LIFE_PATIENCE = 1.0
"""The same for an agent that restarts."""
LAST_PATIENCE = 3.0
"""Wall seconds that the last commit of an agent that leaves may take."""


class Checkpointer:
    """The changes of one agent. One that is not kept has none, but what leaves it waits for what others must keep."""

    def __init__(
        self,
        commits: GroupCommit,
        restored: RestoredState | None,
        keeper: Keeper | None,
        runner: MindRunner,
        mailing: MailClient,
        wire: Wire,
    ) -> None:
        """`restored` and `keeper` are None for an agent that is not kept."""
        self.counters: Counter[str] = Counter()
        """`saved` and `failed`: transactions that had changes of the agent; what was not kept."""
        self.first: AgentRows | None = None
        """Further content of the first commit of this life."""
        self._notes: list[Note] = [] if restored is None else list(restored.notes)
        self._agent, self._mind = runner.mind.name, runner.mind
        self._commits, self._keeper, self._mailing, self._wire = commits, keeper, mailing, wire
        mailing.given = partial(commits.give, self)
        self._begun: dict[str, ActionInFlight] = {}
        """Actions that no commit has yet."""
        self._waiting: dict[str, tuple[float, Callable[[], None]]] = {}
        """Actions that are not on disk: the loop time until which they wait, and what is called then."""
        self._alarm = Alarm(self._begin_unkept)
        self._ended: list[str] = []
        self._since: float | None = None
        """Loop time of the oldest change that is not captured."""
        self._quiet = True
        """Whether the mind had nothing to do after its last turn."""
        self._exposed = False
        """Whether others of the daemon know more of the agent than was captured."""

    def notes(self) -> tuple[Note, ...]:
        """Return why saving fails now, and what was wrong with the file."""
        if self._keeper is None or not self._commits.problem:
            return tuple(self._notes)
        text = f"agent {self._agent} cannot be kept, and its mail waits: {self._commits.problem}"
        return (Note("state_not_kept", text), *self._notes)

    def add_note(self, note: Note) -> None:
        """Log a warning about the restored state, and note it for the rest of this life."""
        log.error("agent=%s %s", self._agent, note.text)
        self._notes.append(note)

    async def count_life(self) -> None:
        """Save that another life begins, before it has any effect; wait for that, at most `LIFE_PATIENCE`."""
        await asyncio.wait([asyncio.ensure_future(self._commits.flush(self))], timeout=LIFE_PATIENCE)

    # --- actions ---

    def begun(self, action: Action, then: Callable[[], None]) -> None:
        """Note an action that is about to be requested; the next `look` begins to save it.

        `then()` is called when it is on disk, or after `ACTION_PATIENCE`; behind the turn, with all that this ends.
        """
        loop = asyncio.get_running_loop()
        self._begun[action.id] = ActionInFlight(action.name, codec(Action).encode(action, self._wire))
        if self._commits.problem:
            self.counters["actions_unkept"] += 1
            loop.call_soon(then)
            return
        due = loop.time() + ACTION_PATIENCE
        self._waiting[action.id] = due, then
        self._alarm.by(due)

    def _begin_unkept(self) -> None:
        """Let actions begin that have waited for too long."""
        for identity, (due, then) in list(self._waiting.items()):
            if asyncio.get_running_loop().time() < due:
                self._alarm.by(due)
                return
            del self._waiting[identity]
            self.counters["actions_unkept"] += 1
            log.warning("agent=%s action=%s begins before it is written down: the disk is slow", self._agent, identity)
            then()

    def ended(self, identity: str) -> None:
        """Note that an action has ended; it is removed from the file when the mind has taken that."""
        if self._commits.problem and self._begun.pop(identity, None) is not None:
            return  # it was never saved
        self._ended.append(identity)

    # --- when ---

    @property
    def atomic(self) -> bool:
        """Whether an atomic plan runs."""
        return self._mind.atomic is not None

    def look(self, quiet: bool) -> None:
        """Ask for a commit of what has changed. Call it between two runs of the mind, when its effects are carried out.

        `quiet`: the mind has nothing to do.
        """
        mailing, commits = self._mailing, self._commits
        outbox = mailing.outbox
        self._quiet = quiet
        mail = mailing.inbox.absorb(len(self._mind.mailbox)) or bool(outbox.unsaved)
        near = self._exposed or bool(mailing.held)
        if not (
            mail
            or near
            or self._begun
            or self._ended
            or outbox.gone
            or self.first is not None
            or (self._keeper is not None and self._keeper.dirty)
        ):
            self._since = None
            return
        if not quiet:
            now = asyncio.get_running_loop().time()
            if self._since is None:
                self._since = now
            if not self._is_whole(now):
                if self._exposed:
                    commits.busy.add(self)
                return
        if mailing.held:
            mailing.release()
            self._exposed = True
        commits.busy.discard(self)
        commits.ask(self, 0.0 if self._begun else MAIL_EVERY if mail else NEAR_EVERY if near else OTHERS_EVERY)

    def _is_whole(self, now: float) -> bool:
        """Return whether the mind may be saved as it is, at a loop time."""
        if self._quiet or (self._begun and self._mind.atomic is None):
            return True
        patience = BUSY_PATIENCE if self._mind.atomic is None else ATOMIC_PATIENCE
        return self._since is not None and now >= self._since + patience

    def capture(self, batch: Batch, now: float) -> bool:
        """Add the changes since the last call to a commit, at a loop time. Return whether they may be written now."""
        if not (self._exposed or self._is_whole(now)):
            return False
        mailing, outbox, inbox = self._mailing, self._mailing.outbox, self._mailing.inbox
        inbox.absorb(len(self._mind.mailbox))
        exposed, self._exposed, self._since = self._exposed or bool(mailing.held), False, None
        if mailing.held:
            mailing.release()
        self._commits.busy.discard(self)
        sent, outbox.unsaved = outbox.unsaved, []
        delivered: list[int] = []
        if not self._mind.mailbox:  # the mind has taken the notices of refused ones
            delivered, outbox.gone = outbox.gone, []
        begun, self._begun = self._begun, {}
        ended: list[str] = []
        if not self._mind.inputs:  # the mind has taken the ends of these actions
            ended, self._ended = self._ended, []
        absorbed, passed, taken = inbox.captured()
        if self._keeper is not None:
            saving, self.first = self.first or AgentRows(), None
            mind = self._keeper.changes()
            for what in mind.unkept:
                self.counters["unkept"] += 1
                log.warning("agent=%s %s", self._agent, what)
            saving.mind = mind
            saving.absorbed = {(one.sender, one.numbering): seq for one, seq in (*passed.items(), *absorbed.items())}
            saving.taken = taken
            saving.outgoing = sent
            saving.delivered += delivered
            saving.next_seq |= {one.receiver: one.seq + 1 for one in sent}
            saving.ended += ended
            saving.actions = {one: action for one, action in begun.items() if one not in saving.ended}
            if saving != AgentRows():
                batch.savings[self._agent] = saving
                batch.members.append(self)
                batch.soft &= not (sent or absorbed or saving.actions or exposed)
        batch.messages += len(sent)
        if sent or absorbed or begun:
            batch.done.append(partial(self._done, sent, absorbed, begun))
        return True

    def _done(self, sent: Sequence[Outgoing], absorbed: Mapping[Numbered, int], begun: Iterable[str]) -> None:
        """Continue what has waited for a commit."""
        if absorbed:
            self._mailing.inbox.done(absorbed)
        if sent:
            self._mailing.outbox.saved(sent)
        for identity in begun:
            if waiting := self._waiting.pop(identity, None):
                waiting[1]()

    def add_mail(self, batch: Batch) -> None:
        """Add the mail of other agents of the daemon that the mind, as captured last, has not taken."""
        rows = self._mailing.rows()
        if rows and self._keeper is not None:
            saving = batch.savings.get(self._agent)
            if saving is None:
                saving = batch.savings[self._agent] = AgentRows()
                batch.members.append(self)
            saving.incoming += rows
            batch.soft = False

    # --- the end ---

    async def finish(self) -> None:
        """Save the rest within `LAST_PATIENCE` wall seconds, so that another life can continue."""
        self._quiet = True
        try:
            async with asyncio.timeout(LAST_PATIENCE):
                await self._commits.flush(self)
        except TimeoutError:
            why = self._commits.problem or "the disk is slow"
            log.error("agent=%s the last of it could not be kept: %s", self._agent, why)

    def leave(self) -> None:
        """Take no part in commits any more."""
        self._commits.leave(self)
        self._alarm.cancel()
