"""The inputs of minds in a recording, batch by batch: which lives they make up, and which batches are missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import msgspec

from schemas.wire.mind_records import MindInputs

PART = "trace/inputs"
MOST_LIVES = 10_000
"""Lives that a recorder follows; gaps of further ones are not reported."""
MOST_MISSING = 100_000
"""Missing batches of one life that are known by number; further ones are only counted."""


@dataclass
class Life:
    """One life of an agent, from its birth to its end or to that of the recording."""

    fleet: str
    agent: str
    boot: str
    batches: list[MindInputs] = field(default_factory=list)
    """Ordered by number, each once."""

    @property
    def missing(self) -> list[range]:
        """The ranges of missing numbers up to the last batch."""
        there = [-1, *(batch.number for batch in self.batches)]
        return [range(one + 1, next_one) for one, next_one in pairwise(there) if next_one > one + 1]

    @property
    def whole(self) -> bool:
        """Whether it can be replayed: from its birth, without a gap. Its end may be missing: `ended`."""
        return bool(self.batches) and self.batches[0].birth is not None and not self.missing

    @property
    def ended(self) -> bool:
        """Whether the last batch is there: the agent left in order."""
        return bool(self.batches) and self.batches[-1].final

    @property
    def until(self) -> float:
        """Mission time of its last recorded input, in seconds."""
        return max((step.now for batch in self.batches for step in batch.steps), default=0.0)


def stretches(numbers: Iterable[int]) -> list[range]:
    """Return numbers as ranges."""
    found: list[range] = []
    for number in sorted(numbers):
        if found and number == found[-1].stop:
            found[-1] = range(found[-1].start, number + 1)
        else:
            found.append(range(number, number + 1))
    return found


def range_text(missing: Iterable[range]) -> str:
    """Return ranges as text: `0-56, 70`."""
    return ", ".join(str(one.start) if one.stop == one.start + 1 else f"{one.start}-{one.stop - 1}" for one in missing)


class Whose(NamedTuple):
    """Identifies one life of an agent."""

    fleet: str
    agent: str
    boot: str


class Gap(msgspec.Struct, frozen=True):
    """The missing inputs of one life of an agent, as the end of a recording holds them; as text for people."""

    fleet: str
    agent: str
    boot: str
    missing: tuple[tuple[int, int], ...]
    """First and last number of each stretch of missing batches, in order."""
    uncounted: int
    """Missing batches besides these."""
    batches: int
    """One more than the highest number received."""

    def __str__(self) -> str:
        known = range_text(range(first, last + 1) for first, last in self.missing)
        which = f"{self.uncounted} more and {known}" if self.uncounted else known
        return f"{self.agent} (boot {self.boot}): batches {which} of {self.batches} of its inputs are missing"


@dataclass
class _Progress:
    next: int = 0
    """One more than the highest number received."""
    missing: set[int] = field(default_factory=set)
    uncounted: int = 0
    """Missing numbers beyond `MOST_MISSING`."""
    ended: bool = False
    """Whether the final batch was received."""
    gone: bool = False
    """Whether its agent has lost its token."""


class Minds:
    """The batches that a recorder has received; filled by its thread, read by the event loop."""

    def __init__(self) -> None:
        self._lives: dict[Whose, _Progress] = {}

    def heard(self, whose: Whose, number: int, *, final: bool = False) -> bool:
        """Note the batch of this `number`, which counts from 0. Returns whether it is new."""
        life = self._lives.get(whose)
        if life is None:
            if len(self._lives) >= MOST_LIVES:
                return True
            life = self._lives[whose] = _Progress()
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
            life.uncounted += max(0, number - life.next - room)  # `len` has 63 bits, a stranger's number any
        life.next = number + 1
        return True

    def gone(self, whose: Whose) -> None:
        """Note that an agent has lost its token."""
        if (life := self._lives.get(whose)) is not None:
            life.gone = True

    def missing(self) -> dict[Whose, frozenset[int]]:
        """Return the missing numbers of each life that has a gap."""
        return {whose: frozenset(life.missing) for whose, life in list(self._lives.items()) if life.missing}

    def gaps(self) -> list[Gap]:
        """Return the gap of each life that has one."""
        found = []
        for whose, numbers in self.missing().items():
            life = self._lives[whose]
            missing = tuple((one.start, one.stop - 1) for one in stretches(numbers))
            found.append(Gap(*whose, missing, life.uncounted, life.next))
        return found

    def cut_short(self) -> list[str]:
        """Return a line for each life that is over and whose final batch is missing."""
        return [
            f"{whose.agent} (boot {whose.boot}): the end of its life is missing: it was killed, or its last inputs lost"
            for whose, life in list(self._lives.items())
            if life.gone and not life.ended
        ]
