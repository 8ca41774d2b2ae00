"""Verify a recorded mind by a replay: which inputs there are, whether it decides the same, what is not proved."""

from __future__ import annotations

import os
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from agentd.mind.data.registry import ACTIONS, FUNCTIONS
from agentd.replay.replay import Act, CannotReplay, Difference, Result, acts, compare, replay
from agentd.standalone.decision_printer import decision_lines
from argosy.cli.errors import progress
from argosy.recording import mind_inputs
from argosy.recording.mind_inputs import range_text
from argosy.recording.reader import Recording
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.humanize import count, shortened
from schemas.version import RELEASE
from schemas.wire.mind_records import DecisionView, InitialMind, MindDecisions, MindInputs

OTHER_VERSION = f"another version of Argosy wrote them, this is {RELEASE}"

NO_END = "its end is not in the recording"


@dataclass
class ReplayCheck:
    """A recorded mind that is to be replayed."""

    number: int
    recorded_mind: mind_inputs.RecordedMind
    args: Namespace
    edited: dict[Path, str]
    """The texts of the edited program."""
    followed: bool = False
    """Whether its agent was restarted after it."""
    still_runs: bool = False
    """Whether its daemon was still there when the recording ended."""
    texts: dict[str, str] = field(default_factory=dict)
    """The same by the recorded paths of the files whose place they take."""
    recorded: Named = str
    """Name the places of the recorded program."""
    other: Named = str
    """And of the program that is replayed."""

    @property
    def name(self) -> str:
        """The agent's, with the number of its start if it is not the first."""
        return self.recorded_mind.agent if self.number == 1 else f"{self.recorded_mind.agent}, start {self.number}"

    @property
    def batches(self) -> list[MindInputs]:
        """The batches without a gap from the start on, and within `--until`."""
        return list(takewhile(self._in_time, self.recorded_mind.unbroken))

    @property
    def _as_asked(self) -> bool:
        """Whether no more than a part of what is there was asked for."""
        return len(self.batches) < len(self.recorded_mind.unbroken)

    def _in_time(self, batch: MindInputs) -> bool:
        until = self.args.until
        return until is None or batch.initial is not None or not batch.steps or batch.steps[0].now <= until

    def verify(self, recording: Recording, decisions: list[MindDecisions], unread: int) -> int:
        """Replay it and print the result; `unread` batches belong to some recorded mind. Returns the exit code."""
        batches, lacks = self.batches, self._lacks(recording)
        if unread and not self._as_asked:
            lacks.append(f"{count(unread, 'batch', 'batches')} of its inputs cannot be read: {OTHER_VERSION}")
        if not batches or batches[0].initial is None:
            return self._print_nothing(lacks)
        for line in self._take_names(batches[0].initial):
            print(line, file=sys.stderr)
        known, begun = {*ACTIONS, *FUNCTIONS}, time.monotonic()
        try:
            own = [one for one in decisions if one.header.boot == self.recorded_mind.boot]
            result, itself = self._result(batches, own), self.edited and replay(batches, own)
            wall = time.monotonic() - begun
            if itself and itself.difference is not None:
                return self._print_not_itself(itself, wall)
            if self.args.why:
                self._print_decisions(batches, result)
        except CannotReplay as error:
            return self._print_nothing([self.other(str(error))])
        foreign = sorted({str(name) for name in {*ACTIONS, *FUNCTIONS} - known})
        return self._print_result(result, wall, lacks, foreign)

    def _take_names(self, initial: InitialMind) -> list[str]:
        """Find whose place each edited file takes: that of the recorded one of its name, or of the main program.

        Returns a note for each file that takes the place of one of several under another name: it may be a wrong one.
        """
        names = {Path(path).name: path for path in initial.files}
        places = {names.get(path.name, initial.program): path for path in self.edited}
        self.texts = {place: self.edited[path] for place, path in places.items()}
        self.recorded = nearer(initial.files, {})
        self.other = nearer(initial.files, {place: str(path) for place, path in places.items()})
        if len(initial.files) == 1:
            return []
        main, known = Path(initial.program).name, ", ".join(sorted(names))
        return [
            f"note: {path} takes the place of {main}: no recorded file is called {path.name}, there are {known}"
            for path in self.edited
            if path.name not in names
        ]

    def _result(self, batches: list[MindInputs], decisions: list[MindDecisions]) -> Result:
        def show(batch: MindInputs) -> None:
            progress(f"batch {batch.number} of {len(batches)}")

        try:
            if self.edited:
                return compare(batches, files=self.texts, progress=show)
            return replay(batches, decisions, progress=show)
        finally:
            progress("")

    def _lacks(self, recording: Recording) -> list[str]:
        """Return what is missing of it, as text."""
        mind = self.recorded_mind
        there, whose = mind.batches, (mind.fleet, mind.agent, mind.boot)
        if not there or there[0].initial is None:
            missing = _batches([range(there[0].number)] if there else [])
            return [f"its start is missing, with {missing} of its inputs: begin to record sooner"]
        if self._as_asked:
            return []
        lost = self.recorded_mind.missing
        found = [f"{_batches(lost)} of its inputs {'is' if _is_one(lost) else 'are'} missing"] if lost else []
        if recording.end is not None and not lost:
            found += [str(gap) for gap in recording.end.gaps if (gap.fleet, gap.agent, gap.boot) == whose]
        if self.recorded_mind.ended:
            return found
        if self.followed:
            found.append(f"{NO_END}: it was killed, at most 0.25 s later, and started again")
        elif recording.missing:
            found.append("the recording was cut off: later inputs are not known")
        elif not self.still_runs:
            found.append(f"{NO_END}: it was killed, or its last inputs were lost")
        return found

    def _unheard(self) -> str:
        """Return until when decisions had no subscriber, so that nothing can be compared; empty if they always had."""
        batches = self.batches
        silent = [index for index, batch in enumerate(batches) if not batch.digest]
        if not silent:
            return ""
        until = max((step.now for batch in batches[: silent[-1] + 1] for step in batch.steps), default=0.0)
        return (
            f"its decisions had no subscriber in {len(silent)} of {len(batches)} batches, the last one at "
            f"{until:.1f} s: record from before the agent begins"
        )

    def _print_not_itself(self, result: Result, wall: float) -> int:
        """The recorded program itself differs: so this recording cannot show what another one would have done."""
        texts, self.edited = self.edited, {}
        code = self._print_result(result, wall, [], [])
        print(f"  this is the recorded program itself: {', '.join(map(str, texts))} cannot be compared with it")
        return code

    def _print_nothing(self, lacks: list[str]) -> int:
        print(f"{self.name}: nothing can be proved")
        for lack in lacks:
            print(f"  {lack}")
        return EXIT_FAILED

    def _print_result(self, result: Result, wall: float, lacks: list[str], foreign: list[str]) -> int:
        gone_in = sum(1 for batch in self.batches for one in batch.inputs if one.cycle <= result.cycles)
        compared, notes, agrees = figures(result, gone_in, wall), list(result.notes), "agrees"
        if not self.edited and result.difference is None and (unheard := self._unheard()):
            lacks, notes = [*lacks, unheard], []
        if result.difference is not None:
            print(f"{self.name}: differs: the same for {compared}")
            edited, shown = bool(self.edited), self.args.show
            for line in difference_lines(result.difference, self.recorded, self.other, edited=edited, shown=shown):
                print(f"  {line}")
        elif lacks:
            print(f"{self.name}: the same for {compared}, but not all of it is proved:")
            for lack in lacks:
                print(f"  {lack}")
        else:
            who = f"{self.name} with {', '.join(map(str, self.edited))}" if self.edited else self.name
            if self._as_asked:
                agrees = f"agrees up to second {self.args.until:g}, as asked"
            elif not self.recorded_mind.ended:
                agrees = "agrees as far as the recording goes"
                notes.append("the recording ends before the agent does")
            print(f"{who}: {agrees}: {compared}")
        if foreign:
            notes.append(
                f"{', '.join(foreign)}: Python of other packages was run again, and may read more than was recorded"
            )
        for note in notes:
            print(f"  note: {note}")
        return EXIT_DONE if result.agrees and not lacks else EXIT_FAILED

    def _print_decisions(self, batches: list[MindInputs], result: Result) -> None:
        """Print the decisions about a name, up to the difference if there is one."""
        last = result.difference.cycle if result.difference is not None else None
        for act in acts(batches, files=self.texts or None, until=last):
            if act.decision is not None and act.decision.name.partition("/")[0] == self.args.why:
                for index, line in enumerate(decision_text(act.decision, self.other)):
                    print(f"{f'{act.time:.3f} s' if index == 0 else '':>11}  {line}")


