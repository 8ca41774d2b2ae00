"""Renew links to other boards' routers that are up but carry no declarations.

Zenoh's routers (1.10.2) declare what they serve when they compute the routing trees, at most once in 100 ms, and only
to neighbours that the last computation did not have. A link that is lost and made again between two computations is not
new to this router, but the other one has dropped all declarations, and never gets them again. This happens to a board
that stood still for longer than its lease, as all its links then end and begin together (source: Zenoh's `hat/router`,
`compute_trees`; reproduced in the tests).

The symptom is a linked board whose `commd` has no liveliness token here. The watchdog closes such a link. Zenoh dials
again, and as nothing else changes at that moment, both routers declare everything. A slow board has its token, which
Zenoh's own threads hold. Only routers whose id shows a board are judged: older versions and foreign routers are not.

On a busy machine, a link that is lost and dialled again within some milliseconds may also end in a connection that both
routers keep open and neither lists as a link, for ever (1 of some 200 times, measured beside four busy processes). Each
router closes such connections at its own ports, of whomever they are, and they are dialled again.
"""

from __future__ import annotations

import asyncio
import logging
import math
import os
import re
import socket
import time
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
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
UNLISTED = 21.0
"""Wall seconds for which a connection may be no link: Zenoh gives the handshakes of TLS and of a session 10 s each."""
SCAN = 7.0
"""Wall seconds between two checks of all connections, as one costs some microseconds for each open file."""
REMEMBERED = 600.0
"""Wall seconds for which health has a note of a renewed link."""
RENEWED = "link_renewed"
"""Code of the note about it."""
TCP = ("tcp/", "tls/")
"""How endpoints begin whose links are TCP connections."""
_PORT = re.compile(r"(?:tcp|tls)/.+?:(\d+)(?:[?#]|$)")
log = logging.getLogger("links")

End = tuple[IPv4Address | IPv6Address, int]
Ends = tuple[End, End]
"""Addresses and ports of a TCP connection, ours first."""


class LinkWatchdog:
    """Watches the links of a board's router to those of other boards, and the connections at its own ports."""

    def __init__(self, bus: Bus, boards: Collection[str], listen: Collection[str]) -> None:
        """`boards` are the other boards of the mission, `listen` the endpoints at which the router listens.

        Make it when the router has claimed its own name.
        """
        self._bus, self._boards = bus, boards
        self._ports = {int(found[1]) for one in listen if (found := _PORT.match(one))}
        self._tokens = Tokens()
        """Of the `commd` of each board."""
        self._deaf_since: dict[str, float] = {}
        self._patience: dict[str, float] = {}
        """By board, after a renewal without effect."""
        self._unlisted_since: dict[Ends, float] = {}
        self._scanned = -math.inf
        self._renewed: dict[str, tuple[float, Note]] = {}
        """The last renewal of the link to a board, or to an address where none is known."""
        self.counters: Counter[str] = Counter()
        bus.watch(keys.alive(bus.fleet, "*", "commd", "*"), self._token)

    def look(self, now: float) -> None:
        """Renew what has been no working link for too long; `now` in monotonic seconds."""
        links = [(zid, _ends(*pair)) for zid, *pair in self._bus.link_ends() if pair[0].startswith(TCP)]
        self._renew_deaf(now, links)
        listed = {ends for _, ends in links}
        if now - self._scanned >= SCAN and None not in listed:
            self._scanned = now
            self._close_unlisted(now, listed)

    def _renew_deaf(self, now: float, links: Collection[tuple[str, Ends | None]]) -> None:
        """Renew the links to boards that were linked without a token for too long."""
        of_board: dict[str, set[Ends | None]] = {}
        for zid, ends in links:
            if board := owner_of(zid, self._boards):
                of_board.setdefault(board, set()).add(ends)
        deaf = of_board.keys() - self._tokens.keys()
        for board in of_board.keys() - deaf:
            self._patience.pop(board, None)
        self._deaf_since = {board: self._deaf_since.get(board, now) for board in deaf}
        for board, since in list(self._deaf_since.items()):
            patience = self._patience.get(board, PATIENCE)
            if now - since < patience:
                continue
            del self._deaf_since[board]
            if sum(_shut_down(one) for one, ends in _connections() if ends in of_board[board]):
                self._patience[board] = min(2 * patience, PATIENCE_MOST)
                text = f"the link to {board} was renewed: it was up, but the declarations of {board} were missing here"
                self._report(now, now - since, Note(RENEWED, text, board))

    def _close_unlisted(self, now: float, listed: Collection[Ends | None]) -> None:
        """Close the connections at the router's own ports that have been no link for too long."""
        unlisted: dict[Ends, float] = {}
        for one, ends in _connections():
            if ends[0][1] not in self._ports or ends in listed:
                continue
            since = unlisted[ends] = self._unlisted_since.get(ends, now)
            if now - since >= UNLISTED and _shut_down(one):
                unlisted[ends] = math.inf
                address = str(ends[1][0])
                text = f"a connection from {address} was closed: the router held it, but had no link by it"
                self._report(now, now - since, Note(RENEWED, text, address))
        self._unlisted_since = unlisted

    def _report(self, now: float, after: float, note: Note) -> None:
        log.warning("event=%s about=%s after=%.0fs: %s", note.code, note.about, after, note.text)
        self.counters["links_renewed"] += 1
        recent = {about: one for about, one in self._renewed.items() if now - one[0] < REMEMBERED}
        self._renewed = recent | {note.about: (now, note)}

    def health(self) -> Health:
        """Return notes of the links renewed within `REMEMBERED`, and counts."""
        now = time.monotonic()
        notes = tuple(note for _, (at, note) in sorted(self._renewed.items()) if now - at < REMEMBERED)
        return Health(notes=notes, counters={name: float(count) for name, count in self.counters.items()})

    def _token(self, key: str, alive: bool) -> None:
        if (parsed := keys.parse(key)) is not None and parsed[1] in self._boards:
            self._tokens.note(parsed[1], key, alive)

    async def run(self) -> None:
        """Look every `LOOK` seconds, for ever."""
        while True:
            await asyncio.sleep(LOOK)
            self.look(time.monotonic())


def _connections() -> Iterator[tuple[socket.socket, Ends]]:
    """Yield this process's TCP connections, each with a socket that is closed when the next one is asked for."""
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # closed meanwhile, or not connected
            number = os.dup(int(name))  # so that the number refers to the same connection until it is closed here
            try:
                found = socket.socket(fileno=number)
            except OSError:  # no socket
                os.close(number)
                continue
            with found:
                if found.family in (socket.AF_INET, socket.AF_INET6):
                    yield found, (_end(found.getsockname()), _end(found.getpeername()))


def _shut_down(connection: socket.socket) -> bool:
    """End a connection of Zenoh's, which has no call for it: it sees that the other side closed it."""
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
        return True
    return False


def _ends(ours: str, theirs: str) -> Ends | None:
    """Return the ends of a link by its endpoints; None = they are no IP addresses."""
    with suppress(ValueError):
        (a, b), (c, d) = (host_and_port(one.partition("/")[2]) for one in (ours, theirs))
        return _end((a.strip("[]"), b)), _end((c.strip("[]"), d))
    return None


def _end(name: Any) -> End:
    """Return the address and port in the name of an IP socket."""
    address = ip_address(str(name[0]).partition("%")[0])
    return getattr(address, "ipv4_mapped", None) or address, int(name[1])
