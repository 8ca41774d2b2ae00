"""Measure everything, and write each table and plot: `make bench`.

python -m benchmarks                  all parts, one after the other, each in a process of its own
python -m benchmarks paper loop       these parts
python -m benchmarks --pages          nothing is measured: pages and pictures are written from benchmarks/results
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from benchmarks import pages, results
from benchmarks.parts import PARTS, Goal, Part, line_of_goals
from benchmarks.processes import BenchmarkFailed

PATIENCE: Final = 4.0
"""Times the minutes that a part says it takes (and never under five): then it is killed."""


def main(argv: list[str] | None = None) -> int:
    """Returns the exit code: 1 when a part could not be measured; a goal that is missed is told, and no error."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(one.name for one in PARTS)}")
    parser.add_argument("--pages", action="store_true", help="measure nothing, write pages and pictures from results")
    parser.add_argument(
        "--quick", action="store_true", help="only try everything: neither results nor pages are written"
    )
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    known = [one.name for one in PARTS]
    if unknown := [name for name in args.parts if name not in known]:
        print(f"error: no part is called {unknown[0]}; there are {', '.join(known)}", file=sys.stderr)
        return 2
    chosen = [one for one in PARTS if not args.parts or one.name in args.parts]
    if args.pages:
        return write_pages(chosen)
    if args.here:
        return measured_here(chosen[0], args.quick)
    failed = [one.name for one in chosen if not _measured_apart(one, args.quick)]
    if not args.quick:
        write_pages([one for one in chosen if one.name not in failed])
    print("\n".join(line_of_goals(goals_of([one for one in chosen if one.name not in failed]))))
    if failed:
        print(f"error: not measured: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _measured_apart(one: Part, quick: bool) -> bool:
    """Measure a part in a process of its own, which ends with it."""
    print(f"{one.name}: about {one.minutes:g} minutes", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", "benchmarks", one.name, "--here", *(["--quick"] if quick else [])]
    begun = time.monotonic()
    try:
        code = subprocess.run(command, cwd=results.ROOT, timeout=60 * max(5.0, PATIENCE * one.minutes)).returncode
    except subprocess.TimeoutExpired:
        print(f"error: {one.name}: not done after {PATIENCE:g} times its minutes", file=sys.stderr)
        return False
    print(f"{one.name}: {'done' if code == 0 else 'failed'} after {time.monotonic() - begun:.0f} s", file=sys.stderr)
    return code == 0


def measured_here(one: Part, quick: bool) -> int:
    """Measure a part in this process and save what it found. Returns the exit code."""
    load = results.load_before()
    try:
        figures = one.module().measure(quick)
    except BenchmarkFailed as error:
        print(f"error: {one.name}: {error}", file=sys.stderr)
        return 1
    if not quick:
        path = results.save(one.name, results.here(f"make bench ARGS={one.name}", load), figures)
        print(f"{one.name}: {path.relative_to(results.ROOT)}", file=sys.stderr)
    return 0


def write_pages(chosen: list[Part]) -> int:
    """Write blocks and pictures of the parts that have results. Returns the exit code."""
    for one in chosen:
        try:
            origin, figures = results.load(one.name, one.module().Figures)
        except FileNotFoundError:
            print(f"{one.name}: no results yet", file=sys.stderr)
            continue
        pages.write_pictures(one.module().pictures(figures))
        _told(pages.write(one.module().blocks(origin, figures)))
    _told(pages.write({"goals": "\n".join(line_of_goals(goals_of(list(PARTS))))}))
    return 0


def goals_of(chosen: list[Part]) -> list[Goal]:
    """Return the goals of the parts that have results."""
    found: list[Goal] = []
    for one in chosen:
        try:
            found += one.module().goals(results.load(one.name, one.module().Figures)[1])
        except FileNotFoundError:
            continue
    return found


def _told(changed: list[Path]) -> None:
    for page in changed:
        print(f"written: {page.relative_to(results.ROOT)}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
