"""Monitor the TLS links to other boards: which are missing and why (Zenoh retries silently), when this board's own
certificate ends, and whether the router has room for more links.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter

from commd.bus.bus import Bus
from commd.bus.connect_diagnosis import why_not
from commd.bus.router_endpoints import endpoint_of
from commd.bus.tls import SOON, Tls, day, identity_of
from commd.router import tls_rejections
from schemas.files.findings import Findings
from schemas.mission.model import Mission
from schemas.wire.records import Health, Note

LOOK = 5.0
"""Wall seconds between two checks; a link that is missing twice is diagnosed."""
READ_AGAIN, READ_SOON = 600.0, 30.0
"""Wall seconds until the own certificate is read again, and after a problem with it: reading takes a handshake."""
NEARLY = 0.8
"""Share of the router's links from which on there is a warning."""
log = logging.getLogger("links")


class Links:
    """Monitors the links to the boards that have an address."""

    def __init__(
        self, bus: Bus, mission: Mission, board: str, tls: Tls, *, look: float = LOOK, most: int | None = None
    ) -> None:
        """`look`: wall seconds between two checks; `most`: the router's limit of links, if known."""
        self._bus, self._tls, self._look, self._most = bus, tls, look, most
        others = {other: endpoint_of(mission, other, "tls") for other in mission.boards if other != board}
        self._others = {other: endpoint for other, endpoint in others.items() if endpoint}
        self._missing: set[str] = set()
        self._why: dict[str, str] = {}
        self._known: set[str] = set()
        self._ending: tuple[Note, ...] = ()
        self._read_again, self._reported = 0.0, (False, False)
        self._links, self._full = 0, ""
        self._defect = ""

    def health(self) -> Health:
        """Return notes of missing links, an ending certificate and a full router, and the counts of links and
        refusals."""
        notes = list(self._ending)
        if self._full:
            notes.append(Note("links_full", self._full, value=self._links))
        if self._defect:
            notes.append(Note("defect", self._defect, "links"))
        notes += (Note("link_missing", f"no link to {one}: {why}", one) for one, why in sorted(self._why.items()))
        return Health(notes=tuple(notes), counters={"links": float(self._links), **tls_rejections.counters})

    async def watch(self) -> None:
        """Check and diagnose, for ever."""
        while True:
            try:
                await self._look_round()
                self._defect = ""
            except Exception as error:  # the next check may succeed; until then health shows the defect
                what = f"defect in argosy: the watch over the links: {type(error).__name__}: {error}"
                if what != self._defect:
                    log.exception("%s", what)
                self._defect = what
            await asyncio.sleep(self._look)

    async def _look_round(self) -> None:
        if time.monotonic() >= self._read_again:
            self._look_at_dates()
        linked = self._bus.links()
        self._count(linked)
        for board in self._others:
            if board in linked:
                self._found(board)
        absent = {board for board in self._others if board not in linked}
        asked = absent & self._missing
        self._missing = absent
        await asyncio.gather(*(self._ask(board) for board in asked))

    def _look_at_dates(self) -> None:
        """Check our certificate; each state is logged once."""
        text, over = dates(self._tls, time.time())
        if text and (over, bool(text)) != self._reported:
            if over:
                log.error("other boards do not let this one in: %s", text)
            else:
                log.warning("%s", text)
        self._reported = over, bool(text)
        self._ending = (Note("keys_refused" if over else "certificate_ends", text),) if text else ()
        self._read_again = time.monotonic() + (READ_SOON if text else READ_AGAIN)

    def _count(self, linked: Counter[str]) -> None:
        """Note when few links are left, and who has most of them: Zenoh refuses further ones silently."""
        self._links = linked.total()
        if self._most is None or self._links < NEARLY * self._most:
            self._full = ""
            return
        who, count = linked.most_common(1)[0]
        whose = f"`{who}` has {count} of them" if who else f"{count} of them are on this board's socket"
        full = f"{self._links} of {self._most} links are taken, {whose}: with none left, further machines are refused"
        if not self._full:
            log.error("%s", full)
        self._full = full

    def _found(self, board: str) -> None:
        self._why.pop(board, None)
        if board not in self._known:
            self._known.add(board)
            log.info("linked board=%s", board)

    async def _ask(self, board: str) -> None:
        why = await why_not(self._others[board], self._tls) or "it is reachable, and not linked yet"
        if why != self._why.get(board):
            log.warning("no link board=%s endpoint=%s why=%s", board, self._others[board], why)
        self._why[board] = why
        self._known.discard(board)


def dates(tls: Tls, now: float) -> tuple[str, bool]:
    """Return a text if the certificate ends soon after `now` (Unix seconds) or the keys are invalid, and whether they
    are."""
    try:
        identity = identity_of(tls, now)
    except Findings as findings:
        return "; ".join(finding.message for finding in findings.findings), True
    if identity.ends - now > SOON:
        return "", False
    return f"the certificate of {identity.name} ends on {day(identity.ends)}: `argosy keys renew` makes another", False
