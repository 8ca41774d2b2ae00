"""`argosy status`: the daemons of a fleet, how they are, and which are missing."""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from argosy.cli.operator_bus import ANY, Where, add_mission_argument, add_router_argument, note_unreached, on_the_bus
from argosy.fleet_model.fleet_status import FleetStatus, Row
from commd.bus.bus import Bus
from commd.process.command_line import finite_number
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.humanize import json_lines, printable
from schemas.liveness import SILENT_AFTER

TABLE_COLUMNS = 80
"""Of a terminal for the table."""
WATCH_EVERY = 1.0
"""Wall seconds between two updates of `--watch`."""
ANY_FLEET = "any"
"""Name for all fleets on the router."""


def add_mission_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments for the fleet and its router."""
    add_mission_argument(parser, "mission file: expected daemons, and the router")
    parser.add_argument("--fleet", metavar="NAME", help="without a mission: only this fleet (default: all)")
    add_router_argument(parser, "the mission's")


_seconds = finite_number(lambda value: value >= 0, "wall seconds, 0 or more")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy status`."""
    add_mission_arguments(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="as JSON")
    form.add_argument("--plain", action="store_true", help="one line for each daemon, as in a pipe")
    parser.add_argument("--watch", action="store_true", help="update until ctrl-C; in a pipe: print changes")
    help_ = f"wall seconds to wait for health (default {SILENT_AFTER + 0.5:g})"
    parser.add_argument("--wait", type=_seconds, default=SILENT_AFTER + 0.5, metavar="S", help=help_)


def run(args: Namespace) -> int:
    """Print the status. Returns 0 if every expected daemon is up, 1 if not."""

    async def ask(bus: Bus, where: Where) -> int:
        fleet_status = FleetStatus.of_bus(bus, where.fleet, where.mission)
        await fleet_status.settle(args.wait)
        fleet = where.fleet if where.fleet != ANY else ANY_FLEET
        if args.watch:
            return await _watch(fleet_status, bus, fleet, args)
        rows = fleet_status.rows()
        _view(fleet, args)(rows)
        await note_unreached(bus)
        return EXIT_DONE if well(rows) else EXIT_FAILED

    return on_the_bus(args, ask)


def well(rows: list[Row]) -> bool:
    """Whether there are daemons, and all are well."""
    return bool(rows) and all(row.well for row in rows)


def _view(fleet: str, args: Namespace) -> Callable[[list[Row]], None]:
    """Return a function that prints the rows: as a table on a terminal, as lines in a pipe, or as JSON."""
    if args.json:
        return lambda rows: print(json_lines(to_json(fleet, rows, well(rows))))
    if _in_lines(args):
        return lambda rows: print("\n".join([*map(status_line, rows), summary(fleet, rows)]))
    from rich.console import Console

    from argosy.status.table import table

    return lambda rows: Console().print(table(summary(fleet, rows), rows))


def _in_lines(args: Namespace) -> bool:
    """Return whether a table is not wanted, or its names and standings would be cut off."""
    return args.plain or not sys.stdout.isatty() or shutil.get_terminal_size().columns < TABLE_COLUMNS


async def _watch(fleet_status: FleetStatus, bus: Bus, fleet: str, args: Namespace) -> int:
    """Show the status until ctrl-C."""
    if args.json or _in_lines(args):
        return await _tell_changes(fleet_status, fleet, args)
    from rich.console import Console
    from rich.live import Live

    from argosy.status.table import table

    with Live(console=Console(), screen=True, auto_refresh=False) as live:
        while True:
            rows = fleet_status.rows()
            live.update(table(summary(fleet, rows), rows, away=not bus.router_up), refresh=True)
            await asyncio.sleep(WATCH_EVERY)


