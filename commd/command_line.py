"""Commands that are misspelt on a command line: what was meant is told."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Iterable, Sequence


def check_command(parser: ArgumentParser, arguments: Sequence[str], commands: Iterable[str]) -> None:
    """End the process with words, as `parser` does, if the first argument is none of its commands."""
    known = list(commands)
    if arguments and not arguments[0].startswith("-") and arguments[0] not in known:
        from schemas.positions import did_you_mean  # who types well does not wait for it

        parser.error(f"there is no command `{arguments[0]}`{did_you_mean(arguments[0], known)}")
