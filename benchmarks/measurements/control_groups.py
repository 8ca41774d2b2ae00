"""Limit processes to the memory and the processor of a small board by control groups of the kernel, version 1 or 2.

Only root may make them, as a rule. A group is made before its processes, and each is started by `ControlGroup.command`.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.processes import MEGABYTE, BenchmarkFailed

LEAST: Final = 1_000
"""Microseconds: the smallest quota that the kernel takes."""
SHORTEST: Final = 10_000
"""Microseconds: a share is kept over no shorter period. (A long one makes no slow core but a fast one with pauses.)"""
ENTER: Final = 'while [ "$1" != -- ]; do echo $$ >> "$1" || exit 125; shift; done; shift; exec "$@"'
"""For a shell: write its number into each file up to `--`, then become the command behind it."""


@dataclass(frozen=True)
class Limits:
    """What processes may use together; None = all that there is."""

    memory: float | None = None
    """MB."""
    share: float | None = None
    """Of one core of this machine: what one core of theirs is."""
    cores: int = 1
    """Of theirs: all processes have `cores` times the share, and no process more than one."""


@dataclass(frozen=True)
class Usage:
    """What processes have used within their limits."""

    peak: float
    """MB that were charged to them at most."""
    throttled: float
    """Seconds in which they were held back, of the group and each process in it together."""
    killed: int
    """Processes that were killed for memory."""


_NAME: Final = "argosy-bench-"
_numbers = itertools.count(1)


class ControlGroup:
    """The kernel's own limits, below the control group in which we are."""

    def __init__(self, memory: Path, cpu: Path, version: int) -> None:
        self._memory, self._cpu, self._version = memory, cpu, version
        self._share: float | None = None
        self._singles: list[Path] = []
        self.kind = f"a control group of the kernel (version {version})"

    @classmethod
    def made(cls) -> ControlGroup | None:
        """Make one without limits; None where that is not possible."""
        name = f"{_NAME}{os.getpid()}-{next(_numbers)}"
        for version, memory, cpu in _places():
            made: list[Path] = []
            _sweep(memory, cpu)
            try:
                for folder in dict.fromkeys((memory / name, cpu / name)):
                    folder.mkdir()
                    made.append(folder)
                needed = ("memory.max", "cpu.max") if version == 2 else ("memory.limit_in_bytes", "cpu.cfs_quota_us")
                if (memory / name / needed[0]).exists() and (cpu / name / needed[1]).exists():
                    return cls(memory / name, cpu / name, version)
            except OSError:
                pass
            for folder in made:
                folder.rmdir()
        return None

    def limit(self, limits: Limits) -> None:
        """Set the limits. Raises OSError."""
        if limits.memory is not None:
            most = str(int(limits.memory * MEGABYTE))
            if self._version == 2:
                (self._memory / "memory.max").write_text(most)
                _written(self._memory / "memory.swap.max", "0")
            else:
                (self._memory / "memory.limit_in_bytes").write_text(most)
                _written(self._memory / "memory.memsw.limit_in_bytes", most)  # not there without accounting of swap
        if limits.share is not None:
            self._hold(self._cpu, limits.share * limits.cores)
            self._share = limits.share if limits.cores > 1 else None
            if self._share is not None and self._version == 2:
                (self._cpu / "cgroup.subtree_control").write_text("+cpu")

    def _hold(self, folder: Path, share: float) -> None:
        period = max(SHORTEST, round(LEAST / share))
        quota = round(period * share)
        if self._version == 2:
            (folder / "cpu.max").write_text(f"{quota} {period}")
        else:
            (folder / "cpu.cfs_period_us").write_text(str(period))
            (folder / "cpu.cfs_quota_us").write_text(str(quota))

    def command(self, argv: list[str]) -> list[str]:
        """Return the command that starts a process in the group: a shell that enters it and becomes the process."""
        cpu = self._cpu
        if self._share is not None:
            cpu = self._cpu / f"core-{len(self._singles)}"
            cpu.mkdir()
            self._singles.append(cpu)
            self._hold(cpu, self._share)
        memory = self._memory if self._version == 1 else cpu
        files = [str(folder / "cgroup.procs") for folder in dict.fromkeys((memory, cpu))]
        return ["/bin/sh", "-c", ENTER, "sh", *files, "--", *argv]

    def charged(self) -> float:
        """Return the MB that count against the limit now."""
        name = "memory.current" if self._version == 2 else "memory.usage_in_bytes"
        return int((self._memory / name).read_text()) / MEGABYTE

    def usage(self) -> Usage:
        """Return the resources used so far."""
        v2 = self._version == 2
        peak = _read(self._memory / ("memory.peak" if v2 else "memory.max_usage_in_bytes"))
        killed = _field(self._memory / ("memory.events" if v2 else "memory.oom_control"), "oom_kill")
        unit = ("throttled_usec", 1e6) if v2 else ("throttled_time", 1e9)
        throttled = sum(_field(folder / "cpu.stat", unit[0]) for folder in (self._cpu, *self._singles)) / unit[1]
        return Usage((peak or 0) / MEGABYTE, throttled, killed)

    def remove(self) -> None:
        """Take it away; what has ended a moment ago may still be in it."""
        until = time.monotonic() + 5
        for folder in dict.fromkeys((*self._singles, self._cpu, self._memory)):
            while True:
                try:
                    folder.rmdir()
                    break
                except OSError:
                    if time.monotonic() > until:
                        raise
                    time.sleep(0.05)


