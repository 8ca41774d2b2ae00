"""The errors that end a command, which `argosy.__main__` prints in a line each; other lines and questions on stderr."""

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


def consent(what: str, refused: str) -> None:
    """Ask on the terminal before doing `what`. Raises BadInput without a terminal, CommandError `refused` for a no."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise BadInput(f"this would {what}; there is no terminal to ask at: confirm by --yes")
    print(f"this will {what}. Go on? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise CommandError(refused)


def progress(line: str) -> bool:
    """Redraw the last line of the terminal at stderr; empty = take it away. Returns whether there is a terminal."""
    if not sys.stderr.isatty():
        return False
    with suppress(OSError):
        wide = (os.get_terminal_size(sys.stderr.fileno()).columns or 80) - 1
        print(f"\r\x1b[K{printable(line)[:wide]}", end="", file=sys.stderr, flush=True)
    return True
