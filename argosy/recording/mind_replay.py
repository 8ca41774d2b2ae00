"""`argosy replay --mind`: a mind lives its recorded inputs again."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace


def add_mind_arguments(parser: ArgumentParser) -> None:
    """Declare `--mind`."""
    parser.add_argument("--mind", metavar="AGENT", help="live the recorded inputs of this agent again, without a bus")


def run_mind(args: Namespace) -> int:
    """Say that it is not built yet."""
    print("error: --mind is not built yet", file=sys.stderr)
    return 2
