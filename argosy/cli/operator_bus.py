"""Operator commands on the bus: which fleet and router, the session, and output that survives a closed pipe."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from argparse import SUPPRESS, Action, ArgumentError, ArgumentParser, Namespace
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable
from contextlib import aclosing, asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from argosy.cli.arguments import name
from argosy.cli.errors import BadInput, CommandError, complain
from argosy.cli.fleet_bus import FleetBus, open_fleet_bus
from argosy.cli.port_check import endpoint
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import BusClosed
from commd.bus.tls import Tls, identity_of
from commd.process.local_runs import router_of
from commd.process.process import EXIT_DONE, tls_of
from schemas.files.findings import Findings, did_you_mean
from schemas.humanize import joined
from schemas.liveness import ACTION_SILENT
from schemas.mission.model import DEFAULT_ROUTER, Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import Record

T = TypeVar("T", bound=Record)

ROUTER_PATIENCE = 3.0
"""Wall seconds to reach the router."""
ANY = "*"
"""Every fleet on the router."""


class Unanswered(CommandError):
    """A query has no answer; the text says who is running."""


@dataclass(frozen=True)
class Where:
    """The fleet and router that a command works on."""

    fleet: str
    """A fleet, or `ANY`."""
    router: str
    tls: Tls | None = None
    """This machine's keys."""
    mission: Mission | None = None
    """The mission, if one is given."""
    boards: Mission | None = None
    """With keys: the mission, for a session with each of its boards."""

    @property
    def whose(self) -> str:
        """The fleet, as text."""
        return "any fleet" if self.fleet == ANY else f"fleet `{self.fleet}`"


