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
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from argosy.processes.process_table import Process, plan
from benchmarks.flights import setup_in, start_all, with_one_process
from benchmarks.parts import Goal, table, tell
from benchmarks.processes import BenchmarkFailed, Sampler, Watched, until
from benchmarks.results import Origin

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
    threads: int
    pss: list[float]
    """MB, one per sample."""
    alone: list[float]
    """MB, now and then."""
    cpu: float
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
        pids = {(subject.board, one.name): one.process.pid for one in ours}
        threads = sum(len(os.listdir(f"/proc/{pid}/task")) for pid in pids.values())
        sampler = Sampler(pids, EVERY)
        with sampler.sampling():
            time.sleep(seconds)
        samples = sampler.until(time.monotonic(), 0.5)
        last = samples[-1]
        return Flown(
            len(pids),
            threads,
            [sum(one.pss.values()) for one in samples],
            [one.alone[subject.board] for one in samples if one.alone],
            100 * sum(last.spent.values()) / last.at,
        )


def _until_it_flies(ours: list[Watched]) -> None:
    until(lambda: any(one.when(FLIES) or one.process.poll() is not None for one in ours), PATIENCE)
    if not any(one.when(FLIES) for one in ours):
        last = "\n".join(line for one in ours for _, line in one.said[-3:])
        raise BenchmarkFailed(f"it does not fly; last:\n{last}")


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


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/guides/boards.md, and those of docs/measurements/comparison.md."""
    lines = [
        origin.line(),
        "",
        f"In flight, every {EVERY:g} s for {SECONDS:g} s: medians, and in brackets the highest. MB = 10^6 bytes. "
        f"Goal: one process under {GOAL:g} MB (PSS).",
        "",
        *table("| board | | processes | threads | PSS, MB | alone on the machine, MB | processor, % of a core | |"),
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
