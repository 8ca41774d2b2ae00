"""`argosy list`: names on the bus, the queries each serves by the table of channels, and the keys that are put."""

from __future__ import annotations

import asyncio
import re
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field

from argosy.cli.arguments import duration
from argosy.cli.errors import complain
from argosy.cli.operator_bus import (
    Where,
    add_fleet_arguments,
    names_there,
    note,
    note_unreached,
    on_the_bus,
    put_out,
)
from argosy.tools.bus_tap import BusTap, published_keys
from argosy.tools.record_text import candidates
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.humanize import printable
from schemas.manifest.loader import ActionDescription
from schemas.wire import keys
from schemas.wire.keys import ROOT, Channel
from schemas.wire.records import Perception

WAIT = 2.5
"""Default wall seconds of listening: health is put once a second."""
ASK = 2.0
"""Wall seconds for bridges to answer."""
MOST = 20_000
"""Listed keys; messages on further ones are only counted."""
_CHUNK = re.compile(r"\{\w+\}")
"""A variable chunk of a key in the table."""
NOUNS = {"agentd": "agent", "client": "client", "bridged": "robot", "commd": "board"}


@dataclass
class Name:
    """Keys and records of one name: an agent, robot, board or client."""

    daemons: set[str] = field(default_factory=set)
    acts: set[str] = field(default_factory=set)
    """Actions of its robot."""
    perceives: bool = False
    """Whether a bridge answers with its percepts."""
    records: dict[str, list[int]] = field(default_factory=dict)
    """Keys below the name: count of messages, and bytes of the last one."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy list`."""
    parser.add_argument("--types", action="store_true", help="also print the record types")
    help_, wait = f"wall time to listen (default {WAIT:g}s)", duration(lambda seconds: seconds > 0, "more than 0 s")
    parser.add_argument("--wait", type=wait, default=WAIT, metavar="DURATION", help=help_)
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")


def run(args: Namespace) -> int:
    """Print the list. Returns 1 if it is empty."""

    async def look(bus: Bus, where: Where) -> int:
        names, left_out = await look_around(bus, where.fleet, args.wait)
        for (fleet, name), found in sorted(names.items()):
            for line in lines_of(fleet, name, found, args.wait, args.types):
                if not put_out(printable(line)):
                    return EXIT_DONE
        await note_unreached(bus)
        if left_out:
            note(f"{left_out} records were left out: more is published than is listed")
        if not names:
            complain(f"error: no daemon of {where.whose} is on the bus at {where.router}")
        return EXIT_DONE if names else EXIT_FAILED

    return on_the_bus(args, look)


async def look_around(bus: Bus, fleet: str, seconds: float) -> tuple[dict[tuple[str, str], Name], int]:
    """Listen for `seconds` of wall time, and query. Returns the names, and the number of records left out."""
    names: dict[tuple[str, str], Name] = {}
    tap, known, left_out = BusTap(bus, published_keys(fleet)), 0, 0
    until = asyncio.get_running_loop().time() + seconds

    async def listen() -> None:
        nonlocal known, left_out
        async for heard in tap.samples(until):
            if (parsed := keys.parse(heard.key)) is None:
                continue
            records, rest = names.setdefault(parsed[:2], Name()).records, "/".join(parsed[2])
            if rest not in records and known >= MOST:
                left_out += 1
                continue
            known += rest not in records
            records[rest] = [records.get(rest, [0])[0] + 1, len(heard.payload)]

    async def ask() -> None:
        for at, daemons in (await names_there(bus, fleet)).items():
            names.setdefault(at, Name()).daemons |= daemons

        def acts(key: str, action: ActionDescription) -> None:
            if (parsed := keys.parse(key)) is not None:
                names.setdefault(parsed[:2], Name()).acts.add(action.name)

        def perceives(key: str, _: Perception) -> None:
            if (parsed := keys.parse(key)) is not None:
                names.setdefault(parsed[:2], Name()).perceives = True

        with suppress(BusClosed):  # show what was received
            await bus.ask_all(keys.action(fleet, "*", "*"), ActionDescription, ASK, acts)
            await bus.ask_all(keys.percept(fleet, "*", "**"), Perception, ASK, perceives)

    await asyncio.gather(listen(), ask())
    return names, left_out + tap.dropped


def lines_of(fleet: str, name: str, found: Name, seconds: float, types: bool) -> Iterator[str]:
    """Yield the lines of one name, heard for `seconds`: its kind, the queries it serves, the keys it puts."""
    nouns = [noun for daemon, noun in NOUNS.items() if daemon in found.daemons]
    at = f"{ROOT}/{fleet}/{name}"
    yield f"{at}  {', '.join(nouns) or ', '.join(sorted(found.daemons)) or 'no token'}"
    for channel in keys.CHANNELS:
        if channel.kind == "query" and _serves(channel, found):
            rest = _CHUNK.sub("*", channel.key.partition("/")[2])
            acts = [f"action/{action}" for action in sorted(found.acts)] if rest == "action/*" else []
            for served in acts or [rest]:
                yield f"  query  {at}/{served}{_types(channel, types)}"
    if "agentd" in found.daemons:
        for part in ("inputs", "decisions", "activity"):
            key = f"{at}/trace/{part}"
            yield f"  put    {key}{_record(key) if types else ''}  while there are subscribers"
    for rest, (count, size) in sorted(found.records.items()):
        key = f"{at}/{rest}"
        yield f"  put    {key}{_record(key) if types else ''}  {count / seconds:.1f} Hz, {size} B"


def _record(key: str) -> str:
    found = candidates(key)
    return f"  {found[0].__name__}" if found else ""


def _serves(channel: Channel, found: Name) -> bool:
    """Whether a running daemon serves this channel under this name, by the table."""
    named, acts = channel.key.partition("/")[0], bool(found.acts) or found.perceives
    match channel.source:
        case "bridged":
            return "bridged" in found.daemons if named == "{robot}" else acts
        case "agentd":
            return (
                bool({"agentd", "client"} & found.daemons)
                if channel.key == "{agent}/inbox"
                else "agentd" in found.daemons
            )
    if named == "{board}":
        return "commd" in found.daemons
    return bool({"agentd", "client"} & found.daemons)  # commd serves it for the names of its board


def _types(channel: Channel, types: bool) -> str:
    if not types:
        return ""
    carries = channel.carries.__name__ if channel.carries is not None else "nothing"
    return f"  {carries} -> {channel.answers.__name__ if channel.answers is not None else 'nothing'}"
