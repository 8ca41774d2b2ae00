"""The ``agentd`` command: ``run``, ``serve``, ``test`` and ``check``; each is imported only when it is asked for."""

from __future__ import annotations

import argparse
import importlib
import sys

from agentd.exit_handling import guarded
from commd.process.command_line import Help, check_command

_COMMANDS = {
    "run": ("agentd.standalone.command", "run agents in this process, without any bus"),
    "serve": ("agentd.daemon", "be the daemon of a mission's agents"),
    "test": ("agentd.testing.command", "run the test plans of programs"),
    "check": ("agentd.check.command", "look for mistakes in programs and start nothing"),
}


def main(argv: list[str] | None = None) -> int:
    """Run a command; the exit code is 0 for done, 1 for failed, 2 for bad input, 128 + N for signal N."""
    arguments = sys.argv[1:] if argv is None else argv
    what = "BDI agents in the Jason dialect of AgentSpeak."
    parser = argparse.ArgumentParser(prog="agentd", description=what, formatter_class=Help)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", prog=parser.prog)
    chosen = arguments[0] if arguments else ""
    for name, (module, help_text) in _COMMANDS.items():
        command = commands.add_parser(name, help=help_text, description=help_text, formatter_class=Help)
        if name == chosen:
            importlib.import_module(module).add_arguments(command)
    check_command(parser, arguments, _COMMANDS)
    args = parser.parse_args(arguments)
    entry = importlib.import_module(_COMMANDS[args.command][0])
    importlib.import_module("agentd.extensions.plugins").discover()
    return guarded(lambda: int(entry.run(args) or 0))


if __name__ == "__main__":
    sys.exit(main())
