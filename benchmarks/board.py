"""What a board needs in flight: its three daemons beside `argosy board`, which is one process; writes docs/board.md.

The board is flown by the daemons that a mission gives it, in simulation; simulators and other boards are processes of
their own and are not counted.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

from argosy.processes import Process, plan
from benchmarks.flights import setup_in, start_all, with_one_process
from benchmarks.held import alone, pss
from benchmarks.processes import BenchmarkFailed
from benchmarks.watched import Watched

GOAL: Final = 60.0
"""MB of PSS."""
SECONDS: Final = 12.0
"""Wall seconds in flight over which it is measured."""
EVERY: Final = 0.5
PATIENCE: Final = 180.0
"""Seconds until the board's vehicle flies."""
FLIES: Final = "takeoff succeeded"
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"


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
class Figures:
    """What the processes of a board used in flight."""

    processes: int
    threads: int = 0
    pss: list[float] = field(default_factory=list)
    alone: list[float] = field(default_factory=list)
    """MB, one per sample."""
    cpu: float = 0.0
    """Per cent of a core."""


def measure(subject: Subject, *, one_process: bool, seconds: float = SECONDS) -> Figures:
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


def _sampled(ours: list[Watched], seconds: float) -> Figures:
    pids = [one.process.pid for one in ours]
    figures = Figures(len(pids), threads=sum(len(os.listdir(f"/proc/{pid}/task")) for pid in pids))
    begun, used = time.monotonic(), sum(one.cpu() for one in ours)
    while time.monotonic() < begun + seconds:
        figures.pss.append(pss(pids))
        if (held := alone(pids)) is not None:
            figures.alone.append(held)
        time.sleep(EVERY)
    figures.cpu = 100 * (sum(one.cpu() for one in ours) - used) / (time.monotonic() - begun)
    return figures


def report(rows: list[tuple[Subject, Figures, Figures]]) -> str:
    """The figures as a table."""
    versions = f"Python {platform.python_version()}, eclipse-zenoh {version('eclipse-zenoh')}"
    machine = f"{os.cpu_count()} cores of {platform.machine()}"
    lines = [
        f"Measured by `make bench-board` on {datetime.now(UTC):%Y-%m-%d}: {versions}, {machine};",
        f"in flight, every {EVERY:g} s for {SECONDS:g} s: medians, and in brackets the highest. MB = 10^6 bytes.",
        "",
        f"| board | | processes | threads | PSS, MB | alone on the machine, MB | processor | goal: PSS < {GOAL:g} MB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for subject, apart, together in rows:
        for what, figures in (("three daemons", apart), ("`argosy board`", together)):
            goal = ("met" if max(figures.pss) < GOAL else "missed") if figures is together else ""
            lines.append(
                f"| {subject.title} | {what} | {figures.processes} | {figures.threads} | {_range(figures.pss)} "
                f"| {_range(figures.alone)} | {figures.cpu:.0f} % | {goal} |"
            )
    return "\n".join(lines)


def _range(values: list[float]) -> str:
    return f"{statistics.median(values):.1f} ({max(values):.1f})" if values else "not told here"


def main() -> int:
    """Measure and write. Returns the exit code: 1 if the goal is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.board", description=__doc__)
    parser.add_argument("--out", type=Path, help="page whose figures are replaced")
    args = parser.parse_args()
    try:
        rows = [
            (subject, measure(subject, one_process=False), measure(subject, one_process=True)) for subject in SUBJECTS
        ]
    except BenchmarkFailed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    text = report(rows)
    print(text)
    if args.out is not None:
        before, _, rest = args.out.read_text(encoding="utf-8").partition(BEGIN)
        args.out.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    return 0 if all(max(together.pss) < GOAL for _, _, together in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
