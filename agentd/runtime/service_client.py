"""Asking the directory of services, which the commd of each board keeps: who joins, who offers what."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Iterable
from contextlib import AsyncExitStack, suppress
from typing import Literal, TypeAlias

from commd.bus.bus import Bus
from commd.bus.errors import BusError
from schemas.wire import keys
from schemas.wire.codec import BadRecord
from schemas.wire.records import BoardServices, ServiceRequest

PATIENCE = 5.0
"""Wall seconds after which a request has failed, if the directory has answered nobody of this daemon meanwhile. A
router that restarts takes less."""
AGAIN = 0.2
"""Wall seconds between two attempts."""
AT_ONCE = 16
"""Requests of this daemon on their way to one board at the same time; commd turns away what comes beyond 256."""
Do: TypeAlias = Literal["join", "leave", "register", "deregister", "search", "subscribe"]


class NotDone(Exception):
    """The directory did not do what it was asked for; says why in words."""

    def __init__(self, why: str, answered: bool, prefix: str = "") -> None:
        super().__init__(why)
        self.answered = answered
        """Whether it has refused; else it did not answer, and may have done it."""
        self.prefix = prefix
        """What it wants the names of agents made at run time to begin with."""


class _Line:
    """Those who wait for the directory of one board."""

    def __init__(self) -> None:
        self.places = asyncio.Semaphore(AT_ONCE)
        self._heard = float("-inf")

    def heard(self) -> None:
        """The directory has answered somebody: who waits for a turn does not wait in vain."""
        self._heard = asyncio.get_running_loop().time()

    def until(self, since: float) -> float:
        """When a request that was made at a time has failed."""
        return max(since, self._heard) + PATIENCE


class Services:
    """The directory as the agents of this daemon ask it, each at its own board, one request after the other."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._order: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)
        self._lines: defaultdict[str, _Line] = defaultdict(_Line)

    async def ask(self, board: str, agent: str, do: Do, service: str = "") -> BoardServices:
        """Have something done. Raises NotDone."""
        request = ServiceRequest(agent=agent, do=do, service=service)
        loop = asyncio.get_running_loop()
        since, line = loop.time(), self._lines[board]
        answer, why = None, "those before it have had no answer either"
        async with AsyncExitStack() as held:
            if await self._turn(held, (self._order[agent], line.places), line, since):
                until = line.until(since)
                while answer is None and (left := until - loop.time()) > 0:
                    answer, why = await self._ask(board, request, left)
                    if answer is None:
                        await asyncio.sleep(min(AGAIN, left))
                    else:
                        line.heard()
        if answer is None:
            raise NotDone(f"the directory of board {board} does not answer: {why}", False)
        if answer.problem:
            raise NotDone(answer.problem, True, answer.prefix)
        return answer

    def done_with(self, agent: str) -> None:
        """An agent has ended."""
        self._order.pop(agent, None)

    async def _turn(
        self, held: AsyncExitStack, gates: Iterable[asyncio.Lock | asyncio.Semaphore], line: _Line, since: float
    ) -> bool:
        """Wait until it is the turn of a request, which `held` then holds; False when the directory is too silent."""
        loop = asyncio.get_running_loop()
        for gate in gates:
            entered = False
            while not entered:
                if loop.time() >= (until := line.until(since)):
                    return False
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(until):
                        await held.enter_async_context(gate)
                        entered = True
        return True

    async def _ask(self, board: str, request: ServiceRequest, seconds: float) -> tuple[BoardServices | None, str]:
        key = keys.service_requests(self._bus.fleet, board, request.agent)
        try:
            return await self._bus.ask_one(key, request, BoardServices, seconds), ""
        except (BusError, BadRecord) as error:
            return None, str(error)
