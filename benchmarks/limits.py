"""Processes kept within the memory and the processor of a small board.

Where a control group can be made (version 1 or 2, as root), the kernel keeps them there: `ControlGroup`. Elsewhere they
are watched from outside: `Watcher` stops and continues them, and kills them all when together they hold too much.
`Cage.kind` says which it was. A cage is made before its processes, and each is started by `Cage.command`.
"""

from __future__ import annotations

import itertools
import os
import signal
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.held import MEGABYTE, pss

LEAST: Final = 1_000
"""Microseconds: the smallest quota that the kernel takes."""
SHORTEST: Final = 10_000
"""Microseconds: a share is kept over no shorter period. (A long one makes no slow core but a fast one with pauses.)"""
ENTER: Final = 'while [ "$1" != -- ]; do echo $$ >> "$1" || exit 125; shift; done; shift; exec "$@"'
_numbers = itertools.count(1)


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
    """What processes have used within a cage."""

    peak: float
    """MB that were charged to them at most."""
    throttled: float
    """Seconds in which they were held back, of each cage and each process in it together."""
    killed: int
    """Processes that were killed for memory."""


class Cage(ABC):
    """A set of processes under limits."""

    kind: str
    """In words, for pages."""

    @abstractmethod
    def command(self, argv: list[str]) -> list[str]:
        """Return how a process of the cage is started: by a shell that enters it and becomes the process."""

    @abstractmethod
    def charged(self) -> float:
        """Return the MB that count against the limit now."""

    @abstractmethod
    def usage(self) -> Usage:
        """Return what was used so far."""


@contextmanager
def caged(limits: Limits) -> Iterator[Cage]:
    """Make a cage and take it away behind the block, in which its processes have to end."""
    group = ControlGroup.made()
    if group is None:
        with tempfile.TemporaryDirectory() as folder:
            watcher = Watcher(limits, Path(folder) / "processes")
            try:
                yield watcher
            finally:
                watcher.end()
        return
    try:
        group.limit(limits)
        yield group
    finally:
        group.remove()


class ControlGroup(Cage):
    """The kernel's own limits, below the control group in which we are."""

    def __init__(self, memory: Path, cpu: Path, version: int) -> None:
        self._memory, self._cpu, self._version = memory, cpu, version
        self._share: float | None = None
        self._singles: list[Path] = []
        self.kind = f"a control group of the kernel (version {version})"

    @classmethod
    def made(cls) -> ControlGroup | None:
        """Make one without limits; None where that is not possible."""
        name = f"argosy-bench-{os.getpid()}-{next(_numbers)}"
        for version, memory, cpu in _places():
            made: list[Path] = []
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
        name = "memory.current" if self._version == 2 else "memory.usage_in_bytes"
        return int((self._memory / name).read_text()) / MEGABYTE

    def usage(self) -> Usage:
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


class Watcher(Cage):
    """Limits kept from outside: a thread that stops processes which have used their share, and kills at the limit.

    Memory is their proportional set size (`benchmarks.held.pss`); it is looked at every `LOOK` seconds, so that it may
    be above the limit for a moment. (A limit of address space would count what Zenoh only reserves.)
    """

    STEP: Final = 0.005
    """Seconds between two looks at the processor time used."""
    LOOK: Final = 0.25

    def __init__(self, limits: Limits, register: Path) -> None:
        self.kind = "a watcher that stops, continues and kills (no control group could be made here)"
        self._limits, self._register = limits, register
        self._register.touch()
        self._peak, self._throttled, self._killed = 0.0, 0.0, 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def command(self, argv: list[str]) -> list[str]:
        return ["/bin/sh", "-c", ENTER, "sh", str(self._register), "--", *argv]

    def charged(self) -> float:
        found = 0.0
        for pid in self._pids():
            with suppress(OSError):
                found += pss([pid])
        return found

    def usage(self) -> Usage:
        return Usage(self._peak, self._throttled, self._killed)

    def end(self) -> None:
        """Stop to watch."""
        self._ended.set()
        self._thread.join(5)

    def _pids(self) -> list[int]:
        return [int(line) for line in self._register.read_text().split()]

    def _watch(self) -> None:
        credit: dict[int, float] = {}
        used: dict[int, float] = {}
        stopped: set[int] = set()
        before, looked = time.monotonic(), 0.0
        while not self._ended.wait(self.STEP):
            now = time.monotonic()
            if now - looked > self.LOOK:
                looked = now
                self._look_at_memory()
            if self._limits.share is not None:
                self._share_out(self._limits.share, now - before, credit, used, stopped)
            before = now
        for pid in stopped:
            _signal(pid, signal.SIGCONT)

    def _share_out(
        self, share: float, passed: float, credit: dict[int, float], used: dict[int, float], stopped: set[int]
    ) -> None:
        """Give each process its share of the time that has passed, and all of them together that of their cores."""
        pids = self._pids()
        spent = {pid: _cpu(pid) for pid in pids}
        steps = {pid: spent[pid] - used.get(pid, 0.0) for pid in pids}
        used.update(spent)
        whole = credit.setdefault(0, 0.0)
        credit[0] = min(whole + self._limits.cores * share * passed - sum(steps.values()), share * SHORTEST / 1e6)
        for pid in pids:
            credit[pid] = min(credit.get(pid, 0.0) + share * passed - steps[pid], share * SHORTEST / 1e6)
            if min(credit[pid], credit[0]) < 0:
                self._throttled += passed if pid in stopped else 0.0
                stopped.add(pid)
                _signal(pid, signal.SIGSTOP)
            elif pid in stopped:
                stopped.discard(pid)
                _signal(pid, signal.SIGCONT)

    def _look_at_memory(self) -> None:
        held = self.charged()
        self._peak = max(self._peak, held)
        if self._limits.memory is not None and held > self._limits.memory:
            for pid in self._pids():
                self._killed += _signal(pid, signal.SIGKILL)


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


def _cpu(pid: int) -> float:
    """Seconds of processor time of all threads of a process so far; of one that has ended 0."""
    total = 0
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            with suppress(OSError):
                total += int(Path(f"/proc/{pid}/task/{task}/schedstat").read_text().split()[0])
    return total / 1e9


def _signal(pid: int, which: signal.Signals) -> bool:
    try:
        os.kill(pid, which)
    except ProcessLookupError:
        return False
    return True
