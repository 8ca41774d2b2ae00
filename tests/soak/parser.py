"""The parser against a million inputs: it reads each or says what is wrong with it, in time; some are run as well.

    python -m tests.soak.parser [--inputs N] [--jobs N] [--seed N]     all of them, and a section of
    docs/measurements/soak.md python -m tests.soak.parser --seed N --only NUMBER                 one of them again,
    shown

Every input is made from the seed and its number (`tests.agentd.mutants`), so a failure can be made again. What has been
done is kept in `.soak_parser`: stopped and started again, the run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from tests.agentd.mutants import mutant
from tests.agentd.trials import Pace, TooLong, try_to_read, try_to_run
from tests.soak.report import ROOT, write_section

INPUTS = 1_000_000
CHUNK = 2_000
TIME_EACH = 4
"""Of so many inputs one is read a second time, against the clock; those longer than `LONG` are all."""
LONG = 2000
RUN_EACH = 20
"""Of so many programs that are read, one is run."""
STATE = ROOT / ".soak_parser"
MOST_SHOWN = 20


def one(seed: int, number: int) -> Counter[str]:
    """Try one input: what came of it. Raises whatever the parser should not have raised."""
    text = mutant(seed, number)
    found: Counter[str] = Counter()
    program = try_to_read(text)
    found["characters"] += len(text)
    found["read" if program is not None else "refused"] += 1
    if number % TIME_EACH == 0 or len(text) > LONG:
        slow = _pace().too_slow(text)
        assert not slow, slow
    if program is not None and number % RUN_EACH == 0:
        found[f"run: {try_to_run(program)}"] += 1
    return found


@lru_cache(maxsize=1)
def _pace() -> Pace:
    return Pace()


def chunk(task: tuple[int, int, int]) -> dict[str, Any]:
    """The inputs from one number to another: how many were read, refused and run, and each failure with its number."""
    seed, begin, end = task
    found: Counter[str] = Counter()
    failures: list[dict[str, Any]] = []
    started = time.monotonic()
    for number in range(begin, end):
        try:
            found += one(seed, number)
        except (Exception, TooLong) as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            what = f"{type(error).__name__}: {error}"[:200]
            failures.append({"number": number, "what": what, "where": f"{where.filename}:{where.lineno}"})
    seconds = time.monotonic() - started
    return {"seed": seed, "begin": begin, "end": end, "found": found, "failures": failures, "seconds": seconds}


def run(seed: int, inputs: int, jobs: int) -> int:
    """All inputs, on several cores; writes the report. Returns 0 only if nothing failed."""
    done = {entry["begin"]: entry for entry in _kept(seed) if entry["end"] <= inputs}
    tasks = [(seed, b, min(b + CHUNK, inputs)) for b in range(0, inputs, CHUNK) if b not in done]
    if done:
        print(f"going on behind {len(done) * CHUNK} inputs that {STATE.name} knows of", flush=True)
    started = time.monotonic()
    with STATE.open("a") as state, multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for count, entry in enumerate(pool.imap_unordered(chunk, tasks), 1):
            state.write(json.dumps(entry) + "\n")
            state.flush()
            done[entry["begin"]] = entry
            for failure in entry["failures"]:
                print(f"seed {seed}, input {failure['number']}: {failure['what']} ({failure['where']})", flush=True)
            if count % 25 == 0 or count == len(tasks):
                print(f"{sum(e['end'] - e['begin'] for e in done.values()):,} inputs", flush=True)
    wall = time.monotonic() - started if len(tasks) * CHUNK >= inputs else None
    failures = _report(seed, list(done.values()), jobs, wall)
    STATE.unlink()
    return 1 if failures else 0


def _kept(seed: int) -> Iterator[dict[str, Any]]:
    """What an earlier run with this seed has done."""
    if STATE.exists():
        for line in STATE.read_text().splitlines():
            entry = json.loads(line)
            if entry["seed"] == seed:
                yield entry


def _report(seed: int, entries: list[dict[str, Any]], jobs: int, wall: float | None) -> int:
    found: Counter[str] = Counter()
    for entry in entries:
        found.update(entry["found"])
    failures = [failure for entry in entries for failure in entry["failures"]]
    count = sum(entry["end"] - entry["begin"] for entry in entries)
    seconds = sum(entry["seconds"] for entry in entries)
    ran = {name.partition(": ")[2]: n for name, n in sorted(found.items()) if name.startswith("run: ")}
    failed = f"{len(failures)} failure{'s' * (len(failures) != 1)}"
    lines = [
        f"The parser fuzzed with **{count:,} inputs** of seed {seed} ({found['characters'] / 1e6:.0f} million "
        f"characters): {found['read']:,} were read, printed, read again as the same tree and checked; "
        f"{found['refused']:,} were refused with a place and a message. **{failed}** (traceback, hang, wrong tree, too "
        "slow).",
        "",
        f"Of the programs that were read {sum(ran.values()):,} were run for up to 200 cycles without a world: "
        + (", ".join(f"{n:,} {name}" for name, n in ran.items()) or "none")
        + ".",
        "",
        f"{seconds:,.0f} s of work in {jobs} process{'es' * (jobs > 1)} at low priority"
        + (f", {wall:,.0f} s from start to end" if wall is not None else ", in several goes")
        + f"; {seconds / count * 1000:.2f} ms for each input. An input is made again by "
        f"`python -m tests.soak.parser --seed {seed} --only NUMBER`.",
    ]
    for failure in failures[:MOST_SHOWN]:
        lines += ["", f"- input {failure['number']}: `{failure['what']}` ({failure['where']})"]
    print("\n".join(lines))
    write_section("Parser", lines)
    return len(failures)


def show(seed: int, number: int) -> int:
    """Try one input again and show it."""
    print(mutant(seed, number))
    print("---")
    print(dict(one(seed, number)))
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--jobs", type=int, default=min(2, multiprocessing.cpu_count()))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, metavar="NUMBER")
    args = parser.parse_args()
    return run(args.seed, args.inputs, args.jobs) if args.only is None else show(args.seed, args.only)


if __name__ == "__main__":
    sys.exit(main())
