"""Start the processes of a benchmark, read their output, and measure their use of processor and memory."""

from __future__ import annotations

import array
import os
import re
import select
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import psutil

PATIENCE: Final = 600.0
"""Seconds after which a process that has not ended is killed and the run is called failed."""
SPEAKS: Final = 30.0
"""Seconds for words that a process is to print."""
LONGEST: Final = 86_400.0
"""Seconds for which a process is read: longer than any part may take, which ends it."""

_LINE: Final = re.compile(r"BENCH\s+(?P<bench>\S+)\s+round\s+\d+\s+ops\s+(?P<ops>\d+)\s+ns\s+(?P<ns>\d+)")


class BenchmarkFailed(Exception):
    """A process failed; the text has its name and its last output."""


@dataclass(frozen=True)
class Speeds:
    """Operations per second of one process, and its peak resident memory in MB."""

    rounds: tuple[float, ...]
    rss: float

    @property
    def cold(self) -> float:
        return self.rounds[0]

    @property
    def warm(self) -> float:
        """The mean of the last two rounds."""
        return statistics.fmean(self.rounds[-2:])


@contextmanager
def started(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process with its output in a pipe; it is killed at the end if it still runs."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "NO_COLOR": "1"}
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        env=environment,
        cwd=Path(__file__).parent.parent,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def lines(process: subprocess.Popen[bytes], patience: float = PATIENCE) -> Iterator[str]:
    """The lines of a process as they come, until it ends. Raises `BenchmarkFailed` after ``patience`` seconds."""
    assert process.stdout is not None
    until = time.monotonic() + patience
    pending = b""
    while True:
        ready, _, _ = select.select([process.stdout], [], [], max(0.0, until - time.monotonic()))
        if not ready:
            raise BenchmarkFailed(f"{process.args!r}: not done after {patience:g} s")
        read = os.read(process.stdout.fileno(), 65536)
        *whole, pending = (pending + read).split(b"\n")
        if not read and pending:
            whole, pending = [pending], b""
        yield from (line.decode(errors="replace") for line in whole)
        if not read:
            return


def memory(pid: int, field: str) -> float:
    """Return ``VmHWM`` (peak) or ``VmRSS`` (now) of a process in MB (10^6 bytes); 0 when it has ended.

    Not `os.wait4`: its figure includes what the parent held when it forked.
    """
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except OSError:
        return 0.0
    found = re.search(rf"^{field}:\s+(\d+) kB$", status, re.MULTILINE)
    return int(found[1]) * 1024 / MEGABYTE if found else 0.0


def run(command: list[str], benches: set[str]) -> dict[str, Speeds]:
    """Run a process to its end; the rounds that it printed, per benchmark. Each of ``benches`` has to be there."""
    rounds: dict[str, list[float]] = {bench: [] for bench in benches}
    peak, last = 0.0, ""
    with started(command) as process:
        for line in lines(process):
            last = line.strip() or last
            found = _LINE.search(line)
            if found is None:
                continue
            peak = max(peak, memory(process.pid, "VmHWM"))
            rounds.setdefault(found["bench"], []).append(int(found["ops"]) / int(found["ns"]) * 1e9)
        code = process.wait(PATIENCE)
    for bench in benches:
        if code or not rounds[bench]:
            shown = " ".join(command)
            raise BenchmarkFailed(f"{shown}: exit code {code}, no round of {bench}; it printed last: {last}")
    return {bench: Speeds(tuple(found), peak) for bench, found in rounds.items()}


def until_line(command: list[str], word: str, settle: float = 0.0) -> tuple[float, float]:
    """Seconds from the start to the first line with ``word``, and the MB resident ``settle`` seconds after it."""
    begun = time.perf_counter()
    with started(command) as process:
        for line in lines(process):
            if word in line:
                spent = time.perf_counter() - begun
                if settle:
                    time.sleep(settle)
                return spent, memory(process.pid, "VmRSS")
    raise BenchmarkFailed(f"{' '.join(command)}: ended without printing {word}")


def until(condition: Callable[[], bool], seconds: float, every: float = 0.02) -> bool:
    """Wait until something holds, and look every so many seconds. Returns whether it did in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(every)
    return True


@dataclass
class Watched:
    """A process of the run and the lines that it has written, each with the moment at which it came."""

    name: str
    process: subprocess.Popen[bytes]
    output: list[tuple[float, str]] = field(default_factory=list)

    def read(self) -> None:
        """Read until it ends; runs in a thread of its own."""
        for line in lines(self.process, LONGEST):
            self.output.append((time.monotonic(), line))

    def wait_for(self, words: str, patience: float = SPEAKS) -> None:
        """Wait until it has printed `words`. Raises BenchmarkFailed."""
        until(lambda: bool(self.when(words)) or self.process.poll() is not None, patience)
        if not self.when(words):
            last = "\n".join(line for _, line in self.output[-5:])
            raise BenchmarkFailed(f"{self.name} did not print `{words}` within {patience:g} s; last:\n{last}")

    def when(self, words: str, since: int = 0) -> float:
        """Return the monotonic time at which a line with `words` came, from line `since` on; 0 = not yet."""
        return next((at for at, line in self.output[since:] if words in line), 0.0)

    def cpu(self) -> float:
        """Seconds of processor time used so far."""
        return processor_time(self.process.pid)


def watched(name: str, *arguments: str) -> AbstractContextManager[Watched]:
    """Run `python ARGUMENTS` while the block lasts."""
    return watched_command(name, [sys.executable, *arguments])


@contextmanager
def watched_command(name: str, command: list[str]) -> Iterator[Watched]:
    """Run a command while the block lasts."""
    with started(command) as process:
        found = Watched(name, process)
        reader = threading.Thread(target=found.read, daemon=True)
        reader.start()
        try:
            yield found
        finally:
            process.kill()
            process.wait()
            reader.join(5)


def processor_time(pid: int) -> float:
    """Return the seconds of processor time of a process, all its threads included, also those that have ended.

    Read from its clock (clock_getcpuclockid(3)), to the nanosecond. Raises OSError for one that has ended.
    """
    return time.clock_gettime((~pid << 3) | 2)


MEGABYTE: Final = 1_000_000
"""Bytes: MB is 10^6 of them in all results and on all pages."""
_PAGE: Final = 4096
_PRESENT: Final = 1 << 63
_FRAME: Final = (1 << 55) - 1


def pss(pids: Iterable[int]) -> float:
    """Return the proportional set size of processes in MB: what they share with others is counted in parts."""
    return sum(_pss(pid) for pid in pids) * 1024 / MEGABYTE


def _pss(pid: int) -> int:
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1])
    raise OSError(f"no Pss of process {pid}")


def alone(pids: Iterable[int]) -> float | None:
    """Return what processes hold in MB if nobody else shares anything with them: each page frame is counted once.

    None where the kernel does not report page frames (it does to root).
    """
    frames: set[int] = set()
    for pid in pids:
        frames |= _frames(pid)
    return None if frames <= {0} else len(frames) * _PAGE / MEGABYTE


def _frames(pid: int) -> set[int]:
    found: set[int] = set()
    with open(f"/proc/{pid}/maps", encoding="utf-8") as maps, open(f"/proc/{pid}/pagemap", "rb", 0) as pages:
        for line in maps:
            if "[v" in line:  # the kernel's own pages
                continue
            begin, end = (int(address, 16) for address in line.split()[0].split("-"))
            pages.seek(begin // _PAGE * 8)
            entries = array.array("Q")
            entries.frombytes(pages.read((end - begin) // _PAGE * 8))
            found.update(entry & _FRAME for entry in entries if entry & _PRESENT)
    return found


ALONE_EVERY: Final = 10
"""One sample of this many also measures what a board would hold alone, which is expensive."""
END: Final = 1.0
"""Wall seconds before the end of a flight from which on a process may have ended: a program that is through goes."""


@dataclass
class Sample:
    """What each process of the boards used at one moment: by board and who."""

    at: float
    """Wall seconds since sampling began."""
    spent: dict[tuple[str, str], float]
    """Seconds of processor time since then."""
    cpu: dict[tuple[str, str], float]
    """Per cent of a core since the sample before."""
    rss: dict[tuple[str, str], float]
    pss: dict[tuple[str, str], float]
    alone: dict[str, float] = field(default_factory=dict)

    @property
    def boards(self) -> list[str]:
        return list(dict.fromkeys(board for board, _ in self.cpu))


class Sampler:
    """Asks psutil what processes use, in a thread of its own: their numbers by board and who."""

    def __init__(self, pids: dict[tuple[str, str], int], every: float) -> None:
        self.samples: list[Sample] = []
        self.begun = 0.0
        self.problem: tuple[float, str] | None = None
        """When a process could be asked no more, and why."""
        self._every, self._pids = every, pids
        self._processes = {key: psutil.Process(pid) for key, pid in pids.items()}
        self._stopped = threading.Event()

    @contextmanager
    def sampling(self) -> Iterator[None]:
        """Sample while the block runs."""
        self.begun = time.monotonic()
        self._first = {key: processor_time(pid) for key, pid in self._pids.items()}
        for process in self._processes.values():
            process.cpu_percent(None)  # per cents are since the last time
        thread = threading.Thread(target=self._run, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._stopped.set()
            thread.join(5)

    def until(self, over: float, enough: float) -> list[Sample]:
        """Return the samples up to a moment, the end of the flight.

        Raises BenchmarkFailed if it could not be sampled to its end, or has less than so large a part of its samples.
        """
        if self.problem is not None and self.problem[0] < over - max(END, self._every):
            raise BenchmarkFailed(f"sampling ended {over - self.problem[0]:.1f} s before the flight: {self.problem[1]}")
        found = [one for one in self.samples if self.begun + one.at <= over]
        wanted = (over - self.begun) / self._every
        if not found or len(found) < enough * wanted - 2:
            raise BenchmarkFailed(f"only {len(found)} samples of {wanted:.0f}")
        return found

    def _run(self) -> None:
        due = self.begun
        while True:
            due = max(due + self._every, time.monotonic() + self._every / 2)  # who is late does not hurry after it
            if self._stopped.wait(due - time.monotonic()):
                return
            try:
                self.samples.append(self._sample(time.monotonic() - self.begun))
            except (
                psutil.Error,
                OSError,
                ValueError,
            ) as error:  # one has ended: `until` checks whether it was allowed to
                self.problem = time.monotonic(), str(error)
                return

    def _sample(self, at: float) -> Sample:
        spent = {key: processor_time(pid) - self._first[key] for key, pid in self._pids.items()}
        cpu = {key: process.cpu_percent(None) for key, process in self._processes.items()}
        rss = {key: process.memory_info().rss / MEGABYTE for key, process in self._processes.items()}
        sample = Sample(at, spent, cpu, rss, {key: pss([pid]) for key, pid in self._pids.items()})
        if len(self.samples) % ALONE_EVERY == ALONE_EVERY // 2:
            for board in sample.boards:
                held = alone([pid for (where, _), pid in self._pids.items() if where == board])
                if held is not None:
                    sample.alone[board] = held
        return sample
