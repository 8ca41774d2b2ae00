"""The `bridged` command."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from commd.process.command_line import Help, Parser, check_command, interruptible


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit code."""
    with interruptible():
        return _main(list(sys.argv[1:] if argv is None else argv))


def _main(argv: list[str]) -> int:
    """Run the command line; each command imports only what it needs: daemons stay small."""
    about = "Argosy's bridge between robots and their agents."
    parser = Parser(prog="bridged", description=about, formatter_class=Help)
    commands = parser.add_subparsers(dest="command", required=True, prog=parser.prog)
    what, example = (
        "connect robots of a mission to their agents",
        "example: bridged serve missions/single_uav.yaml uav1",
    )
    serve = commands.add_parser("serve", help=what, description=what, epilog=example, formatter_class=Help)
    simulate = commands.add_parser("simulate", help="run a simulated robot", formatter_class=Help)
    check_command(parser, argv, ("serve", "simulate"))
    if argv[:1] == ["simulate"]:
        import bridged.simulation.command as simulation

        simulation.add_arguments(simulate, argv)
        return simulation.run(parser.parse_args(argv))
    from bridged import daemon

    daemon.add_arguments(serve)
    return daemon.run(parser.parse_args(argv))


if __name__ == "__main__":
    sys.exit(main())