def add_fleet_arguments(parser: ArgumentParser, without: str) -> None:
    """Declare `--mission`, `--fleet`, `--router` and `--keys`; `without` is the help of `--fleet`, with its default."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--mission", metavar="FILE", help="mission file, for its fleet and router")
    which.add_argument("--fleet", type=name, metavar="NAME", help=without)
    add_router_argument(parser, DEFAULT_ROUTER)


def add_mission_argument(parser: ArgumentParser, text: str) -> None:
    """Declare the mission, as the argument or as `--mission`, by which commands with other arguments take it."""
    parser.add_argument("mission", nargs="?", default=SUPPRESS, action=_OnlyMission, help=text)
    parser.add_argument("--mission", metavar="FILE", action=_OnlyMission, help="the same")


class _OnlyMission(Action):
    """Takes the mission, and refuses a second one, which might be of another fleet."""

    def __call__(self, parser: ArgumentParser, namespace: Namespace, values: Any, option: str | None = None) -> None:
        if (first := getattr(namespace, self.dest, None)) is not None:
            raise ArgumentError(self, f"{first} and {values} are two missions: name one")
        setattr(namespace, self.dest, values)


def add_router_argument(parser: ArgumentParser, default: str) -> None:
    """Declare `--router` and `--keys`."""
    text = f"Zenoh endpoint of the router (default: {default}; with --keys, the boards of the mission)"
    parser.add_argument("--router", type=endpoint, metavar="ENDPOINT", help=text)
    parser.add_argument("--keys", type=Path, metavar="FOLDER", help="keys of this machine, for a secured fleet")


def where(args: Namespace) -> Where:
    """Return the fleet and router of the arguments: the named router, that of a run on this machine, or the default.

    Raises BadInput for a mission with `--fleet`, and Findings for an invalid mission, for unusable keys, and if several
    runs on this machine match.
    """
    if args.mission and args.fleet:
        raise BadInput("--fleet: leave it out, the mission names its fleet")
    mission, tls = load_mission(args.mission) if args.mission else None, tls_of(args)
    if tls is not None and args.router and not args.router.startswith("tls/"):
        raise Findings.about("--keys", f"need an endpoint tls/HOST:PORT, got --router {args.router}")
    if tls is not None and not args.router and mission is None:
        text = "need a board: add --mission FILE or --router tls/HOST:PORT"
        raise Findings.about("--keys", text)
    if mission is not None:
        each = mission if tls is not None and not args.router else None
        if each is not None:
            router = f"the boards of {mission.path.name}"
        elif args.router or mission.names_router:
            router = args.router or mission.router.endpoint
        else:
            router = _router_here(mission.fleet)
        return Where(mission.fleet, router, tls, mission, each)
    router = args.router or (DEFAULT_ROUTER if tls is not None else _router_here(args.fleet or ""))
    return Where(args.fleet or ANY, router, tls)


def _router_here(fleet: str) -> str:
    """Return the router of a run on this machine, or the default; another one than the default is named to the user."""
    router = asyncio.run(router_of(fleet, DEFAULT_ROUTER))
    if router != DEFAULT_ROUTER:
        note(f"at {router}, by the run on this machine")
    return router


@asynccontextmanager
async def operator_bus(place: Where) -> AsyncIterator[Bus]:
    """Open the bus as the operator. Raises BusClosed if no router answers, Findings for unusable keys."""
    who = identity_of(place.tls, time.time()).name if place.tls is not None else "operator"
    if place.boards is not None and place.tls is not None:
        async with open_fleet_bus(place.boards, place.tls, ROUTER_PATIENCE, name=who, daemon="argosy") as bus:
            yield bus
        return
    async with open_bus(
        place.router,
        fleet=place.fleet if place.fleet != ANY else "operator",
        name=who,
        daemon="argosy",
        patience=ROUTER_PATIENCE,
        tls=place.tls,
    ) as bus:
        yield bus


def on_the_bus(args: Namespace, work: Callable[[Bus, Where], Awaitable[int]]) -> int:
    """Run `work` on the bus that the arguments name. Returns the exit code.

    Raises Findings for a bad mission or bad keys, and CommandError if no router answers.
    """
    place = where(args)

    async def main() -> int:
        async with operator_bus(place) as bus:
            failed: CommandError | None = None
            try:
                code = await work(bus, place)
            except CommandError as error:
                code, failed = error.code, error
            if code != EXIT_DONE and place.boards is not None and bus.name in place.boards.security.observers:
                print(f"note: `{bus.name}` is an observer in the mission: it may not give orders", file=sys.stderr)
            if code != EXIT_DONE and place.tls is None and (others := await other_fleets(bus, place.fleet)):
                there = f"there is {joined([f'fleet `{one}`' for one in others])}"
                note(f"nobody of fleet `{place.fleet}` is on the bus at {place.router}; {there}")
            if failed is not None:
                raise failed
            return code

    try:
        return asyncio.run(main())
    except BusClosed as closed:
        raise CommandError(str(closed)) from None


async def unreached(bus: Bus) -> list[str]:
    """Return a line for each board without a session."""
    missing = await bus.boards.unreached() if isinstance(bus, FleetBus) else {}
    return [f"board {board} is not reached: {why}" for board, why in missing.items()]


async def note_unreached(bus: Bus) -> None:
    """Print on stderr which boards are not reached."""
    for line in await unreached(bus):
        note(line)


async def bridges(bus: Bus, fleet: str) -> list[tuple[str, str]]:
    """Return fleet and name of every robot whose bridge has a token. `fleet` may be `ANY`."""
    return sorted(await names_there(bus, fleet, "bridged"))


async def fleet_of(bus: Bus, where: Where, robot: str) -> str:
    """Return the fleet in which a bridge serves the robot. Raises Unanswered."""
    there = await bridges(bus, where.fleet)
    fleets = [its for its, name in there if name == robot]
    if not fleets:
        known = did_you_mean(robot, {name for _, name in there}) or "; no bridge is running"
        missing = "".join(f"\n  {line}" for line in await unreached(bus))
        raise Unanswered(f"{robot}: its bridge is not on the bus at {where.router}{known}{missing}")
    if len(fleets) > 1:
        raise Unanswered(f"{robot}: it is in the fleets {', '.join(fleets)}; choose one by --fleet")
    return fleets[0]


async def names_there(bus: Bus, fleet: str, daemon: str = "*") -> dict[tuple[str, str], set[str]]:
    """Return the daemons that hold each name on the bus, by fleet and name. `fleet` may be `ANY`."""
    found: dict[tuple[str, str], set[str]] = {}
    for token in await bus.tokens(keys.alive(fleet, "*", daemon, "*")):
        if (parsed := keys.parse_alive(token)) is not None:
            found.setdefault(parsed[:2], set()).add(parsed[2])
    return found


async def other_fleets(bus: Bus, fleet: str) -> list[str]:
    """Return the fleets on the router if nobody of `fleet` is there: the mission or the router may be a wrong one."""
    there = {its for its, _ in await names_there(bus, ANY)} if fleet != ANY else set[str]()
    return [] if fleet in there else sorted(there)


def put_out(text: str) -> bool:
    """Print and flush. Returns False if the reader is gone, as after `| head`. Raises Unanswered if writing fails.

    Text from the wire must be `printable` or `escaped` already.
    """
    try:
        print(text, flush=True)
    except OSError as error:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return False
        raise Unanswered(f"the output cannot be written: {error.strerror}") from None
    return True


def note(text: str) -> None:
    """Print a note on stderr."""
    complain(f"note: {text}")


async def replies(
    bus: Bus, key: str, ask: Record | None, answer: type[T], at_most: float
) -> AsyncGenerator[T | str, None]:
    """Query what takes long, and yield its records, or the text of an error, until the replies end.

    It may take `at_most` wall seconds. Raises TimeoutError, with a text, when nothing is heard for `ACTION_SILENT`.
    """
    async with aclosing(bus.query(key, ask, answer, at_most)) as found:
        while True:
            try:
                async with asyncio.timeout(ACTION_SILENT):
                    reply = await anext(found, None)
            except TimeoutError:
                text = f"its bridge has sent nothing for {ACTION_SILENT:g} s: it hangs, or is cut off"
                raise TimeoutError(text) from None
            if reply is None:
                return
            yield reply.error if reply.record is None else reply.record
