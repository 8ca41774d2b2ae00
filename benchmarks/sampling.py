"""What processes of boards use, sampled at a steady rate while they run."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

import psutil

from benchmarks import processes
from benchmarks.processes import BenchmarkFailed

ALONE_EVERY: Final = 10
"""Of so many samples one tells what a board would hold alone: the question is dear."""
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
        self._first = {key: _spent(process) for key, process in self._processes.items()}
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
            ) as error:  # one has ended: `until` says whether it was allowed to
                self.problem = time.monotonic(), str(error)
                return

    def _sample(self, at: float) -> Sample:
        spent = {key: _spent(process) - self._first[key] for key, process in self._processes.items()}
        cpu = {key: process.cpu_percent(None) for key, process in self._processes.items()}
        rss = {key: process.memory_info().rss / processes.MEGABYTE for key, process in self._processes.items()}
        sample = Sample(at, spent, cpu, rss, {key: processes.pss([pid]) for key, pid in self._pids.items()})
        if len(self.samples) % ALONE_EVERY == ALONE_EVERY // 2:
            for board in sample.boards:
                alone = processes.alone([pid for (where, _), pid in self._pids.items() if where == board])
                if alone is not None:
                    sample.alone[board] = alone
        return sample


def _spent(process: psutil.Process) -> float:
    """Return the seconds of processor time of a process so far. Raises psutil.Error."""
    times = process.cpu_times()
    return float(times.user + times.system)
