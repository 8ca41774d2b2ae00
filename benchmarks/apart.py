"""Run a part of the benchmarks in a process of its own, with a time limit; nothing that it started outlives it.

python -m benchmarks.apart NAME MODULE [--quick]             measures a part in this process, and saves its figures
python -m benchmarks.apart NAME MODULE --probe [--quick]     prints its costs, as JSON behind `FOUND `
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import signal
import subprocess
import sys
import time
from typing import Final

import msgspec
import psutil

from benchmarks import results
from benchmarks.parts import Part, line_of_goals
from benchmarks.processes import BenchmarkFailed

PATIENCE: Final = 4.0
"""A part is ended after this many times its expected minutes."""
LEAST: Final = 300.0
"""Seconds that each part is given at least."""
GRACE: Final = 10.0
"""Seconds in which an interrupted part may end its own processes."""
_SET_CHILD_SUBREAPER: Final = 36
_SET_DEATH_SIGNAL: Final = 1


def patience(part: Part) -> float:
    """Return the seconds after which a part is ended."""
    return max(LEAST, 60 * PATIENCE * part.minutes)


def measure(part: Part, quick: bool) -> bool:
    """Measure a part in a process of its own; errors are printed. On Ctrl-C all is ended, too."""
    command = [sys.executable, "-m", "benchmarks.apart", part.name, part.where, *(["--quick"] if quick else [])]
    _prctl(_SET_CHILD_SUBREAPER, 1)  # those whose own parent has gone come to us, also from other sessions
    others = set(psutil.Process().children(recursive=True))
    begun = time.monotonic()
    process = subprocess.Popen(command, cwd=results.ROOT, start_new_session=True)
    try:
        code = process.wait(patience(part))
    except subprocess.TimeoutExpired:
        code = -1
        print(f"error: {part.name}: not done after {patience(part):.0f} s", file=sys.stderr, flush=True)
    finally:
        if left := _end(process, others):
            print(f"note: {part.name} left processes behind, ended: {', '.join(left)}", file=sys.stderr, flush=True)
        _prctl(_SET_CHILD_SUBREAPER, 0)
    word = "done" if code == 0 else "failed"
    print(f"{part.name}: {word} after {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    return code == 0


def _end(process: subprocess.Popen[bytes], others: set[psutil.Process]) -> list[str]:
    """End a part and all that was not there before it. Returns who outlived it."""
    try:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(GRACE)
    finally:  # a second Ctrl-C shortens the grace, and no more
        process.kill()
        process.wait()
        found = [one for one in psutil.Process().children(recursive=True) if one not in others]
        names = [_called(one) for one in found]
        for one in found:
            with contextlib.suppress(psutil.NoSuchProcess):
                one.kill()
        psutil.wait_procs(found, GRACE)
    return [name for name in names if name]


def _called(process: psutil.Process) -> str:
    try:
        return "" if process.status() == psutil.STATUS_ZOMBIE else f"{process.name()} {process.pid}"
    except psutil.NoSuchProcess:
        return ""


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def main(argv: list[str] | None = None) -> int:
    """Return the exit code: 1 when the part could not be measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.apart")
    parser.add_argument("name")
    parser.add_argument("where")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--probe", action="store_true")
    args = parser.parse_args(argv)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # it may have been started where that is ignored
    _prctl(_SET_DEATH_SIGNAL, signal.SIGINT)  # be interrupted when the process that has started this one is killed
    try:
        part = Part(args.name, args.where, 0)
        return probe_here(part, args.quick) if args.probe else measure_here(part, args.quick)
    except KeyboardInterrupt:
        return 130


def probe_here(part: Part, quick: bool) -> int:
    """Print what a part costs."""
    try:
        print("FOUND", msgspec.json.encode(part.module().probe(quick)).decode(), flush=True)
    except (BenchmarkFailed, ImportError) as error:
        print(f"error: {part.name}: {error}", file=sys.stderr)
        return 1
    return 0


def measure_here(part: Part, quick: bool) -> int:
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
        part.pictures(figures)
        print("\n\n".join([*module.blocks(origin, figures).values(), "\n".join(line_of_goals(part.goals(figures)))]))
        return 0
    path = results.save(part.name, origin, figures)
    print(f"{part.name}: {path.relative_to(results.ROOT)}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
