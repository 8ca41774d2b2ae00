"""``agentd run``: agents in one process, without any bus, for trying programs out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from agentd.language.compile import CompiledProgram, DirectiveError, compile_program
from agentd.language.errors import SyntaxErrors
from agentd.language.parser import parse_file
from agentd.standalone import Team

DEEPEST_CALLS = 9000
"""How deep rules may call one another; a computation beyond fails its plan."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the command."""
    parser.add_argument("agents", nargs="+", metavar="[NAME=]FILE.asl", help="an agent; its name is the file's if none")
    parser.add_argument("--exit-when-idle", action="store_true", help="end when no agent has anything left to do")
    parser.add_argument("--timeout", type=float, metavar="S", help="end with exit code 1 after so many seconds")
    parser.add_argument("--seed", type=int, default=0, help="start of the random numbers (default 0)")


def run(args: argparse.Namespace) -> int:
    """Run the agents; the exit code as the command's contract says."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST_CALLS))
    try:
        programs = [_read(argument) for argument in args.agents]
    except _Refused as refused:
        print(refused, file=sys.stderr)
        return 2
    names = [name for name, _ in programs]
    for name in names:
        if names.count(name) > 1:
            print(f"two agents are called '{name}'; give them names: NAME=FILE.asl", file=sys.stderr)
            return 2
    return Team(programs, args.seed).run(args.timeout, args.exit_when_idle)


class _Refused(Exception):
    """A program that cannot be read, told."""


def _read(argument: str) -> tuple[str, CompiledProgram]:
    name, equals, path = argument.partition("=")
    if not equals:
        name, path = Path(argument).stem, argument
    try:
        program = parse_file(path)
        return name, compile_program(program, lambda included: parse_file(included))
    except OSError as error:
        raise _Refused(f"{path}: error: cannot read the program: {error.strerror or error}") from error
    except (SyntaxErrors, DirectiveError) as error:
        raise _Refused(str(error)) from error
    except UnicodeDecodeError as error:
        raise _Refused(f"{path}: error: the program is not UTF-8 text") from error
