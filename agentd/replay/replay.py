"""Replay a recorded mind (`{agent}/trace/inputs`): prove that it decides the same, or see what an edited program would
have done.

    result = replay(batches, decisions)                       # the recorded program: exact, cycle by cycle
    result = compare(batches, program=Path("edited.asl"))     # another program beside the recorded one
    rebuilt = ReplayedMind(batches[0]); rebuilt.feed(batches[0]); rebuilt.mind   # to inspect a former state

`batches` are the `MindInputs` of one start of an agent, in order from number 0; `decisions` are recorded
`MindDecisions` of the same agent, which describe a difference better. The only I/O is reading an edited program. Python
that a program uses runs again: if it reads the outside world, the replay may differ there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final, Literal

from agentd.language.syntax_tree.printer import source_text
from agentd.mind.data.effects import Log
from agentd.mind.data.inputs import ActionDone, Mail, TeamReply
from agentd.mind.data.intention import PLAN
from agentd.mind.introspection.decision_log import Failure
from agentd.mind.introspection.snapshots import short_text
from agentd.replay.replayed_mind import CannotReplay, Done, ReplayedMind, digest_of
from agentd.trace.decision_digest import brief
from agentd.trace.input_records import CameBack, Given, MailRefused, NamesRead
from schemas.files.text_files import read_bounded
from schemas.wire.mind_records import DecisionView, InitialMind, MindDecisions, MindInputs

__all__ = ["Act", "CannotReplay", "Difference", "ReplayedMind", "Result", "acts", "compare", "replay"]

NEXT: Final = 6
"""Acts of each mind that are shown after a difference."""
NEXT_CYCLES: Final = 20_000
"""Cycles that are searched for them."""
AHEAD: Final = 1_000
"""Cycles of an edited program between two inputs at most."""


@dataclass(frozen=True, slots=True)
class Act:
    """A decision or an effect of a mind."""

    cycle: int
    time: float
    """Mission seconds."""
    kind: Literal["decision", "failure", "effect"]
    text: str
    """A decision: the event and the plan chosen for it. An effect such as `action goto(1,2)`."""
    decision: DecisionView | None = None
    """With the rejected plans and the reasons, if known."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first difference between a recorded and a replayed mind."""

    cycle: int
    time: float
    batch: int
    """Number of the batch of inputs in which it is."""
    exact: bool
    """Whether the difference is exactly here; otherwise it is in this batch, up to here."""
    recorded: Act | None
    """The act of the recorded mind; None: it had ended, or the act is not known."""
    replayed: Act | None
    inputs: tuple[str, ...]
    """The last inputs before it, as text, the last one at the end."""
    recorded_next: tuple[Act, ...] = ()
    """The next acts of each."""
    replayed_next: tuple[Act, ...] = ()


@dataclass(slots=True)
class Result:
    """The agreement of a recorded and a replayed mind."""

    agent: str
    program: str
    batches: int = 0
    inputs: int = 0
    cycles: int = 0
    """Those that agree: up to the difference, if there is one."""
    decisions: int = 0
    effects: int = 0
    until: float = 0.0
    """Mission time in seconds up to which they agree."""
    unheard: int = 0
    """Batches that have no digest: nobody listened when they were made."""
    difference: Difference | None = None
    notes: tuple[str, ...] = ()
    """Remarks about this result, as text."""

    @property
    def agrees(self) -> bool:
        """Whether there is no difference."""
        return self.difference is None

    def add(self, batch: MindInputs) -> None:
        """Count a replayed batch."""
        self.batches += 1
        self.inputs += len(batch.inputs)
        self.cycles = batch.last
        self.unheard += not batch.digest

    def count(self, done: list[Done]) -> None:
        """Count decisions, which failures are too, and effects."""
        deciding = sum(one.decides for one in done)
        self.decisions += deciding
        self.effects += len(done) - deciding

    def complete(self, until: float, difference: Difference | None = None) -> Result:
        """Add how it ended, at `until` mission seconds; return the result."""
        self.until, self.difference = until, difference
        if difference is None and self.unheard:
            self.notes = (
                f"{self.unheard} of {self.batches} batches have no digest: nobody listened when they were made",
            )
        return self


Progress = Callable[[MindInputs], None]


def replay(
    batches: Iterable[MindInputs], decisions: Iterable[MindDecisions] = (), *, progress: Progress | None = None
) -> Result:
    """Replay the recorded program exactly: the same inputs in the same cycles at the same times.

    Raises CannotReplay.
    """
    rebuilt, rest = _first(batches)
    tally = Result(rebuilt.agent, rebuilt.initial.program)
    for batch in rest:
        done = rebuilt.feed(batch)
        if batch.digest and digest_of(done, rebuilt.initial.decisions > 0) != (batch.decided, batch.digest):
            return tally.complete(rebuilt.now, _where(rebuilt, batch, done, tally.cycles, decisions))
        tally.add(batch)
        tally.count(done)
        if progress is not None:
            progress(batch)
    return tally.complete(rebuilt.now)


