"""Renew links to other boards' routers that are up but carry no declarations.

Zenoh's routers (1.10.2) declare what they serve when they compute the routing trees, at most once in 100 ms, and only
to neighbours that the last computation did not have. A link that is lost and made again between two computations is not
new to this router, but the other one has dropped all declarations, and never gets them again. This happens to a board
that stood still for longer than its lease, as all its links then end and begin together (source: Zenoh's `hat/router`,
`compute_trees`; reproduced in the tests).

The symptom is a linked board whose `commd` has no liveliness token here. The watchdog closes such a link. Zenoh dials
again, and as nothing else changes at that moment, both routers declare everything. A slow board has its token, which
Zenoh's own threads hold. Only routers whose id shows a board are judged: older versions and foreign routers are not.
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import time
from collections import Counter
from collections.abc import Collection
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import Any

from commd.bus.bus import Bus
from commd.bus.session import owner_of
from commd.liveness.presence import Tokens
from schemas.files.units import host_and_port
from schemas.wire import keys
from schemas.wire.records import Health, Note

LOOK = 1.0
"""Wall seconds between two checks."""
PATIENCE, PATIENCE_MOST = 4.0, 300.0
"""Wall seconds for which a linked board may have no token, longer than a `commd` takes to claim its name; doubled with
each renewal without effect, up to the second figure."""
REMEMBERED = 600.0
"""Wall seconds for which health has a note of a renewed link."""
RENEWED = "link_renewed"
"""Code of the note about it."""
log = logging.getLogger("links")


class LinkWatchdog:
    """Watches the links of a board's router to those of other boards."""

    def __init__(self, bus: Bus, boards: Collection[str]) -> None:
        """`boards` are the other boards of the mission. Make it when the router has claimed its own name."""
        self._bus, self._boards = bus, boards
        self._tokens = Tokens()
        """Of the `commd` of each board."""
        self._deaf_since: dict[str, float] = {}
        self._patience: dict[str, float] = {}
        """By board, after a renewal without effect."""
        self._renewed: dict[str, float] = {}
        """When the link to a board was renewed last."""
        self.counters: Counter[str] = Counter()
        bus.watch(keys.alive(bus.fleet, "*", "commd", "*"), self._token)

    def look(self, now: float) -> None:
        """Renew the links to boards that were linked without a token for too long; `now` in monotonic seconds."""
        ends: dict[str, list[tuple[str, str]]] = {}
        for zid, ours, theirs in self._bus.link_ends():
            if ours.startswith(("tcp/", "tls/")) and (board := owner_of(zid, self._boards)):
                ends.setdefault(board, []).append((ours, theirs))
        deaf = ends.keys() - self._tokens.keys()
        for board in ends.keys() - deaf:
            self._patience.pop(board, None)
        self._deaf_since = {board: self._deaf_since.get(board, now) for board in deaf}
        for board, since in list(self._deaf_since.items()):
            patience = self._patience.get(board, PATIENCE)
            if now - since < patience:
                continue
            del self._deaf_since[board]
            if sum(_close_connection(*pair) for pair in ends[board]):
                text = "event=%s board=%s after=%.0fs: it was linked, but its declarations were missing"
                log.warning(text, RENEWED, board, now - since)
                self.counters["links_renewed"] += 1
                self._patience[board] = min(2 * patience, PATIENCE_MOST)
                self._renewed[board] = now

    def health(self) -> Health:
        """Return notes of the links renewed within `REMEMBERED`, and counts."""
        now = time.monotonic()
        notes = tuple(
            Note(
                RENEWED,
                f"the link to {board} was renewed: it was up, but the declarations of {board} were missing here",
                board,
            )
            for board, at in sorted(self._renewed.items())
            if now - at < REMEMBERED
        )
        return Health(notes=notes, counters={name: float(count) for name, count in self.counters.items()})

    def _token(self, key: str, alive: bool) -> None:
        if (parsed := keys.parse(key)) is not None and parsed[1] in self._boards:
            self._tokens.note(parsed[1], key, alive)

    async def run(self) -> None:
        """Look every `LOOK` seconds, for ever."""
        while True:
            await asyncio.sleep(LOOK)
            self.look(time.monotonic())


def _close_connection(ours: str, theirs: str) -> bool:
    """Shut down this process's TCP connection between two endpoints of Zenoh's; False = there is none.

    Zenoh has no call that closes a link. It sees the connection end, as if the other side had closed it.
    """
    try:
        wanted = _address(ours), _address(theirs)
    except ValueError:  # not an IP address
        return False
    for name in os.listdir("/proc/self/fd"):
        number = -1
        try:
            number = os.dup(int(name))  # so that the number refers to the same connection until it is shut down
            with socket.socket(fileno=number) as found:
                number = -1
                if found.family not in (socket.AF_INET, socket.AF_INET6):
                    continue
                if (_ends_at(found.getsockname()), _ends_at(found.getpeername())) == wanted:
                    found.shutdown(socket.SHUT_RDWR)
                    return True
        except OSError:  # closed, no socket, or not connected
            if number >= 0:
                os.close(number)
    return False


def _address(endpoint: str) -> tuple[IPv4Address | IPv6Address, int]:
    host, port = host_and_port(endpoint.partition("/")[2])
    return _ends_at((host.strip("[]"), port))


def _ends_at(name: Any) -> tuple[IPv4Address | IPv6Address, int]:
    """Return the address and port in the name of an IP socket."""
    address = ip_address(str(name[0]).partition("%")[0])
    return getattr(address, "ipv4_mapped", None) or address, int(name[1])