def _batches(numbers: list[range]) -> str:
    """Return which batches these are, as text."""
    return f"batch{'' if _is_one(numbers) else 'es'} {range_text(numbers)}" if numbers else "all"


def _is_one(numbers: list[range]) -> bool:
    return len(numbers) == 1 and numbers[0].stop == numbers[0].start + 1


SHOWN = 5
"""Number of inputs shown before a difference, and of decisions and effects of each mind after it."""
LONGEST = 200
"""Characters of a line: what programs print may be long."""


Named = Callable[[str], str]
"""Takes a line with names of program files, returns it as people read it."""


def nearer(files: Iterable[str], edited: Mapping[str, str]) -> Named:
    """Return a function that shortens the names of recorded files as far as they stay distinct.

    `edited`: by recorded path, the file that took its place: it is named as it was given.
    """
    folders = {os.path.dirname(path) for path in files}
    folder = os.path.commonpath(folders) if folders and len({os.path.isabs(one) for one in folders}) == 1 else ""
    short = {path: os.path.relpath(path, folder) if folder else path for path in files} | dict(edited)

    def name(line: str) -> str:
        for path, shown in short.items():
            line = line.replace(f"{path}:", f"{shown}:")
        return line

    return name


def figures(result: Result, inputs: int, wall: float) -> str:
    """Return the figures of a comparison as text.

    `inputs`: number of inputs by then; `wall`: duration of the replay, in seconds.
    """
    counts = (
        (result.cycles, "cycle"),
        (inputs, "input"),
        (result.decisions, "decision"),
        (result.effects, "effect"),
    )
    counted = ", ".join(count(number, noun) for number, noun in counts)
    until = result.until if result.difference is None else result.difference.time
    return f"{counted} up to {until:.1f} s of mission time, in {wall:.1f} s"


