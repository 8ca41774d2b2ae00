"""The command `bridged simulate turtle`."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from bridged.simulation.command import number_in
from bridged.simulation.turtle.turtle import STEP, Pen, Turtle, svg
from commd.bus.bus import open_bus
from commd.bus.raw import RawBus, Sample
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE, add_router_argument, run_daemon
from commd.process.state_dir import write_output
from schemas.mission.model import DEFAULT_ROUTER

CATCH_UP = 1.0
"""Wall seconds that are caught up after a stop of the process; the rest is skipped."""
JSON = "application/json"
Colour = Annotated[int, Meta(ge=0, le=255)]
Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
log = logging.getLogger("turtle")


class Vector(msgspec.Struct):
    """Of geometry_msgs."""

    x: Number = 0.0
    y: Number = 0.0
    z: Number = 0.0


class Twist(msgspec.Struct):
    """Of geometry_msgs: payload of `cmd_vel`."""

    linear: Vector = msgspec.field(default_factory=Vector)
    angular: Vector = msgspec.field(default_factory=Vector)


class SetPen(msgspec.Struct):
    """Request of `set_pen`. As in ROS, a missing field is zero, here and in the other messages."""

    r: Colour = 0
    g: Colour = 0
    b: Colour = 0
    width: Annotated[int, Meta(ge=0, le=255)] = 0
    off: bool = False


class TeleportAbsolute(msgspec.Struct):
    """Request of `teleport_absolute`: metres, radians."""

    x: Number = 0.0
    y: Number = 0.0
    theta: Number = 0.0


class TeleportRelative(msgspec.Struct):
    """Request of `teleport_relative`: metres ahead, after a turn by radians to the left."""

    linear: Number = 0.0
    angular: Number = 0.0


class Nothing(msgspec.Struct):
    """Request of `clear` and `reset`."""


class TurtleKeys:
    """A turtle on the bus: publishes `pose`, subscribes to `cmd_vel`, serves the rest."""

    def __init__(self, turtle: Turtle, raw: RawBus, prefix: str) -> None:
        """`prefix` comes before each key, such as `turtle1/`."""
        self.turtle = turtle
        self.unreadable = 0
        """Unreadable `cmd_vel` samples."""
        self._pose = raw.publisher(f"{prefix}pose")
        raw.subscribe(f"{prefix}cmd_vel", self._drive)
        services: dict[str, tuple[type[msgspec.Struct], Callable[[Any], None]]] = {
            "set_pen": (SetPen, self._set_pen),
            "teleport_absolute": (TeleportAbsolute, lambda to: turtle.teleport(to.x, to.y, to.theta)),
            "teleport_relative": (TeleportRelative, lambda to: turtle.teleport_by(to.linear, to.angular)),
            "clear": (Nothing, lambda _: turtle.clear()),
            "reset": (Nothing, lambda _: turtle.reset()),
        }
        for name, (request, work) in services.items():
            raw.serve(f"{prefix}{name}", partial(_serve, request, work))

    def publish(self) -> None:
        """Publish the pose."""
        self._pose.put(msgspec.json.encode(self.turtle.pose()), JSON)

    def _drive(self, sample: Sample) -> None:
        try:
            twist = msgspec.json.decode(sample.payload, type=Twist, strict=False)
        except (msgspec.DecodeError, RecursionError) as error:
            self.unreadable += 1
            if self.unreadable <= 10:
                log.warning("%s: %s", sample.key, error)
            return
        self.turtle.command(twist.linear.x, twist.linear.y, twist.angular.z)

    def _set_pen(self, pen: SetPen) -> None:
        self.turtle.pen = Pen(pen.r, pen.g, pen.b, pen.width, pen.off)


def _serve(request: type[msgspec.Struct], work: Callable[[Any], None], query: Sample) -> Sample:
    answer: dict[str, object] = {"success": True}
    try:
        work(msgspec.json.decode(query.payload or b"{}", type=request, strict=False))
    except (ValueError, RecursionError) as error:  # msgspec's are ValueErrors too
        answer = {"success": False, "message": str(error)}
    return Sample(query.key, msgspec.json.encode(answer), JSON)


async def simulate(
    turtle: Turtle,
    endpoint: str,
    prefix: str,
    speed: float,
    stop: asyncio.Event,
    started: Callable[[], None] = lambda: None,
) -> None:
    """Be a turtle until `stop` is set, at `speed` times real time; poses come at 62.5 Hz at most.

    `started` is called when its keys are there. Raises BusClosed if the router does not come before the stop.
    """
    async with open_bus(endpoint, fleet="simulation", name=prefix.strip("/"), daemon="turtle", stop=stop) as bus:
        keys = TurtleKeys(turtle, bus.raw, prefix)
        started()
        loop = asyncio.get_running_loop()
        seen, owed = loop.time(), 0.0
        while not stop.is_set():
            now = loop.time()
            owed += min(now - seen, CATCH_UP) * speed
            seen = now
            while owed >= STEP:
                turtle.step()
                owed -= STEP
            keys.publish()
            await asyncio.sleep(max(0.0, STEP - (loop.time() - now)))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bridged simulate turtle`."""
    add_router_argument(parser)
    parser.add_argument("--name", default="turtle1", help="the first part of its keys (default turtle1)")
    parser.add_argument("--prefix", default="", help="prefix of its keys, as `prefix` of a mission's robot")
    parser.add_argument(
        "--speed",
        default=1.0,
        type=number_in("a factor", 0.1, 100),
        metavar="X",
        help="simulated seconds per wall second (default 1)",
    )
    parser.add_argument("--draw", type=Path, metavar="FILE", help="write its drawing as SVG at the end")


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGTERM or SIGINT. Returns the exit code: 2 for names that are no keys."""
    from bridged.drivers.zenoh.registration import key_problem

    if problem := key_problem(_prefix(args)):
        print(f"bridged simulate: error: {problem}", file=sys.stderr)
        return EXIT_BAD_INPUT

    async def main(stop: asyncio.Event) -> int:
        turtle = await simulation(args, stop)
        if args.draw is not None:
            try:
                write_output(args.draw, svg(turtle).encode())
            except OSError as error:
                print(f"bridged simulate: error: cannot write {args.draw}: {error.strerror}", file=sys.stderr)
                return EXIT_BAD_INPUT
        return EXIT_DONE

    return run_daemon("turtle", main)


async def simulation(args: argparse.Namespace, stop: asyncio.Event) -> Turtle:
    """Simulate a turtle until `stop` is set. Returns it; raises BusClosed if the router does not come before that."""
    turtle, endpoint, prefix = Turtle(), args.router or DEFAULT_ROUTER, _prefix(args)
    line = f"simulated turtle on {prefix}/*, router {endpoint}, speed {args.speed:g}"

    def announce() -> None:
        print(line, file=sys.stderr, flush=True)

    await simulate(turtle, endpoint, f"{prefix}/", args.speed, stop, announce)
    return turtle


def _prefix(args: argparse.Namespace) -> str:
    """Return the first chunks of its keys."""
    return "/".join(part for part in (args.prefix, args.name) if part)
