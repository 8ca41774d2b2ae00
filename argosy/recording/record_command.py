"""`argosy record`: record everything that is published in a fleet into a file."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import signal
import sys
import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NoReturn

from argosy.cli.arguments import duration
from argosy.cli.errors import BadInput, progress
from argosy.cli.fleet_bus import FleetBus
from argosy.cli.operator_bus import ANY, Where, add_fleet_arguments, note_unreached, on_the_bus
from argosy.cli.vehicle_requests import check_new
from argosy.recording.backfill import Backfill
from argosy.recording.metadata import Facts
from argosy.recording.recorder import NOTES, Limits, Recorder
from argosy.recording.records import wanted_keys
from argosy.recording.write_queue import WriteQueue
from argosy.recording.writer import COMPRESSIONS
from commd.bus.bus import Bus
from commd.process.command_line import mission_speed
from commd.process.output import ERROR, NOTICE, flush, stderr, stdout
from commd.process.process import EXIT_DONE, EXIT_FAILED, on_end_signals
from schemas.humanize import count, size
from schemas.mission.model import Mission, load_mission
from schemas.version import RELEASE
from schemas.wire import keys
from schemas.wire.log_lines import RecordingEnded, RecordingStarted

ENDS = {
    signal.SIGINT: "ctrl-C",
    signal.SIGTERM: "SIGTERM",
    signal.SIGHUP: "the terminal was closed (SIGHUP)",
}
"""Signals that end a recording, and the reason they give."""
NOBODY = 5.0
"""Wall seconds of silence before a note that no daemon is running."""
DISK, HURRY = 60.0, 3.0
"""Wall seconds for writing what is queued at the end; and after a second signal."""
REFRESH = 1.0
"""Wall seconds between two status lines on a terminal."""
LAST_LOOK = 5.0
"""Wall seconds for fetching missing inputs at the end."""
SMALLEST = 1_000_000
"""Smallest size limit of a file, in bytes."""
_UNITS = {"": 1, "b": 1, "kb": 1_000, "mb": 1_000_000, "gb": 1_000_000_000, "tb": 1_000_000_000_000}
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([A-Za-z]*)")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy record`."""
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="file to write (default: FLEET-DATE-TIME.mcap)"
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="KEYEXPR",
        help="record only these keys, such as `uav1/**`; repeatable",
    )
    parser.add_argument(
        "--max-size",
        type=_size,
        default=Limits.size,
        metavar="SIZE",
        help="size limit of a file, such as 500MB (default 2GB)",
    )
    parser.add_argument(
        "--max-time",
        type=duration(lambda seconds: seconds > 0, "more than 0 s"),
        metavar="TIME",
        help="time limit of a file in wall time, such as 1h (default: none)",
    )
    parser.add_argument(
        "--split", action="store_true", help="continue in FILE-0002.mcap when a file is full, instead of ending"
    )
    parser.add_argument(
        "--compression", choices=list(COMPRESSIONS), default="lz4", help="compression of the file (default lz4)"
    )
    parser.add_argument(
        "--speed",
        type=mission_speed,
        metavar="X",
        help="mission seconds per wall second, to be stored in the file (default: the mission's)",
    )
    parser.add_argument(
        "--note", action="append", default=[], metavar="NAME=TEXT", help="a note to store in the file; repeatable"
    )


def run(args: Namespace) -> int:
    """Record until ctrl-C, SIGTERM or a limit. Returns 0 if the file is complete, 1 if writing failed."""
    logging.basicConfig(format="note: %(message)s", level=logging.WARNING, force=True)
    notes = dict(note.partition("=")[::2] for note in args.note)
    mission = load_mission(args.mission) if args.mission else None
    fleet = mission.fleet if mission is not None else args.fleet or ANY
    only = wanted_keys(fleet, args.only)
    path = args.output or Path(f"{fleet if fleet != ANY else 'argosy'}-{time.strftime('%Y%m%d-%H%M%S')}.mcap")
    check_new(path, args.force)

    async def record(bus: Bus, where: Where) -> int:
        write_queue = WriteQueue()
        facts = _facts(write_queue.now(), fleet, mission, only, notes, args.speed)
        limits = Limits(args.max_size, args.max_time, args.split)
        several = isinstance(bus, FleetBus)
        try:
            recorder = Recorder(
                path, facts, limits, write_queue, compression=args.compression, overwrite=args.force, several=several
            )
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror}") from None
        return await _Recording(bus, recorder, Backfill(bus, fleet, write_queue, recorder.minds, only)).run(fleet, only)

    try:
        return on_the_bus(args, record)
    finally:
        flush()


def _facts(
    now: int, fleet: str, mission: Mission | None, only: list[str], notes: dict[str, str], speed: float | None
) -> Facts:
    name = file = text = ""
    if mission is not None:
        name, file, text = mission.name, mission.path.name, mission.text
        speed = mission.speed if speed is None else speed
    return Facts(
        recording=os.urandom(8).hex(),
        fleet=fleet,
        started=now,
        version=RELEASE,
        mission=name,
        mission_file=file,
        mission_text=text,
        only=tuple(only),
        speed=1.0 if speed is None else speed,
        notes=notes,
    )


def hear(bus: Bus, fleet: str, only: Sequence[str], write_queue: WriteQueue) -> None:
    """Subscribe to the keys, at each board where the bus has several sessions."""
    everything = f"{keys.ROOT}/**" if fleet == "*" else f"{keys.ROOT}/{fleet}/**"
    for key in only or (everything,):
        if isinstance(bus, FleetBus):
            bus.boards.at_each(lambda board, one, key=key: one.raw.tap(key, write_queue.sample))  # type: ignore[misc]
        else:
            bus.raw.tap(key, write_queue.sample)


