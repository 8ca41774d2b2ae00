"""What the daemons of a flight use, asked now and then, while nothing but the asking is added to the machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

import psutil

from benchmarks import held
from benchmarks.flights import Flight

ALONE_EVERY: Final = 10
"""Of so many samples one tells what a board would hold alone: the question is dear."""
AGENT: Final = "agent"
ROLES: Final = {"commd": "commd", "bridged": "bridged", "agentd": AGENT, "program": AGENT}
"""What each kind of process is on its board."""


@dataclass
class Sample:
    """What each process of the boards used at one moment: by board and who."""

    at: float
    cpu: dict[tuple[str, str], float]
    rss: dict[tuple[str, str], float]
    pss: dict[tuple[str, str], float]
    alone: dict[str, float] = field(default_factory=dict)

    @property
    def boards(self) -> list[str]:
        return list(dict.fromkeys(board for board, _ in self.cpu))


class Sampler:
    """Asks psutil for what the processes of the boards use; simulators are none of them."""

    def __init__(self, flight: Flight, every: float) -> None:
        self.samples: list[Sample] = []
        self._every = every
        self._pids = {
            (process.board, ROLES[process.kind.name]): watched.process.pid
            for process, watched in flight.watched
            if process.kind.name in ROLES
        }
        self._processes = {key: psutil.Process(pid) for key, pid in self._pids.items()}
        self._stopped = threading.Event()

    @contextmanager
    def sampling(self) -> Iterator[None]:
        """Sample while the block runs, in a thread of its own."""
        for process in self._processes.values():
            process.cpu_percent(None)  # per cents are since the last time
        thread = threading.Thread(target=self._run, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._stopped.set()
            thread.join(5)

    def _run(self) -> None:
        begun = due = time.monotonic()
        while True:
            due = max(due + self._every, time.monotonic() + self._every / 2)  # who is late does not hurry after it
            if self._stopped.wait(due - time.monotonic()):
                return
            try:
                self.samples.append(self._sample(time.monotonic() - begun))
            except (psutil.Error, OSError):  # one has ended, and the flight tells why
                return

    def _sample(self, at: float) -> Sample:
        cpu = {key: process.cpu_percent(None) for key, process in self._processes.items()}
        rss = {key: process.memory_info().rss / held.MEGABYTE for key, process in self._processes.items()}
        sample = Sample(at, cpu, rss, {key: held.pss([pid]) for key, pid in self._pids.items()})
        if len(self.samples) % ALONE_EVERY == ALONE_EVERY // 2:
            for board in sample.boards:
                alone = held.alone([pid for (where, _), pid in self._pids.items() if where == board])
                if alone is not None:
                    sample.alone[board] = alone
        return sample
