"""`argosy replay`: publish a recording again, or print what it holds (`--info`)."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import sys
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from itertools import chain, islice
from pathlib import Path
from typing import Any

from argosy.cli.errors import BadInput, CommandError, progress
from argosy.cli.operator_bus import Where, add_router_argument, operator_bus, where
from argosy.cli.port_check import in_use
from argosy.recording.metadata import SECOND
from argosy.recording.mind_command import add_mind_arguments, check_options, run_mind
from argosy.recording.mind_inputs import MOST_MISSING, PART, RecordedMind, range_text
from argosy.recording.player import LATE, Part, Player, foreign
from argosy.recording.reader import Recording
from argosy.recording.records import wanted_keys
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import BusClosed
from commd.process.command_line import finite_number
from commd.process.process import EXIT_DONE, on_end_signals
from schemas.humanize import count, printable, size, some
from schemas.mission.model import DEFAULT_ROUTER
from schemas.wire import keys

SUFFIX = "-replay"
"""Appended to a fleet's name: the fleet it is replayed into by default, away from the live one."""
_LOOPBACK = re.compile(r"tcp/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
LOOK = 1.0
"""Wall seconds between two checks for other daemons, and between two lines of progress."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy replay`."""
    speed = finite_number(lambda value: 0 < value <= 1000, "a speed above 0, at most 1000")
    seconds = finite_number(lambda value: value >= 0, "seconds since the beginning of the recording")
    parser.add_argument("file", type=Path, metavar="FILE", help="a recording of `argosy record`, or of a report")
    parser.add_argument("--info", action="store_true", help="print what it holds; replay nothing")
    parser.add_argument("--json", action="store_true", help="with --info: as JSON")
    parser.add_argument(
        "--speed", type=speed, default=1.0, metavar="X", help="play X times as fast, up to 1000 (default 1)"
    )
    parser.add_argument(
        "--from", type=seconds, default=0.0, metavar="S", dest="begin", help="begin at this second of the recording"
    )
    parser.add_argument("--to", type=seconds, metavar="S", dest="end", help="end at this second of the recording")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="KEYEXPR",
        help="replay only these keys; repeatable",
    )
    parser.add_argument(
        "--fleet", metavar="NAME", help=f"replay into this fleet (default: the recorded name + {SUFFIX})"
    )
    parser.add_argument("--force", action="store_true", help="replay although daemons of that fleet are running")
    parser.add_argument("--loop", action="store_true", help="repeat until ctrl-C")
    add_router_argument(parser, f"{DEFAULT_ROUTER}, or a router of its own if none is running")
    parser.set_defaults(mission=None)
    add_mind_arguments(parser)


def run(args: Namespace) -> int:
    """Replay. Returns 0 when everything was published, 1 if that failed, 130 for ctrl-C."""
    check_options(args)
    if args.mind is not None:
        return run_mind(args)
    recording = Recording(args.file)
    if args.info:
        print(contents(recording, as_json=args.json), end="")
        return EXIT_DONE
    place, rename = _place(args, recording)
    if recording.missing:
        print(f"note: {recording.missing}", file=sys.stderr)
    part = Part(args.begin, args.end, tuple(wanted_keys("*", args.only)), args.speed)
    try:
        return asyncio.run(_replay(recording, part, place, rename, args))
    except (BusClosed, OSError) as error:
        raise CommandError(str(error)) from None


def _place(args: Namespace, recording: Recording) -> tuple[Where, dict[str, str]]:
    """Return where to replay, and the new name of each fleet. Raises BadInput for impossible arguments."""
    if args.end is not None and args.end <= args.begin:
        raise BadInput(f"--to {args.end:g}: expected more than --from {args.begin:g}")
    if args.begin > recording.seconds:
        raise BadInput(f"--from {args.begin:g}: {args.file} ends after {recording.seconds:.1f} s")
    fleets = recording.fleets
    if args.fleet is not None:
        if len(fleets) > 1:
            raise BadInput(f"--fleet {args.fleet}: {args.file} has several fleets: {', '.join(fleets)}")
        if not _NAME.fullmatch(args.fleet):
            raise BadInput(f"--fleet {args.fleet}: expected letters, digits, `_`, `-` and `.`")
    return where(args), {fleet: args.fleet or fleet + SUFFIX for fleet in fleets}


