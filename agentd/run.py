"""``agentd run``: agents in one process, without any bus, for trying programs out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from agentd.language.compile import CompiledProgram, DirectiveError
from agentd.language.errors import SyntaxErrors
from agentd.paths import SourcePaths, read_folders
from agentd.standalone import Team
from agentd.user_code import UserCodeError, describe_error, load_class
from agentd.why import add_why_arguments, narrator_of

if TYPE_CHECKING:
    from agentd.environment import Environment

DEEPEST_CALLS = 9000
"""How deep rules may call one another; a computation beyond fails its plan."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the command."""
    parser.add_argument("agents", nargs="+", metavar="[NAME=]FILE.asl", help="an agent; its name is the file's if none")
    parser.add_argument("--exit-when-idle", action="store_true", help="end when no agent has anything left to do")
    parser.add_argument("--timeout", type=float, metavar="S", help="end with exit code 1 after so many seconds")
    parser.add_argument("--seed", type=int, default=0, help="start of the random numbers (default 0)")
    add_why_arguments(parser)
    add_environment_arguments(parser)
    add_path_argument(parser)


def add_environment_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments that name a Python environment."""
    parser.add_argument("--env", metavar="MODULE:CLASS", help="what the agents live in: a class of agentd.Environment")
    parser.add_argument(
        "--env-arg", action="append", default=[], metavar="TEXT", help="an argument of its init (repeatable)"
    )


def make_environment(name: str | None) -> Environment | None:
    """The environment that ``--env`` names. Raises `agentd.user_code.UserCodeError`."""
    if name is None:
        return None
    from agentd.environment import Environment

    chosen = load_class(name, Environment)
    try:
        made: Environment = chosen()
    except Exception as error:
        raise UserCodeError(f"{name} cannot be made: {describe_error(error)}") from error
    return made


def add_path_argument(parser: argparse.ArgumentParser) -> None:
    """The argument that says where files which programs name are looked for."""
    parser.add_argument(
        "--include-path",
        "--map",
        action="append",
        default=[],
        metavar="[NAME=]FOLDER",
        help="also look in this folder for the files that programs name; with a name, it is the folder that $NAME "
        "stands for in them, such as --map '$jasonJar=jason' (repeatable)",
    )


def run(args: argparse.Namespace) -> int:
    """Run the agents; the exit code as the command's contract says."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST_CALLS))
    try:
        paths = read_folders(args.include_path)
        programs = [_read(argument, paths) for argument in args.agents]
    except (Refused, ValueError) as refused:
        print(refused, file=sys.stderr)
        return 2
    names = [name for name, _ in programs]
    for name in names:
        if names.count(name) > 1:
            print(f"two agents are called '{name}'; give them names: NAME=FILE.asl", file=sys.stderr)
            return 2
    try:
        environment = make_environment(args.env)
        team = Team(
            programs,
            args.seed,
            paths=paths,
            environment=environment,
            environment_arguments=args.env_arg,
            decisions=args.decisions,
            narrator=narrator_of(args),
        )
    except UserCodeError as error:
        print(f"--env {args.env}: error: {error}", file=sys.stderr)
        return 2
    return team.run(args.timeout, args.exit_when_idle)


class Refused(Exception):
    """A program that cannot be read, told."""


def _read(argument: str, paths: SourcePaths) -> tuple[str, CompiledProgram]:
    name, equals, path = argument.partition("=")
    if not equals:
        name, path = Path(argument).stem, argument
    return name, read_program(path, paths)


def read_program(path: str, paths: SourcePaths) -> CompiledProgram:
    """Read and compile a program. Raises Refused, with what is wrong in words."""
    try:
        return paths.compiled(path)
    except OSError as error:
        raise Refused(f"{path}: error: cannot read the program: {error.strerror or error}") from error
    except (SyntaxErrors, DirectiveError) as error:
        raise Refused(str(error)) from error
