"""Measure one part in this process and save what it found; `benchmarks.apart` starts it.

python -m benchmarks.measuring NAME MODULE [--quick]
"""

from __future__ import annotations

import argparse
import signal
import sys

from benchmarks import results
from benchmarks.apart import end_with_parent
from benchmarks.parts import Part, line_of_goals
from benchmarks.processes import BenchmarkFailed


def main(argv: list[str] | None = None) -> int:
    """Returns the exit code: 1 when the part could not be measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.measuring")
    parser.add_argument("name")
    parser.add_argument("where")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args(argv)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # it may have been started where that is ignored
    end_with_parent()
    try:
        return measured_here(Part(args.name, args.where, 0), args.quick)
    except KeyboardInterrupt:
        return 130


def measured_here(part: Part, quick: bool) -> int:
    """Measure a part. With `quick` nothing is saved, but all that would be made of it is made, and shown."""
    try:
        module = part.module()
        load = results.load_before(0.1 if quick else 2.0)
        before, revision = results.moment(), results.revision()
        figures = module.measure(quick)
        wanted = f'"{part.name} --quick"' if quick else part.name
        origin = results.here(f"make bench ARGS={wanted}", load, results.others(before), revision)
    except (BenchmarkFailed, ImportError) as error:
        print(f"error: {part.name}: {error}", file=sys.stderr)
        return 1
    if quick:
        module.pictures(figures)
        print("\n\n".join([*module.blocks(origin, figures).values(), "\n".join(line_of_goals(module.goals(figures)))]))
        return 0
    path = results.save(part.name, origin, figures)
    print(f"{part.name}: {path.relative_to(results.ROOT)}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
