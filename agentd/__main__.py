"""The ``agentd`` command: ``run``, ``serve``, ``test`` and ``check``; each is imported only when it is asked for."""

from __future__ import annotations

import argparse
import gc
import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from agentd.process import guarded
from commd.process.command_line import Help, Parser, check_command, interruptible

_COMMANDS = {
    "run": ("agentd.standalone.command", "run agents in this process, without a bus", "hello.asl --exit-when-idle"),
    "serve": ("agentd.daemon", "run the agents of a mission's board as a daemon", "missions/single_uav.yaml uav"),
    "test": ("agentd.testing.command", "run the test plans of programs", "tests --filter greets"),
    "check": ("agentd.check.command", "check programs for mistakes; start nothing", "uav.asl --manifest copter"),
}
"""Module, help and the arguments of an example."""


def main(argv: list[str] | None = None) -> int:
    """Run a command; the exit code is 0 for done, 1 for failed, 2 for bad input, 128 + N for signal N."""
    with interruptible(), _starting():
        args = _read(sys.argv[1:] if argv is None else argv)
        entry = importlib.import_module(_COMMANDS[args.command][0])
        importlib.import_module("agentd.extensions.plugins").discover()
    return guarded(lambda: int(entry.run(args) or 0))


@contextmanager
def _starting() -> Iterator[None]:
    """Import without looking for garbage, which takes a tenth of a start and finds none, then or later."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def _read(arguments: list[str]) -> argparse.Namespace:
    """Read the command line. Import the command that it names, for its arguments."""
    what = "Run, test and check BDI agents in the Jason dialect of AgentSpeak."
    parser = Parser(prog="agentd", description=what, formatter_class=Help)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", prog=parser.prog)
    chosen = arguments[0] if arguments else ""
    for name, (module, text, example) in _COMMANDS.items():
        command = commands.add_parser(
            name, help=text, description=text, epilog=f"example: agentd {name} {example}", formatter_class=Help
        )
        if name == chosen:
            importlib.import_module(module).add_arguments(command)
    check_command(parser, arguments, _COMMANDS)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
