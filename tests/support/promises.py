"""Promises in seconds, kept by a quiet machine of today: a busy or slow one has as much longer as it takes for all."""

import subprocess
import sys
import time
from collections.abc import Callable

_WORK = (sys.executable, "-S", "-c", "for _ in range(5_000_000): pass")
_QUIET = 0.15
"""Wall seconds for `_WORK` on a quiet machine."""
_SLOWEST = 10.0


def slowness() -> float:
    """Return how many times longer than a quiet machine this one takes now to start a process and compute, 1 to 10."""
    began = time.monotonic()
    subprocess.run(_WORK, check=True, timeout=60)
    return min(max(1.0, (time.monotonic() - began) / _QUIET), _SLOWEST)


def in_time(took: float, promise: float) -> bool:
    """Return whether `took` seconds keep a promise on a machine as busy as this one is now."""
    return took < promise or took < promise * slowness()


def kept(measure: Callable[[], float], promise: float, attempts: int = 3) -> bool:
    """Measure until a measurement is in time: a burst of other work spoils one, what is slow in itself spoils all."""
    return any(in_time(measure(), promise) for _ in range(attempts))
