"""Keys that a session uses again and again, declared to Zenoh once.

What Zenoh does for a record on a key that was not declared grows with all that its session has declared: at 100 robots
in one process it is the greater part of what a record costs. A declared key is looked up by its number.
"""

from __future__ import annotations

import logging
from typing import Final

import zenoh

MOST: Final = 10_000
"""Keys that a session declares, and keys used once that it remembers; further ones cost what they cost."""
log = logging.getLogger("bus")


class KeyCache:
    """The keys of one session. A key is declared when it is used a second time."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: dict[str, zenoh.KeyExpr] = {}
        self._once: dict[str, None] = {}
        """The last ones that were used once, the oldest first."""

    @property
    def open(self) -> bool:
        """Whether further keys are declared."""
        return len(self._declared) < MOST

    def of(self, key: str) -> zenoh.KeyExpr | str:
        """Return what to put on for a key."""
        return self._declared.get(key) or self.used(key) or key

    def used(self, key: str) -> zenoh.KeyExpr | None:
        """Note that a key was used. Returns it if it is declared."""
        if key in self._declared or not self.open:
            return self._declared.get(key)
        if key not in self._once:
            if len(self._once) >= MOST:
                del self._once[next(iter(self._once))]
            self._once[key] = None
            return None
        del self._once[key]
        try:
            declared: zenoh.KeyExpr = self._session.declare_keyexpr(key)
        except zenoh.ZError as error:  # the session is closed, or this is no key
            log.debug("not_declared key=%s why=%s", key, error)
            return None
        self._declared[key] = declared
        if not self.open:
            log.warning("keys_declared count=%d: records on further keys cost more processor time", MOST)
        return declared
