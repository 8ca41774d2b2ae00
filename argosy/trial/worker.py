"""A process that runs the runs of a trial one after the other: `python -m argosy.trial.worker`.

It has imported everything when the first request comes, and forks for each run: no run sees anything of another. A
request is a line of JSON on its standard input (`Request`), an outcome a line on its standard output.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
import traceback
from importlib import import_module

from argosy.trial.edges import Authority

IMPORTED = ("agentd.daemon", "bridged.daemon", "bridged.drivers.mavlink.driver", "commd.daemon")
"""What each run needs."""
ENOUGH = 600.0
"""Wall seconds after which a run is ended as one that hangs."""


def main() -> None:
    """Serve requests until the input ends."""
    clock = time.monotonic
    authority = Authority()
    authority.take_over()
    import msgspec

    from argosy.cli.errors import BadInput
    from argosy.trial.single_run import Outcome, Request, fly

    for module in IMPORTED:
        import_module(module)
    for line in sys.stdin.buffer:
        request = msgspec.json.decode(line, type=Request)
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            try:
                outcome = fly(authority.begin(request.seed), request)
            except BadInput as bad:
                outcome = Outcome(request.seed, False, f"bad input: {bad}")
            except BaseException as error:  # a defect of the product or of the trial: the run shows it
                where = "".join(traceback.format_exception(error)[-3:])
                outcome = Outcome(request.seed, False, f"defect: {type(error).__name__}: {error}\n{where}")
            _write(writing, msgspec.json.encode(outcome) + b"\n")
            os._exit(0)
        os.close(writing)
        said, until = b"", clock() + ENOUGH
        while select.select([reading], [], [], max(0.0, until - clock()))[0]:
            if not (read := os.read(reading, 1 << 16)):
                break
            said += read
        os.close(reading)
        if not said:
            os.kill(child, signal.SIGKILL)
            said = msgspec.json.encode(Outcome(request.seed, False, f"hung for {ENOUGH:g} s")) + b"\n"
        os.waitpid(child, 0)
        _write(1, said)


def _write(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


if __name__ == "__main__":
    main()
