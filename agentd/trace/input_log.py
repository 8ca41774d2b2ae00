"""Log of every input to one mind, in batches: published while there are subscribers, kept for late joiners.

The inputs are kept as they are and become records on request. When they take too much memory, everything kept is
dropped, because a mind can be rebuilt from its initial state only. The time is noted where it has made a difference
(`agentd.mind.data.intention.Timers.looks`), and at intervals.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, Final

from agentd.language.terms.source_annotations import PERCEPT
from agentd.language.terms.terms import EMPTY, List, Literal, deref
from agentd.mind import Mind
from agentd.mind.data.effects import Effect
from agentd.mind.data.inputs import (
    BeliefAdded,
    GoalAdded,
    Mail,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    PerceptsChanged,
    SignalRaised,
    TeamReply,
)
from agentd.mind.data.intention import Timers
from agentd.trace.decision_digest import DecisionDigest, effect_line
from agentd.trace.input_records import Given, Included, Interrupted, NamesRead, written
from schemas.wire.mind_records import InitialMind, MindInputs, MindStep

MOST_BYTES: Final = 2_000_000
"""Maximum size of the inputs kept since the agent's start, in bytes (estimated)."""
INPUT_BYTES: Final = 200
"""Estimated bytes of an input besides its term."""
PART_BYTES: Final = 50
"""Estimated bytes of a part of a term."""
STEP_BYTES: Final = 16
"""Bytes of a time."""
MOST_PARTS: Final = MOST_BYTES // PART_BYTES
"""Parts of a term that are counted at most."""
BATCH_BYTES: Final = 50_000
"""Bytes (estimated) after which a batch is closed."""
STEP_EVERY: Final = 0.05
"""Mission seconds between two noted times of a mind that is not idle: decisions show the time."""
STEP_CYCLES: Final = 20
"""Cycles that distinguish a mind that is not idle from one that only wakes at intervals."""


class InputBatch:
    """The inputs of some cycles."""

    __slots__ = ("decided", "digest", "final", "firsts", "inputs", "last", "number", "published", "times", "weight")

    def __init__(self, number: int, published: bool) -> None:
        self.number = number
        self.last = 0
        self.firsts, self.times = array("q"), array("d")
        """The first cycles of steps, and their mission times in seconds."""
        self.inputs: list[tuple[int, Given]] = []
        self.weight = 0
        """Estimated bytes."""
        self.decided, self.digest = 0, ""
        """The number of decisions and effects, and their digest, if there were subscribers."""
        self.published = published
        """Whether it is published when it is closed, or was later."""
        self.final = False
        """Whether it is the agent's last one."""


