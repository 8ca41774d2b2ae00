"""Limits that are kept from outside, where no control group can be made."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from benchmarks.held import pss
from benchmarks.small_boards.limits import ENTER, SHORTEST, Cage, Limits, Usage


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
