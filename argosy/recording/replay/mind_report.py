"""What came of living a mind again, in words: how far two lives agree, and where they part."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping

from agentd.replay.replay import Act, Difference, Result
from agentd.standalone.decision_printer import decision_lines
from schemas.humanize import count, shortened
from schemas.wire.mind_records import DecisionView

SHOWN = 5
"""Inputs that are shown of what came in before a difference, and deeds of each life after it."""
LONGEST = 200
"""Characters of a line: what programs print may be long."""


Named = Callable[[str], str]
"""Takes a line with names of program files, returns it as people read it."""


def nearer(files: Iterable[str], edited: Mapping[str, str]) -> Named:
    """Return what shortens the names of recorded files to what tells them apart.

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
    """Return how far two lives agree, in figures.

    `inputs`: how many had gone in by then; `wall`: seconds that it took to live it again.
    """
    counts = (
        (result.cycles, "cycle"),
        (inputs, "input"),
        (result.decisions, "decision"),
        (result.effects, "effect"),
    )
    told = ", ".join(count(number, noun) for number, noun in counts)
    until = result.until if result.difference is None else result.difference.time
    return f"{told} up to {until:.1f} s of mission time, in {wall:.1f} s"


def difference_lines(
    difference: Difference, recorded: Named, other: Named, *, edited: bool, shown: int = SHOWN
) -> Iterator[str]:
    """Tell where two lives part; `edited`: the other program was changed on purpose."""
    where = f"at {difference.time:.3f} s of mission time, in cycle {difference.cycle}"
    if not difference.exact:
        where = f"not known where exactly, up to {difference.time:.3f} s of mission time and cycle {difference.cycle}"
    yield f"first difference: {where} (batch {difference.batch} of its inputs)"
    if inputs := difference.inputs[-shown:] if shown > 0 else ():
        yield "what came in last before it:"
        yield from (f"  {shortened(line, LONGEST)}" for line in inputs)
    most = max(0, shown)
    if _alike(difference.recorded, difference.replayed):
        yield "the same plan is chosen, but its body is another one"
    yield from _side("recorded", difference.recorded, difference.recorded_next[:most], recorded)
    yield from _side("edited" if edited else "now", difference.replayed, difference.replayed_next[:most], other)


def _side(who: str, act: Act | None, following: tuple[Act, ...], name: Named) -> Iterator[str]:
    """Tell what one of the two lives did."""
    if act is None:
        yield f"{who}: nothing, or it is not known"
    elif act.decision is not None:
        yield f"{who}:"
        yield from (f"  {line}" for line in decision_words(act.decision, name))
    else:
        yield f"{who}: {shortened(name(act.text), LONGEST)}"
    if following:
        yield "  then"
        yield from (f"    {shortened(name(f'{one.time:.3f} s  {one.text}'), LONGEST)}" for one in following)


def _alike(one: Act | None, other: Act | None) -> bool:
    """Whether two decisions are the same in words, places aside: the body of the plan was edited then."""
    if one is None or other is None or one.decision is None or other.decision is None:
        return False
    made = one.decision, other.decision
    heads = [(d.event, d.chosen.label, d.chosen.trigger, len(d.rejected)) for d in made if d.chosen is not None]
    return len(heads) == 2 and heads[0] == heads[1]


def told_decision(at: float, decision: DecisionView, name: Named) -> Iterator[str]:
    """Tell a decision with its mission time."""
    for index, line in enumerate(decision_words(decision, name)):
        yield f"{f'{at:.3f} s' if index == 0 else '':>11}  {line}"


def decision_words(decision: DecisionView, name: Named) -> list[str]:
    """Return a decision as `agentd run --why` tells it: the event, and each plan with why it was chosen or not."""
    lines = decision_lines(decision)  # type: ignore[arg-type]
    return [shortened(name(line), LONGEST) for line in lines]
