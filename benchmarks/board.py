"""What a board needs in flight: its three daemons beside `argosy board`, which is one process.

The board is flown by the daemons that a mission gives it, in simulation; simulators and other boards are processes of
their own and are not counted.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from argosy.processes.process_table import Process, plan
from benchmarks import plots
from benchmarks.flights import setup_in, start_all, with_one_process
from benchmarks.parts import Goal, tell
from benchmarks.processes import BenchmarkFailed, alone, pss
from benchmarks.results import Origin
from benchmarks.watched import Watched

GOAL: Final = 60.0
"""MB of PSS."""
SECONDS: Final = 12.0
"""Wall seconds in flight over which it is measured."""
EVERY: Final = 0.5
PATIENCE: Final = 180.0
"""Seconds until the board's vehicle flies."""
FLIES: Final = "takeoff succeeded"


@dataclass(frozen=True)
class Subject:
    """A board of a mission."""

    title: str
    mission: str
    board: str
    speed: float
    """At which it is still in flight when everything is measured."""


SUBJECTS: Final = (
    Subject("the single-UAV mission", "single_uav.yaml", "local", 2),
    Subject("search and rescue, board pi2 of three (a rescuer)", "search_and_rescue.yaml", "pi2", 5),
)


@dataclass
class Flown:
    """What the processes of a board used in flight."""

    processes: int
    threads: int = 0
    pss: list[float] = field(default_factory=list)
    alone: list[float] = field(default_factory=list)
    """MB, one per sample."""
    cpu: float = 0.0
    """Per cent of a core."""


@dataclass
class Row:
    """A board in both forms."""

    title: str
    apart: Flown
    together: Flown


@dataclass
class Figures:
    """All boards."""

    rows: list[Row]


def measure(quick: bool) -> Figures:
    """Fly each board in both forms. Raises BenchmarkFailed."""
    seconds, found = 2.0 if quick else SECONDS, []
    for subject in SUBJECTS[:1] if quick else SUBJECTS:
        tell(f"{subject.title}: three daemons")
        apart = flown(subject, one_process=False, seconds=seconds)
        tell(f"{subject.title}: one process")
        found.append(Row(subject.title, apart, flown(subject, one_process=True, seconds=seconds)))
    return Figures(found)


def flown(subject: Subject, *, one_process: bool, seconds: float) -> Flown:
    """Fly a board once. Raises BenchmarkFailed."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        setup = setup_in(folder, subject.mission, subject.speed)
        planned = plan(setup)
        started: list[tuple[Process, Watched]] = []
        start_all(stack, with_one_process(setup, subject.board, planned) if one_process else planned, started)
        ours = [one for process, one in started if process.board == subject.board and process.kind.measured]
        _until_it_flies(ours)
        return _sampled(ours, seconds)


def _until_it_flies(ours: list[Watched]) -> None:
    until = time.monotonic() + PATIENCE
    while not any(FLIES in line for one in ours for _, line in one.said):
        ended = [one.name for one in ours if one.process.poll() is not None]
        if ended or time.monotonic() > until:
            last = "\n".join(line for one in ours for _, line in one.said[-3:])
            raise BenchmarkFailed(f"it does not fly; ended: {ended}; last:\n{last}")
        time.sleep(0.05)


def _sampled(ours: list[Watched], seconds: float) -> Flown:
    pids = [one.process.pid for one in ours]
    flown = Flown(len(pids), threads=sum(len(os.listdir(f"/proc/{pid}/task")) for pid in pids))
    begun, used = time.monotonic(), sum(one.cpu() for one in ours)
    while time.monotonic() < begun + seconds:
        flown.pss.append(pss(pids))
        if (held := alone(pids)) is not None:
            flown.alone.append(held)
        time.sleep(EVERY)
    flown.cpu = 100 * (sum(one.cpu() for one in ours) - used) / (time.monotonic() - begun)
    return flown


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of a board in one process."""
    return [
        Goal(
            f"one process, {row.title}: memory in flight (PSS)",
            f"under {GOAL:g} MB at any time",
            f"{max(row.together.pss):.1f} MB",
            max(row.together.pss) < GOAL,
            f"three daemons hold {max(row.apart.pss):.1f} MB; what of one process holds the most is not measured here; "
            "tried: one interpreter for all three, and no import but those that tests/test_imports.py names",
        )
        for row in figures.rows
    ]


def pictures(figures: Figures) -> dict[str, str]:
    """Draw the memory of each board in both forms, beside the goal."""
    with plots.figure(height=1.2 + 0.6 * len(figures.rows)) as (made, axes):
        names: list[str] = []
        for row in reversed(figures.rows):
            for what, one, colour in (("one process", row.together, "agentd"), ("three daemons", row.apart, "paper")):
                axes.barh(len(names), statistics.median(one.pss), color=plots.COLOURS[colour])
                names.append(f"{row.title.partition(',')[0]}: {what}")
        axes.axvline(GOAL, color="black", linestyle="--")
        axes.set_yticks(range(len(names)), names)
        axes.set_xlabel("MB in flight (PSS); dashed: goal of one process")
        return {"board": plots.svg(made)}


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/guides/boards.md, and those of docs/measurements/comparison.md."""
    lines = [
        origin.line(),
        "",
        f"In flight, every {EVERY:g} s for {SECONDS:g} s: medians, and in brackets the highest. MB = 10^6 bytes. "
        f"Goal: one process under {GOAL:g} MB (PSS).",
        "",
        "| board | | processes | threads | PSS, MB | alone on the machine, MB | processor, % of a core | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in figures.rows:
        for what, one in (("three daemons", row.apart), ("`argosy board`", row.together)):
            goal = ("met" if max(one.pss) < GOAL else "**missed**") if one is row.together else ""
            lines.append(
                f"| {row.title} | {what} | {one.processes} | {one.threads} | {_range(one.pss)} "
                f"| {_range(one.alone)} | {one.cpu:.0f} % | {goal} |"
            )
    return {"board": "\n".join(lines)}


def in_comparison(figures: Figures) -> list[str]:
    """Return the rows of the table of boards' memory in docs/measurements/comparison.md: what, memory, of which
    machine, source."""
    first = figures.rows[0]
    return [
        f"| {what} in flight | {_held(one)} | a computer | [board.md](../guides/boards.md) |"
        for what, one in (("Argosy, three daemons", first.apart), ("Argosy, one process", first.together))
    ]


def _held(flown: Flown) -> str:
    shared = f"{statistics.median(flown.pss):.0f} MB (PSS)"
    if not flown.alone:
        return shared
    return f"{shared}; {statistics.median(flown.alone):.0f} MB if nothing else on the machine shares their libraries"


def _range(values: list[float]) -> str:
    return f"{statistics.median(values):.1f} ({max(values):.1f})" if values else "not told here"
