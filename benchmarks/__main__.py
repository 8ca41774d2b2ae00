"""Measure everything, and write each table and plot: `make bench`.

python -m benchmarks                  all parts, one after the other, each in a process of its own
python -m benchmarks usage loop       these parts
python -m benchmarks --pages          nothing is measured: pages and pictures are written from benchmarks/results
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

import msgspec

from benchmarks import apart, pages, results
from benchmarks.parts import PARTS, Goal, Part, line_of_goals


def main(argv: list[str] | None = None, table: Sequence[Part] = PARTS) -> int:
    """Returns the exit code: 1 when a part could not be measured; a goal that is missed is reported, and no error."""
    known = [one.name for one in table]
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {', '.join(f'{one.name} ({one.minutes:g} min)' for one in table)}"
    )
    parser.add_argument("--pages", action="store_true", help="measure nothing, write pages and pictures from results")
    parser.add_argument("--quick", action="store_true", help="only try everything: no results and no pages are written")
    args = parser.parse_args(argv)
    if unknown := [name for name in args.parts if name not in known]:
        print(f"error: no part is called {unknown[0]}; there are {', '.join(known)}", file=sys.stderr)
        return 2
    chosen = [one for one in table if not args.parts or one.name in args.parts]
    if args.pages:
        shown = [_write_part(one) for one in chosen]
        _list_pages(pages.write(pages.of_several(table)))
        return 0 if all(shown) else 1
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    try:
        return _measure(chosen, table, args.quick)
    except KeyboardInterrupt:
        print("ended; parts that were done before are in benchmarks/results", file=sys.stderr)
        return 130


def _measure(chosen: list[Part], table: Sequence[Part], quick: bool) -> int:
    if (load := results.load_before(0.2 if quick else 2.0)) > pages.BUSY:
        _report(f"note: others keep {load:.1f} cores of this machine busy: figures will be worse than on a quiet one")
    failed = []
    for number, one in enumerate(chosen):
        left = sum(part.minutes for part in chosen[number:])
        times = "a try" if quick else f"about {one.minutes:g} min, all that is left {left:.0f} min"
        _report(f"[{number + 1} of {len(chosen)}] {one.name}: {times}")
        if not apart.measure(one, quick) or (not quick and not _write_part(one)):
            failed.append(one.name)
    if not quick:
        _list_pages(pages.write(pages.of_several(table)))
        goals = [goal for one in chosen if one.name not in failed for goal in _goals(one)]
        print("\n".join(line_of_goals(goals)))
    if failed:
        print(f"error: not measured: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _write_part(one: Part) -> bool:
    """Write blocks and pictures of a part from its results; reports if that cannot be."""
    try:
        module = one.module()
        origin, figures = results.load(one.name, module.Figures)
        pages.write_pictures(one.pictures(figures))
        _list_pages(pages.write(module.blocks(origin, figures)))
    except FileNotFoundError:
        _report(f"{one.name}: no results yet")
    except (msgspec.DecodeError, KeyError, ImportError) as error:
        print(f"error: {one.name}: {error}", file=sys.stderr)
        return False
    return True


def _goals(one: Part) -> list[Goal]:
    found = pages.found_of(one)
    return [] if found is None else one.goals(found[1])


def _list_pages(changed: list[Path]) -> None:
    for page in changed:
        _report(f"written: {page.relative_to(results.ROOT)}")


def _report(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _interrupt(number: int, _: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