def _places() -> Iterator[tuple[int, Path, Path]]:
    """Return where groups may be made: the version, and the folder for memory and for the processor."""
    own = [line.split(":", 2) for line in Path("/proc/self/cgroup").read_text().splitlines()]
    mounts = [line.split() for line in Path("/proc/self/mounts").read_text().splitlines()]
    for _, controllers, path in own:
        if not controllers:  # version 2: ours may hold processes, and then no groups with limits; those above may
            for mount in (Path(fields[1]) for fields in mounts if fields[2] == "cgroup2"):
                here = mount / path.lstrip("/")
                yield from ((2, one, one) for one in (here, *here.parents) if one.is_relative_to(mount))
    first: dict[str, Path] = {}
    for _, controllers, path in own:
        for fields in mounts:
            if fields[2] == "cgroup" and set(controllers.split(",")) <= set(fields[3].split(",")):
                first |= {name: Path(fields[1]) / path.lstrip("/") for name in controllers.split(",")}
    if "memory" in first and "cpu" in first:
        yield 1, first["memory"], first["cpu"]


def _sweep(*folders: Path) -> None:
    """Take away the groups of benchmarks that were killed."""
    for folder in dict.fromkeys(folders):
        for group in folder.glob(f"{_NAME}*"):
            pid = group.name.removeprefix(_NAME).partition("-")[0]
            if not Path("/proc", pid).exists():
                for one in (*group.glob("core-*"), group):
                    with suppress(OSError):
                        one.rmdir()


def _written(file: Path, text: str) -> None:
    with suppress(OSError):
        file.write_text(text)


def _read(file: Path) -> int | None:
    try:
        return int(file.read_text())
    except (OSError, ValueError):
        return None


def _field(file: Path, name: str) -> int:
    try:
        return int(dict(line.split() for line in file.read_text().splitlines()).get(name, 0))
    except (OSError, ValueError):
        return 0


@contextmanager
def limited(limits: Limits) -> Iterator[ControlGroup]:
    """Make a group with limits, and remove it after the block, in which its processes have to end.

    Raises BenchmarkFailed where no group can be made.
    """
    group = ControlGroup.made()
    if group is None:
        raise BenchmarkFailed("no control group can be made here: run it as root")
    try:
        group.limit(limits)
        yield group
    finally:
        group.remove()
