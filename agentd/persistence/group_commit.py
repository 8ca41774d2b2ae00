"""Write the changes of all agents of a daemon, one transaction after the other.

A transaction holds the daemon at one moment: each agent as it is between two turns, and the mail between them that no
mind has taken. So after a crash no agent remembers more of another than that one does itself. Whatever leaves the
process waits for the transaction that holds it. A full disk delays mail, not the minds: the same transaction is
repeated until it succeeds.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final

from agentd.persistence.checkpoint import AgentRows, Checkpoint, CheckpointError
from commd.common.tasks import Alarm

if TYPE_CHECKING:
    from agentd.persistence.checkpointer import Checkpointer

log = logging.getLogger("keeping")

SHARE: Final = 9.0
"""Time from the beginning of a commit to that of the next, in multiples of the time in which the minds stood still."""
WRITING: Final = 2.0
"""The same in multiples of the time that the disk took for the last one, so that it rests in between..."""
EACH_MESSAGE: Final = 0.002
"""Wall seconds for each message that the last one let leave: where mail flows, more messages share a commit..."""
PAUSE_MOST: Final = 0.02
"""... both up to so many wall seconds: mail must not wait longer for a slow disk than that itself takes."""
BUSY_PATIENCE: Final = 0.5
"""Wall seconds for which a commit waits for a busy mind whose messages others have taken."""
ATOMIC_PATIENCE: Final = 10.0
"""The same while an atomic plan runs: it should be saved whole or not at all."""
RETRY_FIRST, RETRY_MOST = 0.2, 5.0
"""Wall seconds between two attempts of a commit that failed, doubling."""
SLOW = 10.0
"""Wall seconds after which a commit under way is logged and counts as failed: actions do not wait for it."""
CLOSE_PATIENCE = 10.0
"""Wall seconds for closing the file."""


@dataclass(slots=True)
class Batch:
    """What one transaction writes, and what waits for it."""

    savings: dict[str, AgentRows] = field(default_factory=dict)
    """By agent."""
    members: list[Checkpointer] = field(default_factory=list)
    """The agents that it holds."""
    soft: bool = True
    """Whether it must survive the end of the process only, not a power cut: nobody else has heard of what it keeps."""
    messages: int = 0
    """Messages that it lets leave the daemon."""
    done: list[Callable[[], None]] = field(default_factory=list)
    """To be called when it is on disk."""


class GroupCommit:
    """The transactions of one daemon."""

    def __init__(self, checkpoint: Checkpoint | None, writer: Executor) -> None:
        """`checkpoint` is None if no agent of the daemon is kept; then nothing waits."""
        self.problem = ""
        """Why saving fails now; empty: it does not."""
        self.busy: set[Checkpointer] = set()
        """Agents amid their work of whose messages others know more than was captured."""
        self._checkpoint, self._writer = checkpoint, writer
        self._loop = asyncio.get_running_loop()
        self._asked: dict[Checkpointer, None] = {}
        """Agents with changes."""
        self._mail: dict[Checkpointer, None] = {}
        """Agents that others of the daemon have given mail since the last commit."""
        self._flushes: list[tuple[Checkpointer, asyncio.Event]] = []
        self._due: float | None = None
        """Loop time at which the next commit is due; None: nothing asks for it."""
        self._hurry = False
        """Whether it should not wait for busy minds."""
        self._last = -1e9
        self._pause = 0.0
        """Wall seconds from `_last` to the next commit at least."""
        self._wrote = 0.0
        """Wall seconds that the last commit took until it was on disk."""
        self._alarm = Alarm(self.look)
        self._saving: Batch | None = None
        """The commit under way."""
        self._slow = Alarm(self._look_whether_slow)

    # --- when ---

    def ask(self, member: Checkpointer, within: float) -> None:
        """Commit the changes of an agent, `within` wall seconds from the beginning of the last commit; 0: now."""
        self._asked[member] = None
        if within:
            due = self._last + max(within, self._pause)
        else:
            due, self._hurry = self._loop.time(), True
        if self._due is None or due < self._due:
            self._due = due
        self.look()

    def give(self, member: Checkpointer) -> None:
        """Note that an agent was given mail by another one of the daemon."""
        self._mail[member] = None

    def leave(self, member: Checkpointer) -> None:
        """Forget an agent that has ended."""
        self._asked.pop(member, None)
        self._mail.pop(member, None)
        self.busy.discard(member)

    def look(self) -> None:
        """Begin a commit if one is due. Call it between two turns of minds."""
        if self._due is None or self._saving is not None:
            return
        now, due = self._loop.time(), self._due
        if now >= due and self.busy:
            patience = 0.0 if self._hurry else BUSY_PATIENCE
            if now >= due + patience and any(member.atomic for member in self.busy):  # not asked at each turn
                patience = ATOMIC_PATIENCE
            due += patience
        if now >= due:
            self._begin(now)
        else:
            self._alarm.by(due)

    async def flush(self, member: Checkpointer) -> None:
        """Wait until the present changes of an agent are on disk. Its mind must be at rest or leave."""
        done = asyncio.Event()
        self._flushes.append((member, done))
        self._asked[member] = None
        self._due = self._loop.time()
        self._loop.call_soon(self.look)  # others may wait for the same
        await done.wait()

    # --- a commit ---

    def _begin(self, now: float) -> None:
        asked, self._asked, self._due, self._hurry, self._last = self._asked, {}, None, False, now
        batch = Batch()
        for member in asked:
            if not member.capture(batch, now):
                self._asked[member] = None
        mail, self._mail = self._mail, {}
        for member in mail:
            member.add_mail(batch)
        for flush in self._flushes.copy():
            if flush[0] not in self._asked:
                self._flushes.remove(flush)
                batch.done.append(flush[1].set)
        pause = max(WRITING * self._wrote, EACH_MESSAGE * batch.messages)
        self._pause = max(SHARE * (self._loop.time() - now), min(pause, PAUSE_MOST))
        if batch.savings and self._checkpoint is not None:
            self._saving = batch
            self._slow.by(now + SLOW)
            self._hand_in(RETRY_FIRST)
        else:  # behind the turn that has asked for it: an action is requested after the cancellation of another one
            for done in batch.done:
                self._loop.call_soon(done)

    def _look_whether_slow(self) -> None:
        """Note when the commit under way has neither succeeded nor failed for too long."""
        if self._saving is None:
            return
        if self._loop.time() < self._last + SLOW:
            self._slow.by(self._last + SLOW)
        elif not self.problem:
            self.problem = f"the disk has not answered for {SLOW:g} s"
            log.error("nothing is kept, and mail waits: %s", self.problem)

    def _hand_in(self, pause: float) -> None:
        """Let the writer save the commit under way; `pause` wall seconds later again if that fails."""
        batch, checkpoint = self._saving, self._checkpoint
        if batch is None or checkpoint is None:  # closed meanwhile
            return
        ended = partial(self._written, batch, pause)

        def save() -> None:
            """Save; called on the writer's thread."""
            error: Exception | None = None
            try:
                checkpoint.save(batch.savings, batch.soft)
            except Exception as raised:
                error = raised
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(ended, error)
            checkpoint.shorten_log()  # nothing waits for this

        try:
            self._writer.submit(save)
        except RuntimeError as closed:
            self._loop.call_soon(ended, closed)

    def _written(self, batch: Batch, pause: float, error: Exception | None) -> None:
        """Continue what has waited for a commit, or repeat one that failed."""
        if self._saving is None:
            return
        for member in batch.members:
            member.counters["saved" if error is None else "failed"] += 1
        if error is not None:  # defects included: mail must not wait silently
            if not isinstance(error, CheckpointError):
                log.error("defect in argosy: a save of %s", ", ".join(batch.savings), exc_info=error)
            if not self.problem:
                log.error("nothing is kept, and mail waits: %s", error)
            self.problem = str(error)
            self._loop.call_later(pause, self._hand_in, min(pause * 2, RETRY_MOST))
            return
        if self.problem:
            log.info("the agents are kept again")
            self.problem = ""
        self._saving = None
        self._wrote = self._loop.time() - self._last
        for done in batch.done:
            done()
        self.look()

    # --- the end ---

    async def close(self, forget: Iterable[str] = ()) -> None:
        """Close the file; remove the state of agents that `forget` names, so that they begin without a past."""
        self._slow.cancel()
        self._alarm.cancel()
        self._saving = None
        if self._checkpoint is None:
            return
        checkpoint, agents = self._checkpoint, tuple(forget)

        def work() -> None:
            if agents:
                checkpoint.forget(agents)
            checkpoint.close()

        try:
            await asyncio.wait_for(self._loop.run_in_executor(self._writer, work), CLOSE_PATIENCE)
        except TimeoutError:
            log.error("%s is left as it is: the disk does not answer", checkpoint.path)
        except CheckpointError as error:
            log.error("%s", error)
