"""`argosy stop`: order robots from any terminal that reaches the router; the order overrides every agent."""

from __future__ import annotations

import asyncio
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import Final, get_args

from argosy.cli.errors import CommandError
from argosy.cli.operator_bus import Where, add_fleet_arguments, bridges, note_unreached, on_the_bus
from commd.bus.bus import Bus
from commd.bus.errors import BusError, QueryTimeout
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.findings import did_you_mean
from schemas.humanize import printable
from schemas.mission.model import load_mission
from schemas.wire import keys
from schemas.wire.records import OperatorOrder, Outcome, StopOrder

ANSWER_TIMEOUT = 15.0
"""Wall seconds for a bridge to see its vehicle confirm the order; the bridge itself gives up after 10 s."""

ORDERS: tuple[OperatorOrder, ...] = get_args(OperatorOrder)
HELP = (
    "`hold`, `land` and `rtl` fail every action and refuse new ones until `release`; "
    "`pause` holds the robot and suspends its actions until `continue`"
)
UNANSWERED: Final = Outcome(ok=False, reason="its bridge did not answer: it may still carry out the order")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy stop`."""
    words = f"{{{','.join(ORDERS)}}}"
    parser.add_argument("order", type=_order, metavar=words, help=HELP)
    parser.add_argument(
        "robot",
        nargs="*",
        default=[],
        help="robots to order (default: all of the mission, and all with a running bridge)",
    )
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")


def _order(word: str) -> str:
    if word not in ORDERS:
        raise ArgumentTypeError(f"there is no order `{word}`{did_you_mean(word, ORDERS)}")
    return word


def run(args: Namespace) -> int:
    """Send the order and print each outcome. Returns 0 only if every robot has confirmed."""

    there = False

    async def stop(bus: Bus, where: Where) -> int:
        nonlocal there
        there = True
        return await _stop(bus, where, args.order, args.robot)

    try:
        return on_the_bus(args, stop)
    except CommandError:
        for robot in args.robot or load_mission(args.mission).robots if args.mission and not there else ():
            print(f"{robot}: {args.order} NOT confirmed (no router was reached)")
        raise


async def _stop(bus: Bus, where: Where, order: str, wanted: list[str]) -> int:
    """Order the mission's robots immediately, visible or not, then others with a running bridge."""
    looking = asyncio.create_task(bridges(bus, where.fleet))

    async def stopped(fleet: str, robot: str) -> bool:
        outcome = await order_robot(bus, fleet, robot, order)
        reason = outcome.reason
        if outcome is UNANSWERED and robot not in {its for _, its in await looking}:
            reason = f"its bridge is not on the bus at {where.router}"
        why = f" ({printable(reason)})" if reason else ""
        print(f"{robot}: {order} {'confirmed' if outcome.ok else 'NOT confirmed'}{why}", flush=True)
        return outcome.ok

    named = where.mission.robots if where.mission is not None else ()
    known = [robot for robot in named if not wanted or robot in wanted]
    orders = [asyncio.create_task(stopped(where.fleet, robot)) for robot in known]
    absent: list[str] = []
    try:
        if not wanted or set(wanted) - set(known):  # else nobody is to wait for boards that are nothing to them
            there = await looking
            orders += [
                asyncio.create_task(stopped(fleet, robot))
                for fleet, robot in there
                if robot not in known and (not wanted or robot in wanted)
            ]
            absent = _absent(where, wanted, known, [robot for _, robot in there])
            await note_unreached(bus)
        confirmed = all(await asyncio.gather(*orders))
    finally:
        for task in (looking, *orders):
            task.cancel()
        await asyncio.gather(looking, *orders, return_exceptions=True)
    return EXIT_DONE if orders and confirmed and not absent else EXIT_FAILED


def _absent(where: Where, wanted: list[str], known: list[str], there: list[str]) -> list[str]:
    """Print and return the wanted robots that are unknown; print an error if there is no robot at all."""
    absent = [robot for robot in wanted if robot not in (*known, *there)]
    for robot in absent:
        others = f"; there is {', '.join(sorted(set(there)))}" if there else ""
        print(f"{robot}: its bridge is not on the bus at {where.router}{others}", file=sys.stderr)
    if not (there or known or wanted):
        why = f"no bridge of {where.whose} is on the bus at {where.router}: nothing was ordered"
        print(f"error: {why}; if a robot moves, its pilot must take over", file=sys.stderr)
    return absent


async def order_robot(bus: Bus, fleet: str, robot: str, order: str) -> Outcome:
    """Send an order to one robot and return its outcome."""
    ask = StopOrder(order=order)  # type: ignore[arg-type]
    try:
        return await bus.ask_one(keys.stop(fleet, robot), ask, Outcome, ANSWER_TIMEOUT)
    except QueryTimeout:
        return UNANSWERED
    except BusError as error:  # the others have their orders, and their outcomes are to be shown
        return Outcome(ok=False, reason=str(error))
