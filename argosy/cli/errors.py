"""The errors that end a command: `argosy.__main__` prints each in a line and exits with its code."""

from __future__ import annotations

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
