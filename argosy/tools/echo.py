"""`argosy echo`: print messages on the bus, one line each."""

from __future__ import annotations

import asyncio
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from typing import Any

import msgspec

from argosy.cli.arguments import count
from argosy.cli.operator_bus import Where, add_fleet_arguments, note, note_unreached, on_the_bus, put_out
from argosy.tools.bus_tap import (
    QUIET,
    ROOM,
    BusTap,
    Heard,
    add_key_argument,
    key_expressions,
    note_who_is_there,
)
from argosy.tools.record_text import line_of, plain
from commd.bus.bus import Bus
from commd.process.process import EXIT_DONE
from schemas.humanize import escaped, shortened
from schemas.wire.codec import BadRecord


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy echo`."""
    add_key_argument(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--raw", action="store_true", help="print payloads unchanged; escaped on a terminal")
    form.add_argument("--json", action="store_true", help="print a JSON object in each line")
    parser.add_argument("--count", type=count, metavar="N", help="end after N messages (default: at ctrl-C)")
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")


def run(args: Namespace) -> int:
    """Print messages until ctrl-C, or until the reader is gone."""

    async def echo(bus: Bus, where: Where) -> int:
        tap = BusTap(bus, key_expressions(args.key, where.fleet))
        raw = _raw_on_a_terminal if sys.stdout.isatty() else _raw
        show = raw if args.raw else _json if args.json else _line
        noticing = asyncio.create_task(_notice(bus, where, args.key))
        missing = asyncio.create_task(note_unreached(bus))
        asking = None if args.key is None else asyncio.create_task(tap.ask_last_known(bus, where.fleet))
        try:
            await _echo(tap, show, args.count, noticing)
            await missing
        finally:
            noticing.cancel()
            missing.cancel()
            if asking is not None:
                asking.cancel()
            if tap.dropped:
                note(f"{tap.dropped} records were left out: more was published than could be shown")
        return EXIT_DONE

    return on_the_bus(args, echo)


async def _echo(tap: BusTap, show: Callable[[Heard], str], count: int | None, noticing: asyncio.Task[None]) -> None:
    shown, changed = 0, set[str]()
    async for heard in tap.samples():
        noticing.cancel()
        if heard.last_known and heard.key in changed:  # it has changed since the query
            continue
        if not heard.last_known and len(changed) < ROOM:
            changed.add(heard.key)
        if not put_out(show(heard)):
            return
        shown += 1
        if shown == count:
            return


async def _notice(bus: Bus, where: Where, text: str | None) -> None:
    """Print who is on the bus if nothing is received."""
    await asyncio.sleep(QUIET)
    await note_who_is_there(bus, where, text)


def _line(heard: Heard) -> str:
    at = time.strftime("%H:%M:%S", time.localtime(heard.at)) + f".{int(heard.at % 1 * 1000):03}"
    content = "(deleted)" if heard.deleted else line_of(heard.key, heard.payload, heard.encoding)
    return f"{at} {shortened(heard.key)}  {content}{'  (last known)' if heard.last_known else ''}"


def _raw_on_a_terminal(heard: Heard) -> str:
    return escaped(_raw(heard))


def _raw(heard: Heard) -> str:
    return f"{heard.key} {heard.payload.decode(errors='backslashreplace')}"


def _json(heard: Heard) -> str:
    """Return one line of JSON; a payload that JSON cannot express is text in it."""
    line: dict[str, Any] = {"key": heard.key, "encoding": heard.encoding, "at": round(heard.at, 6)}
    if heard.last_known:
        line["last_known"] = True
    try:
        line["record"] = None if heard.deleted else plain(heard.payload, heard.encoding)
        return escaped(msgspec.json.encode(line).decode())
    except (BadRecord, TypeError, ValueError, RecursionError):
        line.pop("record", None)
        line["text"] = heard.payload.decode(errors="backslashreplace")
        return escaped(msgspec.json.encode(line).decode())
