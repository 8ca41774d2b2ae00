"""`argosy replay --mind`: replay the recorded inputs of a mind, to prove that it decides the same.

With an edited program it shows what that would have done. What is not in the recording is not proved: the output
has what is missing and up to when it could be proved, and the exit code is 1.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path

from agentd.extensions.plugins import discover
from agentd.language.parse import parse_file
from agentd.language.syntax_tree.errors import SyntaxErrors
from argosy.cli.arguments import mission_second
from argosy.cli.errors import BadInput
from argosy.recording import mind_inputs
from argosy.recording.mind_verification import OTHER_VERSION, SHOWN, ReplayCheck
from argosy.recording.reader import Recording
from argosy.recording.records import TokenSeen
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.files.text_files import read_bounded
from schemas.humanize import count
from schemas.wire import keys
from schemas.wire.mind_records import MindDecisions, MindInputs

FOR_A_MIND: Mapping[str, tuple[str, object]] = {
    "--program": ("program", []),
    "--start": ("start", None),
    "--until": ("until", None),
    "--why": ("why", None),
    "--show": ("show", SHOWN),
}
"""Options that have a meaning with `--mind` only: the name and the default of each."""
OF_CONTENTS: Mapping[str, tuple[str, object]] = {"--info": ("info", False), "--json": ("json", False)}
"""Those that print what a recording holds."""
OF_PUBLISHING: Mapping[str, tuple[str, object]] = {
    "--speed": ("speed", 1.0),
    "--from": ("begin", 0.0),
    "--to": ("end", None),
    "--only": ("only", []),
    "--force": ("force", False),
    "--loop": ("loop", False),
    "--router": ("router", None),
    "--keys": ("keys", None),
}
"""And those of a replay on the bus."""


def add_mind_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy replay --mind`."""
    group = parser.add_argument_group("one mind", "replay the recorded inputs of a mind, without a bus")
    group.add_argument("--mind", metavar="AGENT", help="verify that this agent decides as it was recorded")
    group.add_argument(
        "--program",
        type=Path,
        action="append",
        default=[],
        metavar="ASL",
        help="use this program instead of the recorded file of the same name, or of the main file if there is none; "
        "shows what it would have done (repeatable)",
    )
    group.add_argument("--start", type=int, metavar="N", help="only its Nth start, 1 or more, if it was restarted")
    group.add_argument("--until", type=mission_second, metavar="S", help="stop at this mission second")
    group.add_argument("--why", metavar="NAME", help="print every decision about goals and beliefs of this name")
    group.add_argument(
        "--show",
        type=int,
        default=SHOWN,
        metavar="N",
        help=f"at a difference, print N inputs before it and N effects of each run after it (default {SHOWN})",
    )


def run_mind(args: Namespace) -> int:
    """Replay the mind of an agent. Returns 0 if all agrees, 1 if it differs or is incomplete. Raises BadInput."""
    try:
        edited = {path: _text(path) for path in args.program}
    except SyntaxErrors as errors:
        print(errors, file=sys.stderr)
        return EXIT_BAD_INPUT
    recording = Recording(args.file)
    fleet = _fleet(recording, args)
    asked = _checks(recording, args, fleet, edited)
    if recording.missing:
        print(f"warning: {recording.missing}", file=sys.stderr)
    discover()
    unread = _unread(recording, fleet, args.mind)
    channel = (keys.trace(fleet, args.mind, "decisions"),)
    decisions = [record for _, record in recording.typed(MindDecisions, channel)]
    return max((one.verify(recording, decisions, unread) for one in asked), default=EXIT_DONE)


def _text(path: Path) -> str:
    """Return the text of an edited program. Raises BadInput if it cannot be read, SyntaxErrors if it is none."""
    try:
        parse_file(path)
        return read_bounded(path).decode("utf-8-sig")
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from None


def check_options(args: Namespace) -> None:
    """Check that each option of a replay has a meaning with `--mind`, `--info` or without them. Raises BadInput."""
    if args.mind is not None:
        _refuse(args, {**OF_CONTENTS, **OF_PUBLISHING}, "not with --mind, which publishes nothing")
        return
    _refuse(args, FOR_A_MIND, "only with --mind AGENT")
    if args.info:
        _refuse(args, OF_PUBLISHING, "not with --info, which publishes nothing")
    else:
        _refuse(args, OF_CONTENTS, "only with --info")


def _refuse(args: Namespace, options: Mapping[str, tuple[str, object]], why: str) -> None:
    for option, (name, default) in options.items():
        if getattr(args, name) != default:
            raise BadInput(f"{option}: {why}")


def _fleet(recording: Recording, args: Namespace) -> str:
    """Return of which fleet the agent is. Raises BadInput."""
    there = {one for one in recording.names_of(MindInputs) if args.fleet in (None, one[0])}
    fleets = sorted(fleet for fleet, agent in there if agent == args.mind)
    of_fleet = f" of fleet {args.fleet}" if args.fleet is not None else ""
    if not fleets:
        known = ", ".join(sorted({agent for _, agent in there}))
        others = f"there are those of {known}" if known else "nor of any other agent"
        raise BadInput(f"{args.file}: there are no inputs of {args.mind}{of_fleet} in it, {others}")
    if len(fleets) > 1:
        raise BadInput(f"{args.file}: {args.mind} is in several fleets: add --fleet {' or '.join(fleets)}")
    return fleets[0]


def _checks(recording: Recording, args: Namespace, fleet: str, edited: dict[Path, str]) -> list[ReplayCheck]:
    """Return the recorded minds that were asked for. Raises BadInput."""
    recorded = [mind for mind in recording.minds(args.mind) if mind.fleet == fleet]
    if not recorded:
        raise BadInput(f"{args.file}: no inputs of {args.mind} can be read: {OTHER_VERSION}")
    last, there = len(recorded), _still_runs(recording, recorded[-1])
    found = [
        ReplayCheck(number, mind, args, edited, followed=number < last, still_runs=there and number == last)
        for number, mind in enumerate(recorded, 1)
    ]
    if args.start is None:
        return found
    if not 1 <= args.start <= len(found):
        raise BadInput(f"{args.file}: --start {args.start}: {args.mind} has {count(len(found), 'start')} in it")
    return [found[args.start - 1]]


def _still_runs(recording: Recording, mind: mind_inputs.RecordedMind) -> bool:
    """Whether the recording came to its end in order, and the daemon of this mind was still running then."""
    since: dict[str, int] = {}
    """When each daemon first held its token."""
    there: set[str] = set()
    heard = 0
    only = (f"{keys.ROOT}/{mind.fleet}/{mind.agent}/alive/agentd", keys.trace(mind.fleet, mind.agent, "inputs"))
    for message in recording.messages(only=only, records=(TokenSeen, MindInputs)):
        match message.record:
            case TokenSeen(key=key, alive=alive):
                since.setdefault(key, message.at)
                (there.add if alive else there.discard)(key)
            case MindInputs(header=header) if header.boot == mind.boot:
                heard = message.at
    itself = any(since[key] <= heard for key in there)  # not the next one, of which no inputs have come yet
    return itself and recording.end is not None and not recording.missing


def _unread(recording: Recording, fleet: str, agent: str) -> int:
    """Return how many batches of an agent's inputs do not decode."""
    only = (keys.trace(fleet, agent, "inputs"),)
    return sum(message.record is None for message in recording.messages(only=only, records=(MindInputs,)))
