"""The operator's bus to a secured fleet: a session with each board, and each query to the board that serves it.

The router of a board accepts an operator's own requests, but not those that another board forwards
(docs/guides/security.md). Tokens and messages are received from all boards, whatever the links between them.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any, TypeVar

import zenoh

from commd.bus.bus import Bus, Reply, open_bus
from commd.bus.errors import BusClosed
from commd.bus.router_endpoints import endpoint_of
from commd.bus.tls import Tls
from commd.common.tasks import Tasks
from commd.liveness.presence import Tokens
from schemas.files.findings import Findings
from schemas.mission.access_rules import hidden
from schemas.mission.model import Mission
from schemas.wire.codec import codec
from schemas.wire.records import Header, Record

R = TypeVar("R", bound=Record)
DIAL_AGAIN = 5.0
"""Wall seconds between two attempts to reach a board, while something subscribes at all boards."""
MOST_STREAMS = 20_000
"""Keys whose last sequence number is remembered; beyond that all are forgotten, and a record may be delivered twice."""


class Boards:
    """The sessions with the boards that are reached."""

    def __init__(self, mission: Mission) -> None:
        robots = {name: robot.board for name, robot in mission.robots.items()}
        self.homes: Mapping[str, str] = mission.mailboxes | robots | {board: board for board in mission.boards}
        """The board of each name."""
        self._sights = mission.security.sights
        self.opening: dict[str, asyncio.Task[FleetBus]] = {}
        self.work = Tasks("asking a board")
        """Queries, and subscriptions at boards that are not reached yet."""
        self.dial: Callable[[str], asyncio.Task[FleetBus]] | None = None

    def why_unseen(self, observer: str, key: str) -> str:
        """Return why an observer may not see a key; empty = it may. A router would just not answer."""
        sight = self._sights.get(observer)
        asked = zenoh.KeyExpr(key.partition("?")[0])
        if sight is None or not any(zenoh.KeyExpr(one).intersects(asked) for one in hidden(sight)):
            return ""
        return f"`{observer}` is an observer of {sight} by the mission: it may not see this (docs/guides/security.md)"

    async def bus(self, board: str) -> Bus | str:
        """Return the session with a board, or why there is none."""
        if board not in self.opening:
            return "it has no address in the mission"
        try:
            return await asyncio.shield(self.opening[board])
        except BusClosed as closed:
            return str(closed)

    async def unreached(self) -> dict[str, str]:
        """Wait for all attempts; return the boards without a session, and why."""
        found = {board: await self.bus(board) for board in self.opening}
        return {board: why for board, why in found.items() if isinstance(why, str)}

    def at_each(self, declare: Callable[[str, Bus], None]) -> None:
        """Call `declare(board, session)` for each board, as soon as it is reached."""
        for board in self.opening:
            self.work.spawn(self._once_reached(board, declare))

    async def _once_reached(self, board: str, declare: Callable[[str, Bus], None]) -> None:
        while isinstance(bus := await self.bus(board), str):
            await asyncio.sleep(DIAL_AGAIN)
            if self.dial is not None and self.opening[board].done():
                self.opening[board] = self.dial(board)
        declare(board, bus)


class FleetBus(Bus):
    """A session with one board that sends each query to the board that serves it, and subscribes at all boards."""

    boards: Boards

    async def tokens(self, key: str, timeout: float = 2.0) -> list[str]:
        """Like `Bus.tokens`, of all reached boards; `timeout`: wall seconds. `boards.unreached` names the others."""

        async def at(board: str) -> list[str]:
            bus = await self.boards.bus(board)
            return [] if isinstance(bus, str) else await Bus.tokens(bus, key, timeout)

        found = await asyncio.gather(*map(at, self.boards.opening))
        return sorted({token for tokens in found for token in tokens})

    def watch(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Like `Bus.watch`: a token exists as long as one board has it."""
        seen = Tokens()

        def changed(board: str, token: str, alive: bool) -> None:
            if seen.note(token, board, alive):
                handler(token, alive)

        self.boards.at_each(lambda board, bus: Bus.watch(bus, key, partial(changed, board)))

    def subscribe(self, key: str, record: type[R], handler: Callable[[str, R], None]) -> None:
        """Like `Bus.subscribe`: a record that arrives by several boards is delivered once."""
        newest: dict[str, tuple[str, int]] = {}

        def deliver(name: str, sample: R) -> None:
            header = getattr(sample, "header", None)
            if isinstance(header, Header) and header.boot:
                boot, seq = newest.get(name, ("", -1))
                if header.boot == boot and header.seq <= seq:
                    return
                if len(newest) >= MOST_STREAMS:
                    newest.clear()
                newest[name] = (header.boot, header.seq)
            handler(name, sample)

        self.boards.at_each(lambda _, bus: Bus.subscribe(bus, key, record, deliver))

    def ask(
        self,
        key: str,
        ask: Record | None,
        answer: type[R],
        timeout: float,
        heard: Callable[[Reply[R] | None], None],
    ) -> Callable[[], object]:
        """Like `Bus.ask`; for an unreached board the reply says why. `timeout`: wall seconds, of each board."""
        if ask is not None:
            codec(type(ask)).encode(ask, self.wire)  # it raises here, and not in a task
        why = self.boards.why_unseen(self.name, key)
        root, fleet, name, rest = key.split("/", 3)
        homes = [self.boards.homes[name]] if name in self.boards.homes else list(self.boards.opening)

        async def at(board: str) -> None:
            bus, ended = await self.boards.bus(board), asyncio.Event()
            if isinstance(bus, str):
                its_key = "/".join((root, fleet, board, rest)) if "*" in name else key
                heard(Reply(its_key, None, f"board {board} is not reached: {bus}"))
                return
            try:
                close = Bus.ask(bus, key, ask, answer, timeout, lambda one: heard(one) if one else ended.set())
            except BusClosed as closed:
                heard(Reply(key, None, f"board {board} is no longer reached: {closed}"))
                return
            try:
                await ended.wait()
            finally:
                close()

        async def everywhere() -> None:
            if why:
                heard(Reply(key, None, why))
            else:
                for error in filter(None, await asyncio.gather(*map(at, homes), return_exceptions=True)):
                    heard(Reply(key, None, f"defect in argosy: {type(error).__name__}: {error}"))
            heard(None)

        return self.boards.work.spawn(everywhere()).cancel


