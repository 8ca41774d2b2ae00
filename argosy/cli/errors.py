"""The errors that end a command, which `argosy.__main__` prints in a line each, and other lines for stderr."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from schemas.humanize import printable


class CommandError(Exception):
    """A command has failed; the text says why, for the terminal."""

    code = 1
    """Exit code of the process."""


class BadInput(CommandError):
    """The arguments or files of a command cannot be used; the text says which and why."""

    code = 2


def complain(text: str) -> None:
    """Print on stderr, without control characters; ignore a closed stream."""
    with suppress(OSError):
        print("\n".join(map(printable, text.split("\n"))), file=sys.stderr, flush=True)


def progress(line: str) -> bool:
    """Redraw the last line of the terminal at stderr; empty = take it away. Returns whether there is a terminal."""
    if not sys.stderr.isatty():
        return False
    with suppress(OSError):
        wide = (os.get_terminal_size(sys.stderr.fileno()).columns or 80) - 1
        print(f"\r\x1b[K{printable(line)[:wide]}", end="", file=sys.stderr, flush=True)
    return True
