"""What tools print: lines to whoever reads them, and complaints beside them."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from argosy.cli.operator_bus import Unanswered
from schemas.humanize import printable


def put_out(text: str) -> bool:
    """Print a text at once. Returns whether anybody reads: after `| head` nobody does. Raises Unanswered if it is lost.

    Wire text in it must be `printable` or `escaped` already.
    """
    try:
        print(text, flush=True)
    except OSError as error:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return False
        raise Unanswered(f"what it has to say cannot be written: {error.strerror}") from None
    return True


def note(text: str) -> None:
    """Say something besides, on stderr."""
    complain(f"note: {text}")


def complain(text: str) -> None:
    """Say on stderr what is wrong, each line of it as one that no terminal takes for a command, if anybody reads it."""
    with suppress(OSError):
        print("\n".join(map(printable, text.split("\n"))), file=sys.stderr, flush=True)
