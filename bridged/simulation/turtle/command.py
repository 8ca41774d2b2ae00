"""The command `bridged simulate turtle`."""

from __future__ import annotations

import argparse
import asyncio
import sys
from pathlib import Path

from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE, add_router_argument, run_daemon
from schemas.mission.model import DEFAULT_ROUTER


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what `bridged simulate turtle` understands."""
    add_router_argument(parser)
    parser.add_argument("--name", default="turtle1", help="the first part of its keys (default turtle1)")
    parser.add_argument("--prefix", default="", help="what stands before the name, as `prefix` of a mission's robot")
    parser.add_argument("--speed", default=1.0, type=_speed, metavar="X", help="times real time (default 1)")
    parser.add_argument("--draw", type=Path, metavar="FILE", help="write what it has drawn as SVG at the end")


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGTERM or SIGINT. Returns the exit code: 2 for names that are no keys."""
    from bridged.drivers.zenoh.manifest_validation import key_problem
    from bridged.simulation.turtle.process import simulate
    from bridged.simulation.turtle.turtle import Turtle, svg

    prefix = "/".join(part for part in (args.prefix, args.name) if part)
    if problem := key_problem(prefix):
        print(f"bridged simulate: error: {problem}", file=sys.stderr)
        return EXIT_BAD_INPUT
    endpoint, turtle = args.router or DEFAULT_ROUTER, Turtle()
    said = f"simulated turtle on {prefix}/*, router {endpoint}, speed {args.speed:g}"

    async def main(stop: asyncio.Event) -> int:
        def started() -> None:
            print(said, file=sys.stderr, flush=True)

        await simulate(turtle, endpoint, f"{prefix}/", args.speed, stop, started)
        return EXIT_DONE

    code = run_daemon("turtle", main)
    if args.draw is not None:
        try:
            args.draw.write_text(svg(turtle))
        except OSError as error:
            print(f"bridged simulate: error: cannot write {args.draw}: {error.strerror}", file=sys.stderr)
            return EXIT_BAD_INPUT
    return code


def _speed(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.1 <= value <= 100:
        raise argparse.ArgumentTypeError(f"expected a factor between 0.1 and 100, got {text!r}")
    return value
