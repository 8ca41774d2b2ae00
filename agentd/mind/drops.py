"""What a mind drops because too much waits: counted by kind, told at once and then now and again with the number."""

from __future__ import annotations

from typing import Any, Final

from agentd.mind.effects import Log

PERIOD: Final = 10.0
"""Mission seconds between two notes about what is dropped."""


class Drops:
    """The drops of one mind."""

    def __init__(self, mind: Any) -> None:
        self._mind = mind
        self.counts: dict[str, int] = {}
        """How many were dropped: of ``events``, ``messages``, ``questions``."""
        self._told: dict[str, tuple[int, float]] = {}
        """How many had been dropped when that was told last, and when that was."""

    def note(self, kind: str, text: str) -> None:
        """Count one that is dropped; ``text`` says of what kind and why."""
        mind, count = self._mind, self.counts.get(kind, 0) + 1
        self.counts[kind] = count
        told = self._told.get(kind)
        if told is None or mind.now >= told[1] + PERIOD:
            so_far = "" if told is None else f" ({count} so far)"
            self._told[kind] = (count, mind.now)
            mind.effects.append(Log("warning", text + so_far))

    def untold(self) -> list[Log]:
        """Notes about what was dropped since that was told last: for the end of a run."""
        left = {kind: count for kind, count in self.counts.items() if count > self._told[kind][0]}
        self._told.update((kind, (count, self._mind.now)) for kind, count in left.items())
        return [Log("warning", f"{count} {kind} were dropped in all") for kind, count in left.items()]
