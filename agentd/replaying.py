"""A mind lived again from what was recorded of it (`{agent}/trace/inputs`): to prove that it decides the same, or
to see what an edited program would have done.

    result = replay(batches, decisions)                       # the recorded program: exact, cycle by cycle
    result = compare(batches, program=Path("edited.asl"))     # another program beside the recorded one
    life = Life(birth); life.feed(batch); life.mind           # to look into a mind as it was

`batches` are the `MindInputs` of one life, in order from number 0; `decisions` the `MindDecisions` of the same agent as
far as there are any (only used to say more about a difference). Nothing here does I/O but reading an edited program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from agentd.mind import Mind
from schemas.minds import DecisionView, MindBirth, MindDecisions, MindInputs


class CannotReplay(ValueError):
    """Why a recording cannot be lived again: batches are missing, another version, a program that cannot be read."""


@dataclass(frozen=True, slots=True)
class Act:
    """A decision or an effect of a mind."""

    cycle: int
    time: float
    """Mission seconds."""
    kind: Literal["decision", "effect"]
    text: str
    """A decision: the event and the plan chosen for it. An effect: what was done, such as `action goto(1,2)`."""
    decision: DecisionView | None = None
    """With the plans that were rejected and why, where it is known."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Where two lives part."""

    cycle: int
    time: float
    batch: int
    """Number of the batch of inputs in which it is."""
    exact: bool
    """Whether this is the place itself; otherwise it is somewhere in this batch, up to here."""
    recorded: Act | None
    """What the recorded mind did; none: nothing any more, or it is not known."""
    replayed: Act | None
    inputs: tuple[str, ...]
    """What went in last before it, in words, the last one last."""
    recorded_next: tuple[Act, ...] = ()
    """What each did next."""
    replayed_next: tuple[Act, ...] = ()


@dataclass(frozen=True, slots=True)
class Result:
    """How far two lives agree."""

    agent: str
    program: str
    batches: int
    inputs: int
    cycles: int
    """All of these agree: up to the difference, if there is one."""
    decisions: int
    effects: int
    until: float
    """Mission seconds up to which they agree."""
    difference: Difference | None = None
    notes: tuple[str, ...] = ()
    """What should be known about this result, such as that user code was run again."""

    @property
    def agrees(self) -> bool:
        """Whether there is no difference."""
        return self.difference is None


class Life:
    """One mind that lives again. `feed` batch after batch; in between `mind` may be looked at."""

    mind: Mind

    def __init__(self, agent: str, birth: MindBirth, *, program: Mapping[str, str] | None = None) -> None:
        """`program`: texts by path that take the place of those recorded. Raises CannotReplay."""
        raise NotImplementedError

    def feed(self, batch: MindInputs, until: int | None = None) -> list[Act]:
        """Live a batch (up to a cycle); return what was decided and done, in order. Raises CannotReplay."""
        raise NotImplementedError


def replay(
    batches: Iterable[MindInputs],
    decisions: Iterable[MindDecisions] = (),
    *,
    progress: Callable[[MindInputs], None] | None = None,
) -> Result:
    """Live the recorded program again, exactly: the same inputs in the same cycles at the same times.

    Raises CannotReplay.
    """
    raise NotImplementedError


def compare(
    batches: Iterable[MindInputs],
    decisions: Iterable[MindDecisions] = (),
    *,
    program: Path | str | None = None,
    files: Mapping[str, str] | None = None,
    progress: Callable[[MindInputs], None] | None = None,
) -> Result:
    """Live the recorded program and an edited one on the same inputs; find the first decision or effect that differs.

    `program`: the file (Path) or the text (str) that takes the place of the main file; `files`: texts that take the
    place of further files, by their recorded paths. Raises CannotReplay.
    """
    raise NotImplementedError
