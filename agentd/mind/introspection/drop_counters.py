"""What a mind drops because too much waits: counted by kind, told at once and then now and again with the number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from agentd.mind.data.effects import Log

PERIOD: Final = 10.0
"""Mission seconds between two notes about what is dropped."""
MOST_NAMES: Final = 50
"""So many kinds of what was dropped are told apart; of further ones only the number is known."""


@dataclass(slots=True)
class Dropped:
    """What was dropped of one kind: ``what`` is ``events``, ``messages`` or ``questions``.

    ``name`` is the event's, such as ``+tick/1``, or the sender's.
    ``first`` and ``last`` are mission seconds; ``reason`` says why, in words.
    """

    what: str
    name: str
    reason: str
    first: float
    last: float
    count: int = 0


class Drops:
    """The drops of one mind."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        """How many were dropped: of ``events``, ``messages``, ``questions``."""
        self._by_name: dict[tuple[str, str], Dropped] = {}
        self._told: dict[str, tuple[int, float]] = {}
        """How many had been dropped when that was told last, and when that was."""

    @property
    def by_name(self) -> list[Dropped]:
        """What was dropped, by its name, in the order in which that began."""
        return list(self._by_name.values())

    def note(self, kind: str, text: str, name: str, now: float) -> Log | None:
        """Count one that is dropped at ``now`` (mission seconds) and return what is to be logged of it, if anything.

        ``text`` says of what kind and why, ``name`` which: `Dropped.name`.
        """
        count = self.counts[kind] = self.counts.get(kind, 0) + 1
        self._note_name(kind, name, text, now)
        told = self._told.get(kind)
        if told is not None and now < told[1] + PERIOD:
            return None
        self._told[kind] = (count, now)
        return Log("warning", text if told is None else f"{text} ({count} so far)")

    def _note_name(self, kind: str, name: str, text: str, now: float) -> None:
        known = self._by_name.get((kind, name))
        if known is None:
            if len(self._by_name) >= MOST_NAMES:
                return
            known = self._by_name[kind, name] = Dropped(kind, name, text, now, now)
        known.count += 1
        known.last = now

    def untold(self, now: float) -> list[Log]:
        """Return notes about what was dropped since the last one: for the end of a run, at ``now``."""
        left = {kind: count for kind, count in self.counts.items() if count > self._told[kind][0]}
        self._told.update((kind, (count, now)) for kind, count in left.items())
        return [Log("warning", f"{count} {kind} were dropped in all") for kind, count in left.items()]
