"""Decide when an agent is saved: immediately when mail or an action waits for it, else at intervals.

One save at a time. It has the changes of the mind, the mail sent and received, and the actions about to begin, in one
transaction; what waits for it continues when it is on disk. A full disk delays mail, not the mind: the same save is
repeated until it succeeds.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from agentd.mail.mail_client import MailClient
from agentd.mind.persistence.change_tracking import Keeper
from agentd.persistence.checkpoint import ActionInFlight, CheckpointError, Saving
from agentd.persistence.restore import RestoredState
from agentd.runtime.mind_runner import MindRunner
from schemas.wire.codec import Wire, codec
from schemas.wire.records import Action, Note

log = logging.getLogger("keeping")

MAIL_EVERY = 0.02
"""Wall seconds from the beginning of a save to that of the next for which mail waits."""
OTHERS_EVERY = 0.5
"""The same for saves for which nothing waits."""
BUSY_PATIENCE = 0.5
"""Wall seconds after which a mind that is always busy is saved nevertheless."""
ATOMIC_PATIENCE = 10.0
"""The same while an atomic plan runs: it should be saved whole or not at all."""
ACTION_PATIENCE = 0.3
"""Wall seconds for which an action waits for its save; a slow disk must not keep a robot from acting."""
LIFE_PATIENCE = 1.0
"""The same for an agent that restarts."""
RETRY_FIRST, RETRY_MOST = 0.2, 5.0
"""Wall seconds between two attempts of a save that failed, doubling."""
LAST_PATIENCE = 3.0
"""Wall seconds that the last save of an agent that leaves may take."""
SLOW = 10.0
"""Wall seconds after which a save under way is logged and counts as failed: actions do not wait for it."""
CLOSE_PATIENCE = 10.0
"""Wall seconds for closing or removing the file; all agents of a daemon share the writer."""


class Checkpointer:
    """The saves of one agent."""

    def __init__(
        self, memory: RestoredState, keeper: Keeper, runner: MindRunner, mailing: MailClient, wire: Wire
    ) -> None:
        self.counters: Counter[str] = Counter()
        self.problem = ""
        """Why saving fails now; empty: it does not."""
        self.first: Saving | None = None
        """Further content of the first save of this life."""
        self._notes = list(memory.checkpoint.notes)
        self._agent, self._mind = runner.mind.name, runner.mind
        self._keeper, self._runner, self._mailing = keeper, runner, mailing
        self._checkpoint, self._writer = memory.checkpoint, memory.writer
        self._wire = wire
        self._begun: dict[str, ActionInFlight] = {}
        """Actions that no save has yet."""
        self._waiting: list[asyncio.Future[None]] = []
        """Done when the actions in `_begun` are on disk."""
        self._ended: list[str] = []
        self._saving: asyncio.Future[None] | None = None
        """The save under way."""
        self._slow: asyncio.TimerHandle | None = None
        """Notes when that takes too long."""
        self._again = False
        """Whether `look` was called meanwhile."""
        self._last = -OTHERS_EVERY
        self._since: float | None = None
        """Loop time of the oldest change that is not saved."""

    def notes(self) -> tuple[Note, ...]:
        """Return why saving fails now, and what was wrong with the file."""
        return (*((Note("state_not_kept", self.problem),) if self.problem else ()), *self._notes)

    def add_note(self, note: Note) -> None:
        """Log a warning about the restored state, and note it for the rest of this life."""
        log.error("agent=%s %s", self._agent, note.text)
        self._notes.append(note)

    async def count_life(self) -> None:
        """Save that another life begins, before it has any effect; wait for that, at most `LIFE_PATIENCE`."""
        if self.first is None:
            return
        saving, self.first = self.first, None
        await asyncio.wait([self._write(saving, lambda: None)], timeout=LIFE_PATIENCE)

    # --- actions ---

    def begun(self, action: Action) -> asyncio.Future[None]:
        """Note an action that is about to be requested; the next `look` begins to save it.

        The future is done when it is on disk, or after `ACTION_PATIENCE`.
        """
        loop = asyncio.get_running_loop()
        self._begun[action.id] = ActionInFlight(action.name, codec(Action).encode(action, self._wire))
        waiting: asyncio.Future[None] = loop.create_future()
        if self.problem:
            self.counters["actions_unkept"] += 1
            waiting.set_result(None)
            return waiting

        def late() -> None:
            if not waiting.done():
                waiting.set_result(None)
                self.counters["actions_unkept"] += 1
                log.warning(
                    "agent=%s action=%s begins before it is written down: the disk is slow", self._agent, action.id
                )

        loop.call_later(ACTION_PATIENCE, late)
        self._waiting.append(waiting)
        return waiting

    def ended(self, identity: str) -> None:
        """Note that an action has ended; it is removed from the file when the mind has taken that."""
        if self.problem and self._begun.pop(identity, None) is not None:
            return  # it was never saved
        self._ended.append(identity)

    # --- when ---

    def look(self, quiet: bool) -> float | None:
        """Begin a save if one is due. Call it between two runs of the mind, after its effects were carried out.

        `quiet`: the mind has nothing to do. Returns the wall seconds until the next call at the latest.
        """
        mail = self._mailing.absorbed() or bool(self._mailing.outbox.unsaved)
        if self._saving is not None:
            self._again = True
            return None
        others = self._keeper.dirty or self._mailing.outbox.gone or self._ended or self.first is not None
        if not (mail or self._begun or others):
            self._since = None
            return None
        now = asyncio.get_running_loop().time()
        if self._since is None:
            self._since = now
        if self._begun and (quiet or self._mind.atomic is None):
            due = now
        else:
            due = self._last + (MAIL_EVERY if mail else OTHERS_EVERY)
            if not quiet:
                patience = BUSY_PATIENCE if self._mind.atomic is None else ATOMIC_PATIENCE
                due = max(due, self._since + patience)
        if due > now:
            return due - now
        self._last, self._since = now, None
        self._begin()
        return None

    def _begin(self) -> None:
        mailing = self._mailing
        mind = self._keeper.changes()
        for what in mind.unkept:
            self.counters["unkept"] += 1
            log.warning("agent=%s %s", self._agent, what)
        sent, absorbed = mailing.outbox.take_unsaved(), mailing.inbox.take_absorbed()
        saving = self.first or Saving()
        self.first = None
        saving.mind = mind if mind else None
        saving.absorbed = {(whose.sender, whose.numbering): seq for whose, seq in absorbed.items()}
        saving.outgoing = sent
        if not self._mind.mailbox:  # the mind has taken the notices about refused messages
            saving.delivered += mailing.outbox.take_gone()
        saving.next_seq = {one.receiver: one.seq + 1 for one in sent}
        if not self._mind.inputs:  # the mind has taken the ends of these actions
            saving.ended, self._ended = saving.ended + self._ended, []
        saving.actions = {one: action for one, action in self._begun.items() if one not in saving.ended}
        self._begun = {}
        saving.soft = not (sent or absorbed or saving.actions)
        waiting, self._waiting = self._waiting, []
        if saving == Saving(soft=True):
            return

        def done() -> None:
            mailing.inbox.saved(absorbed)
            mailing.outbox.saved(sent)
            for one in waiting:
                if not one.done():
                    one.set_result(None)

        self._write(saving, done)

    def _write(self, saving: Saving, done: Callable[[], None]) -> asyncio.Future[None]:
        """Hand a save to the writer. The future is done when it is on disk."""
        loop = asyncio.get_running_loop()
        self._saving = saved = loop.create_future()
        self._slow = loop.call_later(SLOW, self._is_slow)
        self._again = False
        self._hand_in(saving, done, saved, RETRY_FIRST)
        return saved

    def _is_slow(self) -> None:
        """Note that the save under way has neither succeeded nor failed."""
        if not self.problem:
            why = f"the disk has not answered for {SLOW:g} s"
            log.error("agent=%s nothing is kept, and mail waits: %s", self._agent, why)
            self.problem = f"agent {self._agent} cannot be kept, and its mail waits: {why}"

    def _hand_in(self, saving: Saving, done: Callable[[], None], saved: asyncio.Future[None], pause: float) -> None:
        loop = asyncio.get_running_loop()
        ended = partial(self._written, saving, done, saved, pause)

        def save() -> None:
            """Save; called on the writer's thread."""
            error: Exception | None = None
            try:
                self._checkpoint.save(saving)
            except Exception as raised:
                error = raised
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(ended, error)
            self._checkpoint.shrink()  # nothing waits for this

        if saved.cancelled():
            return
        try:
            self._writer.submit(save)
        except RuntimeError as closed:
            loop.call_soon(ended, closed)

    def _written(
        self,
        saving: Saving,
        done: Callable[[], None],
        saved: asyncio.Future[None],
        pause: float,
        error: Exception | None,
    ) -> None:
        """Continue what has waited for a save, or repeat one that failed."""
        if saved.cancelled():
            return
        if error is not None:  # defects included: mail must not wait silently
            if not isinstance(error, CheckpointError):
                log.error("defect in argosy: a save of agent %s", self._agent, exc_info=error)
            self.counters["failed"] += 1
            if not self.problem:
                log.error("agent=%s nothing is kept, and mail waits: %s", self._agent, error)
            self.problem = f"agent {self._agent} cannot be kept, and its mail waits: {error}"
            again = min(pause * 2, RETRY_MOST)
            asyncio.get_running_loop().call_later(pause, self._hand_in, saving, done, saved, again)
            return
        if self.problem:
            log.info("agent=%s is kept again", self._agent)
            self.problem = ""
        self.counters["saved"] += 1
        self._saving = None
        if self._slow is not None:
            self._slow.cancel()
        saved.set_result(None)
        done()
        outbox = self._mailing.outbox
        if self._again or self._begun or self._ended or self._keeper.dirty or outbox.unsaved or outbox.gone:
            self._runner.wake()

    # --- the end ---

    async def finish(self) -> None:
        """Save the rest within `LAST_PATIENCE` wall seconds, so that another life can continue."""
        try:
            async with asyncio.timeout(LAST_PATIENCE):
                for _ in range(2):  # what is under way, and later changes
                    if self._saving is not None:
                        await asyncio.shield(self._saving)
                    self._mailing.absorbed()
                    self._begin()
                if self._saving is not None:
                    await asyncio.shield(self._saving)
        except TimeoutError:
            log.error("agent=%s the last of it could not be kept: %s", self._agent, self.problem or "the disk is slow")

    async def close(self, forget: bool) -> None:
        """Close the file; `forget` removes it, so that the next life begins without a past."""
        if self._slow is not None:
            self._slow.cancel()
        if self._saving is not None:
            self._saving.cancel()
            await asyncio.gather(self._saving, return_exceptions=True)
        work = self._checkpoint.forget if forget else self._checkpoint.close
        try:
            await asyncio.wait_for(asyncio.get_running_loop().run_in_executor(self._writer, work), CLOSE_PATIENCE)
        except TimeoutError:
            log.error("agent=%s its file is left as it is: the disk does not answer", self._agent)
        except CheckpointError as error:
            log.error("agent=%s %s", self._agent, error)
