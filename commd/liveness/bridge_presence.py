"""Whether the bridge of an agent's robot is there, judged with patience: a router restart is not a death."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from commd.bus.bus import Bus
from commd.liveness.health_timeout import SILENCE, Silence
from schemas.wire import keys
from schemas.wire.records import Health

log = logging.getLogger("bridge")

DEBOUNCE = 0.3
"""Wall seconds that a token must be absent under a live router before its daemon counts as dead."""
ROUTER_GRACE = 5.0
"""Wall seconds that the router has to come back, and daemons after it did: what they told is out of date by then.
One that comes and goes again begins them anew each time."""
LOOK = 0.5
"""Wall seconds between two looks whether it still says something."""


class BridgeWatch:
    """Follows the liveliness tokens of one robot's bridge; tells `on_up` and `on_gone` once for each change.

    While `run` runs, a bridge whose token is there and that says nothing for `SILENCE` counts as gone: it hangs.
    """

    def __init__(
        self,
        bus: Bus,
        robot: str,
        on_up: Callable[[], None],
        on_gone: Callable[[], None],
        board: str | None = None,
    ) -> None:
        """`board`: where the robot is, if that is another one: its bridge may go because the link to it is cut."""
        self.up = False
        """A bridge has been seen and has not been given up."""
        self.gone = False
        """A bridge was there and is dead or out of reach: its token is absent although the router answers, or the
        router itself has been away for too long."""
        self.hangs = False
        """It is gone although its token is there."""
        self.fell_silent: list[Callable[[], None]] = []
        """Called when it begins to hang: what waits for its answers waits in vain."""
        self._bus, self._robot, self._on_up, self._on_gone = bus, robot, on_up, on_gone
        self._tokens: set[str] = set()
        self._silence = Silence(SILENCE)
        self.router_since = asyncio.get_running_loop().time()
        """When the router was lost or was back last."""
        self._routers_there: set[str] = set()
        """Tokens of the other board's commd."""
        self._board_since: float | None = None
        """When that board went or came last, if it ever went."""
        self._judging: asyncio.Task[None] | None = None
        bus.on_router(self._router)
        if board is not None:
            bus.watch(keys.alive(bus.fleet, board, "commd", "*"), self._board)
        bus.watch(keys.alive(bus.fleet, robot, "bridged", "*"), self._token)
        bus.subscribe(keys.health(bus.fleet, robot, "bridged"), Health, self._word)

    async def run(self) -> None:
        """Look for ever whether the bridge still says something."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(LOOK)
            silent = self._silence.silent(loop.time())
            if silent and self._tokens and self._bus.router_up and not self.hangs:
                self.hangs, self.up, self.gone = True, False, True
                log.warning("bridge_lost robot=%s: it is there and has said nothing for %g s", self._robot, SILENCE)
                self._on_gone()
                for handler in list(self.fell_silent):
                    handler()

    def _word(self, _: str, health: Health) -> None:
        self._silence.word(self._robot, health.header.boot, asyncio.get_running_loop().time())
        if self.hangs and self._tokens:
            self._there()

    def _there(self) -> None:
        self.hangs = self.gone = False
        if not self.up:
            self.up = True
            log.info("bridge_up robot=%s", self._robot)
        self._on_up()

    def _router(self, up: bool) -> None:
        self.router_since = asyncio.get_running_loop().time()
        if up:
            self._silence.excuse(self.router_since, SILENCE)

    def _board(self, key: str, alive: bool) -> None:
        there = bool(self._routers_there)
        if alive:
            self._routers_there.add(key)
        else:
            self._routers_there.discard(key)
        if there != bool(self._routers_there) and (there or self._board_since is not None):
            self._board_since = asyncio.get_running_loop().time()

    def _excused_until(self, lost_at: float) -> float:
        """Until when a token may be absent, since then, for the loss of our router or of the link to its board."""
        if not self._bus.router_up:
            return max(lost_at, self.router_since) + ROUTER_GRACE
        until = self.router_since + ROUTER_GRACE if self.router_since > lost_at else lost_at
        if self._board_since is None:
            return until
        if not self._routers_there:
            return max(until, lost_at + ROUTER_GRACE)
        return max(until, self._board_since + ROUTER_GRACE) if self._board_since >= lost_at else until

    def _token(self, key: str, alive: bool) -> None:
        self._silence.token(self._robot, key.rsplit("/", 1)[-1], alive, asyncio.get_running_loop().time())
        if alive:
            self._tokens.add(key)
            self._there()
            return
        self._tokens.discard(key)
        if not self._tokens and self._judging is None:
            self._judging = asyncio.get_running_loop().create_task(self._judge())

    async def _judge(self) -> None:
        """Decide whether an absent token means a dead bridge."""
        loop = asyncio.get_running_loop()
        lost_at = loop.time()
        try:
            await asyncio.sleep(DEBOUNCE)
            while not self._tokens:
                if loop.time() >= self._excused_until(lost_at):
                    self.up, self.gone, self.hangs = False, True, False
                    why = "its token is gone" if self._bus.router_up else "no router"
                    log.warning("bridge_lost robot=%s: %s", self._robot, why)
                    self._on_gone()
                    return
                await asyncio.sleep(0.1)
        finally:
            self._judging = None
