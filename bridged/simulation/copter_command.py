"""The command `bridged simulate copter`."""

import argparse
import asyncio
import math
import sys

from bridged.simulation.geo import Place

HOME = "-27.604033,-48.518363,21"
"""Where a simulated copter stands if nothing else is said: the field of the paper's experiments."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares what `bridged simulate copter` understands."""
    parser.add_argument(
        "--link",
        required=True,
        metavar="LINK",
        help="where it speaks MAVLink 2: udpout:HOST:PORT, udpin:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or "
        "serial:DEVICE:BAUD",
    )
    parser.add_argument(
        "--home",
        default=HOME,
        type=_place,
        metavar="LAT,LON,ALT",
        help=f"where it stands: degrees, degrees, metres above mean sea level (default {HOME})",
    )
    parser.add_argument(
        "--heading", default=0.0, type=_heading, metavar="DEG", help="where its nose points (default 0)"
    )
    parser.add_argument("--sysid", default=1, type=_sysid, metavar="N", help="its MAVLink system id (default 1)")
    parser.add_argument("--speed", default=1.0, type=_speed, metavar="X", help="times real time (default 1)")
    parser.add_argument(
        "--boot",
        default="quick",
        choices=["quick", "real"],
        help="quick: ready to fly after 3 s; real: after 41 s, as a real ArduCopter (default quick)",
    )


def run(args: argparse.Namespace) -> int:
    """Simulates until SIGTERM or SIGINT: exit code 0, or 2 if the link cannot be opened."""
    from bridged.drivers.mavlink.address import LinkAddress, LinkAddressError
    from bridged.drivers.mavlink.link import LinkError
    from bridged.simulation.process import simulate
    from bridged.simulation.vehicle import Vehicle

    home: Place = args.home
    vehicle = Vehicle(home, system=args.sysid, heading=math.radians(args.heading), boot=args.boot)
    try:
        address = LinkAddress.parse(args.link)
        started = (
            f"simulated copter {args.sysid} on {address}, home {home.lat:.6f} {home.lon:.6f} {home.alt:g} m, "
            f"speed {args.speed:g}"
        )
        asyncio.run(simulate(vehicle, address, args.speed, started=lambda: print(started, file=sys.stderr, flush=True)))
    except (LinkAddressError, LinkError) as error:
        print(f"bridged simulate: error: {error}", file=sys.stderr)
        return 2
    return 0


def _place(text: str) -> Place:
    try:
        lat, lon, alt = (float(part) for part in text.split(","))
        return Place(lat, lon, alt)
    except ValueError:
        problem = f"expected LAT,LON,ALT such as {HOME}, got {text!r}"
        raise argparse.ArgumentTypeError(problem) from None


def _within(text: str, low: float, high: float, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"expected {what} between {low:g} and {high:g}, got {text!r}")
    return value


def _speed(text: str) -> float:
    return _within(text, 0.1, 100, "a factor")


def _heading(text: str) -> float:
    return _within(text, 0, 360, "degrees")


def _sysid(text: str) -> int:
    value = _within(text, 1, 255, "a system id")
    if value != int(value):
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}")
    return int(value)