class InputLog:
    """The inputs of one mind, batch by batch. Made before the mind, for its first inputs; `follow` completes it."""

    def __init__(
        self,
        agent: str,
        initial: Callable[[], InitialMind | None],
        names: Callable[[], Collection[str]],
        room: Callable[[], int] = lambda: MOST_BYTES,
        dropped: Callable[[], None] = lambda: None,
    ) -> None:
        """`initial` returns the initial state of the mind; `names` returns those that can be sent to, another
        collection when they have changed.

        `room` returns the bytes that may be kept; `dropped` is called when that was too little.
        """
        self.included: dict[int, Included] = {}
        """Programs that were read at run time, by the id of the request."""
        self.dropped = 0
        """Inputs that are in no batch: those that were dropped, and later ones without subscribers."""
        self.listened = False
        """Whether there are subscribers."""
        self.on = True
        """Whether inputs are noted: from the start until they are dropped, and while there are subscribers."""
        self._agent, self._initial, self._names, self._room, self._on_dropped = agent, initial, names, room, dropped
        self._mind: Mind
        self._timers: Timers
        self._kept: list[InputBatch] | None = []
        """The batches since the agent's start."""
        self._kept_inputs = self._kept_bytes = 0
        self._names_read: Collection[str] = ()
        """The names that the mind has read last."""
        self._acts = DecisionDigest()
        """The decisions and effects of the present batch, while there are subscribers."""
        self._looks = -1
        self._step_at, self._step_from = -1.0, 0
        self._open = InputBatch(0, False)
        self._begun = 0
        """The cycle after which the present batch began."""
        self._put: Callable[[InputBatch], None] = lambda batch: None

    def follow(self, mind: Mind) -> None:
        """Log this mind, which was made with `given` and `names`."""
        self._mind, self._timers, self._begun = mind, mind.timers, mind.cycle

    # --- inputs ---

    def given(self, cycle: int, item: Given) -> None:
        """Note an input of the cycle with this number (0 or more)."""
        batch, kind = self._open, type(item)
        batch.inputs.append((cycle, item))
        batch.weight += INPUT_BYTES
        if kind in _WITH_LITERAL:
            batch.weight += PART_BYTES * _parts(item.literal)  # type: ignore[union-attr]
        else:
            match item:
                case Mail(content=term) | TeamReply(value=term):
                    batch.weight += PART_BYTES * _parts(term)
                case NamesRead(names=names):
                    batch.weight += PART_BYTES * len(names)
                case PerceptsChanged(percepts=percepts):
                    parts = sum(_parts(literal) for literal in percepts.values() if literal is not None)
                    batch.weight += INPUT_BYTES * len(percepts) + PART_BYTES * parts

    def ran(self, first: int, now: float, effects: Iterable[Effect] = ()) -> None:
        """Note a run of the mind from cycle `first` on at mission time `now`, in seconds; effects are for `did`."""
        batch, looks = self._open, self._timers.looks
        if looks != self._looks or (now >= self._step_at and (first >= self._step_from or batch.inputs)):
            self._looks, self._step_at, self._step_from = looks, now + STEP_EVERY, first + STEP_CYCLES
            batch.firsts.append(first)
            batch.times.append(now)
            batch.weight += STEP_BYTES
        if batch.weight > BATCH_BYTES:
            self.close()

    def decided(self, entries: Iterable[Any]) -> None:
        """Note decisions (`agentd.mind.introspection.decision_log`), while there are subscribers."""
        self._acts.decided(entries)

    def did(self, cycle: int, effect: Effect) -> None:
        """Note an effect of the cycle with this number (0 or more), while there are subscribers."""
        self._acts.did(effect_line(cycle, effect))

    def names(self) -> Collection[str]:
        """Return the names that can be sent to; a reading by the mind is an input."""
        names = self._names()
        if names is not self._names_read and self.on and self._mind.on_input is not None:
            known = tuple(names)
            if known != tuple(self._names_read):
                self.given(self._mind.cycle, NamesRead(known))
            self._names_read = names
        return names

    # --- batches ---

    def listen(self, put: Callable[[InputBatch], None] | None) -> None:
        """Publish each batch with `put` when it is closed; None: there are no subscribers any more."""
        if self.on and (self._mind.cycle > self._begun or self._open.inputs):
            self.close()  # a batch is published whole or not at all
        self.listened = put is not None
        self._put = put if put is not None else lambda batch: None
        if self.listened and not self.on:
            self.on = True  # the number that is left out shows that inputs are missing
            self._open = InputBatch(self._open.number + 1, True)
            self._looks, self._step_at = -1, -1.0
        self._open.published = self.listened
        if not self.listened and self._kept is None:
            self.on = False

    def close(self) -> None:
        """End the present batch and begin the next."""
        batch, self._open = self._open, InputBatch(self._open.number + 1, self.listened)
        batch.last = self._begun = self._mind.cycle
        if self.listened:
            batch.decided, batch.digest = self._acts.take()
        if self._kept is not None:
            self._kept.append(batch)
            self._kept_inputs += len(batch.inputs)
            self._kept_bytes += batch.weight
            if self._kept_bytes > self._room():
                self.drop()
        self._put(batch)

    def flush(self) -> None:
        """End the present batch unless it is empty."""
        batch = self._open
        if batch.inputs or batch.firsts or self._acts.count:
            self.close()

    def end(self) -> None:
        """Publish a last batch, empty or not: the agent has ended without a defect."""
        self._open.final = True
        self.close()

    def drop(self) -> None:
        """Drop what is kept since initial: late joiners will not get it."""
        self._kept = None
        self.included.clear()
        self._initial = lambda: None
        if not self.listened:
            self.dropped += self._kept_inputs
            self.on = False
        self._on_dropped()

    def unpublished(self) -> list[InputBatch]:
        """Return the kept batches that were not published when they were closed, each once."""
        found = [batch for batch in self._kept or () if not batch.published]
        for batch in found:
            batch.published = True
        return found

    def since_start(self) -> Iterator[MindInputs] | None:
        """Return all batches since the start; None if they were dropped."""
        if self._kept is None:
            return None
        self.flush()
        return None if self._kept is None else map(self.record, list(self._kept))

    def record(self, batch: InputBatch) -> MindInputs:
        """Return a batch as a record, without its header."""
        return MindInputs(
            agent=self._agent,
            number=batch.number,
            initial=self._initial() if batch.number == 0 else None,
            last=batch.last,
            steps=tuple(MindStep(first=f, now=n) for f, n in zip(batch.firsts, batch.times, strict=True)),
            inputs=tuple(written(cycle, item, self.included) for cycle, item in batch.inputs),
            decided=batch.decided,
            digest=batch.digest,
            final=batch.final,
        )


_WITH_LITERAL: Final = frozenset(
    (PerceptReplaced, PerceptAdded, PerceptRemoved, GoalAdded, BeliefAdded, SignalRaised, Interrupted)
)


def _parts(term: Any) -> int:
    """Count the parts of a term, up to `MOST_PARTS`."""
    if type(term) is Literal and (not term.annots or term.annots is PERCEPT):
        count = 1 + len(term.args)
        for part in term.args:
            if type(part) is str:
                count += 1 + len(part) // PART_BYTES
            elif type(part) is not float and (type(part) is not Literal or part.args or part.annots):
                break
        else:
            return count  # as most are
    count, pending = 0, [term]
    while pending and count < MOST_PARTS:
        part = deref(pending.pop())
        count += 1
        if type(part) is str:
            count += 1 + len(part) // PART_BYTES
        elif type(part) is Literal:
            pending += part.args
            pending += part.annots
        elif type(part) is List and part is not EMPTY:
            pending += part.items[part.at :]
            pending.append(part.tail)
    return count
