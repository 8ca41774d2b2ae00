"""What a board tells `argosy doctor`: its clock, the room on its disk, and how it reaches the other boards."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence
from pathlib import Path

from commd.bus.bus import Bus, Query
from commd.bus.errors import BusError, QueryTimeout
from schemas.wire import keys
from schemas.wire.records import BoardReport, Checkup, LinkReport

ROUND_TRIPS = 5
"""Tried with each board; the fastest tells the clock best."""
PATIENCE = 1.5
"""Wall seconds for a round trip."""
FILLER = 16_384
"""Bytes that are sent to see how fast a link is."""
FILLER_PATIENCE = 4.0
"""Wall seconds that they may take: what needs longer carries less than 4 kB/s."""
LINKS_WITHIN = 10.0
"""Wall seconds for the links to all boards; what is not measured by then is told to be so."""
MEASURED_FOR = 3.0
"""Wall seconds for which links that were measured are told again: who asks often must not load them."""
DISK_PATIENCE = 2.0
"""Wall seconds that the disk has to say how much room it has."""
AT_MOST = 65_536
"""Bytes of a question that are read."""


class SelfCheck:
    """Answers `{board}/checkup`."""

    def __init__(self, bus: Bus, board: str, others: Sequence[str], folder: Path) -> None:
        """`others` are the boards to which links are measured, `folder` is where state is kept."""
        self._bus, self._board, self._folder = bus, board, folder
        self._others = [other for other in others if other != board]
        self._measuring = asyncio.Lock()
        self._links: tuple[LinkReport, ...] = ()
        self._measured = float("-inf")
        bus.serve(keys.checkup(bus.fleet, board), Checkup, self._answer, at_most=AT_MOST)

    async def _answer(self, query: Query[Checkup]) -> None:
        if query.error:
            query.reply_error(query.error)
            return
        links: tuple[LinkReport, ...] = ()
        free = size = None
        if query.record is not None and query.record.links:
            links = await self._all_links()
            free, size = await room(self._folder)
        report = BoardReport(
            header=self._bus.header("checkup"),
            board=self._board,
            state=str(self._folder),
            disk_free=free,
            disk_size=size,
            links=links,
        )
        query.reply(report, keys.checkup(self._bus.fleet, self._board))

    async def _all_links(self) -> tuple[LinkReport, ...]:
        loop = asyncio.get_running_loop()
        async with self._measuring:
            if loop.time() - self._measured > MEASURED_FOR:
                self._links = await measure_all(self._bus, self._others)
                self._measured = loop.time()
            return self._links


async def measure_all(bus: Bus, boards: Sequence[str], within: float = LINKS_WITHIN) -> tuple[LinkReport, ...]:
    """Measure the links to some boards one after the other: at the same time they would disturb each other."""
    loop = asyncio.get_running_loop()
    until = loop.time() + within
    found: list[LinkReport] = []
    for board in boards:
        try:
            async with asyncio.timeout_at(until):
                found.append(await measure(bus, board))
        except TimeoutError:
            found.append(LinkReport(board=board, problem=f"not measured within {within:g} s"))
    return tuple(found)


async def measure(bus: Bus, board: str) -> LinkReport:
    """Measure round trips to a board, by how much its clock is ahead, and how fast the link is."""
    trips: list[tuple[float, float]] = []
    problem = ""
    for _ in range(ROUND_TRIPS):
        try:
            trips.append(await _round_trip(bus, board, "", PATIENCE))
        except BusError as error:
            problem = str(error)
            if isinstance(error, QueryTimeout) and error.nobody:
                break
    if not trips:
        return LinkReport(board=board, asked=ROUND_TRIPS, problem=problem)
    fastest, ahead = min(trips)
    rate = None
    try:
        with_filler, _ = await _round_trip(bus, board, "x" * FILLER, FILLER_PATIENCE)
        if with_filler > 1.5 * fastest + 0.002:  # else the difference is noise, and the link is fast
            rate = FILLER / (with_filler - fastest)
    except BusError as error:
        problem = f"{FILLER} bytes: {error}"
    return LinkReport(
        board=board,
        asked=ROUND_TRIPS,
        answered=len(trips),
        round_trip=fastest,
        slowest=max(trips)[0],
        ahead=ahead,
        rate=rate,
        problem=problem,
    )


async def _round_trip(bus: Bus, board: str, filler: str, timeout: float) -> tuple[float, float]:
    """Return how many wall seconds an answer took, and by how many its clock is ahead. Raises BusError."""
    loop = asyncio.get_running_loop()
    began, sent = loop.time(), bus.stamp()
    report = await bus.ask_one(keys.checkup(bus.fleet, board), Checkup(filler=filler), BoardReport, timeout)
    took = loop.time() - began
    return took, (report.header.stamp - sent) / 1e9 - took / 2


async def room(folder: Path) -> tuple[int | None, int | None]:
    """Return the bytes that are free for this process where a folder is, and all of them; None: not known."""
    try:
        found = await asyncio.wait_for(asyncio.to_thread(os.statvfs, folder), DISK_PATIENCE)
    except (OSError, TimeoutError):
        return None, None
    return found.f_bavail * found.f_frsize, found.f_blocks * found.f_frsize
