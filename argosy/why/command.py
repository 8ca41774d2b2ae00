"""`argosy why`: why an agent did, or did not do, something."""

from __future__ import annotations

import shutil
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

import msgspec

from argosy.cli.arguments import count, mission_second, name
from argosy.cli.errors import BadInput
from argosy.cli.operator_bus import Where, add_fleet_arguments, note, on_the_bus, put_out
from argosy.why.answer import Explanation, plain
from argosy.why.explain import LAST, explain, explain_view
from argosy.why.question import subject_of
from commd.bus.bus import Bus
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.humanize import escaped


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy why`."""
    parser.add_argument("agent", type=name, help="the agent's name")
    text = "a goal, a belief or an action: takeoff, go/1, '!go(3,_)' (default: what the agent does now, and why)"
    parser.add_argument("about", nargs="?", default="", metavar="NAME", help=text)
    help_ = f"print the last N occurrences, with counts (default {LAST})"
    parser.add_argument("--last", type=count, default=LAST, metavar="N", help=help_)
    parser.add_argument("--json", action="store_true", help="as JSON")
    help_ = "ask a recording instead of the running fleet: the mind is replayed up to --at"
    parser.add_argument("--recording", type=Path, metavar="FILE", help=help_)
    help_ = "with --recording: second of the agent, as printed here; the run's clock is ahead (default: the end)"
    parser.add_argument("--at", type=mission_second, metavar="S", help=help_)
    add_fleet_arguments(parser, "only this fleet (default: whichever has the agent)")


def run(args: Namespace) -> int:
    """Print the explanation. Returns 1 if the agent has nothing of that name.

    Raises Findings for a NAME that no goal, belief or action can have, BadInput for a file that is no recording, and
    CommandError if the agent does not answer or is not in the recording.
    """
    if args.about:
        subject_of(args.about)
    if args.recording is not None:
        from argosy.why.from_recording import recorded_view  # a running fleet needs no mcap

        view, notes = recorded_view(args.recording, args.agent, args.at)
        for text in notes:
            note(text)
        return _show(explain_view(view, args.about, last=args.last), args.json)
    if args.at is not None:
        raise BadInput("argosy why: --at needs --recording FILE")

    async def ask(bus: Bus, where: Where) -> int:
        return _show(await explain(bus, where.fleet, args.agent, args.about, args.last), args.json)

    return on_the_bus(args, ask)


def _show(explanation: Explanation, as_json: bool) -> int:
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    text = msgspec.json.format(msgspec.json.encode(explanation)).decode() if as_json else plain(explanation, columns)
    put_out("\n".join(map(escaped, text.split("\n"))))
    return EXIT_DONE if explanation.known else EXIT_FAILED
