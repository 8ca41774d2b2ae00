"""All that goes into one mind, from its birth on: kept for a while for who comes late, told while somebody listens.

What is kept are the inputs themselves; they become records when somebody asks. Once they take too much memory, the
beginning is dropped whole, for a life can be lived again from its birth only. The time is noted where it has made a
difference (`agentd.mind.data.intention.Timers.looks`), and now and then.
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
    ActionDone,
    Mail,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    PerceptsChanged,
    TeamReply,
    TimeRead,
    TooDeep,
)
from agentd.trace.decision_digest import DecisionDigest, deed_line
from agentd.trace.environment_reads import CameBack, Given, MailRefused, NamesRead
from agentd.trace.input_records import Included, written
from schemas.wire.mind_records import MindBirth, MindInputs, MindStep

MOST_BYTES: Final = 2_000_000
"""Bytes that what is kept since birth takes at most, roughly."""
INPUT_BYTES: Final = 200
"""What an input takes, roughly, besides its term."""
PART_BYTES: Final = 50
"""What a part of a term takes."""
STEP_BYTES: Final = 16
"""What a time takes."""
MOST_PARTS: Final = MOST_BYTES // PART_BYTES
"""So many parts of a term are counted."""
BATCH_BYTES: Final = 50_000
"""Bytes after which a batch is closed in any case."""
STEP_EVERY: Final = 0.05
"""Mission seconds after which the time of a mind that is not idle is noted in any case: decisions show it."""
STEP_CYCLES: Final = 20
"""So many cycles tell one that is not idle from one that only wakes now and then."""


class InputBatch:
    """A stretch of a life: one batch."""

    __slots__ = ("decided", "digest", "final", "firsts", "inputs", "last", "number", "times", "told", "weight")

    def __init__(self, number: int, told: bool) -> None:
        self.number = number
        self.last = 0
        self.firsts, self.times = array("q"), array("d")
        """The first cycles of steps, and their times."""
        self.inputs: list[tuple[int, Given]] = []
        self.weight = 0
        """Bytes that it takes, roughly."""
        self.decided, self.digest = 0, ""
        """How much was decided and done, and its digest, if somebody listened."""
        self.told = told
        """Whether it is told as it ends."""
        self.final = False
        """Whether the life ends with it."""


class InputLog:
    """What goes into one mind, batch by batch."""

    def __init__(
        self,
        mind: Mind,
        birth: Callable[[], MindBirth | None],
        early: Iterable[tuple[int, Given]] = (),
        *,
        room: Callable[[], int] = lambda: MOST_BYTES,
        forgotten: Callable[[], None] = lambda: None,
    ) -> None:
        """`birth` tells what the mind was made of, when somebody asks; `early` has gone into it meanwhile.

        `room`: so many bytes may be kept; `forgotten` is called when it was too much.
        """
        self.included: dict[int, Included] = {}
        """Programs that were read at run time, by the id of the request."""
        self.dropped = 0
        """Inputs that are in no batch: those of the beginning when they were dropped, and all while nobody listened."""
        self.listened = False
        self._mind, self._birth, self._timers = mind, birth, mind.timers
        self._kept: list[InputBatch] | None = []
        """The batches since birth."""
        self._kept_inputs = self._kept_bytes = 0
        self._room, self._forgotten = room, forgotten
        self._names: tuple[str, ...] | None = None
        """Who could be sent to when the mind asked last."""
        self._acts = DecisionDigest()
        """What was decided and done since the present batch began, while somebody listens."""
        self._looks = -1
        self._step_at, self._step_from = -1.0, 0
        self._open = InputBatch(0, False)
        self._begun = mind.cycle
        """The cycle after which the present batch began."""
        self.on = True
        """Whether inputs are noted now: from birth until that is too much, and while somebody listens."""
        self._put: Callable[[InputBatch], None] = lambda stretch: None
        for cycle, item in early:
            self.given(cycle, item)

    # --- what happens ---

    def given(self, cycle: int, item: Given) -> None:
        """Something has gone into the mind."""
        stretch = self._open
        stretch.inputs.append((cycle, item))
        stretch.weight += weight(item)

    def ran(self, first: int, now: float, effects: Iterable[Effect] = ()) -> None:
        """The mind has run some cycles at a time; `first` is the first of them. `effects`, what it wants done, are for
        `did`.
        """
        stretch, looks = self._open, self._timers.looks
        if looks != self._looks or (now >= self._step_at and (first >= self._step_from or stretch.inputs)):
            self._looks, self._step_at, self._step_from = looks, now + STEP_EVERY, first + STEP_CYCLES
            stretch.firsts.append(first)
            stretch.times.append(now)
            stretch.weight += STEP_BYTES
        if stretch.weight > BATCH_BYTES:
            self.close()

    def decided(self, entries: Iterable[Any]) -> None:
        """The mind has decided something (`agentd.mind.introspection.decision_log`); while somebody listens."""
        self._acts.decided(entries)

    def did(self, cycle: int, effect: Effect) -> None:
        """The mind has done something; while somebody listens."""
        self._acts.did(deed_line(cycle, effect))

    def reading(self, names: Callable[[], Collection[str]]) -> Callable[[], Collection[str]]:
        """Return `names`, who can be sent to, as the mind is to ask for them: what it learns by that is noted."""
        mind = self._mind

        def read() -> Collection[str]:
            found = names()
            if self.on and mind.on_input is not None and (known := tuple(found)) != self._names:
                self._names = known
                self.given(mind.cycle, NamesRead(known))
            return found

        return read

    # --- batches ---

    def listen(self, put: Callable[[InputBatch], None] | None) -> None:
        """From now on somebody listens: `put` takes each batch as it is closed. None: nobody does."""
        if self.on and (self._mind.cycle > self._begun or self._open.inputs):
            self.close()  # a batch is listened to as a whole or not at all
        self.listened = put is not None
        self._put = put if put is not None else lambda stretch: None
        if self.listened and not self.on:
            self.on = True  # the number that is left out says that something is missing
            self._open = InputBatch(self._open.number + 1, True)
            self._looks, self._step_at = -1, -1.0
        self._open.told = self.listened
        if not self.listened and self._kept is None:
            self.on = False

    def close(self) -> None:
        """End the present batch and begin the next."""
        stretch, self._open = self._open, InputBatch(self._open.number + 1, self.listened)
        stretch.last = self._begun = self._mind.cycle
        if self.listened:
            stretch.decided, stretch.digest = self._acts.take()
        if self._kept is not None:
            self._kept.append(stretch)
            self._kept_inputs += len(stretch.inputs)
            self._kept_bytes += stretch.weight
            if self._kept_bytes > self._room():
                self.forget()
        self._put(stretch)

    def flush(self) -> None:
        """End the present batch if anything happened in it."""
        stretch = self._open
        if stretch.inputs or stretch.firsts or self._acts.count:
            self.close()

    def end(self) -> None:
        """The life has ended in order: tell who listens, with a last batch although nothing may have happened in it."""
        self._open.final = True
        self.close()

    def forget(self) -> None:
        """Drop the beginning: from now on nobody who comes late gets it."""
        self._kept = None
        self.included.clear()
        self._birth = lambda: None
        if not self.listened:
            self.dropped += self._kept_inputs
            self.on = False
        self._forgotten()

    def untold(self) -> list[InputBatch]:
        """Return the batches since birth that were not told as they ended, each once."""
        found = [stretch for stretch in self._kept or () if not stretch.told]
        for stretch in found:
            stretch.told = True
        return found

    def since_birth(self) -> Iterator[MindInputs] | None:
        """Return all batches since birth; None if the beginning has been dropped."""
        if self._kept is None:
            return None
        self.flush()
        return None if self._kept is None else map(self.record, list(self._kept))

    def record(self, stretch: InputBatch) -> MindInputs:
        """Return a batch as a record, without its header."""
        return MindInputs(
            agent=self._mind.name,
            number=stretch.number,
            birth=self._birth() if stretch.number == 0 else None,
            last=stretch.last,
            steps=tuple(MindStep(first=f, now=n) for f, n in zip(stretch.firsts, stretch.times, strict=True)),
            inputs=tuple(written(cycle, item, self.included) for cycle, item in stretch.inputs),
            decided=stretch.decided,
            digest=stretch.digest,
            final=stretch.final,
        )


_PERCEPT: Final = frozenset((PerceptReplaced, PerceptAdded, PerceptRemoved))


def weight(item: Given) -> int:
    """Bytes that an input takes, roughly."""
    if type(item) in _PERCEPT:
        return INPUT_BYTES + PART_BYTES * _parts(item.literal)  # type: ignore[union-attr]
    if isinstance(item, Mail):
        return INPUT_BYTES + PART_BYTES * _parts(item.content)
    match item:
        case TeamReply(value=term):
            return INPUT_BYTES + PART_BYTES * _parts(term)
        case NamesRead(names=names):
            return INPUT_BYTES + PART_BYTES * len(names)
        case PerceptsChanged(percepts=percepts):
            return INPUT_BYTES + sum(
                INPUT_BYTES + (0 if literal is None else PART_BYTES * _parts(literal)) for literal in percepts.values()
            )
        case TimeRead() | ActionDone() | MailRefused() | TooDeep() | CameBack():
            return INPUT_BYTES
    return INPUT_BYTES + PART_BYTES * _parts(item.literal)


def _parts(term: Any) -> int:
    """How many parts a term has, up to some number."""
    if type(term) is Literal and (not term.annots or term.annots is PERCEPT):
        count = 1 + len(term.args)
        for part in term.args:
            if type(part) is str:
                count += 1 + len(part) // PART_BYTES
            elif type(part) is not float:
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
