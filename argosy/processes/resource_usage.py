"""Memory and processor time of the processes of a run, measured from outside.

Memory is PSS (`/proc/PID/smaps_rollup`): a process's own memory plus its share of shared memory, so that the
figures of several processes may be added. Processor time is the kernel's own count in nanoseconds, of all threads.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

MEGABYTE = 1_000_000
_CPUCLOCK_SCHED = 2
MAX_SAMPLES = 100_000


def memory(pid: int) -> int | None:
    """Return the PSS of a process in bytes; None if it is gone or not ours to see."""
    try:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError):
        return None
    return None


def cpu_seconds(pid: int) -> float | None:
    """Return the processor time that a process has used; None if it is gone."""
    try:
        return time.clock_gettime((~pid << 3) | _CPUCLOCK_SCHED)  # clock_getcpuclockid(3) as Linux defines it
    except OSError:
        return None


@dataclass
class Usage:
    """Present usage of one process."""

    memory: int = 0
    """Bytes of PSS."""
    cpu: float = 0.0
    """Share of one core since the last sample, 1.0 = a whole core."""


@dataclass
class Window:
    """A stretch of the run over which processor time is counted."""

    wall: float = 0.0
    cpu: float = 0.0

    @property
    def share(self) -> float | None:
        """Share of one core; None if the window is too short."""
        return self.cpu / self.wall if self.wall >= 1.0 else None


@dataclass
class Meter:
    """Samples the processes of a run, about once a second."""

    usage: dict[int, Usage] = field(default_factory=dict)
    """By pid."""
    flight_memory: list[int] = field(default_factory=list)
    """Bytes of PSS of the measured daemons together, one per sample in flight."""
    flight: Window = field(default_factory=Window)
    idle: Window = field(default_factory=Window)
    _before: dict[int, tuple[float, float]] = field(default_factory=dict)

    def sample(self, pids: list[int], measured: list[int], *, flying: bool, idle: bool) -> None:
        """Take one sample of all `pids`; those in `measured` count together, in flight or while idle."""
        together_memory, together_cpu, span, complete = 0, 0.0, 0.0, bool(measured)
        for pid in pids:
            used, now, held = cpu_seconds(pid), time.monotonic(), memory(pid)
            if used is None or held is None:
                self.usage.pop(pid, None)
                complete = complete and pid not in measured
                continue
            then, before = self._before.get(pid, (now, used))
            self._before[pid] = now, used
            usage = self.usage.setdefault(pid, Usage())
            usage.memory = held
            if now > then:
                usage.cpu = (used - before) / (now - then)
            if pid in measured:
                together_memory += held
                together_cpu += used - before
                span = max(span, now - then)
        if not complete:
            return
        if flying and len(self.flight_memory) < MAX_SAMPLES:
            self.flight_memory.append(together_memory)
        for window, counts in ((self.flight, flying), (self.idle, idle)):
            if counts:
                window.wall += span
                window.cpu += together_cpu
