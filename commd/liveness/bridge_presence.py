"""Judge whether the bridge of a robot is alive, by its liveliness token and its health records."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from commd.bus.bus import Bus
from commd.common.tasks import in_step
from commd.liveness.presence import Presence, Silence
from schemas.liveness import BRIDGE_GRACE, SILENT_AFTER
from schemas.wire import keys
from schemas.wire.records import Health

log = logging.getLogger("bridge")

POLL = 0.5
"""Wall seconds between two checks of its health."""


class BridgePresence:
    """Watches one robot's bridge; calls `on_up` and `on_gone` once for each change.

    While `run` runs, a bridge with a token and no health record for `SILENT_AFTER` counts as gone: it hangs.
    """

    def __init__(
        self,
        bus: Bus,
        robot: str,
        on_up: Callable[[], None],
        on_gone: Callable[[], None],
        board: str | None = None,
    ) -> None:
        """`board`: of the robot, if it is another one: the link to it may be cut."""
        self.up = False
        """Whether a bridge was seen and is not lost."""
        self.gone = False
        """Whether a bridge was seen and is lost: its token is missing although the router answers, the router itself
        has been away for too long, or it hangs."""
        self.hangs = False
        """Whether it is lost although its token exists."""
        self.fell_silent: list[Callable[[], None]] = []
        """Called when it begins to hang."""
        self.came: list[Callable[[], None]] = []
        """Called when it is there, before `on_up`."""
        self._bus, self.robot, self._on_up, self._on_gone = bus, robot, on_up, on_gone
        self._presence = Presence((robot,), lambda _: board, BRIDGE_GRACE)
        self._silence = Silence(SILENT_AFTER)
        self.router_since = asyncio.get_running_loop().time()
        """When the router was last lost or back, on the event loop's clock."""
        self._judging: asyncio.Task[None] | None = None
        bus.on_router(self._router)
        if board is not None:
            bus.watch(keys.alive(bus.fleet, board, "commd", "*"), self._board)
        bus.watch(keys.alive(bus.fleet, robot, "bridged", "*"), self._token)
        bus.subscribe(keys.health(bus.fleet, robot, "bridged"), Health, self._word)

    async def run(self) -> None:
        """Check the bridge's health records, for ever."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(in_step(loop.time(), POLL))
            silent = self._silence.silent(loop.time())
            if silent and self._there and self._bus.router_up and not self.hangs:
                self.hangs, self.up, self.gone = True, False, True
                log.warning(
                    "bridge_lost robot=%s: no health record for %g s, but a token",
                    self.robot,
                    SILENT_AFTER,
                )
                self._on_gone()
                for handler in list(self.fell_silent):
                    handler()

    def _word(self, _: str, health: Health) -> None:
        self._silence.word(self.robot, health.header.boot, asyncio.get_running_loop().time())
        if self.hangs and self._there:
            self._came()

    @property
    def _there(self) -> bool:
        """Whether it has a liveliness token."""
        return self.robot in self._presence.there()

    def _came(self) -> None:
        self.hangs = self.gone = False
        if not self.up:
            self.up = True
            log.info("bridge_up robot=%s", self.robot)
        for handler in self.came:
            handler()
        self._on_up()

    def _router(self, up: bool) -> None:
        self.router_since = asyncio.get_running_loop().time()
        self._presence.router(up, self.router_since)
        if up:
            self._silence.excuse(self.router_since, SILENT_AFTER)

    def _board(self, key: str, alive: bool) -> None:
        _, board, _, _, boot = key.rsplit("/", 4)
        self._presence.board(board, boot, alive, asyncio.get_running_loop().time())

    def _token(self, key: str, alive: bool) -> None:
        now, boot = asyncio.get_running_loop().time(), key.rsplit("/", 1)[-1]
        self._silence.token(self.robot, boot, alive, now)
        self._presence.token(self.robot, boot, alive, now)
        if alive:
            self._came()
        elif self._judging is None and not self._there and self._presence.seems_there(self.robot):
            self._judging = asyncio.get_running_loop().create_task(self._judge())

    async def _judge(self) -> None:
        """Wait until the bridge is back or lost."""
        loop = asyncio.get_running_loop()
        try:
            while not self._there:
                if why := self._presence.lost(loop.time()).get(self.robot):
                    self.up, self.gone, self.hangs = False, True, False
                    log.warning("bridge_lost robot=%s: %s", self.robot, why)
                    self._on_gone()
                    return
                await asyncio.sleep(min(0.1, max(0.01, self._presence.due - loop.time())))
        finally:
            self._judging = None
