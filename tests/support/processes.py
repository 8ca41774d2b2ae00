"""Daemons as real processes in tests: started with a bound on everything, and always ended."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.support.forked import PROGRAMS, ROOT, Forked

PATIENCE = 90.0
"""Wall seconds for what a process is to say, and for its end."""


def poll(
    condition: Callable[[], object],
    wish: str,
    seconds: float = PATIENCE,
    *,
    said: Callable[[], str] = str,
    process: subprocess.Popen[Any] | None = None,
) -> float:
    """Wait until something holds; returns the wall seconds that it took.

    After a bound, or when `process` has ended before, it fails with the wish and what was `said` by then.
    """
    begun = time.monotonic()
    while not condition():
        ended, took = None if process is None else process.poll(), time.monotonic() - begun
        if ended is not None or took > seconds:
            raise AssertionError(f"not within {took:.1f} s: {wish}; exit {ended}; it said:\n{said()}")
        time.sleep(0.02)
    return time.monotonic() - begun


class Daemon:
    """A running process and the lines that it has said."""

    def __init__(
        self,
        *arguments: str,
        within: Sequence[str] = (),
        code: Path = ROOT,
        environment: Mapping[str, str] | None = None,
        start: type[subprocess.Popen[Any]] = Forked,
    ) -> None:
        """Run `python -m ARGUMENTS` of a checkout; `within` stands before it, such as `ip netns exec NAME`.

        `environment` is added to that of the tests. Who measures the process gives `subprocess.Popen` as `start`;
        other modules than Argosy's programs, and what something stands before, take that by themselves.
        """
        self.arguments = arguments
        self.lines: list[str] = []
        forks = start is Forked and arguments[0] in PROGRAMS and not within and code == ROOT
        self.process = (Forked if forks else subprocess.Popen)(
            arguments if forks else [*within, sys.executable, "-m", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
            cwd=code,
            env=os.environ | (environment or {}),
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def until(self, condition: Callable[[str], bool], wish: str, seconds: float = PATIENCE) -> None:
        """Wait until what it said fulfils a condition."""
        poll(lambda: condition(self.text), wish, seconds, said=lambda: self.text, process=self.process)

    def says(self, words: str, seconds: float = PATIENCE) -> None:
        """Wait until it has said `words`."""
        self.until(lambda text: words in text, f"`{self.arguments}` says `{words}`", seconds)

    def ends(self, seconds: float = PATIENCE) -> int:
        """Wait for its end and return its exit code."""
        code = self.process.wait(seconds)
        self._reader.join(30)
        return code

    def signal(self, number: int) -> None:
        self.process.send_signal(number)

    def kill(self) -> None:
        """Kill -9, by its id."""
        if self.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait(10)


@contextlib.contextmanager
def running(
    *arguments: str, environment: Mapping[str, str] | None = None, start: type[subprocess.Popen[Any]] = Forked
) -> Iterator[Daemon]:
    """Start `python -m ARGUMENTS` and end it when the block ends."""
    daemon = Daemon(*arguments, environment=environment, start=start)
    try:
        yield daemon
    finally:
        daemon.kill()
