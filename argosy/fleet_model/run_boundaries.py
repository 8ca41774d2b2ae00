"""Whether a fleet flies anew: what was heard of an earlier run must not be taken for what is so now.

A run is over when everybody of it has gone. A daemon that is started again while others are there goes on in the run;
that the router was away ends none, as long as somebody of before is there afterwards.
"""

from __future__ import annotations

DAEMONS = frozenset({"agentd", "bridged", "commd"})
"""Those that a run is made of; whoever else holds a name may outlive many."""
MOST = 4_000
"""Lives of one run that are kept; the oldest are forgotten first."""

Life = tuple[str, str, str]
"""Name, daemon and boot, as a token has them."""


class Runs:
    """Takes tokens and tells of a new run."""

    def __init__(self) -> None:
        self.number = 1
        """Of the run that is on."""
        self._there: set[Life] = set()
        self._known: dict[Life, None] = {}
        """The lives of this run, also those that have ended."""
        self._came: float | None = None
        """When somebody came while nobody was there; None = that was not so, or it is settled what it meant."""

    def token(self, life: Life, alive: bool, now: float) -> None:
        """A token came or went."""
        if life[1] not in DAEMONS:
            return
        if not alive:
            self._there.discard(life)
            return
        if not self._there and self._known and self._came is None:
            self._came = now
        self._there.add(life)
        if self._came is None:
            self._know(life)

    def anew(self) -> float | None:
        """Return since when another run is on, once; else None. To be asked when all that are there have been heard."""
        if self._came is None or not self._there:
            return None
        came, self._came = self._came, None
        same = not self._there.isdisjoint(self._known)
        if not same:
            self._known.clear()
            self.number += 1
        for life in self._there:
            self._know(life)
        return None if same else came

    def _know(self, life: Life) -> None:
        self._known.pop(life, None)
        self._known[life] = None
        if len(self._known) > MOST:
            del self._known[next(iter(self._known))]
