"""Asking the directory of services, which the commd of each board keeps: who joins, who offers what."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from contextlib import aclosing
from typing import Literal, TypeAlias

from commd.bus import Bus, BusClosed
from schemas import keys
from schemas.codec import BadRecord
from schemas.records import BoardServices, ServiceRequest

PATIENCE = 5.0
"""Wall seconds in which the directory answers, or a request has failed. A router that restarts takes less."""
AGAIN = 0.2
"""Wall seconds between two attempts."""
AT_ONCE = 16
"""Requests of this daemon on their way at the same time; commd turns away what comes beyond 256."""
Do: TypeAlias = Literal["join", "leave", "register", "deregister", "search", "subscribe"]


class NotDone(Exception):
    """The directory did not do what it was asked for; says why in words."""

    def __init__(self, why: str, answered: bool, prefix: str = "") -> None:
        super().__init__(why)
        self.answered = answered
        """Whether it has refused; else it did not answer, and may have done it."""
        self.prefix = prefix
        """What it wants the names of agents made at run time to begin with."""


class Services:
    """The directory as the agents of this daemon ask it, each at its own board, one request after the other."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._order: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)
        self._turn = asyncio.Semaphore(AT_ONCE)

    async def ask(self, board: str, agent: str, do: Do, service: str = "") -> BoardServices:
        """Have something done. Raises NotDone."""
        request = ServiceRequest(agent=agent, do=do, service=service)
        loop = asyncio.get_running_loop()
        async with self._order[agent], self._turn:  # what it waits for here is bounded in the same way
            until = loop.time() + PATIENCE
            answer, why = None, ""
            while answer is None and (left := until - loop.time()) > 0:
                answer, why = await self._ask(board, request, left)
                if answer is None:
                    await asyncio.sleep(min(AGAIN, left))
        if answer is None:
            raise NotDone(f"the directory of board {board} does not answer: {why or 'its commd is not there'}", False)
        if answer.problem:
            raise NotDone(answer.problem, True, answer.prefix)
        return answer

    def done_with(self, agent: str) -> None:
        """An agent has ended."""
        self._order.pop(agent, None)

    async def _ask(self, board: str, request: ServiceRequest, seconds: float) -> tuple[BoardServices | None, str]:
        why = ""
        key = keys.service_requests(self._bus.fleet, board, request.agent)
        try:
            async with aclosing(self._bus.query(key, request, BoardServices, seconds)) as replies:
                async for reply in replies:
                    if reply.record is not None:
                        return reply.record, ""
                    why = reply.error
        except (BusClosed, BadRecord) as error:
            why = str(error)
        return None, why