@asynccontextmanager
async def open_fleet_bus(mission: Mission, tls: Tls, patience: float, **options: Any) -> AsyncIterator[FleetBus]:
    """Open sessions with all boards, each within `patience` wall seconds; yield the first one as soon as it is open.

    Raises Findings for a mission without addresses, and BusClosed with a line for each board if none is reached.
    """
    places = {board: endpoint_of(mission, board, "tls") for board in mission.boards}
    if not any(places.values()):
        text = "no board has an address: name a router with --router tls/HOST:PORT"
        raise Findings([mission.positions.finding(("boards",), text)])
    boards = Boards(mission)
    async with AsyncExitStack() as sessions:

        async def reach(endpoint: str) -> FleetBus:
            opened = open_bus(
                endpoint,
                fleet=mission.fleet,
                patience=patience,
                tls=tls,
                make=FleetBus,
                **options,
            )
            bus = await sessions.enter_async_context(opened)
            assert isinstance(bus, FleetBus)
            bus.boards = boards
            return bus

        boards.dial = lambda board: asyncio.create_task(reach(places[board] or ""))
        boards.opening = {board: boards.dial(board) for board, place in places.items() if place}
        try:
            yield await _first(list(boards.opening.values()))
        finally:
            await boards.work.end()
            for task in boards.opening.values():
                task.cancel()
            await asyncio.gather(*boards.opening.values(), return_exceptions=True)


async def _first(opening: Sequence[asyncio.Task[FleetBus]]) -> FleetBus:
    """Return the first open session. Raises BusClosed with the error of each attempt."""
    reasons, waiting = list[str](), set(opening)
    while waiting:
        done, waiting = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            try:
                return task.result()
            except BusClosed as closed:
                reasons.append(str(closed))
    raise BusClosed(
        "\n  ".join(("no board of the fleet is reached:", *sorted(reasons))) if len(reasons) > 1 else reasons[0]
    )
