"""``agentd run``: agents in one process, without any bus, for trying programs out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from agentd.extensions.user_code import UserCodeError, load_class
from agentd.language.compiler.compile import CompiledProgram, DirectiveError
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.process import allow_deep_calls, loading_notice, seconds
from agentd.runtime.program_paths import Setup, SourcePaths, read_folders
from agentd.standalone.decision_printer import add_why_arguments, narrator_of
from agentd.standalone.standalone_team import Team
from commd.process.user_code import MISTAKES, describe_error
from schemas.files.findings import Findings

if TYPE_CHECKING:
    from agentd.environment import Environment

_DESCRIPTION = """\
Run agents in this process, without a bus. Exit code: that of .stopMAS; 0 if nothing is left to do, whether or not the
agents have achieved their goals (see --fail-on-error); 1 if --timeout is over or the output cannot be written; 2 if a
program or an argument cannot be used; 128 + N after signal N (SIGINT: 130, SIGTERM: 143), which first stops the
environment."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `agentd run`."""
    parser.add_argument(
        "agents",
        nargs="+",
        metavar="[NAME=]FILE.asl | FILE.mas2j",
        help="program of an agent, which is named after its file if no NAME is given; or one project file of Jason",
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = _DESCRIPTION
    parser.add_argument(
        "--exit-when-idle",
        action="store_true",
        help="end when no agent has anything left to do (default: go on until --timeout, .stopMAS or a signal)",
    )
    parser.add_argument(
        "--fail-on-error",
        action="store_true",
        help="end with exit code 1 instead of 0 if an intention failed without a plan that handles the failure, or was "
        "still waiting when --exit-when-idle ended the run",
    )
    parser.add_argument(
        "--timeout",
        type=seconds,
        metavar="S",
        help="end with exit code 1 after S seconds (more than 0, at most 1e9; default: no limit)",
    )
    parser.add_argument("--seed", type=int, default=0, help="integer that random numbers start from (default 0)")
    parser.add_argument(
        "--allow-folder",
        type=Path,
        action="append",
        default=[],
        metavar="FOLDER",
        help="let .include, .create_agent and .save_agent use files in FOLDER too, not only in the working folder, "
        "the programs' folders and those of --include-path; links are resolved first (repeatable)",
    )
    add_why_arguments(parser)
    add_environment_arguments(parser)
    add_path_argument(parser)


def add_environment_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments for an environment in Python."""
    parser.add_argument(
        "--env",
        metavar="MODULE:CLASS",
        help="environment of the agents: a subclass of agentd.Environment in a module or file, such as world.py:World "
        "(default: none, and actions fail)",
    )
    parser.add_argument(
        "--env-arg",
        action="append",
        default=[],
        metavar="TEXT",
        help="argument for the init method of the environment (repeatable)",
    )


def make_environment(name: str | None) -> Environment | None:
    """Make the environment that ``--env`` names. Raises `agentd.extensions.user_code.UserCodeError`."""
    if name is None:
        return None
    from agentd.environment import Environment

    chosen = load_class(name, Environment)
    try:
        made: Environment = chosen()
    except MISTAKES as error:
        raise UserCodeError(f"{name} cannot be made: {describe_error(error)}") from error
    return made


def add_path_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the argument for folders with the files that programs name."""
    parser.add_argument(
        "--include-path",
        "--map",
        action="append",
        default=[],
        metavar="[NAME=]FOLDER",
        help="also look in FOLDER for files that programs name; with NAME, replace $NAME in the paths of these files "
        "by FOLDER, as in --map '$jasonJar=jason' (repeatable)",
    )


def run(args: argparse.Namespace) -> int:
    """Run the agents and return the exit code that the command's description promises."""
    allow_deep_calls()
    with loading_notice(args.agents):
        team = _team(args)
    if team is None:
        return 2
    code = team.run(args.timeout, args.exit_when_idle)
    return 1 if code == 0 and args.fail_on_error and team.failures else code


def _team(args: argparse.Namespace) -> Team | None:
    """Make the team of the arguments; None, with the reason on stderr, if that fails."""
    try:
        setup = _set_up(args, read_folders(args.include_path, SourcePaths))
    except (ProgramsRefused, ValueError) as refused:
        print(refused, file=sys.stderr)
        return None
    paths = setup.paths
    folders = [paths.project, *(Path(program.file).parent for _, program in setup.programs)]
    folders += [*paths.folders, *paths.names.values(), *args.allow_folder]
    try:
        return Team(
            setup.programs,
            args.seed,
            paths=paths,
            environment=make_environment(args.env),
            environment_arguments=args.env_arg or setup.environment_arguments,
            decisions=args.decisions,
            narrator=narrator_of(args),
            verbosity=setup.verbosity,
            folders=folders,
        )
    except UserCodeError as error:
        print(f"--env {args.env}: error: {error}", file=sys.stderr)
        return None


class ProgramsRefused(Exception):
    """The arguments do not name agents that can run; the text is for the terminal."""


def _set_up(args: argparse.Namespace, paths: SourcePaths) -> Setup:
    """Read the agents that the arguments name. Raises ProgramsRefused."""
    if any(argument.endswith(".mas2j") for argument in args.agents):
        if len(args.agents) > 1:
            raise ProgramsRefused("error: a project file is run alone: it names its agents")
        return _project(args.agents[0], paths, args.env is not None)
    setup = Setup(paths=paths)
    taken: set[str] = set()
    refused: list[str] = []
    for argument in args.agents:
        name, equals, path = argument.partition("=")
        if not equals:
            name, path = Path(argument).stem, argument
        if not name:
            raise ProgramsRefused(f"{argument}: error: the agent has no name; NAME=FILE.asl is expected")
        if name in taken:
            raise ProgramsRefused(f"error: two agents are called '{name}'; give them names: NAME=FILE.asl")
        taken.add(name)
        try:
            setup.programs.append((name, read_program(path, paths)))
        except ProgramsRefused as wrong:
            refused.append(str(wrong))
    if refused:
        raise ProgramsRefused("\n".join(dict.fromkeys(refused)))
    return setup


def _project(file: str, paths: SourcePaths, has_environment: bool) -> Setup:
    from agentd.jason_project.loader import read_project

    try:
        setup = read_project(file, paths, has_environment)
    except OSError as error:
        raise ProgramsRefused(f"{file}: error: cannot read the project: {error.strerror or error}") from error
    except (SyntaxErrors, Findings) as error:
        raise ProgramsRefused(str(error)) from error
    for warning in sorted(setup.warnings):
        print(warning, file=sys.stderr)
    return setup


def read_program(path: str, paths: SourcePaths) -> CompiledProgram:
    """Read and compile a program. Raises ProgramsRefused with its mistakes."""
    try:
        return paths.compiled(path)
    except OSError as error:
        raise ProgramsRefused(f"{path}: error: cannot read the program: {error.strerror or error}") from error
    except (SyntaxErrors, DirectiveError) as error:
        raise ProgramsRefused(str(error)) from error
