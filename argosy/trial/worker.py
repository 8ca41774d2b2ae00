"""A process that runs the runs of a trial one after the other: `python -m argosy.trial.worker [SECONDS]`.

It has imported everything when the first request comes, reads the manifests of its mission, and forks for each run: no
run sees anything of another. A request is a line of JSON on its standard input (`Request`), an outcome a line on its
standard output. A run that takes longer than SECONDS of wall time is ended. When the standard input ends, so does the
run that is under way.
"""

from __future__ import annotations

import gc
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Final, NoReturn

from argosy.processes.launcher import end_with_parent
from argosy.trial.edges import Authority

IMPORTED: Final = (
    "agentd.daemon",
    "bridged.daemon",
    "bridged.drivers.mavlink.driver",
    "bridged.drivers.mavlink.registration",
    "bridged.simulation.vehicle.command",
    "bridged.simulation.turtle.command",
    "commd.daemon",
    "encodings.idna",
)
"""What runs need."""
ENOUGH: Final = 600.0
"""Wall seconds after which a run is ended as one that hangs."""


def main() -> None:
    """Serve requests until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ctrl-C in the terminal: the trial closes the input
    clock, patience = time.monotonic, float(sys.argv[1]) if len(sys.argv) > 1 else ENOUGH
    authority = Authority()
    authority.take_over()
    import msgspec

    from argosy.trial.single_run import Outcome, Request, fly
    from schemas.files.findings import Findings

    for module in IMPORTED:
        import_module(module)
    gc.freeze()  # what is imported is no garbage: no run looks through it, and all share its memory
    gc.disable()  # when it frees what is garbage, and finalizes it, is no matter of the seed; a run fits into memory

    def outcome_of(request: Request) -> Outcome:
        try:
            return fly(authority.begin(request.seed), request)
        except Findings as bad:
            return Outcome(request.seed, False, str(bad), bad_input=True)
        except BaseException as error:  # a defect of the product or of the trial: the run shows it
            where = "".join(traceback.format_exception(error)[-3:])
            return Outcome(request.seed, False, f"defect: {type(error).__name__}: {error}\n{where}")

    while line := _line():
        request = msgspec.json.decode(line, type=Request)
        read_ahead(request.mission)
        run = _Forked(lambda request=request: msgspec.json.encode(outcome_of(request)))  # type: ignore[misc]
        answer, in_time = run.answer(clock, clock() + patience)
        code, cpu, memory = run.end()
        why = f"died: {ended_by(code)}" if in_time else f"hung: it was ended after {patience:g} s"
        outcome = (
            msgspec.json.decode(answer, type=Outcome)
            if answer
            else Outcome(request.seed, False, why, faults=[*request.faults])
        )
        outcome.cpu, outcome.memory = round(cpu, 3), memory
        _write(1, msgspec.json.encode(outcome) + b"\n")


@cache
def read_ahead(mission: str) -> None:
    """Read a mission, its manifests and programs, as the daemons do: they are kept, and those of a run find them."""
    from agentd.runtime.program_loader import prepare
    from argosy.trial.process import read_once
    from bridged.drivers.registry import load_robot_manifest
    from schemas.manifest.loader import load_manifest
    from schemas.wire.codec import codec
    from schemas.wire.records import Record

    for record in Record.__subclasses__():
        codec(record)
    with suppress(Exception):  # a run says what is wrong with them
        read = read_once(mission)
        for agent in read.agents:
            prepare(read, agent, 0)
        for robot in read.robots.values():
            load_robot_manifest(robot.manifest, read.path.parent)
            if isinstance(robot.manifest, str):
                load_manifest(robot.manifest, read.path.parent)


class _Forked:
    """A process that makes one answer."""

    def __init__(self, answer: Callable[[], bytes]) -> None:
        self._reading, writing = os.pipe()
        self._child = os.fork()
        if self._child == 0:
            end_with_parent(signal.SIGKILL)  # its worker
            os.close(self._reading)
            _answer(answer, writing)
        os.close(writing)

    def answer(self, clock: Callable[[], float], until: float) -> tuple[bytes, bool]:
        """Return what it has answered, empty if it died, and whether it has ended in time."""
        answer = b""
        while True:
            readable = select.select([self._reading, 0], [], [], max(0.0, until - clock()))[0]
            if 0 in readable:  # no request comes before the answer: the trial has ended
                self.end()
                os._exit(0)
            if not readable:
                return b"", False
            if not (read := os.read(self._reading, 1 << 16)):
                return answer, True
            answer += read

    def end(self) -> tuple[int, float, int]:
        """End the process if it runs. Returns its exit code, its seconds of CPU and its greatest memory in bytes."""
        os.kill(self._child, signal.SIGKILL)
        _, status, used = os.wait4(self._child, 0)
        os.close(self._reading)
        return os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def ended_by(code: int) -> str:
    """Return how a process has ended, by its exit code or minus its signal."""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def _answer(answer: Callable[[], bytes], writing: int) -> NoReturn:
    try:
        _write(writing, answer())
    finally:
        os._exit(0)


def _line() -> bytes:
    """Return a line of the standard input; what it is has been written alone, so that nothing is read ahead."""
    line = b""
    while not line.endswith(b"\n"):
        if not (read := os.read(0, 1 << 16)):
            return b""
        line += read
    return line


def _write(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


if __name__ == "__main__":
    main()
