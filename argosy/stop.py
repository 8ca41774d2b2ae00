"""`argosy stop`: an order to robots that stands above every agent, from any terminal that reaches the router."""

from __future__ import annotations

import asyncio
import sys
import time
from argparse import ArgumentParser, Namespace
from contextlib import aclosing

from argosy.endpoint import endpoint
from commd.bus import Bus, BusClosed, open_bus
from commd.process import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED
from schemas import keys
from schemas.findings import Findings
from schemas.mission import DEFAULT_ROUTER, load_mission
from schemas.records import Outcome, StopOrder

ROUTER_PATIENCE = 3.0
"""Wall seconds to reach the router."""
ANSWER_TIMEOUT = 15.0
"""Wall seconds that a bridge has to see the order confirmed by its vehicle; it gives up after 10 s itself."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy stop`."""
    orders = ("hold", "land", "rtl", "release")
    parser.add_argument(
        "order", choices=orders, metavar=f"{{{','.join(orders)}}}", help="`release` lets the agents act again"
    )
    parser.add_argument("robot", nargs="*", default=[], help="robots (default: every robot whose bridge is there)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--mission", metavar="FILE", help="take fleet and router from this mission")
    which.add_argument("--fleet", metavar="NAME", help="only this fleet (default: every fleet on the router)")
    parser.add_argument(
        "--router", type=endpoint, metavar="ENDPOINT", help=f"the router's endpoint (default: {DEFAULT_ROUTER})"
    )


def run(args: Namespace) -> int:
    """Send the order and print what became of it. Returns 0 only if every robot confirmed."""
    fleet, router = args.fleet or "*", args.router or DEFAULT_ROUTER
    if args.mission:
        try:
            mission = load_mission(args.mission)
        except Findings as findings:
            print(findings, file=sys.stderr)
            return EXIT_BAD_INPUT
        fleet, router = mission.fleet, args.router or mission.router.endpoint
    try:
        return asyncio.run(_stop(args.order, args.robot, fleet, router))
    except BusClosed as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_FAILED


async def _stop(order: str, wanted: list[str], fleet: str, endpoint: str) -> int:
    name = fleet if fleet != "*" else "operator"
    async with open_bus(
        endpoint, fleet=name, name="operator", daemon="argosy", stamp=time.time_ns, patience=ROUTER_PATIENCE
    ) as bus:
        robots = await bridges(bus, fleet)
        there = {robot for _, robot in robots}
        absent = [robot for robot in wanted if robot not in there]
        for robot in absent:
            known = f"; there is {', '.join(sorted(there))}" if there else ""
            print(f"{robot}: its bridge is not on the bus at {endpoint}{known}", file=sys.stderr)
        if not robots and not wanted:
            what = f"fleet `{fleet}`" if fleet != "*" else "any fleet"
            print(f"error: no robot of {what} is on the bus at {endpoint}", file=sys.stderr)
        chosen = [(its, robot) for its, robot in robots if not wanted or robot in wanted]
        outcomes = await asyncio.gather(*(order_robot(bus, its, robot, order) for its, robot in chosen))
        for (_, robot), outcome in zip(chosen, outcomes, strict=True):
            said = f" ({outcome.reason})" if outcome.reason else ""
            print(f"{robot}: {order} {'confirmed' if outcome.ok else 'NOT confirmed'}{said}", flush=True)
        confirmed = bool(outcomes) and all(outcome.ok for outcome in outcomes) and not absent
        return EXIT_DONE if confirmed else EXIT_FAILED


async def bridges(bus: Bus, fleet: str) -> list[tuple[str, str]]:
    """Return fleet and name of every robot whose bridge has a liveliness token; `*` means any fleet."""
    tokens = await bus.tokens(keys.alive(fleet, "*", "bridged", "*"))
    return sorted({(parsed[0], parsed[1]) for token in tokens if (parsed := keys.parse(token))})


async def order_robot(bus: Bus, fleet: str, robot: str, order: str) -> Outcome:
    """Give one robot an order and return what became of it."""
    told = Outcome(ok=False, reason="its bridge did not answer")
    ask = StopOrder(order=order)  # type: ignore[arg-type]
    async with aclosing(bus.query(keys.stop(fleet, robot), ask, Outcome, ANSWER_TIMEOUT)) as replies:
        async for reply in replies:
            told = reply.record or Outcome(ok=False, reason=reply.error)
    return told
