"""A part of the benchmarks in a process of its own: it is given its time, and nothing that it started outlives it."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from typing import Final

import psutil

from benchmarks.parts import Part
from benchmarks.results import ROOT

PATIENCE: Final = 4.0
"""Times the minutes that a part says it takes: then it is ended."""
LEAST: Final = 300.0
"""Seconds that each part is given at least."""
GRACE: Final = 10.0
"""Seconds in which a part that is told to end may end its own processes."""
_SET_CHILD_SUBREAPER: Final = 36
_SET_DEATH_SIGNAL: Final = 1


def patience(part: Part) -> float:
    """Return the seconds after which a part is ended."""
    return max(LEAST, 60 * PATIENCE * part.minutes)


def measured(part: Part, quick: bool) -> bool:
    """Measure a part; what went wrong it has told itself, or is told here. On Ctrl-C all is ended, too."""
    command = [sys.executable, "-m", "benchmarks.measuring", part.name, part.where, *(["--quick"] if quick else [])]
    _guard(True)
    others = set(psutil.Process().children(recursive=True))
    begun = time.monotonic()
    process = subprocess.Popen(command, cwd=ROOT, start_new_session=True)
    try:
        code = process.wait(patience(part))
    except subprocess.TimeoutExpired:
        code = -1
        print(f"error: {part.name}: not done after {patience(part):.0f} s", file=sys.stderr, flush=True)
    finally:
        if left := _end(process, others):
            print(f"note: {part.name} left processes behind, ended: {', '.join(left)}", file=sys.stderr, flush=True)
        _guard(False)
    word = "done" if code == 0 else "failed"
    print(f"{part.name}: {word} after {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    return code == 0


def _end(process: subprocess.Popen[bytes], others: set[psutil.Process]) -> list[str]:
    """End a part and all that it has started: all that was not there before it. Returns who outlived it."""
    try:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(GRACE)
    finally:  # a second Ctrl-C shortens the grace, and no more
        process.kill()
        process.wait()
        left = _kill_all(process.pid, others)
    return left


def _kill_all(group: int, others: set[psutil.Process]) -> list[str]:
    """Kill a process group, and all that has come to us because those that had started it are gone."""
    found = [one for one in psutil.Process().children(recursive=True) if one not in others]
    names = [_called(one) for one in found]
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)
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


def _guard(wanted: bool) -> None:
    """Become the parent of processes whose own parent has gone (Linux), also of those in a session of their own."""
    _prctl(_SET_CHILD_SUBREAPER, int(wanted))


def end_with_parent() -> None:
    """Be interrupted when the process that has started this one is killed (Linux)."""
    _prctl(_SET_DEATH_SIGNAL, signal.SIGINT)


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)
