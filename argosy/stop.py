"""`argosy stop`: an order to robots that stands above every agent, from any terminal that reaches the router."""

from __future__ import annotations

import asyncio
import sys
from argparse import ArgumentParser, Namespace
from contextlib import aclosing

from argosy.operator_bus import ANY, Where, add_fleet_arguments, bridges, on_the_bus, unreached
from commd.bus import Bus
from commd.process import EXIT_DONE, EXIT_FAILED
from schemas import keys
from schemas.records import Outcome, StopOrder

ANSWER_TIMEOUT = 15.0
"""Wall seconds that a bridge has to see the order confirmed by its vehicle; it gives up after 10 s itself."""

UNANSWERED = "its bridge did not answer"


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy stop`."""
    orders = ("hold", "land", "rtl", "release")
    parser.add_argument(
        "order", choices=orders, metavar=f"{{{','.join(orders)}}}", help="`release` lets the agents act again"
    )
    parser.add_argument(
        "robot",
        nargs="*",
        default=[],
        help="robots (default: all of the mission, and every robot whose bridge is there)",
    )
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")


def run(args: Namespace) -> int:
    """Send the order and print what became of it. Returns 0 only if every robot confirmed."""

    async def stop(bus: Bus, where: Where) -> int:
        return await _stop(bus, where, args.order, args.robot)

    return on_the_bus(args, stop)


async def _stop(bus: Bus, where: Where, order: str, wanted: list[str]) -> int:
    """Order the mission's robots whether they are seen or not, and at once; then others whose bridges are there."""
    known = [robot for robot in where.robots if not wanted or robot in wanted]
    ordered = {robot: asyncio.create_task(order_robot(bus, where.fleet, robot, order)) for robot in known}
    try:
        return await _told(bus, where, order, wanted, ordered)
    finally:
        for task in ordered.values():
            task.cancel()


async def _told(
    bus: Bus, where: Where, order: str, wanted: list[str], ordered: dict[str, asyncio.Task[Outcome]]
) -> int:
    robots = await bridges(bus, where.fleet)
    there = {robot for _, robot in robots}
    absent = [robot for robot in wanted if robot not in there and robot not in ordered]
    for robot in absent:
        known = f"; there is {', '.join(sorted(there))}" if there else ""
        print(f"{robot}: its bridge is not on the bus at {where.router}{known}", file=sys.stderr)
    if not robots and not ordered and not wanted:
        what = f"fleet `{where.fleet}`" if where.fleet != ANY else "any fleet"
        print(f"error: no robot of {what} is on the bus at {where.router}", file=sys.stderr)
    others = [(its, robot) for its, robot in robots if robot not in ordered and (not wanted or robot in wanted)]
    orders = [*ordered.values(), *(order_robot(bus, its, robot, order) for its, robot in others)]
    outcomes = await asyncio.gather(*orders)
    for robot, outcome in zip((*ordered, *(robot for _, robot in others)), outcomes, strict=True):
        reason = outcome.reason
        if reason == UNANSWERED and robot not in there:
            reason = f"its bridge is not on the bus at {where.router}"
        said = f" ({reason})" if reason else ""
        print(f"{robot}: {order} {'confirmed' if outcome.ok else 'NOT confirmed'}{said}", flush=True)
    for line in await unreached(bus):
        print(f"note: {line}", file=sys.stderr)
    confirmed = bool(outcomes) and all(outcome.ok for outcome in outcomes) and not absent
    return EXIT_DONE if confirmed else EXIT_FAILED


async def order_robot(bus: Bus, fleet: str, robot: str, order: str) -> Outcome:
    """Give one robot an order and return what became of it."""
    told = Outcome(ok=False, reason=UNANSWERED)
    ask = StopOrder(order=order)  # type: ignore[arg-type]
    async with aclosing(bus.query(keys.stop(fleet, robot), ask, Outcome, ANSWER_TIMEOUT)) as replies:
        async for reply in replies:
            told = reply.record or Outcome(ok=False, reason=reply.error)
    return told
