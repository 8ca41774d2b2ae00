"""Parsers of the four programs: one form of help, and a hint for a misspelt command. Imports next to nothing."""

from __future__ import annotations

import math
import os
import signal
import sys
from argparse import ArgumentParser, ArgumentTypeError, HelpFormatter, Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager


class Help(HelpFormatter):
    """Help as wide as the terminal, without the import of `shutil` that argparse makes for the width."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=_columns() - 2)


class Parser(ArgumentParser):
    """A parser that has a hint for a misspelt option."""

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Namespace | None = None
    ) -> Namespace:
        """Return the arguments, or end the process with an error."""
        return self._all_known(*self.parse_known_args(args, namespace))

    def parse_intermixed_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Namespace | None = None
    ) -> Namespace:
        """Return the arguments, with options anywhere, or end the process with an error."""
        return self._all_known(*self.parse_known_intermixed_args(args, namespace))

    def _all_known(self, found: Namespace, unknown: Sequence[str]) -> Namespace:
        if unknown:
            from schemas.files.findings import near_miss  # imported only for a typing error

            first = unknown[0].partition("=")[0]
            hint = near_miss(first, _options(self)) if first.startswith("--") else ""
            self.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
        return found


def _options(parser: ArgumentParser) -> Iterator[str]:
    for action in parser._actions:
        yield from action.option_strings
        for command in action.choices.values() if isinstance(action.choices, dict) else ():
            yield from _options(command)


def finite_number(accepted: Callable[[float], bool], expected: str) -> Callable[[str], float]:
    """Return a reader of finite numbers that refuses those not `accepted`; `expected` describes the others."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and accepted(value)):
            raise ArgumentTypeError(f"expected {expected}, got `{text}`")
        return value

    return read


mission_speed = finite_number(lambda value: 0 < value <= 100, "a speed above 0, at most 100")
"""Reads mission seconds per wall second."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Let ctrl-C end the process without a traceback, also while it imports, which takes seconds on a small board."""
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)


def command_parser(program: str, name: str, text: str, example: str) -> ArgumentParser:
    """Return the parser of a command from its help, and the arguments of an example."""
    called = f"{program} {name}"
    about = f"{text[0].upper()}{text[1:]}."
    return Parser(prog=called, description=about, epilog=f"example: {called} {example}".rstrip(), formatter_class=Help)


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
    """End the process with an error of `parser`, with a hint, if the first argument is not one of its commands."""
    known = list(commands)
    if arguments and not arguments[0].startswith("-") and arguments[0] not in known:
        from schemas.files.findings import did_you_mean  # imported only for a typing error

        parser.error(f"there is no command `{arguments[0]}`{did_you_mean(arguments[0], known)}")
