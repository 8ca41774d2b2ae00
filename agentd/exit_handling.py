"""How a command of `agentd` ends before its work is done: by a signal, or because nobody can take its output."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

LONGEST = 1e9
"""Seconds, some 30 years: no clock of the system can wait much longer, and nobody wants to."""


class Terminated(BaseException):
    """The process was asked to end; no plan, plug-in or environment may take this for an error of its own."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.exit_code = 128 + number


@contextmanager
def termination() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise `Terminated` in the main thread, so that what was begun is ended in order.

    Only the first does: a second one must not break off the end of an environment. A signal that the one who started
    the process has set to be ignored (``nohup``) stays ignored.
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
    """Run a command and flush what it has printed; its exit code, also where it was broken off."""
    if sys.stderr is None:  # nobody wants to hear: printing to None would go to stdout
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
    except SystemExit as error:  # raised by code of the user's that nothing stands around
        from agentd.extensions.user_code import describe_error

        print(f"agentd: error: the program's Python ended the process: {describe_error(error)}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader has gone, as in `agentd run ... | head`: nobody is left to tell
        _forget_output()
        return 1
    except OSError as error:
        what = "write the output" if error.filename is None else f"use {error.filename}"
        with suppress(OSError):
            print(f"agentd: error: cannot {what}: {error.strerror or error}", file=sys.stderr)
        _forget_output()
        return 1


def _forget_output() -> None:
    """Let what could not be written not fail once more when Python ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def seconds(text: str) -> float:
    """The value of ``--timeout``. Raises argparse.ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"`{text}` is no number of seconds") from None
    if math.isnan(value) or not 0 < value <= LONGEST:
        raise argparse.ArgumentTypeError(f"`{text}`: more than 0 s and at most {LONGEST:.0f} s are needed")
    return value