async def _tell_changes(fleet_status: FleetStatus, fleet: str, args: Namespace) -> int:
    """Print changes with the time: presence and warnings as lines, or everything as one line of JSON."""
    known: dict[tuple[str, str], object] = {}
    while True:
        rows = fleet_status.rows()
        now = time.strftime("%H:%M:%S")
        if args.json:
            print(json_lines(to_json(fleet, rows, well(rows)), indent=None), flush=True)
        else:
            current: dict[tuple[str, str], object] = {(row.title, row.daemon): _what_matters(row) for row in rows}
            for row in rows:
                if known.get((row.title, row.daemon)) != current[row.title, row.daemon]:
                    print(now, status_line(row), flush=True)
            for name, daemon in known.keys() - current.keys():
                print(now, printable(f"gone {daemon} {name}"), flush=True)
            known = current
        await asyncio.sleep(WATCH_EVERY)


def _what_matters(row: Row) -> object:
    """Return the part of a row whose change is printed."""
    life = None if row.health is None else (row.health.header.boot, row.health.errors)
    return row.standing, [note.identity for note in row.notes], life


def status_line(row: Row) -> str:
    """Return a daemon in one line: presence, daemon, name, then its health as `key=value`."""
    fields: dict[str, object] = {"board": row.board}
    if (health := row.now) is not None:
        fields |= {
            "version": health.version,
            "uptime": f"{health.uptime:.0f}",
            "age": f"{row.age:.1f}",
            "lag": f"{health.lag:.3f}",
            "drops": health.drops,
            "bad_input": health.bad_input,
            "restarts": "" if health.restarts is None else health.restarts,
            "errors": health.errors,
            "last_error": _quoted(health.last_error),
        }
        if health.paused:
            fields["paused"] = "yes"
    if not row.in_mission:
        fields["in_mission"] = "no"
    words = " ".join(f"{name}={value}" for name, value in fields.items() if value != "")
    notes = "".join(f" note={_quoted(note.text)}" for note in row.notes)
    return printable(f"{row.standing} {row.daemon} {row.title} {words}{notes}".rstrip())


def summary(fleet: str, rows: Sequence[Row]) -> str:
    """Return in one status_line whether all is well."""
    ill = [row for row in rows if not row.well]
    whose = f"fleet {fleet}" if fleet != ANY_FLEET else "all fleets"
    there = f"{whose}: {len(rows) - len(ill)} of {len(rows)} daemons are up"
    if not rows:
        return f"{whose}: no daemon is running"
    if not ill:
        return there if fleet != ANY_FLEET else f"{there}; `argosy status MISSION` also shows which are missing"
    standings = dict.fromkeys(row.standing for row in ill)
    kinds = (f"{one}: {', '.join(f'{r.daemon} {r.title}' for r in ill if r.standing == one)}" for one in standings)
    return printable(f"{there}; {'; '.join(kinds)}")


def to_json(fleet: str, rows: Sequence[Row], well: bool) -> dict[str, Any]:
    """Return the status as a JSON object."""
    return {"fleet": fleet, "well": well, "daemons": [_row_to_json(row) for row in rows]}


def _row_to_json(row: Row) -> dict[str, Any]:
    fields: dict[str, Any] = {
        **({"fleet": row.fleet} if row.fleet else {}),
        "name": row.name,
        "daemon": row.daemon,
        "board": row.board,
        "standing": row.standing,
        "well": row.well,
        "in_mission": row.in_mission,
        "notes": msgspec.to_builtins(row.notes),
    }
    if row.now is not None:
        health = row.now
        names = ("version", "pid", "uptime", "cpu", "lag", "drops", "bad_input", "restarts", "errors")
        fields |= {name: getattr(health, name) for name in (*names, "last_error", "last_error_age", "counters")}
        if row.daemon == "bridged":
            fields |= {"paused": health.paused, "ordered": health.ordered}
        fields["age"] = None if row.age is None else round(row.age, 1)
    return fields


def _quoted(text: str) -> str:
    return json.dumps(printable(text), ensure_ascii=False) if text else ""