async def _replay(recording: Recording, part: Part, place: Where, rename: dict[str, str], args: Namespace) -> int:
    async with _bus(place, next(iter(rename.values()), "")) as bus:
        player = Player(bus, recording, rename)
        if not args.force and (there := await _somebody(bus, rename.values(), player)):
            raise CommandError(_danger(there))
        return await _Replay(bus, player, part, args).run(list(rename.values()))


@asynccontextmanager
async def _bus(place: Where, fleet: str) -> AsyncIterator[Bus]:
    """Open the bus; be the router where none is running on loopback."""
    alone = place.tls is None and _LOOPBACK.match(place.router) and not in_use(place.router)
    if not alone:
        async with operator_bus(place) as bus:
            yield bus
        return
    async with open_bus(place.router, fleet=fleet, name="replay", daemon="argosy", mode="router") as bus:
        print(f"no router at {place.router}: this replay is the router until it ends", flush=True)
        yield bus


async def _somebody(bus: Bus, fleets: Iterable[str], player: Player) -> list[str]:
    """Return the daemons of these fleets that are not the replay's."""
    found: list[str] = []
    for fleet in fleets:
        found += [
            f"{who} of fleet `{fleet}`"
            for who in foreign(await bus.tokens(keys.alive(fleet, "*", "*", "*")), player.declared)
        ]
    return found


def _danger(there: list[str]) -> str:
    who = some(there, 1)
    return f"{who} is running: it must not receive the percepts of another flight. Name another --fleet, or use --force"


class _Replay:
    """A running replay."""

    def __init__(self, bus: Bus, player: Player, part: Part, args: Namespace) -> None:
        self._bus, self._player, self._part, self._args = bus, player, part, args
        self._signal: signal.Signals | None = None
        self._somebody: list[str] = []

    async def run(self, fleets: list[str]) -> int:
        """Replay to the end, to a signal, or until another daemon appears. Returns the exit code."""
        playing = asyncio.create_task(self._play())
        on_end_signals(lambda number: self._cancel(number, playing))
        print(f"replaying {self._player.recording.path} into fleet {', '.join(fleets)}", flush=True)
        watching = asyncio.create_task(self._watch(fleets, playing))
        try:
            await playing
        except asyncio.CancelledError:
            if self._signal is None and not self._somebody:
                raise
        finally:
            watching.cancel()
            self._player.clear()
        self._report()
        if self._somebody:
            raise CommandError(f"stopped: {_danger(self._somebody)}")
        if self._signal is not None:
            return 128 + self._signal
        if not self._player.figures.republished:
            raise CommandError("nothing was published: no message of this part and on these keys can be")
        return EXIT_DONE

    async def _play(self) -> None:
        await self._player.play(self._part)
        while self._args.loop and self._player.figures.republished:
            self._player.clear()
            await self._player.play(self._part)

    def _cancel(self, number: signal.Signals, playing: asyncio.Task[None]) -> None:
        self._signal = self._signal or number
        playing.cancel()

    async def _watch(self, fleets: list[str], playing: asyncio.Task[None]) -> None:
        """Stop when another daemon appears in the fleet; show progress."""
        while True:
            await asyncio.sleep(LOOK)
            if not self._args.force and (there := await _somebody(self._bus, fleets, self._player)):
                self._somebody = there
                playing.cancel()
                return
            figures = self._player.figures
            progress(f"{figures.at:.0f} of {self._player.recording.seconds:.0f} s  {figures.republished} messages")

    def _report(self) -> None:
        figures = self._player.figures
        progress("")
        left = f", {figures.left_out} left out (answers to queries)" if figures.left_out else ""
        with suppress(OSError):
            print(f"replayed {figures.at:.1f} s: {figures.republished} messages{left}")
        if figures.not_ours:
            why = "their keys are outside the recorded fleets and could reach running robots"
            print(f"warning: {figures.not_ours} messages were not published: {why}", file=sys.stderr)
        if figures.unreadable:
            print(f"warning: {figures.unreadable} messages were not published: they cannot be read", file=sys.stderr)
        if figures.behind > LATE:
            print(
                f"warning: up to {figures.behind:.1f} s late: this machine is too slow for the speed", file=sys.stderr
            )


Unread = Counter[tuple[str, str]]
"""Number of batches that do not decode, by fleet and agent."""


def contents(recording: Recording, *, as_json: bool = False) -> str:
    """Return what a recording holds, as text or JSON."""
    unread: Unread = Counter()
    minds = recording.minds(unread=unread)
    if as_json:
        return json.dumps(_data(recording, minds, unread), indent=2) + "\n"
    return (
        "\n".join(map(printable, [*_head(recording), "", *_minds(recording, minds, unread), "", *_topics(recording)]))
        + "\n"
    )


