"""`argosy replay --mind`: a mind lives its recorded inputs again, to prove that it decides the same.

With an edited program the same shows what that would have done. What is not in the recording is not proved: it is told
what is missing and up to when it could be proved, and the exit code is 1.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from agentd.language.errors import SyntaxErrors
from agentd.language.parser import parse_file
from agentd.plugins import discover
from argosy.recording import lives
from argosy.recording.mind_proof import OTHER_VERSION, LifeAgain
from argosy.recording.mind_words import SHOWN
from argosy.recording.reader import BadRecording, Recording, open_recording
from commd.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas import keys
from schemas.minds import MindDecisions, MindInputs


def add_mind_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy replay --mind`."""
    group = parser.add_argument_group("one mind", "it lives its recorded inputs again; nothing is said on a bus")
    group.add_argument("--mind", metavar="AGENT", help="prove that this agent decides as it did when it was recorded")
    group.add_argument(
        "--program",
        type=Path,
        action="append",
        default=[],
        metavar="ASL",
        help="what would this program have done instead? Takes the place of the file of this name that the program "
        "was read from, of the main file if none is called so (repeatable)",
    )
    group.add_argument("--life", type=int, metavar="N", help="its Nth life alone, if it was started again")
    group.add_argument("--until", type=float, metavar="S", help="up to this second of its mission time")
    group.add_argument("--why", metavar="NAME", help="tell every decision about goals and beliefs of this name")
    group.add_argument(
        "--show",
        type=int,
        default=SHOWN,
        metavar="N",
        help=f"at a difference: N inputs before it, and N deeds of each life after it (default {SHOWN})",
    )


class Refused(Exception):
    """What was asked for is not there, or cannot be read: what is said to people, all of it."""


def run_mind(args: Namespace) -> int:
    """Live an agent again. Returns 0 if all of it agrees, 1 if it does not or not all is there, 2 for bad input."""
    try:
        edited = {path: _text(path) for path in args.program}
        recording = open_recording(args.file)
        asked = [LifeAgain(number, life, args, edited, last) for number, life, last in _lives(recording, args)]
    except (Refused, BadRecording) as error:
        print(error if isinstance(error, Refused) else f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    if recording.missing:
        print(f"warning: {recording.missing}", file=sys.stderr)
    discover()
    unread = _unread(recording, args.mind)
    decisions = [record for _, record in recording.typed(MindDecisions) if record.agent == args.mind]
    return max((one.live_again(recording, decisions, unread) for one in asked), default=EXIT_DONE)


def _text(path: Path) -> str:
    """Return the text of an edited program. Raises Refused if it is none."""
    try:
        parse_file(path)
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise Refused(f"error: {path}: {error.strerror}") from None
    except SyntaxErrors as errors:
        raise Refused(str(errors)) from None


def _lives(recording: Recording, args: Namespace) -> list[tuple[int, lives.Life, bool]]:
    """Return the lives that were asked for with their numbers, and whether others follow. Raises Refused."""
    parsed = [keys.parse(topic.key) for topic in recording.topics if topic.record == MindInputs.__name__]
    known = sorted({one[1] for one in parsed if one is not None})
    if args.mind not in known:
        there = f"there are those of {', '.join(known)}" if known else "nor of any other agent"
        raise Refused(f"error: {args.file}: there are no inputs of {args.mind} in it, {there}")
    lived = recording.lives(args.mind)
    if not lived:
        raise Refused(f"error: {args.file}: no inputs of {args.mind} can be read: {OTHER_VERSION}")
    found = [(number, life, number < len(lived)) for number, life in enumerate(lived, 1)]
    if args.life is None:
        return found
    if not 1 <= args.life <= len(found):
        raise Refused(f"error: {args.file}: --life {args.life}: there are {len(found)} lives of {args.mind} in it")
    return [found[args.life - 1]]


def _unread(recording: Recording, agent: str) -> int:
    """Return how many batches of an agent's inputs do not decode."""
    only = (keys.trace("*", agent, "inputs"),)
    return sum(message.record is None for message in recording.messages(only=only, records=(MindInputs,)))
