"""The `commd` command."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from commd.process.command_line import Help, Parser, check_command, interruptible


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit code."""
    with interruptible():
        return _main(sys.argv[1:] if argv is None else argv)


def _main(given: Sequence[str]) -> int:
    from commd import daemon

    about = "Argosy's comm daemon: router and mail of a board."
    parser = Parser(prog="commd", description=about, formatter_class=Help)
    commands = parser.add_subparsers(dest="command", required=True, prog=parser.prog)
    what = "run the router of a mission's board and deliver its agents' mail"
    example = "example: commd serve missions/search_and_rescue.yaml --board pi1"
    serve = commands.add_parser("serve", help=what, description=what, epilog=example, formatter_class=Help)
    daemon.add_arguments(serve)
    check_command(parser, given, ("serve",))
    return daemon.run(parser.parse_args(given))


if __name__ == "__main__":
    sys.exit(main())
