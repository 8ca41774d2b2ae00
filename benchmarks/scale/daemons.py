"""What the processes of a run use, by their kinds: processor, memory, and how long they wait for a core."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.held import pss
from benchmarks.processes import memory


@dataclass
class Use:
    """What the processes of one kind used over a time."""

    processes: int
    cpu: float = 0.0
    """Per cent of a core, all together."""
    waited: float = 0.0
    """Per cent of the time that their threads were ready and no core was free, all together."""
    rss: float = 0.0
    """MB resident, all together; what they share counts for each."""
    pss: float = 0.0
    """MB (10^6), all together; what they share counts once."""


@dataclass
class Sample:
    """What processes had used at a moment, by kind, in seconds."""

    cpu: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    waited: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    idle: float = 0.0
    """Of all cores of the machine."""


def sample(pids: dict[str, list[int]]) -> Sample:
    """Look at processes now; one that has ended counts no more."""
    found = Sample(idle=_idle())
    for kind, those in pids.items():
        for pid in those:
            with suppress(OSError):
                cpu, waited = _of(pid)
                found.cpu[kind] += cpu
                found.waited[kind] += waited
    return found


def _of(pid: int) -> tuple[float, float]:
    """Seconds on a core and seconds that a core was waited for, of all threads, as the scheduler counts them.

    Nanoseconds, where `/proc/PID/stat` looks a hundred times a second who is there.
    """
    ran = waited = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):
            on_core, in_line, *_ = (task / "schedstat").read_text().split()
            ran, waited = ran + int(on_core), waited + int(in_line)
    return ran / 1e9, waited / 1e9


def _idle() -> float:
    """Seconds for which the cores had nothing to do, since the machine started.

    A core that waits for a disk is free for who is ready; one that the host of a virtual machine has taken away is not.
    """
    fields = Path("/proc/stat").read_text().split(maxsplit=6)
    return (int(fields[4]) + int(fields[5])) / os.sysconf("SC_CLK_TCK")


def used(pids: dict[str, list[int]], before: Sample, after: Sample, seconds: float) -> dict[str, Use]:
    """Return what processes used between two samples, and what they hold now."""
    found: dict[str, Use] = {}
    for kind, those in pids.items():
        found[kind] = Use(
            len(those),
            100 * (after.cpu[kind] - before.cpu[kind]) / seconds,
            100 * (after.waited[kind] - before.waited[kind]) / seconds,
            sum(memory(pid, "VmRSS") for pid in those),
            pss(those),
        )
    return found


def lost_datagrams(ports: Iterable[int]) -> int:
    """Return how many datagrams the kernel has dropped so far at UDP ports, for their buffers were full."""
    wanted = {f"{port:04X}" for port in ports}
    lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    return sum(int(fields[-1]) for line in lines if (fields := line.split())[1].rpartition(":")[2] in wanted)
