"""Measures the reasoner of agentd beside its peers, interleaved in one run, and prints the tables.

    python -m benchmarks.reasoner [--repeat 5] [--rows a,f2] [--out docs/reasoner.md]

Each program is run by each reasoner in a fresh process, A B A B ..., so that a machine that is slow for a while is
slow for all of them. Ratios are medians of the ratios of neighbouring runs. Peers that are not installed are left out.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.footprint import FOOTPRINTS
from benchmarks.processes import BenchmarkFailed, Speeds, run
from benchmarks.report import Result, report
from benchmarks.rows import ROWS, Row
from benchmarks.subjects import Subject, subjects_here


def measure(rows: list[Row], subjects: list[Subject], repeat: int) -> list[Result]:
    """Run the rows' programs ``repeat`` times on each subject. Rows with the same programs share their runs."""
    groups: dict[tuple[object, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.agents, row.environment), []).append(row)
    results = []
    for group in groups.values():
        runs: dict[str, list[dict[str, Speeds]]] = {subject.key: [] for subject in subjects}
        for turn in range(repeat):
            for subject in subjects:
                if subject.key == "jason" and group[0].environment:
                    continue
                _tell(f"{', '.join(r.bench for r in group)}: {subject.title}, {turn + 1} of {repeat}")
                with subject.prepared(group[0].paths(), group[0].environment) as command:
                    runs[subject.key].append(run(command, {r.bench for r in group}))
        results += [
            Result(row, {key: [found[row.bench] for found in turns] for key, turns in runs.items() if turns})
            for row in group
        ]
    return results


def footprints(subjects: list[Subject], times: int) -> dict[str, dict[str, float]]:
    """Start times and memory: by title, then by subject."""
    found: dict[str, dict[str, float]] = {}
    for footprint in FOOTPRINTS:
        found[footprint.title] = {}
        for subject in subjects:
            if subject.key == "jason":
                continue
            _tell(f"{footprint.title}: {subject.title}")
            found[footprint.title][subject.key] = footprint.measure(subject, times)
    return found


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main() -> int:
    """The command; exit code 1 when a process did not do what its row needs, 2 for an unknown row."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reasoner", description=__doc__)
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="runs of each program (default 5)")
    parser.add_argument("--rows", metavar="a,b,...", help="only these rows, and no start times and memory")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the report there as well")
    args = parser.parse_args()
    keys = args.rows.split(",") if args.rows else [row.key for row in ROWS]
    unknown = [key for key in keys if key not in {row.key for row in ROWS}]
    if unknown:
        known = ", ".join(row.key for row in ROWS)
        print(f"no row is called {', '.join(unknown)}; there are {known}", file=sys.stderr)
        return 2
    subjects = subjects_here()
    if not any(subject.key == "agentspeak" for subject in subjects):
        _tell("python-agentspeak is not installed (pip install '.[bench]'): no ratios")
    try:
        results = measure([row for row in ROWS if row.key in keys], subjects, args.repeat)
        text = report(results, {} if args.rows else footprints(subjects, 10), subjects, args.repeat)
    except BenchmarkFailed as failed:
        print(f"error: {failed}", file=sys.stderr)
        return 1
    print(text)
    if args.out is not None:
        args.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
