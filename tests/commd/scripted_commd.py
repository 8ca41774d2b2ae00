"""A `commd` that answers as it is told, for what a real one does seldom; on a real bus."""

import asyncio
from collections.abc import Callable

from commd.bus.bus import Bus, Query
from schemas.wire import keys
from schemas.wire.records import BoardServices, Mail, Message, Receipt, ServiceRequest

Answer = Receipt | str | None
"""A receipt, an error, or no answer at all."""


class ScriptedCommd:
    """Takes what it is sent, unless it is told otherwise; hands over what it is told to."""

    def __init__(self, bus: Bus, name: str) -> None:
        self.taken: list[Message] = []
        self.asked: list[ServiceRequest] = []
        self.answers: list[Answer] = []
        """What the next batches are answered with; then all is taken."""
        self.hangs = False
        """Whether it says nothing at all."""
        self.answer_directory: Callable[[ServiceRequest], BoardServices] = lambda _: BoardServices(board="local")
        self._bus, self._name = bus, name
        bus.serve(keys.outbox(bus.fleet, name), Mail, self._take)
        bus.serve(keys.service_requests(bus.fleet, "local", "*"), ServiceRequest, self._direct)

    async def offer(self, *messages: Message, patience: float = 60.0) -> Receipt | None:
        """Hand over a batch once. Returns the answer, if there is one."""
        inbox = keys.inbox(self._bus.fleet, self._name)
        found = [one async for one in self._bus.query(inbox, Mail(messages=messages), Receipt, patience)]
        assert len(found) <= 1
        return found[0].record if found else None

    async def _take(self, query: Query[Mail]) -> None:
        assert query.record is not None
        if self.hangs:
            await asyncio.sleep(60)
        answer: Answer = Receipt(taken=len(query.record.messages))
        if self.answers:
            answer = self.answers.pop(0)
        match answer:
            case Receipt():
                if answer.taken:
                    self.taken += query.record.messages
                query.reply(answer)
            case str():
                query.reply_error(answer)
            case None:
                self.taken += query.record.messages  # on disk, and the answer is lost
                await asyncio.sleep(0)

    async def _direct(self, query: Query[ServiceRequest]) -> None:
        assert query.record is not None
        self.asked.append(query.record)
        query.reply(self.answer_directory(query.record))