def _head(recording: Recording) -> list[str]:
    facts, end = recording.facts, recording.end
    began = datetime.fromtimestamp(facts.started / SECOND, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    held = sum(file.stat().st_size for file in recording.files)
    files = f"{len(recording.files)} files, " if len(recording.files) > 1 else ""
    mission = f", mission {facts.mission} ({facts.mission_file}, at speed {facts.speed:g})" if facts.mission else ""
    lines = [
        f"{recording.path}: {files}{size(held)}, of Argosy {facts.version}",
        f"  fleet    {', '.join(recording.fleets) or facts.fleet}{mission}",
        f"  began    {began}",
        f"  lasts    {recording.seconds:.1f} s, {sum(topic.messages for topic in recording.topics)} messages",
        f"  ended    {end.why if end is not None else 'no: it was cut off, or is still being written'}",
    ]
    if recording.missing:
        lines.append(f"  missing  {recording.missing}")
    if facts.only:
        lines.append(f"  only     {' '.join(facts.only)}")
    lines += [f"  {name:8} {text}" for name, text in facts.notes.items()]
    return lines


def _minds(recording: Recording, minds: list[RecordedMind], unread: Unread) -> list[str]:
    width = max((len(agent) for agent in [*(mind.agent for mind in minds), *(agent for _, agent in unread)]), default=0)
    lines = [f"  {mind.agent:{width}}  {mind.boot:8}  {_extent(mind)}" for mind in minds]
    for (_, agent), number in sorted(unread.items()):
        batches = count(number, "batch", "batches")
        lines.append(f"  {agent:{width}}  {batches} of its inputs cannot be read: another version of Argosy wrote them")
    if lines:
        return ["minds", *lines]
    if any(topic.key.endswith(f"/{PART}") for topic in recording.topics):
        return ["no minds: the messages on `trace/inputs` are not Argosy's"]
    return ["no minds: `trace/inputs` was not recorded"]


def _extent(mind: RecordedMind) -> str:
    last = mind.batches[-1]
    if mind.whole:
        initial = mind.batches[0].initial
        unknown = f", cannot be replayed: {initial.unknown}" if initial is not None and initial.unknown else ""
        decided = sum(batch.decided for batch in mind.batches)
        extent = "whole" if mind.ended else f"from its start to {mind.until:.1f} s of mission time, its end is missing"
        return f"{extent}, {last.last} cycles, {decided} decisions and effects{unknown}"
    if mind.missing:
        return f"incomplete: batches {range_text(mind.missing)} of {last.number + 1} of its inputs are missing"
    return "incomplete: its initial is missing"


def _topics(recording: Recording) -> list[str]:
    if not recording.topics:
        return ["no messages"]
    seconds = max(recording.seconds, 1e-9)
    width = max(len(topic.key) for topic in recording.topics)
    names = max(len(topic.record) for topic in recording.topics)
    rows = [
        f"  {topic.key:{width}}  {topic.record:{names}}  {topic.messages:>7}  {topic.messages / seconds:>8.2f}"
        for topic in recording.topics
    ]
    return [f"  {'':{width}}  {'':{names}}  {'number':>7}  {'Hz':>8}", *rows]


def _data(recording: Recording, minds: list[RecordedMind], unread: Unread) -> dict[str, Any]:
    facts, end = recording.facts, recording.end
    return {
        "files": [str(file) for file in recording.files],
        "fleets": recording.fleets,
        "mission": facts.mission,
        "speed": facts.speed,
        "version": facts.version,
        "started": facts.started,
        "seconds": recording.seconds,
        "ended": None if end is None else end.why,
        "missing": recording.missing,
        "dropped": 0 if end is None else end.dropped + end.too_large,
        "notes": dict(facts.notes),
        "minds": [
            {
                "agent": mind.agent,
                "boot": mind.boot,
                "whole": mind.whole and mind.ended,
                "end": mind.ended,
                "batches": len(mind.batches),
                "missing": list(islice(chain.from_iterable(mind.missing), MOST_MISSING)),
            }
            for mind in minds
        ],
        "unread_inputs": [
            {"fleet": fleet, "agent": agent, "batches": count} for (fleet, agent), count in sorted(unread.items())
        ],
        "topics": [
            {"key": topic.key, "record": topic.record, "messages": topic.messages} for topic in recording.topics
        ],
    }