def difference_lines(
    difference: Difference, recorded: Named, other: Named, *, edited: bool, shown: int = SHOWN
) -> Iterator[str]:
    """Yield lines about the first difference.

    `edited`: the other program was changed on purpose; `shown`: inputs before the difference, and decisions and
    effects of each mind after it, that are shown.
    """
    where = f"at {difference.time:.3f} s of mission time, in cycle {difference.cycle}"
    if not difference.exact:
        where = f"not known where exactly, up to {difference.time:.3f} s of mission time and cycle {difference.cycle}"
    yield f"first difference: {where} (batch {difference.batch} of its inputs)"
    if inputs := difference.inputs[-shown:] if shown > 0 else ():
        yield "last inputs before it:"
        yield from (f"  {shortened(line, LONGEST)}" for line in inputs)
    most = max(0, shown)
    if _alike(difference.recorded, difference.replayed):
        yield "the same plan is chosen, but its body was changed"
    yield from _side("recorded", difference.recorded, difference.recorded_next[:most], recorded)
    yield from _side("edited" if edited else "now", difference.replayed, difference.replayed_next[:most], other)


def _side(who: str, act: Act | None, following: tuple[Act, ...], name: Named) -> Iterator[str]:
    """Yield lines about what one of the two minds did."""
    if act is None:
        yield f"{who}: nothing, or it is not known"
    elif act.decision is not None:
        yield f"{who}:"
        yield from (f"  {line}" for line in decision_text(act.decision, name))
    else:
        yield f"{who}: {shortened(name(act.text), LONGEST)}"
    if following:
        yield "  then"
        yield from (f"    {shortened(name(f'{one.time:.3f} s  {one.text}'), LONGEST)}" for one in following)


def _alike(one: Act | None, other: Act | None) -> bool:
    """Whether two decisions are equal but for their positions: then only the body of the plan was edited."""
    if one is None or other is None or one.decision is None or other.decision is None:
        return False
    made = one.decision, other.decision
    heads = [(d.event, d.chosen.label, d.chosen.trigger, len(d.rejected)) for d in made if d.chosen is not None]
    return len(heads) == 2 and heads[0] == heads[1]


def decision_text(decision: DecisionView, name: Named) -> list[str]:
    """Return a decision as `agentd run --why` prints it: the event, and each plan with why it was chosen or not."""
    lines = decision_lines(decision)
    return [shortened(name(line), LONGEST) for line in lines]
