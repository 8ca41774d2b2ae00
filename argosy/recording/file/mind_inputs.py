"""The lives of minds in a recording: the stretches of their inputs, in order, and which are missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

from schemas.wire import keys
from schemas.wire.mind_records import MindInputs

PART = "trace/inputs"


@dataclass
class Life:
    """One life of an agent, from its birth to its end or to that of the recording."""

    fleet: str
    agent: str
    boot: str
    batches: list[MindInputs] = field(default_factory=list)
    """In the order of their numbers, each once."""

    @property
    def missing(self) -> list[range]:
        """The numbers that are missing before the last one that is there, as stretches: a number may be anything."""
        there = [-1, *(batch.number for batch in self.batches)]
        return [range(one + 1, next_one) for one, next_one in pairwise(there) if next_one > one + 1]

    @property
    def whole(self) -> bool:
        """Whether it can be lived again: from birth on, and nothing missing in between. Its end may be: `ended`."""
        return bool(self.batches) and self.batches[0].birth is not None and not self.missing

    @property
    def ended(self) -> bool:
        """Whether its end is there: the agent left in order, and nothing can be missing behind the last batch."""
        return bool(self.batches) and self.batches[-1].final

    @property
    def until(self) -> float:
        """Mission seconds of the last that is known of it."""
        return max((step.now for batch in self.batches for step in batch.steps), default=0.0)


def lives_of(inputs: Iterable[tuple[str, MindInputs]]) -> list[Life]:
    """Return the lives that these stretches, with their keys, are of, in the order in which they were first heard."""
    found: dict[tuple[str, str, str], dict[int, MindInputs]] = {}
    for key, batch in inputs:
        parsed = keys.parse(key)
        if parsed is not None:
            found.setdefault((parsed[0], parsed[1], batch.header.boot), {}).setdefault(batch.number, batch)
    return [Life(*whose, [batches[number] for number in sorted(batches)]) for whose, batches in found.items()]


def stretches(numbers: Iterable[int]) -> list[range]:
    """Return the stretches that numbers make."""
    found: list[range] = []
    for number in sorted(numbers):
        if found and number == found[-1].stop:
            found[-1] = range(found[-1].start, number + 1)
        else:
            found.append(range(number, number + 1))
    return found


def in_words(missing: Iterable[range]) -> str:
    """Return stretches of numbers: `0-56, 70`."""
    return ", ".join(str(one.start) if one.stop == one.start + 1 else f"{one.start}-{one.stop - 1}" for one in missing)
