"""`argosy keys`: certificates for the machines of a fleet (docs/guides/security.md)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from commd.process.process import EXIT_BAD_INPUT
from schemas.files.findings import Findings

AddArguments = Callable[[argparse.ArgumentParser], None]
Run = Callable[[argparse.Namespace], int]

COMMANDS = {
    "init": "make a fleet's authority, and certificates for all that its mission names",
    "add-board": "make a certificate for a board that came to the mission, or that takes the place of a revoked one",
    "add-operator": "make a certificate for an operator of the mission",
    "add-observer": "make a certificate for an observer of the mission",
    "renew": "make new certificates for machines whose old ones end soon, or for those named",
    "revoke": "disown machines: nobody believes their certificates any more",
    "show": "tell who has which certificate and until when, of a mission's fleet or of one machine's folder",
}


def main(given: list[str]) -> int:
    """Run `argosy keys COMMAND ...`. Returns the exit code."""
    if given and given[0] in COMMANDS:
        name, text = given[0], COMMANDS[given[0]]
        command = argparse.ArgumentParser(prog=f"argosy keys {name}", description=f"{text[0].upper()}{text[1:]}.")
        add_arguments, run = _load(name)
        add_arguments(command)
        try:
            return run(command.parse_intermixed_args(given[1:]))
        except Findings as findings:
            print(findings, file=sys.stderr)
            return EXIT_BAD_INPUT
    parser = argparse.ArgumentParser(prog="argosy keys", description="Who may reach the boards of a fleet.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        commands.add_parser(name, help=text)
    parser.parse_args(given)
    return EXIT_BAD_INPUT


def _load(name: str) -> tuple[AddArguments, Run]:
    if name == "show":
        from argosy.keys import show_command

        return show_command.add_arguments, show_command.run
    from argosy.keys import certificate_commands

    kind = name.removeprefix("add-")
    if kind != name:
        return certificate_commands.add_add_arguments, lambda args: certificate_commands.add(args, kind)
    return getattr(certificate_commands, f"add_{name}_arguments"), getattr(certificate_commands, name)
