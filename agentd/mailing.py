"""An agent's mail: out through the board's commd, in order per receiver; in once per message."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, OrderedDict
from collections.abc import Callable
from contextlib import aclosing

from commd.bus import Bus, BusClosed, Query
from schemas import keys
from schemas.codec import BadRecord
from schemas.records import Mail, Message, Receipt

log = logging.getLogger("mail")

QUEUE = 10_000
"""Messages that may wait for one receiver; further ones are dropped, counted and logged."""
RETRY_FIRST, RETRY_MOST = 0.1, 2.0
"""Wall seconds between two attempts to hand over a message, doubling."""
PATIENCE = 60.0
"""Wall seconds after which a message that nobody takes is given up, with a warning."""
ANSWER_TIMEOUT = 8.0
REMEMBERED = 10_000
"""Message ids kept to tell a repeated message from a new one."""


class Mailing:
    """The mail of one agent."""

    def __init__(self, bus: Bus, agent: str, on_message: Callable[[Message], str]) -> None:
        self.counters: Counter[str] = Counter()
        self._bus, self._agent, self._on_message = bus, agent, on_message
        self._queues: dict[str, asyncio.Queue[Message]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._seen: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._close = bus.serve(keys.inbox(bus.fleet, agent), Mail, self._receive)

    def send(self, message: Message) -> None:
        """Queue a message for its receiver."""
        queue = self._queues.get(message.receiver)
        if queue is None:
            queue = self._queues[message.receiver] = asyncio.Queue(QUEUE)
            task = asyncio.get_running_loop().create_task(self._post(queue))
            self._tasks.add(task)
        try:
            queue.put_nowait(message)
        except asyncio.QueueFull:
            self.counters["dropped"] += 1
            if self.counters["dropped"] % 1000 == 1:
                log.warning("mail_dropped receiver=%s count=%d", message.receiver, self.counters["dropped"])

    async def drain(self, patience: float) -> None:
        """Take no mail any more; wait until what was sent has been handed over, at most `patience` wall seconds."""
        self._close()
        waiting = [asyncio.create_task(queue.join()) for queue in self._queues.values()]
        if waiting:
            await asyncio.wait(waiting, timeout=patience)
        self._tasks.update(waiting)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _post(self, queue: asyncio.Queue[Message]) -> None:
        while True:
            message = await queue.get()
            reason, pause = await self._hand_over(message), RETRY_FIRST
            until = asyncio.get_running_loop().time() + PATIENCE
            while reason and reason != "receiver_not_found" and asyncio.get_running_loop().time() < until:
                await asyncio.sleep(pause)
                pause = min(pause * 2, RETRY_MOST)
                reason = await self._hand_over(message)
            self.counters["undelivered" if reason else "sent"] += 1
            if reason:
                log.warning("mail_undelivered id=%s receiver=%s why=%s", message.id, message.receiver, reason)
            queue.task_done()

    async def _hand_over(self, message: Message) -> str:
        """Give a message to commd. Returns why it was not taken, or an empty text."""
        reason = "commd does not answer"
        outbox = keys.outbox(self._bus.fleet, self._agent)
        try:
            async with aclosing(self._bus.query(outbox, Mail(messages=(message,)), Receipt, ANSWER_TIMEOUT)) as replies:
                async for reply in replies:
                    if reply.record is None:
                        reason = reply.error
                    elif message.id in reply.record.taken:
                        return ""
                    else:
                        reason = reply.record.refused.get(message.id, "not taken")
        except BadRecord as bad:
            self.counters["unsendable"] += 1
            log.warning("mail_unsendable id=%s why=%s", message.id, bad)
            return ""
        except BusClosed as closed:
            return str(closed)
        return reason

    async def _receive(self, query: Query[Mail]) -> None:
        if query.record is None or not query.concrete:
            query.reply_error(query.error or "expected a Mail record on a concrete key")
            return
        taken: list[str] = []
        refused: dict[str, str] = {}
        for message in query.record.messages:
            known = (message.sender, message.id)
            reason = "" if known in self._seen else self._on_message(message)
            if reason:
                refused[message.id] = reason
                continue
            if known not in self._seen:
                self.counters["received"] += 1
                self._seen[known] = None
                if len(self._seen) > REMEMBERED:
                    self._seen.popitem(last=False)
            taken.append(message.id)
        query.reply(Receipt(taken=tuple(taken), refused=refused))
