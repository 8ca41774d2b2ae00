"""Processes of a benchmark that run beside it: what they say, what they use."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import Popen
from typing import Final

from benchmarks.processes import BenchmarkFailed, lines, started

PATIENCE: Final = 30.0
"""Seconds for words that a process is to say."""
LONGEST: Final = 86_400.0
"""Seconds for which a process is read: longer than any part may take, which ends it."""


@dataclass
class Watched:
    """A process of the run and the lines that it has written, each with the moment at which it came."""

    name: str
    process: Popen[bytes]
    said: list[tuple[float, str]] = field(default_factory=list)

    def read(self) -> None:
        """Read until it ends; runs in a thread of its own."""
        for line in lines(self.process, LONGEST):
            self.said.append((time.monotonic(), line))

    def says(self, words: str, patience: float = PATIENCE) -> None:
        """Wait until it has said `words`. Raises BenchmarkFailed."""
        until = time.monotonic() + patience
        while not any(words in line for _, line in self.said):
            if self.process.poll() is not None or time.monotonic() > until:
                last = "\n".join(line for _, line in self.said[-5:])
                raise BenchmarkFailed(f"{self.name} did not say `{words}` within {patience:g} s; last:\n{last}")
            time.sleep(0.02)

    def cpu(self) -> float:
        """Seconds of processor time used so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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
