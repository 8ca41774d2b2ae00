"""`argosy why`: why an agent did, or did not do, something."""

from __future__ import annotations

import shutil
import sys
from argparse import ArgumentParser, Namespace

import msgspec

from argosy.operator_bus import Where, add_fleet_arguments, on_the_bus
from argosy.why.explaining import LAST, explain
from argosy.why.story import plain
from argosy.why.subject import subject_of
from commd.bus import Bus
from commd.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.findings import Findings


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy why`."""
    parser.add_argument("agent", help="the agent's name")
    text = "a goal, a belief or an action: takeoff, go/1, '!go(3,_)' (default: what the agent is doing now, and why)"
    parser.add_argument("about", nargs="?", default="", metavar="NAME", help=text)
    help_ = f"tell the last N things that happened, each with how often (default {LAST})"
    parser.add_argument("--last", type=_count, default=LAST, metavar="N", help=help_)
    parser.add_argument("--json", action="store_true", help="as JSON")
    add_fleet_arguments(parser, "only this fleet (default: whichever has the agent)")


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError
    return number


def run(args: Namespace) -> int:
    """Print the explanation. Returns 1 if the agent does not answer, 2 for what no goal, belief or action is called."""
    try:
        if args.about:
            subject_of(args.about)
    except Findings as findings:
        print(findings, file=sys.stderr)
        return EXIT_BAD_INPUT

    async def ask(bus: Bus, where: Where) -> int:
        told = await explain(bus, where.fleet, args.agent, args.about, args.last)
        columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
        print(msgspec.json.format(msgspec.json.encode(told)).decode() if args.json else plain(told, columns))
        return EXIT_DONE

    return on_the_bus(args, ask)
