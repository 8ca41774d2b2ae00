"""Run many runs on all cores: workers that fork a process for each run."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Final

import msgspec
from msgspec.structs import replace

from argosy.trial.single_run import Outcome, Request
from argosy.trial.worker import ENOUGH, ended_by

GRACE: Final = 2.0
"""Wall seconds in which a worker ends the run that is under way, and itself."""


class WorkerDied(ChildProcessError):
    """A worker has ended before its run."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.wanted = process.stdin is None or process.stdin.closed
        """Whether the trial has ended it."""
        self.code = process.wait()
        super().__init__(f"the worker of the trial has ended: {ended_by(self.code)}")


@dataclass
class Worker:
    """A process that runs runs."""

    process: subprocess.Popen[bytes]

    def run(self, request: Request) -> Outcome:
        """Run one. Raises WorkerDied."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(msgspec.json.encode(request) + b"\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except (OSError, ValueError):  # closed meanwhile
            line = b""
        if not line:
            raise WorkerDied(self.process)
        return msgspec.json.decode(line, type=Outcome)


@contextmanager
def workers(jobs: int, patience: float = ENOUGH) -> Iterator[Callable[[Iterable[Request]], Iterator[Outcome]]]:
    """Start workers; yield what runs requests on them and returns each outcome when it is there.

    A run that takes longer than `patience` wall seconds fails, and one whose process dies: the others go on. At the
    end, also by ctrl-C, no process is left.
    """
    with ExitStack() as stack:
        pool = stack.enter_context(ThreadPoolExecutor(jobs))
        free: SimpleQueue[Worker] = SimpleQueue()
        for _ in range(jobs):
            free.put(Worker(stack.enter_context(_started(patience))))

        def run_one(request: Request) -> Outcome:
            worker = free.get()
            try:
                if request.folder:
                    return worker.run(request)
                with tempfile.TemporaryDirectory(prefix="argosy-trial-", ignore_cleanup_errors=True) as folder:
                    return worker.run(replace(request, folder=folder))
            except WorkerDied as died:
                if died.wanted:
                    raise
                worker = Worker(stack.enter_context(_started(patience)))
                return Outcome(request.seed, False, f"died: {ended_by(died.code)}", faults=[*request.faults])
            finally:
                free.put(worker)

        def run_all(requests: Iterable[Request]) -> Iterator[Outcome]:
            pending: list[Future[Outcome]] = [pool.submit(run_one, request) for request in requests]
            try:
                for done in as_completed(pending):
                    yield done.result()
            finally:
                for one in pending:
                    one.cancel()

        yield run_all


@contextmanager
def _started(patience: float) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-P", "-m", "argosy.trial.worker", f"{patience:g}"]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONHASHSEED": "0"},
        cwd=Path(__file__).parents[2],
    )
    try:
        yield process
    finally:
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a worker and the run that is under way: it does so itself when its input ends."""
    assert process.stdin is not None
    with suppress(OSError):
        process.stdin.close()
    try:
        process.wait(GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    assert process.stdout is not None
    process.stdout.close()
