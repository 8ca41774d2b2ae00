"""Command-line arguments: commands with subcommands, names, counts and durations."""

from __future__ import annotations

import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Mapping
from typing import NoReturn

from commd.process.command_line import check_command, command_parser, finite_number
from schemas.files.units import Duration
from schemas.wire.keys import check_name

Command = tuple[Callable[[ArgumentParser], None], Callable[[Namespace], int]]
"""Declares the arguments of a command; runs it and returns the exit code."""
_COUNT = re.compile(r"0*[1-9][0-9]{0,8}")


def run_command(prog: str, name: str, texts: tuple[str, str], command: Command, given: list[str]) -> int:
    """Run a command with the arguments `given`; `texts`: its help and an example. Returns the exit code."""
    parser = command_parser(prog, name, *texts)
    add_arguments, run = command
    add_arguments(parser)
    return run(parser.parse_intermixed_args(given))  # options may be anywhere: nobody orders words in a hurry


def expect_command(parser: ArgumentParser, commands: Mapping[str, tuple[str, str]], given: list[str]) -> NoReturn:
    """End the process with the help or an error of `parser`: none of its `commands` (to help and example) is given."""
    choices = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, (text, _) in commands.items():
        choices.add_parser(name, help=text)
    check_command(parser, given, commands)
    parser.parse_args(given)
    parser.error("expected the COMMAND first")


def name(text: str) -> str:
    """Read the name of a fleet, agent, robot or board: one chunk of a key. Raises ArgumentTypeError."""
    try:
        return check_name(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None


def count(text: str) -> int:
    """Read a count of 1 or more. Raises ArgumentTypeError."""
    if not _COUNT.fullmatch(text):
        raise ArgumentTypeError(f"expected a number, 1 or more, got `{text}`")
    return int(text)


mission_second = finite_number(lambda value: value >= 0, "a mission second, 0 or more")
"""Reads a time of a mission."""


def duration(accepted: Callable[[float], bool], expected: str) -> Callable[[str], Duration]:
    """Return a reader of durations in seconds that refuses those not `accepted`; `expected` describes the others."""

    def read(text: str) -> Duration:
        try:
            seconds = Duration.read(text)
        except ValueError as error:
            raise ArgumentTypeError(str(error)) from None
        if not accepted(seconds):
            raise ArgumentTypeError(f"expected {expected}, got {text}")
        return seconds

    return read
