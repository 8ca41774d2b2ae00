"""Which boards this board's router should be linked to by TLS and is not, and why: Zenoh retries without a word.

And until when they let this board in: what its own certificate says.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from commd import refusals
from commd.bus import Bus
from commd.reach import why_not
from commd.routers import endpoint_of
from commd.tls import SOON, Tls, day, identity_of
from schemas.findings import Findings
from schemas.mission import Mission
from schemas.records import Health

LOOK = 5.0
"""Wall seconds between two looks; a link that is missing at two of them is asked about."""
READ_AGAIN = 600.0
"""Wall seconds after which the own certificate is looked at again: it takes a handshake."""
log = logging.getLogger("links")


class Links:
    """Watches over the links to the boards that have an address."""

    def __init__(self, bus: Bus, mission: Mission, board: str, tls: Tls, look: float = LOOK) -> None:
        self._bus, self._tls, self._look = bus, tls, look
        others = {other: endpoint_of(mission, other, "tls") for other in mission.boards if other != board}
        self._others = {other: endpoint for other, endpoint in others.items() if endpoint}
        self._missing: set[str] = set()
        self._why: dict[str, str] = {}
        self._known: set[str] = set()
        self._ending: tuple[str, ...] = ()
        self._read_again = 0.0

    def health(self) -> Health:
        """Tell which links are missing, that the certificate ends soon, and how often somebody was refused."""
        missing = (f"no link to {board}: {why}" for board, why in sorted(self._why.items()))
        return Health(notes=(*self._ending, *missing), counters=dict(refusals.counters))

    async def watch(self) -> None:
        """Look, ask and tell, for ever."""
        while True:
            there = self._bus.linked()
            for board in self._others:
                if board in there:
                    self._found(board)
            absent = {board for board in self._others if board not in there}
            await asyncio.gather(*(self._ask(board) for board in absent & self._missing))
            self._missing = absent
            if time.monotonic() >= self._read_again:
                self._ending, self._read_again = ending(self._tls, time.time()), time.monotonic() + READ_AGAIN
            await asyncio.sleep(self._look)

    def _found(self, board: str) -> None:
        self._why.pop(board, None)
        if board not in self._known:
            self._known.add(board)
            log.info("linked board=%s", board)

    async def _ask(self, board: str) -> None:
        why = await why_not(self._others[board], self._tls) or "it can be reached, and is not linked yet"
        if why != self._why.get(board):
            log.warning("no link board=%s endpoint=%s why=%s", board, self._others[board], why)
        self._why[board] = why
        self._known.discard(board)


def ending(tls: Tls, now: float) -> tuple[str, ...]:
    """Return in words that the certificate ends soon, or that the keys are good no more; nothing if all is well."""
    try:
        identity = identity_of(tls, now)
    except Findings as findings:
        return tuple(finding.message for finding in findings.findings)
    if identity.ends - now > SOON:
        return ()
    return (f"the certificate of {identity.name} ends on {day(identity.ends)}: `argosy keys renew` makes another",)


@asynccontextmanager
async def open_links(bus: Bus, mission: Mission, board: str, tls: Tls) -> AsyncIterator[Links]:
    """Watch over the links of a board until the end."""
    links = Links(bus, mission, board, tls)
    watching = asyncio.create_task(links.watch())
    try:
        yield links
    finally:
        watching.cancel()
