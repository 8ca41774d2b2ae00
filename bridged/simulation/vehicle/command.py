"""The commands `bridged simulate copter`, `plane` and `rover`."""

import argparse
import asyncio
import math
import signal
import sys
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bridged.simulation.command import number_in
from bridged.simulation.vehicle.autopilot import CHARGE_S
from bridged.simulation.vehicle.geodesy import Place
from schemas.files.units import check_endpoint
from schemas.mission.model import DEFAULT_ROUTER

if TYPE_CHECKING:
    from bridged.simulation.vehicle.fault_injection import Faults
    from bridged.simulation.vehicle.vehicle import Vehicle
    from bridged.simulation.vehicle.world import Victim

HOME = "-27.604033,-48.518363,21"
"""Default home: the field of the paper's experiments."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `bridged simulate copter`, `plane` and `rover`."""
    parser.add_argument(
        "--autopilot",
        default="ardupilot",
        choices=["ardupilot", "px4"],
        help="the autopilot that it behaves as (default ardupilot)",
    )
    parser.add_argument(
        "--link",
        required=True,
        action="append",
        metavar="LINK",
        help="where it speaks MAVLink 2: udpout:HOST:PORT, udpin:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or "
        "serial:DEVICE:BAUD; once more for each further link, such as the one of a pilot's ground station",
    )
    parser.add_argument(
        "--home",
        default=HOME,
        type=_place,
        metavar="LAT,LON,ALT",
        help=f"its home: degrees, degrees, metres above mean sea level (default {HOME})",
    )
    parser.add_argument(
        "--heading",
        default=0.0,
        type=number_in("degrees", 0, 360),
        metavar="DEG",
        help="its heading in degrees (default 0)",
    )
    parser.add_argument(
        "--sysid",
        default=1,
        type=number_in("a system id", 1, 255, int),
        metavar="N",
        help="its MAVLink system id (default 1)",
    )
    parser.add_argument(
        "--speed",
        default=1.0,
        type=number_in("a factor", 0.1, 100),
        metavar="X",
        help="simulated seconds per wall second (default 1)",
    )
    parser.add_argument(
        "--boot",
        default="quick",
        choices=["quick", "real"],
        help="quick: ready after 3 s; real: after as long as the recorded vehicle, an ArduCopter 41 s (default quick)",
    )
    parser.add_argument(
        "--param",
        default=[],
        action="append",
        type=_parameter,
        metavar="NAME=VALUE",
        help="a parameter of the autopilot, such as FS_GCS_ENABLE=1; repeatable",
    )
    parser.add_argument(
        "--battery-minutes",
        type=number_in("minutes", 0.1, 10_000),
        metavar="M",
        help="minutes a full battery lasts in the air, with falling voltage (default: 12.6 V throughout, as recorded)",
    )
    parser.add_argument(
        "--recharge-seconds",
        default=CHARGE_S,
        type=number_in("seconds", 1, 100_000),
        metavar="S",
        help=f"seconds in which an empty battery is charged, at home with the motors off (default {CHARGE_S:g})",
    )
    parser.add_argument(
        "--servo-log", type=Path, metavar="FILE", help="log of its servo outputs with time and place, as JSON lines"
    )
    parser.add_argument(
        "--victims",
        type=_victims,
        metavar="N,SEED,SOUTH,WEST,NORTH,EAST",
        help="number and seed of victims in the water, and their area",
    )
    parser.add_argument(
        "--camera",
        type=number_in("metres", 0.1, 10_000),
        metavar="M",
        help="range of its camera, in metres over ground",
    )
    parser.add_argument(
        "--camera-key",
        default="camera/victim",
        metavar="KEY",
        help="the key on which its camera publishes them (camera/victim)",
    )
    parser.add_argument(
        "--router", default=DEFAULT_ROUTER, type=_endpoint, metavar="ENDPOINT", help="the router that its camera is on"
    )
    parser.add_argument(
        "--signing-passphrase-file",
        type=Path,
        metavar="FILE",
        help="sign its packets, and accept only packets signed with the passphrase in the first line of FILE",
    )
    parser.add_argument(
        "--fault",
        default=[],
        action="append",
        metavar="FAULT[,...]",
        help="what is wrong with it and its links: loss=SHARE, duplicate=SHARE, reorder=SHARE, garbage=SHARE, "
        "mute-acks, lie, cut=AT+SECONDS, reboot=AT, wind=SPEED:FROM[:GUST], gps-loss=AT+SECONDS, "
        "gps-jump=AT+SECONDS:METRES, pilot=AT+SECONDS[:lands], camera=SHARE, prearm=[UNTIL:]TEXT, autopilot=N, seed=N; "
        "repeatable",
    )


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGTERM or SIGINT. Returns the exit code: 2 if a link cannot be opened or an argument is wrong."""
    if (args.camera is None) != (args.victims is None):
        print("bridged simulate: error: a camera needs --victims, and victims need a --camera", file=sys.stderr)
        return 2

    async def main() -> None:
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        await simulation(args, stop)

    try:
        asyncio.run(main())
    except OSError as error:
        where = f"--servo-log {error.filename}: {error.strerror}" if error.filename else error
        print(f"bridged simulate: error: {where}", file=sys.stderr)
        return 2
    except ValueError as error:
        print(f"bridged simulate: error: {error}", file=sys.stderr)
        return 2
    return 0


async def simulation(args: argparse.Namespace, stop: asyncio.Event) -> None:
    """Simulate until `stop` is set. Raises OSError (a link or the servo log) and ValueError (an argument)."""
    from bridged.drivers.mavlink.transport.address import LinkAddress
    from bridged.drivers.mavlink.transport.signing import read_key
    from bridged.simulation.vehicle.fault_injection import Faults
    from bridged.simulation.vehicle.kinds import KINDS
    from bridged.simulation.vehicle.process import simulate
    from bridged.simulation.vehicle.vehicle import Vehicle
    from bridged.simulation.vehicle.world import ServoLog

    home: Place = args.home
    addresses = [LinkAddress.parse(link) for link in args.link]
    faults = Faults.parse(args.fault)
    kind = KINDS[args.vehicle, args.autopilot]
    vehicle = Vehicle(
        home,
        kind,
        system=args.sysid,
        heading=math.radians(args.heading),
        boot=args.boot,
        channels=len(addresses),
        faults=faults,
        key=read_key(args.signing_passphrase_file) if args.signing_passphrase_file else None,
        parameters=(kind.battery(args.battery_minutes) if args.battery_minutes else []) + args.param,
        charge_time=args.recharge_seconds,
    )
    if args.servo_log is not None:
        log = ServoLog(args.servo_log)
        vehicle.on_servo = lambda output, pulse: log.moved(
            vehicle.autopilot, vehicle.system, vehicle.age, output, pulse
        )
    started = (
        f"simulated {kind.name} {args.sysid} on {' and '.join(map(str, addresses))}, "
        f"home {home.lat:.6f} {home.lon:.6f} {home.alt:g} m, speed {args.speed:g}"
    )

    def announce() -> None:
        print(started, file=sys.stderr, flush=True)

    beside = _camera(args, vehicle, faults) if args.camera is not None else None
    await simulate(vehicle, addresses, args.speed, stop, announce, faults, beside)


def _camera(
    args: argparse.Namespace, vehicle: "Vehicle", faults: "Faults"
) -> "Callable[[asyncio.Event], Coroutine[Any, Any, None]]":
    """Attach the camera to the vehicle; returns the coroutine function that publishes its sightings."""
    from bridged.simulation.vehicle.camera import Camera, publish_sightings
    from commd.bus.errors import BusClosed

    camera = Camera(args.victims, args.camera, faults.camera, faults.seed)
    vehicle.on_step = lambda: camera.look(lambda: vehicle.autopilot.true_place, vehicle.age, time.monotonic())

    async def publish(stop: asyncio.Event) -> None:
        with suppress(BusClosed):  # it was to end before the router was there
            await publish_sightings(camera, args.router, args.camera_key, stop)

    return publish


def _victims(text: str) -> "list[Victim]":
    from bridged.simulation.vehicle.world import Area, victims_of

    try:
        number, seed, *borders = text.split(",")
        count, dice = int(number), int(seed)
        south, west, north, east = map(float, borders)
    except ValueError:
        problem = f"expected N,SEED,SOUTH,WEST,NORTH,EAST: two whole numbers and four in degrees, got {text!r}"
        raise argparse.ArgumentTypeError(problem) from None
    if count < 1:
        raise argparse.ArgumentTypeError(f"expected 1 victim or more, got {count}")
    try:
        return victims_of(dice, count, Area(south, west, north, east))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _parameter(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not name or not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE such as FS_GCS_ENABLE=1, got {text!r}")
    return name, number


def _place(text: str) -> Place:
    try:
        lat, lon, alt = (float(part) for part in text.split(","))
        return Place(lat, lon, alt)
    except ValueError:
        ranges = "latitude -90 to 90, longitude -180 to 180, altitude in metres"
        problem = f"expected LAT,LON,ALT such as {HOME} ({ranges}), got {text!r}"
        raise argparse.ArgumentTypeError(problem) from None


def _endpoint(text: str) -> str:
    try:
        return check_endpoint(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
