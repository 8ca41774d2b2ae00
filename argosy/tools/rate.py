"""`argosy hz`: rate, jitter and bandwidth of each key."""

from __future__ import annotations

import asyncio
import sys
from argparse import ArgumentParser, Namespace
from collections import deque
from collections.abc import Iterable
from itertools import pairwise
from statistics import pstdev

from argosy.cli.arguments import duration
from argosy.cli.operator_bus import Where, add_fleet_arguments, note, on_the_bus, put_out, unreached
from argosy.tools.bus_tap import QUIET, BusTap, add_key_argument, key_expressions, note_who_is_there
from commd.bus.bus import Bus
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.humanize import columns, shortened

WINDOW = 5.0
"""Default window in wall seconds."""
MOST_KEYS = 5_000
"""Measured keys; a further one replaces a silent one, or is only counted."""
MOST_SAMPLES = 10_000
"""Samples of one key in a window; the oldest are left out."""
TABLE_EVERY = 1.0
"""Wall seconds between two tables on a terminal."""
HEAD = ("key", "Hz", "min ms", "max ms", "jitter ms", "B/s", "n", "last s ago")


class Rates:
    """Samples of each key within a window (seconds), and the last one of silent keys."""

    def __init__(self, window: float) -> None:
        self.left_out = 0
        """Samples on keys beyond `MOST_KEYS`."""
        self._window = window
        self._keys: dict[str, deque[tuple[float, int]]] = {}
        """Arrival and bytes of samples; keys in order of their last sample."""

    def add(self, key: str, at: float, size: int) -> None:
        """Add a sample of `size` bytes, received `at` this second of the event loop's clock."""
        known = self._keys.pop(key, None)
        if known is None:
            if len(self._keys) >= MOST_KEYS and not self._make_room(at):
                self.left_out += 1
                return
            known = deque(maxlen=MOST_SAMPLES)
        known.append((at, size))
        self._keys[key] = known

    def _make_room(self, now: float) -> bool:
        """Remove the key that was silent for longest, if it is silent for a window."""
        silent = next(iter(self._keys))
        if self._keys[silent][-1][0] >= now - self._window:
            return False
        del self._keys[silent]
        return True

    def rows(self, now: float, since: float) -> list[tuple[str, ...]]:
        """Return the figures of each key in the window that ends at `now`.

        `since`: when listening began (both in seconds).
        """
        span = min(self._window, max(now - since, 1e-9))
        rows = []
        for key, known in sorted(self._keys.items()):
            while len(known) > 1 and known[0][0] < now - self._window:
                known.popleft()
            lately = [(at, size) for at, size in known if at >= now - self._window]  # the last one is kept
            times, size = [at for at, _ in lately], sum(size for _, size in lately)
            rows.append((shortened(key), *figures(times, size, span), f"{max(0.0, now - known[-1][0]):.1f}"))
        return rows

    def silent(self, now: float) -> bool:
        """Whether no key has a sample in the window that ends at `now`, in seconds."""
        return all(known[-1][0] < now - self._window for known in self._keys.values())


def figures(times: list[float], size: int, span: float) -> tuple[str, ...]:
    """Return rate in Hz, shortest and longest interval and their standard deviation in ms, bytes/s, and the count.

    `times`: arrivals in seconds; `size`: bytes of all of them. Rate and bytes/s are over the whole `span`, in seconds.
    """
    gaps = [later - earlier for earlier, later in pairwise(times)]
    rate, many = f"{len(times) / span:.2f}", (f"{size / span:.0f}", str(len(times)))
    if not gaps:
        return rate, "-", "-", "-", *many
    return rate, *(f"{1000 * one:.1f}" for one in (min(gaps), max(gaps), pstdev(gaps))), *many


def table(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Return rows in columns, figures flush right."""
    return columns([HEAD, *rows], right=range(1, len(HEAD)))


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy hz`."""
    add_key_argument(parser)
    help_ = f"measure over this wall time, 100ms to 1h (default {WINDOW:g}s)"
    window = duration(lambda seconds: 0.1 <= seconds <= 3600, "100ms to 1h")
    parser.add_argument("--window", type=window, default=WINDOW, metavar="DURATION", help=help_)
    parser.add_argument("--once", action="store_true", help="print once, after one window, and end")
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")


def run(args: Namespace) -> int:
    """Print figures until ctrl-C; with `--once` return 1 if nothing was received."""

    async def measure(bus: Bus, where: Where) -> int:
        tap, rates = BusTap(bus, key_expressions(args.key, where.fleet)), Rates(args.window)
        loop = asyncio.get_running_loop()
        missing = asyncio.create_task(unreached(bus))
        redraw = sys.stdout.isatty() and not args.once
        every = TABLE_EVERY if redraw else args.window
        began, heard, noticed, reported = loop.time(), False, False, False
        while True:
            until = loop.time() + every
            async for sample in tap.samples(until):
                rates.add(sample.key, sample.arrived, len(sample.payload))
            if missing.done() and not reported and not redraw:
                reported = True
                for board in missing.result():
                    note(board)
            rows = rates.rows(loop.time(), began)
            heard = heard or bool(rows)
            if not heard and not noticed and (args.once or loop.time() - began >= QUIET):
                noticed = True
                await note_who_is_there(bus, where, args.key, round(loop.time() - began, 1))
            lines = table(rows) if rows else []
            if rows and rates.silent(loop.time()):
                lines.append(f"nothing was published in the last {args.window:g} s")
            if tap.dropped or rates.left_out:
                lines.append(f"{tap.dropped + rates.left_out} records were left out: more is published than is counted")
            if lines and redraw and missing.done():
                lines += missing.result()
            if lines and not put_out(
                "\n".join((["\x1b[H\x1b[J"] if redraw else []) + lines + ([] if args.once else [""]))
            ):
                return EXIT_DONE
            if args.once:
                for board in [] if reported else await missing:
                    note(board)
                return EXIT_DONE if heard else EXIT_FAILED

    return on_the_bus(args, measure)
