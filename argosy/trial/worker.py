"""A process that runs the runs of a trial one after the other: `python -m argosy.trial.worker [SECONDS]`.

It has imported everything when the first request comes, and forks for each run: no run sees anything of another. A
request is a line of JSON on its standard input (`Request`), an outcome a line on its standard output. A run that takes
longer than SECONDS of wall time is ended. When the standard input ends, so does the run that is under way.
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
from importlib import import_module
from typing import Final, NoReturn

from argosy.trial.edges import Authority

IMPORTED: Final = ("agentd.daemon", "bridged.daemon", "bridged.drivers.mavlink.driver", "commd.daemon")
"""What each run needs."""
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
        run = _Forked(lambda request=request: msgspec.json.encode(outcome_of(request)))  # type: ignore[misc]
        said, why = run.answer(clock, clock() + patience)
        cpu, memory = run.end()
        outcome = (
            msgspec.json.decode(said, type=Outcome)
            if said
            else Outcome(
                request.seed, False, why or f"hung: it was ended after {patience:g} s", faults=[*request.faults]
            )
        )
        outcome.cpu, outcome.memory = round(cpu, 3), memory
        _write(1, msgspec.json.encode(outcome) + b"\n")


class _Forked:
    """A process that makes one answer."""

    def __init__(self, answer: Callable[[], bytes]) -> None:
        self._reading, writing = os.pipe()
        self._child = os.fork()
        if self._child == 0:
            os.close(self._reading)
            _answer(answer, writing)
        os.close(writing)

    def answer(self, clock: Callable[[], float], until: float) -> tuple[bytes, str]:
        """Return what it has answered, and why it is nothing if it died; both are empty if it takes too long."""
        said = b""
        while True:
            readable = select.select([self._reading, 0], [], [], max(0.0, until - clock()))[0]
            if 0 in readable:  # no request comes before the answer: the trial has ended
                self.end()
                os._exit(0)
            if not readable:
                return b"", ""
            if not (read := os.read(self._reading, 1 << 16)):
                return said, "" if said else "the process of the run died"
            said += read

    def end(self) -> tuple[float, int]:
        """End the process. Returns its seconds of CPU and its greatest memory in bytes."""
        os.kill(self._child, signal.SIGKILL)
        _, _, used = os.wait4(self._child, 0)
        os.close(self._reading)
        return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


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