def compare(
    batches: Iterable[MindInputs],
    *,
    program: Path | str | None = None,
    files: Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> Result:
    """Replay the recorded program and an edited one with equal inputs; find the first decision or effect that differs.

    `program`: the file (Path) or the text (str) that takes the place of the main file; `files`: texts that take the
    place of further files, by their recorded paths. Plans are distinguished by trigger and body, not by their place.
    Whether the recorded program itself agrees with the recording is for `replay` to say. Raises CannotReplay.
    """
    rebuilt, rest = _first(batches)
    initial = rebuilt.initial
    first = next(rest)
    other, tally = ReplayedMind(first, program=_texts(initial, program, files)), Result(rebuilt.agent, initial.program)
    keys = _Keys()
    for batch in chain((first,), rest):
        rebuilt.take(batch)
        other.take(batch)
        while rebuilt.mind.cycle < batch.last:
            own, others = rebuilt.cycle(), other.cycle()
            place = keys.difference(own, others)
            if place is not None:
                tally.count(own[:place])
                tally.cycles = rebuilt.mind.cycle - 1
                until = rebuilt.now
                return tally.complete(until, _parting(rebuilt, other, batch, rest, own[place:], others[place:]))
            tally.count(own)
        rebuilt.end_of_batch()
        other.end_of_batch()
        tally.add(batch)
        if progress is not None:
            progress(batch)
    return tally.complete(rebuilt.now)


def acts(
    batches: Iterable[MindInputs],
    *,
    program: Path | str | None = None,
    files: Mapping[str, str] | None = None,
    until: int | None = None,
) -> Iterator[Act]:
    """Replay a mind up to cycle `until`, from 1 (None: all), and yield its decisions and effects.

    `program` and `files` as in `compare`. Raises CannotReplay.
    """
    rebuilt, rest = _first(batches, program, files)
    for batch in rest:
        rebuilt.take(batch)
        while rebuilt.mind.cycle < (batch.last if until is None else min(until, batch.last)):
            for one in rebuilt.cycle():
                yield _act(rebuilt, one)
        if until is not None and batch.last >= until:
            return
        rebuilt.end_of_batch()


def _texts(initial: InitialMind, program: Path | str | None, files: Mapping[str, str] | None) -> dict[str, str]:
    """Return the texts that replace recorded ones. Raises CannotReplay."""
    texts = dict(files or {})
    if unknown := sorted(texts.keys() - initial.files.keys()):
        known = ", ".join(initial.files) or "none"
        raise CannotReplay(f"the recorded program has no file {unknown[0]}; its files are {known}")
    if program is not None:
        texts[initial.program] = program if isinstance(program, str) else _text(program)
    return texts


def _first(
    batches: Iterable[MindInputs], program: Path | str | None = None, files: Mapping[str, str] | None = None
) -> tuple[ReplayedMind, Iterator[MindInputs]]:
    """Rebuild the mind; return it with all batches, the first one included. Raises CannotReplay."""
    rest = iter(batches)
    first = next(rest, None)
    if first is None:
        raise CannotReplay("there are no inputs of a mind in the recording")
    texts = {} if first.initial is None else _texts(first.initial, program, files)
    return ReplayedMind(first, program=texts), chain((first,), rest)


def _text(path: Path) -> str:
    try:
        return read_bounded(path).decode("utf-8-sig")
    except OSError as error:
        raise CannotReplay(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise CannotReplay(f"{path}: the file is not UTF-8 text") from None


# --- an exact replay that differs ---


def _where(
    rebuilt: ReplayedMind, batch: MindInputs, done: list[Done], before: int, decisions: Iterable[MindDecisions]
) -> Difference:
    """Find the first difference in a batch with another digest, by the recorded decisions."""
    views = [(one, rebuilt.view_of(one)) for one in done if type(one.what) is tuple]
    known = {_decided(view) for _, view in views}
    own = (view for some in decisions if some.agent == rebuilt.agent for view in some.decisions)
    lost = next((view for view in own if before < view.cycle <= batch.last and _decided(view) not in known), None)
    mine = None if lost is None else next((one for one, _ in views if one.cycle >= lost.cycle), None)
    return Difference(
        cycle=batch.last if lost is None else lost.cycle,
        time=rebuilt.now if lost is None else lost.time,
        batch=batch.number,
        exact=lost is not None,
        recorded=None if lost is None else Act(lost.cycle, lost.time, "decision", _decision_text(lost), lost),
        replayed=None if mine is None else _act(rebuilt, mine),
        inputs=_inputs(rebuilt),
        replayed_next=tuple(_act(rebuilt, one) for one in done if lost is None or one.cycle > lost.cycle)[:NEXT],
    )


def _inputs(rebuilt: ReplayedMind) -> tuple[str, ...]:
    return tuple(f"cycle {cycle}: {given_text(item)}" for cycle, item in rebuilt.lasts)


def _decided(view: DecisionView) -> tuple[Any, ...]:
    return view.cycle, view.kind, view.name, None if view.chosen is None else view.chosen.position


# --- two programs ---


class _Keys:
    """The keys by which acts of two programs are compared."""

    def __init__(self) -> None:
        self._plans: dict[Any, str] = {}

    def difference(self, own: list[Done], others: list[Done]) -> int | None:
        """Return the index of the first difference between the acts of a cycle."""
        for place, (one, other) in enumerate(zip_longest(own, others)):
            if one is None or other is None or self._key(one) != self._key(other):
                return place
        return None

    def _key(self, done: Done) -> tuple[Any, ...]:
        what = done.what
        if type(what) is Failure:
            return what.intention, what.failed.error
        if type(what) is tuple:
            (relevant, args, *_), frame = what[2], what[6]
            return what[0], repr(relevant), *map(brief, args), None if frame is None else self._plan(frame[PLAN])
        return (_PLACE.sub("", done.line) if isinstance(what, Log) else done.line,)

    def _plan(self, plan: Any) -> str:
        known = self._plans.get(plan)
        if known is None:
            node = plan.syntax
            known = self._plans[plan] = f"{source_text(node.trigger)} <- {source_text(node.body)}"
        return known


_PLACE: Final = re.compile(r":\d+(:\d+)?\b")


def _parting(
    rebuilt: ReplayedMind,
    other: ReplayedMind,
    batch: MindInputs,
    rest: Iterator[MindInputs],
    own: list[Done],
    others: list[Done],
) -> Difference:
    """Describe a difference; `own` and `others` are the differing acts of this cycle. Find the next acts of each."""
    cycle, time = rebuilt.mind.cycle, rebuilt.now
    inputs = _inputs(rebuilt)
    recorded, replayed = (_act(rebuilt, own[0]) if own else None), (_act(other, others[0]) if others else None)
    mine, theirs = [_act(rebuilt, one) for one in own[1:]], [_act(other, one) for one in others[1:]]
    limit, here = cycle + NEXT_CYCLES, batch
    while rebuilt.mind.cycle < limit and (len(mine) < NEXT or len(theirs) < NEXT):
        if rebuilt.mind.cycle >= here.last:
            following = next(rest, None)
            if following is None:  # no more inputs: the edited program may end what it has begun
                theirs += [_act(other, one) for one in other.go_on(AHEAD)]
                break
            here = following
            rebuilt.take(here)
            other.take(here)
            continue
        if rebuilt.at_boundary:
            theirs += [_act(other, one) for one in other.go_on(AHEAD)]
        mine += [_act(rebuilt, one) for one in rebuilt.cycle()]
        other.mind.cycle = rebuilt.mind.cycle - 1  # inputs are numbered by the recorded cycles
        theirs += [_act(other, one) for one in other.cycle()]
    return Difference(
        cycle=cycle,
        time=time,
        batch=batch.number,
        exact=True,
        recorded=recorded,
        replayed=replayed,
        inputs=inputs,
        recorded_next=tuple(mine[:NEXT]),
        replayed_next=tuple(theirs[:NEXT]),
    )


# --- as text ---


def _act(rebuilt: ReplayedMind, done: Done) -> Act:
    what = done.what
    if type(what) is tuple:
        view = rebuilt.view_of(done)
        return Act(done.cycle, done.time, "decision", _decision_text(view), view)
    return Act(done.cycle, done.time, "failure" if type(what) is Failure else "effect", done.text)


def _decision_text(view: DecisionView) -> str:
    if view.chosen is None:
        return f"{view.event}: no plan"
    label = f"{view.chosen.label} " if view.chosen.label else ""
    return f"{view.event}: {label}{view.chosen.trigger} ({view.chosen.position})"


def given_text(item: Given) -> str:
    """Return an input as text."""
    match item:
        case Mail():
            return f"{item.performative} {short_text(item.content)} from {item.sender}"
        case ActionDone():
            reason = f": {item.reason}" if item.reason else ""
            return f"action #{item.id} {item.state or ('succeeded' if item.ok else 'failed')}{reason}"
        case TeamReply():
            return f"answer of the team to #{item.id}{f': {item.error} {item.message}' if item.error else ''}"
        case NamesRead(names=names):
            return f"the team is {', '.join(names)}"
        case MailRefused():
            return f"message {item.msg_id} was refused: {item.message}"
        case CameBack(life=number):
            return f"restart no. {number:g}"
    literal = getattr(item, "literal", None)
    kind = type(item).__name__
    return kind if literal is None else f"{_WORDS.get(kind, kind)} {short_text(literal)}"


_WORDS: Final = {
    "PerceptReplaced": "percept",
    "PerceptAdded": "percept also",
    "PerceptRemoved": "no percept any more",
    "GoalAdded": "goal",
    "BeliefAdded": "belief",
    "SignalRaised": "signal",
    "Interrupted": "signal",
}
