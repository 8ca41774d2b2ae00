"""Measure a board for `argosy doctor`: its clock, the room on its disk, and its links to the other boards."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Sequence
from pathlib import Path

from commd.bus.bus import Bus, Query
from commd.bus.errors import BusError, CannotServe, QueryTimeout
from schemas.wire import keys
from schemas.wire.records import BoardReport, Checkup, LinkReport

ROUND_TRIPS = 5
"""Round trips to each board; the fastest gives the best estimate of the clock."""
PATIENCE = 1.5
"""Wall seconds for a round trip."""
FILLER = 16_384
"""Bytes that are sent to measure the rate of a link."""
FILLER_PATIENCE = 4.0
"""Wall seconds for them, which a link below 4 kB/s exceeds."""
LINKS_WITHIN = 10.0
"""Wall seconds for all links; the rest is reported as not measured."""
MEASURED_FOR = 3.0
"""Wall seconds for which a measurement is repeated from memory, so that frequent queries do not load the links."""
DISK_PATIENCE = 2.0
"""Wall seconds for the disk to report its free space."""
AT_MOST = 65_536
"""Bytes of the largest query."""


class SelfCheck:
    """Answers `{board}/checkup`."""

    def __init__(self, bus: Bus, board: str, others: Sequence[str], folder: Path) -> None:
        """`others`: boards whose links are measured; `folder`: of the state."""
        self._bus, self._board, self._folder = bus, board, folder
        self._others = [other for other in others if other != board]
        self._measuring = asyncio.Lock()
        self._links: tuple[LinkReport, ...] = ()
        self._measured = float("-inf")
        bus.serve(keys.checkup(bus.fleet, board), Checkup, self._answer, at_most=AT_MOST)

    async def _answer(self, query: Query[Checkup]) -> None:
        if query.error:
            raise CannotServe(query.error)
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
    """Measure the links to boards one after the other, as they would disturb each other, in `within` wall seconds."""
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
    """Measure round trips to a board, how far its clock is ahead, and the rate of the link."""
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
        if with_filler > 1.5 * fastest + 0.002:  # else the difference is noise
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
    """Return the wall seconds of a round trip, and by how many the other clock is ahead. Raises BusError."""
    loop = asyncio.get_running_loop()
    began, sent = loop.time(), time.time_ns()
    report = await bus.ask_one(keys.checkup(bus.fleet, board), Checkup(filler=filler), BoardReport, timeout)
    took = loop.time() - began
    return took, (report.header.stamp - sent) / 1e9 - took / 2


async def room(folder: Path) -> tuple[int | None, int | None]:
    """Return the free bytes of a folder's file system for this process, and all bytes; None = unknown."""
    try:
        found = await asyncio.wait_for(asyncio.to_thread(os.statvfs, folder), DISK_PATIENCE)
    except (OSError, TimeoutError):
        return None, None
    return found.f_bavail * found.f_frsize, found.f_blocks * found.f_frsize
