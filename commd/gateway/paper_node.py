"""Old Comm nodes as the gateway knows them: where they are, how much they may say, what they said a short time ago."""

from __future__ import annotations

import hashlib
from collections import OrderedDict

RATE, BURST = 200.0, 400.0
"""Datagrams a second of one node, and at once; further ones are dropped unread and counted."""
REPEATED_WITHIN = 60.0
"""Seconds within which an equal datagram is a repetition; not longer, for Jason counts its ids anew with each start."""
REMEMBERED = 10_000


class Allowance:
    """How much a host may say: so many datagrams a second for each node that it has, and at once."""

    def __init__(self) -> None:
        self.nodes = 1
        self._left, self._since = BURST, 0.0

    def take(self, now: float) -> bool:
        """Whether another datagram is within it."""
        self._left = min(BURST * self.nodes, self._left + (now - self._since) * RATE * self.nodes)
        self._since = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Node:
    """An agent behind an old Comm node."""

    def __init__(self, name: str, address: str) -> None:
        self.name, self.address = name, address
        self.at: tuple[str, int] | None = None
        """IP address and port, once its host is found."""
        self.missed = False
        """It has been said that its host is not found."""
        self._heard: OrderedDict[bytes, float] = OrderedDict()

    def repeats(self, payload: bytes, now: float) -> bool:
        """Whether it has sent this very datagram, id and all, a short time ago."""
        heard, digest = self._heard, hashlib.blake2b(payload, digest_size=16).digest()
        while heard and (len(heard) > REMEMBERED or now - next(iter(heard.values())) > REPEATED_WITHIN):
            heard.popitem(last=False)
        known = digest in heard
        heard.setdefault(digest, now)
        return known
