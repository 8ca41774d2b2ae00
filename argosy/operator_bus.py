"""The operator's way onto the bus from any terminal: which fleet, which router, and what if nobody is there."""

from __future__ import annotations

import asyncio
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

from argosy.endpoint import endpoint
from commd.bus import Bus, BusClosed, open_bus
from commd.process import EXIT_BAD_INPUT, EXIT_FAILED
from schemas import keys
from schemas.findings import Findings
from schemas.mission import DEFAULT_ROUTER, load_mission

ROUTER_PATIENCE = 3.0
"""Wall seconds to reach the router."""
ANY = "*"
"""Every fleet on the router."""


class Unanswered(Exception):
    """Nobody has answered who should; says who is there."""


@dataclass(frozen=True)
class Where:
    """What an operator speaks to."""

    fleet: str
    """A fleet, or `ANY`."""
    router: str


def add_fleet_arguments(parser: ArgumentParser, without: str) -> None:
    """Declare `--mission`, `--fleet` and `--router`; `without` is the help of `--fleet`, with its default."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--mission", metavar="FILE", help="take fleet and router from this mission")
    which.add_argument("--fleet", metavar="NAME", help=without)
    add_router_argument(parser, DEFAULT_ROUTER)


def add_router_argument(parser: ArgumentParser, default: str) -> None:
    """Declare `--router`."""
    text = f"the router's endpoint (default: {default})"
    parser.add_argument("--router", type=endpoint, metavar="ENDPOINT", help=text)


def where(args: Namespace) -> Where:
    """Return the fleet and the router that the arguments name. Raises Findings for a mission that cannot be read."""
    if args.mission:
        mission = load_mission(args.mission)
        return Where(mission.fleet, args.router or mission.router.endpoint)
    return Where(args.fleet or ANY, args.router or DEFAULT_ROUTER)


@asynccontextmanager
async def operator_bus(place: Where) -> AsyncIterator[Bus]:
    """Open the bus as the operator. Raises BusClosed if the router does not answer soon."""
    fleet = place.fleet if place.fleet != ANY else "operator"
    async with open_bus(
        place.router, fleet=fleet, name="operator", daemon="argosy", stamp=time.time_ns, patience=ROUTER_PATIENCE
    ) as bus:
        yield bus


def on_the_bus(args: Namespace, work: Callable[[Bus, Where], Awaitable[int]]) -> int:
    """Do an operator's work on the bus that the arguments name. Returns its exit code, or tells why it cannot be."""
    try:
        place = where(args)
    except Findings as findings:
        print(findings, file=sys.stderr)
        return EXIT_BAD_INPUT

    async def main() -> int:
        async with operator_bus(place) as bus:
            return await work(bus, place)

    try:
        return asyncio.run(main())
    except (BusClosed, Unanswered) as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_FAILED


async def bridges(bus: Bus, fleet: str) -> list[tuple[str, str]]:
    """Return fleet and name of every robot whose bridge has a liveliness token; `ANY` means any fleet."""
    tokens = await bus.tokens(keys.alive(fleet, "*", "bridged", "*"))
    return sorted({(parsed[0], parsed[1]) for token in tokens if (parsed := keys.parse(token))})
