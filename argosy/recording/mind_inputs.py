"""The inputs of minds in a recording, batch by batch: which minds they belong to, and which batches are missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise, takewhile
from typing import NamedTuple

import msgspec

from schemas.wire.mind_records import MindInputs

PART = "trace/inputs"
MAX_MINDS = 10_000
"""Lives that a recorder follows; gaps of further ones are not reported."""
MOST_MISSING = 100_000
"""Missing batches of one mind that are known by number; further ones are only counted."""


@dataclass
class RecordedMind:
    """The inputs of an agent from one start to its end, or to that of the recording."""

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
        """Whether it can be replayed: from its start, without a gap. Its end may be missing: `ended`."""
        return bool(self.batches) and self.batches[0].initial is not None and not self.missing

    @property
    def unbroken(self) -> list[MindInputs]:
        """The batches from its start to the first gap."""
        whole = takewhile(lambda pair: pair[0] == pair[1].number, enumerate(self.batches))
        return [batch for _, batch in whole]

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
    """Identifies one start of an agent."""

    fleet: str
    agent: str
    boot: str


class Gap(msgspec.Struct, frozen=True):
    """The missing inputs of one start of an agent, as the end of a recording holds them; as text for people."""

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
    absent: bool = False
    """Whether its agent has lost its token."""


class Minds:
    """The batches that a recorder has received; filled by its thread, read by the event loop."""

    def __init__(self) -> None:
        self._progress: dict[Whose, _Progress] = {}

    def heard(self, whose: Whose, number: int, *, final: bool = False) -> bool:
        """Note the batch of this `number`, which counts from 0. Returns whether it is new."""
        progress = self._progress.get(whose)
        if progress is None:
            if len(self._progress) >= MAX_MINDS:
                return True
            progress = self._progress[whose] = _Progress()
        progress.ended = progress.ended or final
        if number < progress.next:
            if number not in progress.missing:
                return False
            progress.missing = progress.missing - {number}  # a new set: another thread may look at the old one
            return True
        if number > progress.next:
            room = max(0, MOST_MISSING - len(progress.missing))
            stretch = range(progress.next, number)
            progress.missing = progress.missing.union(stretch[-room:] if room else ())
            progress.uncounted += max(0, number - progress.next - room)  # `len` has 63 bits, a stranger's number any
        progress.next = number + 1
        return True

    def agent_left(self, whose: Whose) -> None:
        """Note that an agent has lost its token."""
        if (progress := self._progress.get(whose)) is not None:
            progress.absent = True

    def missing(self) -> dict[Whose, frozenset[int]]:
        """Return the missing numbers of each mind that has a gap."""
        return {
            whose: frozenset(progress.missing) for whose, progress in list(self._progress.items()) if progress.missing
        }

    def gaps(self) -> list[Gap]:
        """Return the gap of each mind that has one."""
        found = []
        for whose, numbers in self.missing().items():
            progress = self._progress[whose]
            missing = tuple((one.start, one.stop - 1) for one in stretches(numbers))
            found.append(Gap(*whose, missing, progress.uncounted, progress.next))
        return found

    def cut_short(self) -> list[str]:
        """Return a line for each agent that has ended and whose final batch is missing."""
        return [
            f"{whose.agent} (boot {whose.boot}): its end is missing: it was killed, or its last inputs were lost"
            for whose, progress in list(self._progress.items())
            if progress.absent and not progress.ended
        ]
