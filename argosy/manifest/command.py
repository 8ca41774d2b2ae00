"""`argosy manifest`: what belongs to manifests, in files and in running bridges."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from commd.process.command_line import check_command
from commd.process.process import EXIT_BAD_INPUT

AddArguments = Callable[[argparse.ArgumentParser], None]
Run = Callable[[argparse.Namespace], int]

COMMANDS = {
    "check": "read manifests and tell everything that is wrong with them",
    "schema": "print the JSON Schema of manifests, for editors",
    "convert": "write the paper's pair of INI files as one TOML manifest",
    "get": "print the manifest that a robot runs by now, or a part of it",
    "set": "change the manifest of a running robot",
}


def main(given: list[str]) -> int:
    """Run `argosy manifest COMMAND ...`. Returns the exit code."""
    if given and given[0] in COMMANDS:
        name, text = given[0], COMMANDS[given[0]]
        command = argparse.ArgumentParser(prog=f"argosy manifest {name}", description=f"{text[0].upper()}{text[1:]}.")
        add_arguments, run = _load(name)
        add_arguments(command)
        return run(command.parse_intermixed_args(given[1:]))
    parser = argparse.ArgumentParser(prog="argosy manifest", description="Manifests of robots: files and live ones.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        commands.add_parser(name, help=text)
    check_command(parser, given, COMMANDS)
    parser.parse_args(given)
    return EXIT_BAD_INPUT


def _load(name: str) -> tuple[AddArguments, Run]:
    match name:
        case "check" | "schema":
            from argosy.manifest import file_commands

            return getattr(file_commands, f"add_{name}_arguments"), getattr(file_commands, name)
        case "convert":
            from argosy.manifest import convert_command

            return convert_command.add_arguments, convert_command.run
        case _:
            from argosy.manifest import live_commands

            return getattr(live_commands, f"add_{name}_arguments"), getattr(live_commands, f"{name}_manifest")
