"""Process setup of each command of `agentd`: recursion limit, signals, exit codes, a notice that it is slow."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from time import process_time
from types import FrameType

DEEPEST_CALLS = 9000
"""Depth of calls between rules; a deeper computation fails its plan."""
LONGEST = 1e9
"""Seconds (about 30 years) of the longest `--timeout`: no system clock can wait much longer."""
PATIENCE = 1.0
"""Seconds of processor time until the notice that loading is slow; time that other processes take does not count."""
_NAMED = 3
"""Files named in that notice at most."""


def allow_deep_calls() -> None:
    """Raise Python's recursion limit to `DEEPEST_CALLS`, unless it is higher."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST_CALLS))


class Terminated(BaseException):
    """A signal has ended the process; no plan, plug-in or environment may catch this as an error of its own."""

    def __init__(self, number: int) -> None:
        """`number` is that of the signal, such as 15 for SIGTERM."""
        super().__init__(signal.Signals(number).name)
        self.exit_code = 128 + number


@contextmanager
def termination() -> Iterator[None]:
    """Let the first SIGTERM or SIGHUP raise `Terminated` in the main thread, so that the command can clean up.

    Further ones are ignored: they must not interrupt the cleaning up. A signal that the parent process has set to be
    ignored (``nohup``) stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    taken = [number for number in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(number) is signal.SIG_DFL]

    def end(number: int, frame: FrameType | None) -> None:
        for each in taken:
            signal.signal(each, signal.SIG_IGN)
        raise Terminated(number)

    for number in taken:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def guarded(command: Callable[[], int]) -> int:
    """Run a command and flush its output. Return its exit code, also if it was interrupted."""
    if sys.stderr is None:  # without it, `print` would write errors to stdout
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for the rest of the process
    if sys.stdout is None:
        print("agentd: error: standard output is closed; send it to /dev/null if nobody wants it", file=sys.stderr)
        return 2
    try:
        with termination():
            code = command()
            sys.stdout.flush()
            return code
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except Terminated as ended:
        with suppress(OSError):
            print(f"agentd: ended by {ended}", file=sys.stderr)
        return ended.exit_code
    except SystemExit as error:  # raised by user code outside of any guard
        from commd.process.user_code import describe_error

        print(f"agentd: error: the program's Python ended the process: {describe_error(error)}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader has gone, as in `agentd run ... | head`
        _forget_output()
        return 1
    except OSError as error:
        what = "write the output" if error.filename is None else f"use {error.filename}"
        with suppress(OSError):
            print(f"agentd: error: cannot {what}: {error.strerror or error}", file=sys.stderr)
        _forget_output()
        return 1


def _forget_output() -> None:
    """Discard buffered output that could not be written, so that it does not fail once more when Python exits."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def seconds(text: str) -> float:
    """Parse the value of ``--timeout``, in seconds. Raises argparse.ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"`{text}` is no number of seconds") from None
    if math.isnan(value) or not 0 < value <= LONGEST:
        raise argparse.ArgumentTypeError(f"`{text}`: more than 0 s and at most {LONGEST:.0f} s are needed")
    return value


@contextmanager
def loading_notice(files: Iterable[str], after: float = PATIENCE) -> Iterator[None]:
    """Print once on stderr that files are still loading if the block takes `after` (more than 0) processor seconds."""
    names = list(files)
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    done, begun = threading.Event(), process_time()

    def watch() -> None:
        while not done.wait(after):
            if process_time() - begun >= after:
                with suppress(OSError, ValueError):  # stderr is closed
                    print(f"still loading {', '.join(names[:_NAMED])}{more} ...", file=sys.stderr, flush=True)
                return

    watching = threading.Thread(target=watch, name="progress", daemon=True)
    watching.start()
    try:
        yield
    finally:
        done.set()
        watching.join(PATIENCE)  # the notice is printed before later output
