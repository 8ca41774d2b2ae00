"""Measure the reasoner of agentd beside its peers, interleaved in one run: the part `reasoner` of `make bench`.

    python -m benchmarks.reasoner --rows f,h [--repeat 3]      some rows; nothing is written

Each program is run by each reasoner in a fresh process, A B A B ..., so that a slow phase of the machine affects all of
them. Ratios are medians of the ratios of neighbouring runs. Peers that are not installed are left out.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from benchmarks.parts import Goal, at_most, progress
from benchmarks.processes import BenchmarkFailed, Speeds, lines, run, started
from benchmarks.reasoner import report
from benchmarks.reasoner.instructions import Counted, count_apart
from benchmarks.reasoner.report import Result, tables, warm
from benchmarks.reasoner.rows import FOOTPRINTS, ROWS, Row, row_called
from benchmarks.reasoner.subjects import Agentd, Subject, subjects_here
from benchmarks.results import Origin

REPEAT: Final = 2
STARTS: Final = 10
"""How often a start is timed."""
QUICK_ROWS: Final = ("g",)
GOAL_START: Final = 1.5
"""Times python-agentspeak's time from its start to the first print."""
_BEHIND: Final = (
    "Tried: effects from mind to mind without intermediate objects where a count of instructions showed some "
    "([mind.md](../architecture/mind.md#speed)); what else these rows take is counted there"
)
COUNTED: Final = ("f", "f2", "h")
"""Rows whose instructions are counted: the slowest beside python-agentspeak."""


@dataclass(frozen=True)
class Figures:
    """All that was measured."""

    repeat: int
    rows: list[Result]
    footprints: dict[str, dict[str, float]]
    """Start times and memory: by title, then by subject."""
    instructions: dict[str, Counted] = field(default_factory=dict)
    """What a cycle takes, of the rows in `COUNTED`."""


def measure(quick: bool) -> Figures:
    """Measure all rows, start times and memory. Raises BenchmarkFailed."""
    subjects = subjects_here()
    if not any(subject.key == "agentspeak" for subject in subjects):
        raise BenchmarkFailed("python-agentspeak is not installed: pip install '.[bench]'")
    rows = [row for row in ROWS if not quick or row.key in QUICK_ROWS]
    repeat = 1 if quick else REPEAT
    results = measure_rows(rows, subjects, repeat)
    took = {key: count_apart(row_called(key)) for key in COUNTED}
    return Figures(repeat, results, footprints(subjects, 1 if quick else STARTS), took)


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/measurements/reasoner.md and of docs/architecture/mind.md."""
    results = figures.rows
    return {
        "reasoner": report.page(origin, results, figures.footprints, figures.repeat),
        "mind-instructions": report.instructions(origin, figures.instructions),
    }


def pictures(figures: Figures) -> dict[str, str]:
    """Return the picture of docs/measurements/reasoner.md."""
    return {"reasoner": report.picture(figures.rows)}


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of each row, and of start and memory."""
    found = []
    for result in figures.rows:
        row, ratio = result.of, result.ratio("agentd", warm)
        if ratio is not None:
            title = f"{row.operation}: speed beside python-agentspeak, warm"
            wanted, ours = f"at least {row.target:g} times", f"{ratio:,.1f}" if ratio < 100 else f"{ratio:,.0f}"
            found.append(Goal(title, wanted, ours, ratio >= row.target, row.why))
    won, known, behind = report.ahead(figures.rows)
    if known == len(report.OF_JASON):
        title = "reasoner: rows ahead of Jason's warm JVM, by the ratio to python-agentspeak"
        found.append(
            Goal(title, f"{known} of {known}", f"{won} of {known}", won == known, f"behind: {behind}. {_BEHIND}")
        )
    start = figures.footprints[FOOTPRINTS[0].title]
    if "agentspeak" in start:
        ratio = start["agentd"] / start["agentspeak"]
        title = f"reasoner: {FOOTPRINTS[0].title}, beside python-agentspeak"
        found.append(at_most(title, GOAL_START, ratio, "times", FOOTPRINTS[0].why))
    for one in FOOTPRINTS:
        value = figures.footprints[one.title]["agentd"]
        found.append(at_most(f"reasoner: {one.title}", one.limit, value, one.unit, one.why, digits=2))
    return found


