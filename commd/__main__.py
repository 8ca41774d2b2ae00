"""The `commd` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from commd import daemon
from commd.process.command_line import Help, check_command


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit code."""
    about = "Argosy's comm daemon: a board's router and its mail."
    parser = argparse.ArgumentParser(prog="commd", description=about, formatter_class=Help)
    commands = parser.add_subparsers(dest="command", required=True, prog=parser.prog)
    what = "route for a board of a mission, and carry its agents' mail"
    daemon.add_arguments(commands.add_parser("serve", help=what, description=what, formatter_class=Help))
    given = sys.argv[1:] if argv is None else list(argv)
    check_command(parser, given, ("serve",))
    return daemon.run(parser.parse_args(given))


if __name__ == "__main__":
    sys.exit(main())
