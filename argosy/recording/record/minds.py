"""Which stretches of which minds' inputs have been recorded, and which are missing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from argosy.recording.file.mind_inputs import in_words, stretches

MOST_LIVES = 10_000
"""Lives that are followed; of further ones gaps are not told."""
MOST_MISSING = 100_000
"""Numbers of one life that can be missing before the recorder no longer keeps account of which."""


class Whose(NamedTuple):
    """One life of an agent."""

    fleet: str
    agent: str
    boot: str


@dataclass
class _Heard:
    next: int = 0
    """One more than the highest number that was heard."""
    missing: set[int] = field(default_factory=set)
    uncounted: int = 0
    """Numbers that are missing beyond those that are kept account of."""
    ended: bool = False
    """Whether the last stretch of all was heard."""
    gone: bool = False
    """Whether its agent is there no longer."""


class Minds:
    """Filled by the thread that writes, asked by the one that asks for what is missing."""

    def __init__(self) -> None:
        self._lives: dict[Whose, _Heard] = {}

    def heard(self, whose: Whose, number: int, *, final: bool = False) -> bool:
        """Note a stretch. Returns whether it is new."""
        life = self._lives.get(whose)
        if life is None:
            if len(self._lives) >= MOST_LIVES:
                return True
            life = self._lives[whose] = _Heard()
        life.ended = life.ended or final
        if number < life.next:
            if number not in life.missing:
                return False
            life.missing = life.missing - {number}  # a new set: another thread may look at the old one
            return True
        if number > life.next:
            room = max(0, MOST_MISSING - len(life.missing))
            stretch = range(life.next, number)
            life.missing = life.missing.union(stretch[-room:] if room else ())
            life.uncounted += max(0, number - life.next - room)  # `len` has 63 bits, a number of a stranger's any
        life.next = number + 1
        return True

    def gone(self, whose: Whose) -> None:
        """Note that an agent is there no longer."""
        if (life := self._lives.get(whose)) is not None:
            life.gone = True

    def knows(self, fleet: str, agent: str) -> bool:
        """Whether any stretch of an agent was heard."""
        return any(whose.fleet == fleet and whose.agent == agent for whose in list(self._lives))

    def missing(self) -> dict[Whose, frozenset[int]]:
        """Return what is missing by life, where something is."""
        return {whose: frozenset(life.missing) for whose, life in list(self._lives.items()) if life.missing}

    def gaps(self) -> list[str]:
        """Return in words what is missing."""
        told = []
        for whose, numbers in self.missing().items():
            life = self._lives[whose]
            told_ones = in_words(stretches(numbers))
            which = f"{life.uncounted} more and {told_ones}" if life.uncounted else told_ones
            told.append(f"{whose.agent} (boot {whose.boot}): of its inputs {which} of {life.next} are missing")
        return told

    def cut_short(self) -> list[str]:
        """Return in words whose end is missing, of those that are there no longer."""
        return [
            f"{whose.agent} (boot {whose.boot}): the end of its life is missing: it was killed, or its last inputs lost"
            for whose, life in list(self._lives.items())
            if life.gone and not life.ended
        ]