def in_short(figures: Figures) -> list[str]:
    """Return the rows of the README's table."""
    return report.in_short(figures.rows, figures.footprints)


_ROUND: Final = re.compile(r"BENCH (\S+) round +\d+ +ops +(\d+) +ns +(\d+)")
_BY_PROCESSOR_TIME: Final = """
import runpy, sys, time
time.monotonic, time.perf_counter_ns = time.process_time, time.process_time_ns
module, sys.argv = sys.argv[1], sys.argv[1:]
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""
"""Runs a module whose clocks show the processor time of its process."""


def probe(quick: bool) -> dict[str, float]:
    """Return processor time per operation of each row, instructions per cycle, start and memory: less is better."""
    found: dict[str, float] = {}
    for programs, environment in dict.fromkeys((row.agents, row.environment) for row in ROWS):
        rows = [row for row in ROWS if (row.agents, row.environment) == (programs, environment)]
        if quick and rows[0].key not in QUICK_ROWS:
            continue
        spent = _rounds(rows[0])
        found |= {f"{row.operation} (ns)": min(spent[row.bench]) for row in rows}
    for key in () if quick else COUNTED:
        found[f"{row_called(key).operation}, a cycle (instructions)"] = count_apart(row_called(key)).whole
    for one in FOOTPRINTS:
        found[f"{one.title} ({one.unit})"] = one.measure(Agentd(), 1 if quick else 5)
    return found


def _rounds(row: Row) -> dict[str, list[float]]:
    """Run a row's programs. Returns ns of processor time per operation of each round, by the name of the benchmark."""
    found: dict[str, list[float]] = {}
    command = Agentd().command(row.paths(), row.environment)
    with started([command[0], "-c", _BY_PROCESSOR_TIME, *command[2:]]) as process:
        for line in lines(process):
            if match := _ROUND.search(line):
                found.setdefault(match[1], []).append(int(match[3]) / int(match[2]))
    return found


def measure_rows(rows: Sequence[Row], subjects: Sequence[Subject], repeat: int) -> list[Result]:
    """Run the rows' programs ``repeat`` times on each subject. Rows with the same programs share their runs."""
    groups: dict[tuple[object, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.agents, row.environment), []).append(row)
    results = []
    for group in groups.values():
        runs: dict[str, list[dict[str, Speeds]]] = {subject.key: [] for subject in subjects}
        for turn in range(repeat):
            for subject in subjects:
                progress(f"{', '.join(r.bench for r in group)}: {subject.title}, {turn + 1} of {repeat}")
                command = subject.command(group[0].paths(), group[0].environment)
                runs[subject.key].append(run(command, {r.bench for r in group}))
        results += [
            Result(row.key, {key: [found[row.bench] for found in turns] for key, turns in runs.items() if turns})
            for row in group
        ]
    return results


def footprints(subjects: Sequence[Subject], times: int) -> dict[str, dict[str, float]]:
    """Measure start times and memory: by title, then by subject."""
    found: dict[str, dict[str, float]] = {}
    for footprint in FOOTPRINTS:
        found[footprint.title] = {}
        for subject in subjects:
            progress(f"{footprint.title}: {subject.title}")
            found[footprint.title][subject.key] = footprint.measure(subject, times)
    return found


def main() -> int:
    """The command; exit code 1 when a process did not do what its row needs, 2 for an unknown row."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reasoner")
    parser.add_argument("--rows", metavar="a,b,...", required=True, help=f"of {', '.join(row.key for row in ROWS)}")
    parser.add_argument(
        "--repeat", type=int, default=REPEAT, metavar="N", help=f"runs of each program (default {REPEAT})"
    )
    args = parser.parse_args()
    keys = args.rows.split(",")
    if unknown := [key for key in keys if key not in {row.key for row in ROWS}]:
        print(f"error: no row is called {unknown[0]}; there are {', '.join(row.key for row in ROWS)}", file=sys.stderr)
        return 2
    try:
        results = measure_rows([row for row in ROWS if row.key in keys], subjects_here(), args.repeat)
    except BenchmarkFailed as failed:
        print(f"error: {failed}", file=sys.stderr)
        return 1
    print("\n\n".join(tables(results)))
    return 0
