"""Everything that reads what strangers can send, against 100,000 inputs each.

python -m tests.soak.fuzz [--inputs N] [--seed N]             all targets, and a section of docs/measurements/soak.md
python -m tests.soak.fuzz --keep FILE                         the same, resumed: what is in the file is not run again
python -m tests.soak.fuzz --seed N --only TARGET NUMBER       one input again, shown
"""

import argparse
import json
import logging
import multiprocessing
import random
import sys
from collections import Counter
from pathlib import Path

from tests.soak.fuzz_targets import GROWTH, TARGETS, Found, fuzz, mutant, read_one
from tests.soak.report import table, write_section

INPUTS = 100_000


def report(found: list[Found], seed: int, inputs: int) -> int:
    """Write the section. Returns how many inputs failed, and targets grew."""
    failures = sum(len(one.failures) for one in found)
    grown = sum(one.growth >= GROWTH for one in found)
    lines = [
        f"Each reader of what strangers can send, fuzzed with **{inputs:,} inputs** of seed {seed} (made from recorded "
        f"and shipped data): **{failures} failures** (an error that is not documented, or more than 1 s of processor "
        f"time), **{grown} grew** by {GROWTH / 1e6:g} MB or more after a tenth of the inputs. An input is made again "
        f"by `python -m tests.soak.fuzz --seed {seed} --only TARGET NUMBER`.",
        "",
        *table("target | read | refused | failures | slowest, s | growth, kB", map(_row, found)),
    ]
    for one in found:
        lines += [f"\n- {one.target}, input {number}: `{what}`" for number, what in one.failures[:5]]
    print("\n".join(lines))
    write_section("Fuzzed readers", lines)
    return failures + grown


def _row(one: Found) -> tuple[object, ...]:
    counts = (f"{one.outcomes[what]:,}" for what in ("read", "refused"))
    return one.target, *counts, len(one.failures), f"{one.slowest:.2f}", f"{one.growth / 1000:,.0f}"


def _kept(file: Path | None) -> dict[str, Found]:
    """Return what a run that was ended has found, by target."""
    if file is None or not file.exists():
        return {}
    kept = [Found(**one) for one in json.loads(file.read_text())]
    for one in kept:
        one.outcomes = Counter(one.outcomes)
    return {one.target: one for one in kept}


def _of_target(task: tuple[int, int, int]) -> Found:
    """Fuzz one target, in a process of its own."""
    logging.disable(logging.CRITICAL)
    number, seed, inputs = task
    return fuzz(TARGETS[number], seed, inputs)


def main() -> int:
    """Run it. Returns 0 only if nothing failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, metavar="FILE")
    parser.add_argument("--only", nargs=2, metavar=("TARGET", "NUMBER"))
    args = parser.parse_args()
    if args.only is not None:
        target = next(one for one in TARGETS if one.name == args.only[0])
        data = mutant(target, args.seed, int(args.only[1]))
        print(data)
        print(read_one(target, data, random.Random(int(args.only[1]))))
        return 0
    kept = _kept(args.keep)
    with multiprocessing.get_context("spawn").Pool(2, maxtasksperchild=1) as pool:
        left = [number for number, target in enumerate(TARGETS) if target.name not in kept]
        for one in pool.imap_unordered(_of_target, [(number, args.seed, args.inputs) for number in left], chunksize=1):
            kept[one.target] = one
            print(one.target, dict(one.outcomes), one.failures[:5], flush=True)
            if args.keep is not None:
                args.keep.write_text(json.dumps([vars(each) for each in kept.values()]))
    found = [kept[target.name] for target in TARGETS]
    return 1 if report(found, args.seed, args.inputs) else 0


if __name__ == "__main__":
    sys.exit(main())
