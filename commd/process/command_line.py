"""Command lines of daemons: a command that is misspelt is told what was meant, and help imports next to nothing."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, HelpFormatter
from collections.abc import Iterable, Sequence


class Help(HelpFormatter):
    """Help as wide as the terminal; that of argparse is made for each argument, and imports `shutil` for the width."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=_columns() - 2)


def _columns() -> int:
    try:
        return int(os.environ.get("COLUMNS", "")) or 80
    except ValueError:
        pass
    try:
        return os.get_terminal_size(sys.__stdout__.fileno()).columns or 80  # type: ignore[union-attr]
    except (AttributeError, ValueError, OSError):
        return 80


def check_command(parser: ArgumentParser, arguments: Sequence[str], commands: Iterable[str]) -> None:
    """End the process with words, as `parser` does, if the first argument is none of its commands."""
    known = list(commands)
    if arguments and not arguments[0].startswith("-") and arguments[0] not in known:
        from schemas.files.findings import did_you_mean  # who types well does not wait for it

        parser.error(f"there is no command `{arguments[0]}`{did_you_mean(arguments[0], known)}")
