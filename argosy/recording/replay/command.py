"""`argosy replay`: what a recording holds, said once more on the bus; or what it holds, in words."""

from __future__ import annotations

import asyncio
import re
import signal
import sys
import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from argosy.cli.operator_bus import Where, add_router_argument, operator_bus, where
from argosy.cli.port_check import in_use
from argosy.recording.file.contents import contents
from argosy.recording.file.reader import BadRecording, Recording, open_recording
from argosy.recording.record.subscriptions import wanted_keys
from argosy.recording.replay.mind_command import add_mind_arguments, run_mind, without_a_mind
from argosy.recording.replay.player import LATE, Part, Player, foreign
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import BusClosed
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED
from schemas.files.findings import Findings
from schemas.mission.model import DEFAULT_ROUTER
from schemas.wire import keys

SUFFIX = "-replay"
"""Behind the name of a fleet: where it is replayed by default, so that no live one hears of it."""
_LOOPBACK = re.compile(r"tcp/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
LOOK = 1.0
"""Wall seconds between two looks at whether anybody has come, and between two lines of progress."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy replay`."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a recording, of `argosy record` or a report")
    parser.add_argument("--info", action="store_true", help="tell what is in it; replay nothing")
    parser.add_argument("--json", action="store_true", help="with --info: as JSON")
    parser.add_argument("--speed", type=_speed, default=1.0, metavar="X", help="X times as fast as it was recorded")
    parser.add_argument(
        "--from", type=_seconds, default=0.0, metavar="S", dest="begin", help="seconds into the recording"
    )
    parser.add_argument("--to", type=_seconds, metavar="S", dest="end", help="seconds into the recording")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="KEYEXPR",
        help="replay these keys alone; may stand several times",
    )
    parser.add_argument(
        "--fleet", metavar="NAME", help=f"replay into this fleet (default: the recorded name + {SUFFIX})"
    )
    parser.add_argument("--force", action="store_true", help="replay although somebody is there in that fleet")
    parser.add_argument("--loop", action="store_true", help="again and again, until ctrl-C")
    add_router_argument(parser, f"{DEFAULT_ROUTER}, with a router of its own if none is there")
    parser.set_defaults(mission=None)
    add_mind_arguments(parser)


def _speed(text: str) -> float:
    speed = float(text)
    if not 0 < speed <= 1000:
        raise ValueError
    return speed


_speed.__name__ = "speed (0 < X <= 1000)"


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds < float("inf"):
        raise ArgumentTypeError(f"expected seconds since the beginning of the recording, got `{text}`")
    return seconds


def run(args: Namespace) -> int:
    """Replay. Returns 0 when all was said, 1 if it could not be, 130 for ctrl-C."""
    if args.mind is not None:
        return run_mind(args)
    if wrong := without_a_mind(args):
        print(f"error: {wrong}", file=sys.stderr)
        return EXIT_BAD_INPUT
    try:
        recording = open_recording(args.file)
        if args.info:
            print(contents(recording, as_json=args.json), end="")
            return EXIT_DONE
        place, rename = _place(args, recording)
    except (BadRecording, Findings, ValueError) as error:
        print(error if isinstance(error, Findings) else f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    if recording.missing:
        print(f"note: {recording.missing}", file=sys.stderr)
    part = Part(args.begin, args.end, tuple(wanted_keys("*", args.only)), args.speed)
    try:
        return asyncio.run(_replay(recording, part, place, rename, args))
    except Findings as findings:
        print(findings, file=sys.stderr)
        return EXIT_BAD_INPUT
    except (BusClosed, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_FAILED


def _place(args: Namespace, recording: Recording) -> tuple[Where, dict[str, str]]:
    """Return where it is replayed and how fleets are called there. Raises ValueError for what cannot be."""
    if args.end is not None and args.end <= args.begin:
        raise ValueError(f"--to {args.end:g}: expected more than --from {args.begin:g}")
    if args.begin > recording.seconds:
        raise ValueError(f"--from {args.begin:g}: {args.file} ends after {recording.seconds:.1f} s")
    fleets = recording.fleets
    if args.fleet is not None:
        if len(fleets) > 1:
            raise ValueError(f"--fleet {args.fleet}: {args.file} is of several fleets: {', '.join(fleets)}")
        if not _NAME.fullmatch(args.fleet):
            raise ValueError(f"--fleet {args.fleet}: expected letters, digits, `_`, `-` and `.`")
    wanted_keys("*", args.only)
    return where(args), {fleet: args.fleet or fleet + SUFFIX for fleet in fleets}


async def _replay(recording: Recording, part: Part, place: Where, rename: dict[str, str], args: Namespace) -> int:
    async with _bus(place, next(iter(rename.values()), "")) as bus:
        player = Player(bus, recording, rename)
        if not args.force and (there := await _somebody(bus, rename.values(), player)):
            print(f"error: {_danger(there)}", file=sys.stderr)
            return EXIT_FAILED
        return await _Replay(bus, player, part, args).run(list(rename.values()))


@asynccontextmanager
async def _bus(place: Where, fleet: str) -> AsyncIterator[Bus]:
    """Open the bus; where no router is and one may be, be one."""
    alone = place.tls is None and _LOOPBACK.match(place.router) and not in_use(place.router)
    if not alone:
        async with operator_bus(place) as bus:
            yield bus
        return
    async with open_bus(
        place.router, fleet=fleet, name="replay", daemon="argosy", stamp=time.time_ns, mode="router"
    ) as bus:
        print(f"no router at {place.router}: this replay is one, as long as it lasts", flush=True)
        yield bus


async def _somebody(bus: Bus, fleets: Iterable[str], player: Player) -> list[str]:
    """Return who is in these fleets and is not the replay's."""
    found: list[str] = []
    for fleet in fleets:
        found += [
            f"{who} of fleet `{fleet}`"
            for who in foreign(await bus.tokens(keys.alive(fleet, "*", "*", "*")), player.declared)
        ]
    return found


def _danger(there: list[str]) -> str:
    who = there[0] if len(there) == 1 else f"{there[0]} and {len(there) - 1} more"
    return (
        f"{who} is there: what was perceived in another flight must not be told to it. Name another --fleet, or --force"
    )


class _Replay:
    """One replay under way."""

    def __init__(self, bus: Bus, player: Player, part: Part, args: Namespace) -> None:
        self._bus, self._player, self._part, self._args = bus, player, part, args
        self._signal: signal.Signals | None = None
        self._somebody: list[str] = []

    async def run(self, fleets: list[str]) -> int:
        """Replay to the end, to a signal, or until somebody is there. Returns the exit code."""
        loop = asyncio.get_running_loop()
        playing = asyncio.create_task(self._play())
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._told, number, playing)
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
        self._tell()
        if self._somebody:
            print(f"error: stopped: {_danger(self._somebody)}", file=sys.stderr)
            return EXIT_FAILED
        return EXIT_DONE if self._signal is None else 128 + self._signal

    async def _play(self) -> None:
        await self._player.play(self._part)
        while self._args.loop:
            self._player.clear()
            await self._player.play(self._part)

    def _told(self, number: signal.Signals, playing: asyncio.Task[None]) -> None:
        self._signal = self._signal or number
        playing.cancel()

    async def _watch(self, fleets: list[str], playing: asyncio.Task[None]) -> None:
        """Stop when somebody alive comes into the fleet; show how far it is."""
        while True:
            await asyncio.sleep(LOOK)
            if not self._args.force and (there := await _somebody(self._bus, fleets, self._player)):
                self._somebody = there
                playing.cancel()
                return
            if sys.stderr.isatty():
                figures = self._player.figures
                told = f"{figures.at:.0f} of {self._player.recording.seconds:.0f} s  {figures.said} messages"
                print(f"\r\x1b[K{told}", end="", file=sys.stderr, flush=True)

    def _tell(self) -> None:
        figures = self._player.figures
        if sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
        left = f", {figures.left_out} left out (they were answers to questions)" if figures.left_out else ""
        with suppress(OSError):
            print(f"replayed {figures.at:.1f} s: {figures.said} messages{left}")
        if figures.not_ours:
            told = "under keys that are none of a recorded fleet's, and were not said: they could reach somebody alive"
            print(f"warning: {figures.not_ours} messages stand {told}", file=sys.stderr)
        if figures.unreadable:
            print(f"warning: {figures.unreadable} messages cannot be read, and were not said", file=sys.stderr)
        if figures.behind > LATE:
            print(
                f"warning: up to {figures.behind:.1f} s late: this machine is too slow for the speed", file=sys.stderr
            )
