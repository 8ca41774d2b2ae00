"""When an agent's mind and mail are kept: at once when mail or an action waits for it, else now and then.

One save at a time. It holds what the mind has become, the mail that it has sent and taken, and the actions that it is
about to begin, in one transaction; what was waiting for it goes on when it is on disk. A disk that is full holds up
mail, not the mind: the same save is tried again until it succeeds.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from agentd.mail.mail_client import MailClient
from agentd.mind import Mind
from agentd.mind.persistence.change_tracking import Keeper
from agentd.persistence.checkpoint import ActionInFlight, CheckpointError, Outgoing, Saving
from agentd.persistence.restore import RestoredState
from schemas.wire.codec import Wire, codec
from schemas.wire.records import Action, Message, Note

log = logging.getLogger("keeping")

MAIL_EVERY = 0.02
"""Wall seconds between the beginnings of two saves that mail waits for."""
OTHERS_EVERY = 0.5
"""Wall seconds between two saves that nobody waits for."""
BUSY_PATIENCE = 0.5
"""Wall seconds after which a mind that is never at rest is kept as it stands."""
ATOMIC_PATIENCE = 10.0
"""The same while an atomic plan runs: it is to be kept whole or not at all."""
ACTION_PATIENCE = 0.3
"""Wall seconds for which an action waits to be written down; a slow disk must not keep a robot from acting."""
LIFE_PATIENCE = 1.0
"""The same for an agent that begins to reason again."""
RETRY_FIRST, RETRY_MOST = 0.2, 5.0
"""Wall seconds between two attempts of a save that failed, doubling."""
LAST_PATIENCE = 3.0
"""Wall seconds that the last save of an agent that leaves may take."""
SLOW = 10.0
"""Wall seconds after which a save that has not ended is told, and counts as one that fails: actions wait no more."""
CLOSE_PATIENCE = 10.0
"""Wall seconds that the disk has to close the file, or to remove it; all agents of a daemon share its writer."""


class Checkpointer:
    """The saves of one agent."""

    def __init__(
        self,
        agent: str,
        memory: RestoredState,
        keeper: Keeper,
        mind: Mind,
        mailing: MailClient,
        wire: Wire,
        wake: Callable[[], None],
    ) -> None:
        """`wake` lets `look` be called again."""
        self.counters: Counter[str] = Counter()
        self.problem = ""
        """Why nothing can be kept now; empty = it can."""
        self.first: Saving | None = None
        """What the first save of this life holds besides."""
        self._told = list(memory.checkpoint.notes)
        self._agent, self._keeper, self._mind, self._mailing = agent, keeper, mind, mailing
        self._checkpoint, self._writer = memory.checkpoint, memory.writer
        self._wire, self._wake = wire, wake
        self._begun: dict[str, ActionInFlight] = {}
        """Actions that no save has begun to hold, and those who wait for that."""
        self._waiting: list[asyncio.Future[None]] = []
        self._ended: list[str] = []
        self._saving: asyncio.Future[None] | None = None
        """The save under way."""
        self._slow: asyncio.TimerHandle | None = None
        """Tells when the disk takes too long for it."""
        self._again = False
        """`look` was called meanwhile."""
        self._last = -OTHERS_EVERY
        self._since: float | None = None
        """When there was first something to keep that is not kept yet."""

    def notes(self) -> tuple[Note, ...]:
        """Return why nothing can be kept now, and what was wrong with the file."""
        return (*((Note("state_not_kept", self.problem),) if self.problem else ()), *self._told)

    def tell(self, note: Note) -> None:
        """Report something about what was kept, for the rest of this life."""
        log.error("agent=%s %s", self._agent, note.text)
        self._told.append(note)

    async def count_life(self) -> None:
        """Write down that there is another life, before anything comes of it; waits for that, but not for long."""
        if self.first is None:
            return
        saving, self.first = self.first, None
        await asyncio.wait([self._write(saving, lambda: None)], timeout=LIFE_PATIENCE)

    # --- actions (`agentd.runtime.action_client.Journal`) ---

    def begun(self, action: Action) -> asyncio.Future[None]:
        """Note that an action is about to be asked for, before the next `look`, which begins to save it.

        Returns what ends when that is on disk, or when it has taken too long.
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
        """The mind is being told how an action ended: it need not be remembered when the mind has taken that."""
        if self.problem and self._begun.pop(identity, None) is not None:
            return  # a disk that is full does not make a list of what it has missed
        self._ended.append(identity)

    # --- when ---

    def look(self, quiet: bool) -> float | None:
        """Begin a save if one is due; to be called between two runs of the mind, when its effects are carried out.

        `quiet`: the mind has nothing to do. Returns the wall seconds until it is to be called again at the latest.
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
        saving.outgoing = [
            Outgoing(
                one.place, one.message.receiver, one.message.header.seq, codec(Message).encode(one.message, self._wire)
            )
            for one in sent
        ]
        if not self._mind.mailbox:  # the mind has heard of what commd has refused
            saving.delivered += mailing.outbox.take_gone()
        saving.next_seq = {one.message.receiver: one.message.header.seq + 1 for one in sent}
        if not self._mind.inputs:  # what an action came to is in the mind, not on its way
            saving.ended, self._ended = saving.ended + self._ended, []
        saving.actions = {one: action for one, action in self._begun.items() if one not in saving.ended}
        self._begun = {}
        saving.soft = not (sent or absorbed)
        waiting, self._waiting = self._waiting, []
        if not self._is_something(saving):
            return

        def done() -> None:
            mailing.inbox.kept(absorbed)
            mailing.outbox.saved(sent)
            for one in waiting:
                if not one.done():
                    one.set_result(None)

        self._write(saving, done)

    @staticmethod
    def _is_something(saving: Saving) -> bool:
        return saving != Saving(soft=True)

    def _write(self, saving: Saving, done: Callable[[], None]) -> asyncio.Future[None]:
        """Hand a save to the writer, at once. Returns what ends when it is on disk."""
        loop = asyncio.get_running_loop()
        self._saving = saved = loop.create_future()
        self._slow = loop.call_later(SLOW, self._is_slow)
        self._again = False
        self._hand_in(saving, done, saved, RETRY_FIRST)
        return saved

    def _is_slow(self) -> None:
        """The disk neither takes the save under way nor refuses it."""
        if not self.problem:
            told = f"the disk has not answered for {SLOW:g} s"
            log.error("agent=%s nothing is kept, and mail waits: %s", self._agent, told)
            self.problem = f"agent {self._agent} cannot be kept, and its mail waits: {told}"

    def _hand_in(self, saving: Saving, done: Callable[[], None], saved: asyncio.Future[None], pause: float) -> None:
        loop = asyncio.get_running_loop()
        told = partial(self._written, saving, done, saved, pause)

        def save() -> None:
            """On the writer's thread."""
            error: Exception | None = None
            try:
                self._checkpoint.save(saving)
            except Exception as raised:
                error = raised
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(told, error)
            self._checkpoint.shrink()  # nobody waits for that

        if saved.cancelled():
            return
        try:
            self._writer.submit(save)
        except RuntimeError as ended:
            loop.call_soon(told, ended)

    def _written(
        self,
        saving: Saving,
        done: Callable[[], None],
        saved: asyncio.Future[None],
        pause: float,
        error: Exception | None,
    ) -> None:
        """A save has ended; one that failed is tried again."""
        if saved.cancelled():
            return
        if error is not None:  # also a defect must not let mail wait without a word
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
            self._wake()

    # --- the end ---

    async def finish(self) -> None:
        """Save what is left, within `LAST_PATIENCE` wall seconds: this life ends, another may go on."""
        try:
            async with asyncio.timeout(LAST_PATIENCE):
                for _ in range(2):  # what was under way, and what has come since
                    if self._saving is not None:
                        await asyncio.shield(self._saving)
                    self._mailing.absorbed()
                    self._begin()
                if self._saving is not None:
                    await asyncio.shield(self._saving)
        except TimeoutError:
            log.error("agent=%s the last of it could not be kept: %s", self._agent, self.problem or "the disk is slow")

    async def close(self, forget: bool) -> None:
        """Close the file; `forget` removes it: nothing of this agent is to come back."""
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
