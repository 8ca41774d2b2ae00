"""The parser against a million inputs: it reads each or says what is wrong with it, in time; some are run as well.

python -m tests.soak.parser [--inputs N] [--seed N]      all of them, and a section of docs/measurements/soak.md
python -m tests.soak.parser --seed N --only NUMBER       one of them again, shown

Every input is made from the seed and its number (`tests.agentd.mutants`), so a failure can be made again.
"""

import argparse
import multiprocessing
import sys
import time
import traceback
from collections import Counter
from functools import lru_cache

from tests.agentd.mutants import mutant
from tests.agentd.trials import Pace, TooLong, try_to_read, try_to_run
from tests.soak.report import write_section

INPUTS, CHUNK, JOBS = 1_000_000, 2_000, 2
TIME_EACH = 4
"""Of so many inputs one is read a second time, against the clock; those longer than `LONG` are all."""
LONG = 2000
RUN_EACH = 20
"""Of so many programs that are read, one is run."""
MOST_SHOWN = 20


def one(seed: int, number: int) -> Counter[str]:
    """Try one input: what came of it. Raises whatever the parser should not have raised."""
    text = mutant(seed, number)
    program = try_to_read(text)
    found = Counter({"characters": len(text), "read" if program is not None else "refused": 1})
    if number % TIME_EACH == 0 or len(text) > LONG:
        slow = _pace().too_slow(text)
        assert not slow, slow
    if program is not None and number % RUN_EACH == 0:
        found[f"run: {try_to_run(program)}"] += 1
    return found


@lru_cache(maxsize=1)
def _pace() -> Pace:
    return Pace()


def chunk(task: tuple[int, int]) -> tuple[Counter[str], list[str], float]:
    """Try `CHUNK` inputs from a number on: what came of them, each failure, and seconds."""
    seed, begin = task
    found, failures, started = Counter[str](), list[str](), time.monotonic()
    for number in range(begin, begin + CHUNK):
        try:
            found += one(seed, number)
        except (Exception, TooLong) as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            failures.append(
                f"input {number}: `{type(error).__name__}: {error!s:.180}` ({where.filename}:{where.lineno})"
            )
    return found, failures, time.monotonic() - started


def run(seed: int, inputs: int) -> int:
    """Try all inputs, and write the report. Returns how many failed."""
    found, failures, seconds = Counter[str](), list[str](), 0.0
    started = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(JOBS) as pool:
        for some, failed, took in pool.imap_unordered(chunk, [(seed, begin) for begin in range(0, inputs, CHUNK)]):
            found, failures, seconds = found + some, failures + failed, seconds + took
    ran = {name.partition(": ")[2]: n for name, n in sorted(found.items()) if name.startswith("run: ")}
    lines = [
        f"The parser fuzzed with **{inputs:,} inputs** of seed {seed} ({found['characters'] / 1e6:.0f} million "
        f"characters): {found['read']:,} were read, printed, read again as the same tree and checked; "
        f"{found['refused']:,} were refused with a place and a message. **{len(failures)} "
        f"failure{'s' * (len(failures) != 1)}** (traceback, hang, wrong tree, too slow).",
        "",
        f"Of the programs that were read {sum(ran.values()):,} were run for up to 200 cycles without a world: "
        + (", ".join(f"{n:,} {name}" for name, n in ran.items()) or "none")
        + ".",
        "",
        f"{seconds:,.0f} s of work in {JOBS} processes at low priority, {time.monotonic() - started:,.0f} s from start "
        f"to end; {seconds / inputs * 1000:.2f} ms for each input. An input is made again by "
        f"`python -m tests.soak.parser --seed {seed} --only NUMBER`.",
        *(f"\n- {failure}" for failure in failures[:MOST_SHOWN]),
    ]
    print("\n".join(lines))
    write_section("Parser", lines)
    return len(failures)


def main() -> int:
    """Run it. Returns 0 only if nothing failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, metavar="NUMBER")
    args = parser.parse_args()
    if args.only is None:
        return 1 if run(args.seed, args.inputs) else 0
    print(f"{mutant(args.seed, args.only)}\n---\n{dict(one(args.seed, args.only))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
