"""Whether daemons that are there still say something: one that hangs keeps its token, but not its health.

Zenoh's threads answer for a process whose event loop stands still, in a Python function of the user's that does not
return, so a token alone proves no life. The health that a loop puts once a second does. Pure: tokens, health and wall
seconds go in.
"""

from __future__ import annotations

from schemas.liveness import FIRST_HEALTH, SILENT_AFTER

STALL = 1.5
"""Wall seconds between two looks of ours after which it may be us who have not listened."""
CATCH_UP = 2.0
"""Wall seconds that others then have at least: their words wait to be heard."""


class Silence:
    """Tells which daemons say nothing. Who has no token is not found silent, but one that was stays so without it."""

    def __init__(self, patience: float = SILENT_AFTER) -> None:
        """`patience`: wall seconds that a daemon may be silent between two words."""
        self.patience = patience
        self._until: dict[tuple[str, str], float] = {}
        """By name and boot: when it is to have spoken at the latest."""
        self._spoke: dict[str, str] = {}
        """The boot under which each has spoken last."""
        self._hung: dict[str, str] = {}
        """Those that say nothing, with their boot; they do so until they speak, or another life of them comes."""
        self._looked = float("inf")

    def token(self, name: str, boot: str, alive: bool, wall: float) -> None:
        """The token of a daemon came or went."""
        if not alive:
            self._until.pop((name, boot), None)
            return
        first = self._spoke.get(name) != boot
        self._until[name, boot] = wall + (max(self.patience, FIRST_HEALTH) if first else self.patience)
        if self._hung.get(name) != boot:
            self._hung.pop(name, None)

    def word(self, name: str, boot: str, wall: float) -> None:
        """A daemon has put its health."""
        if (name, boot) in self._until:
            self._until[name, boot], self._spoke[name] = wall + self.patience, boot
            self._hung.pop(name, None)

    def excuse(self, wall: float, seconds: float) -> None:
        """We may have missed words: nobody falls silent for some time."""
        for life, until in self._until.items():
            self._until[life] = max(until, wall + seconds)

    def silent(self, wall: float) -> list[str]:
        """Return who says nothing. To be asked about twice a second: after a longer pause it was we who slept."""
        if wall - self._looked > STALL:
            self.excuse(wall, CATCH_UP)
        self._looked = wall
        latest: dict[str, tuple[float, str]] = {}
        for (name, boot), until in self._until.items():  # of two lives that overlap the new one speaks
            latest[name] = max((until, boot), latest.get(name, (until, boot)))
        self._hung |= {name: boot for name, (until, boot) in latest.items() if wall >= until}
        return list(self._hung)
