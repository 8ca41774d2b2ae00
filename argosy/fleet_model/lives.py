"""Lives of daemons, from their liveliness tokens: which daemon was restarted, and whether another run has begun.

A run is over when all its daemons have gone. A daemon that is restarted while others are there goes on in the same run.
A lost router does not end a run, as long as one of its daemons is there afterwards.
"""

from __future__ import annotations

DAEMONS = frozenset({"agentd", "bridged", "commd"})
"""The daemons of a run; other holders of a name may outlive many runs."""
MOST_NAMES = 2_000
"""Names whose present lives are kept."""
MOST_LIVES = 4_000
"""Lives of one run that are kept; the oldest are forgotten first."""

Life = tuple[str, str, str]
"""Name, daemon and boot, as in a token."""


class Lives:
    """The present life of each agent and bridge, and the number of the present run."""

    def __init__(self) -> None:
        self.run = 1
        """Number of the present run."""
        self._boots: dict[tuple[str, str], tuple[str, float]] = {}
        """Boot of each name and daemon, and when it began; 0 = it was the first one seen."""
        self._there: set[Life] = set()
        self._known: dict[Life, None] = {}
        """The lives of this run, including those that have ended."""
        self._came: float | None = None
        """When a daemon came while none was there; None = that did not happen, or has been judged."""

    def token(self, life: Life, alive: bool, now: float) -> bool:
        """Take a token at `now`, in seconds. Returns whether the daemon was restarted: it had another life before."""
        name, daemon, boot = life
        if daemon in DAEMONS:
            self._of_run(life, alive, now)
        if not alive:
            return False
        known = self._boots.pop((name, daemon), (boot, 0.0))
        restarted = known[0] != boot
        self._boots[name, daemon] = (boot, now) if restarted else known
        if len(self._boots) > MOST_NAMES:
            del self._boots[next(iter(self._boots))]
        return restarted

    def began(self, name: str, daemon: str) -> float:
        """Return when the present life began, if another one was seen before; else 0."""
        return self._boots.get((name, daemon), ("", 0.0))[1]

    def new_run(self) -> float | None:
        """Return since when another run is on, once; else None. Call it when all present daemons have been heard."""
        if self._came is None or not self._there:
            return None
        came, self._came = self._came, None
        same = not self._there.isdisjoint(self._known)
        if not same:
            self._known.clear()
            self.run += 1
        for life in self._there:
            self._know(life)
        return None if same else came

    def _of_run(self, life: Life, alive: bool, now: float) -> None:
        if not alive:
            self._there.discard(life)
            return
        if not self._there and self._known and self._came is None:
            self._came = now
        self._there.add(life)
        if self._came is None:
            self._know(life)

    def _know(self, life: Life) -> None:
        self._known.pop(life, None)
        self._known[life] = None
        if len(self._known) > MOST_LIVES:
            del self._known[next(iter(self._known))]