class _Recording:
    """One recording under way."""

    def __init__(self, bus: Bus, recorder: Recorder, backfill: Backfill) -> None:
        self._bus, self._recorder, self._backfill = bus, recorder, backfill
        self._ended, self._stopping, self._again = asyncio.Event(), asyncio.Event(), asyncio.Event()
        self._why = ""
        self._router_lost = False

    async def run(self, fleet: str, only: list[str]) -> int:
        """Record to the end. Returns the exit code."""
        loop, recorder = asyncio.get_running_loop(), self._recorder
        on_end_signals(lambda number: self._stop(ENDS[number]), *ENDS)
        recorder.start(partial(loop.call_soon_threadsafe, self._ended.set))
        hear(self._bus, fleet, only, recorder.write_queue)
        self._backfill.start()
        self._bus.on_router(self._router)
        stdout().write(f"recording {recorder.path}", NOTICE, event=RecordingStarted())
        await note_unreached(self._bus)
        nobody = asyncio.create_task(self._print_if_nobody_is_there(fleet))
        showing = asyncio.create_task(show_status(recorder))
        await self._until_it_ends()
        showing.cancel()
        await asyncio.gather(showing, return_exceptions=True)
        nobody.cancel()
        await self._backfill.close()
        return self._finish()

    async def _until_it_ends(self) -> None:
        stopping, ended = asyncio.create_task(self._stopping.wait()), asyncio.create_task(self._ended.wait())
        await asyncio.wait((stopping, ended), return_when=asyncio.FIRST_COMPLETED)
        stopping.cancel()
        if not self._ended.is_set() and self._bus.router_up:
            with suppress(TimeoutError):
                async with asyncio.timeout(LAST_LOOK):
                    await self._backfill.last_look()
        self._recorder.stop(self._why)
        again = asyncio.create_task(self._again.wait())
        await asyncio.wait((ended, again), timeout=DISK, return_when=asyncio.FIRST_COMPLETED)
        again.cancel()
        await asyncio.wait((ended,), timeout=HURRY)
        if not self._ended.is_set():
            self._leave()

    def _leave(self) -> NoReturn:
        """End the process while the recorder's thread blocks on the disk: nothing else ends it."""
        problem = f"{self._recorder.path.parent.absolute()} does not accept writes: the last messages are lost"
        stderr().write(f"error: {problem}; the file can be read up to there", ERROR)
        flush()
        os._exit(EXIT_FAILED)

    def _finish(self) -> int:
        held = content(self._recorder)
        stdout().write(f"{held}; ended: {self._recorder.why}", NOTICE, event=RecordingEnded(text=held))
        for line in warnings(self._recorder):
            stdout().write(line, NOTICE)
        if self._recorder.problem:
            stderr().write(f"error: {self._recorder.problem}; the file can be read up to there", ERROR)
            return EXIT_FAILED
        return EXIT_DONE

    def _stop(self, why: str) -> None:
        self._why = self._why or why
        if self._stopping.is_set():
            self._again.set()
        self._stopping.set()

    def _router(self, up: bool) -> None:
        if up and self._router_lost:
            self._recorder.note("router", "the router is back")
            self._backfill.look_again()
        elif not up:
            self._recorder.note("router", "the router is lost: nothing is received")
        self._router_lost = not up

    async def _print_if_nobody_is_there(self, fleet: str) -> None:
        await asyncio.sleep(NOBODY)
        if not self._backfill.tokens and not self._recorder.messages:
            who = f"no daemon of fleet `{fleet}`" if fleet != ANY else "no daemon"
            print(f"note: {who} is on {self._bus.endpoint} yet; recording starts when one appears", file=sys.stderr)


def _size(text: str) -> int:
    """Return the bytes of `2GB`, `500MB` or a number of bytes. Raises ArgumentTypeError."""
    found = _SIZE.fullmatch(text.strip())
    if found is None or found[2].lower() not in _UNITS:
        raise ArgumentTypeError(f"expected a size such as `2GB` or `500MB`, got `{text}`")
    read = int(float(found[1]) * _UNITS[found[2].lower()])
    if read < SMALLEST:
        raise ArgumentTypeError(f"expected 1MB at least, got `{text}`")
    return read


async def show_status(recorder: Recorder) -> None:
    """Redraw one line of figures on a terminal until cancelled; do nothing where there is no terminal."""
    before, rate = 0, 0.0
    try:
        while progress(
            f"{recorder.seconds:.0f} s  {rate:.0f} messages/s  {size(recorder.size)}  {recorder.dropped} dropped"
        ):
            before = recorder.messages
            await asyncio.sleep(REFRESH)
            rate = (recorder.messages - before) / REFRESH
    finally:
        progress("")


def content(recorder: Recorder) -> str:
    """Return the files and how much was recorded, as text."""
    many = f"{count(recorder.messages, 'message')} in {recorder.seconds:.1f} s"
    files = str(recorder.path) if len(recorder.files) == 1 else f"{recorder.path} and {len(recorder.files) - 1} more"
    return f"{files}: {many}, {size(recorder.size)}"


def warnings(recorder: Recorder) -> list[str]:
    """Return a line for each loss or oddity of a recording."""
    lines = []
    if recorder.dropped:
        lines.append(f"warning: {recorder.dropped} messages did not fit and are missing")
    if recorder.writer.unread:
        lines.append(f"note: {recorder.writer.unread} messages are neither JSON nor MessagePack and are kept as bytes")
    if recorder.filter.wild:
        lines.append(f"warning: {recorder.filter.wild} messages, put on key expressions (`*`), are under {NOTES}")
    return lines + [f"warning: {gap}" for gap in [*recorder.minds.gaps(), *recorder.minds.cut_short()]]
