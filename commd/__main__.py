"""The `commd` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from commd import daemon


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="commd", description="Argosy's comm daemon: a board's router and its mail.")
    commands = parser.add_subparsers(dest="command", required=True)
    daemon.add_arguments(
        commands.add_parser("serve", help="route for a board of a mission, and carry its agents' mail")
    )
    return daemon.run(parser.parse_args(argv))


if __name__ == "__main__":
    sys.exit(main())
