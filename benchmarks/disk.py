"""What the disk of this machine takes: whatever is kept through a loss of power waits for it."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from typing import Final

WRITES: Final = 50


def fsync() -> float:
    """Return the milliseconds that a commit costs here at least: the median of writing a page (4 kB) and fsync."""
    with tempfile.NamedTemporaryFile() as file:
        values = []
        for _ in range(WRITES):
            begun = time.perf_counter()
            os.pwrite(file.fileno(), bytes(4096), 0)
            os.fsync(file.fileno())
            values.append(time.perf_counter() - begun)
    return 1000 * statistics.median(values)
