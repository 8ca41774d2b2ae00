"""`argosy plan`: plan files of ground stations, and the mission that a vehicle stores as such a file."""

from __future__ import annotations

import math
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from argosy.cli.arguments import Command
from argosy.cli.errors import BadInput, CommandError
from argosy.cli.operator_bus import Where, add_fleet_arguments, fleet_of, note, on_the_bus, put_out
from argosy.cli.vehicle_requests import ask_vehicle, check_new, write_whole
from bridged.drivers.mavlink.actions.mission_items import ABOVE_HOME, Item
from bridged.drivers.mavlink.plan_files import SUFFIXES, BadPlan, has_place, read_plan, write_plan
from commd.bus.bus import Bus
from commd.process.process import EXIT_DONE
from schemas.humanize import columns, count, printable
from schemas.wire import keys
from schemas.wire.vehicle_records import PlanItem, StoredPlan

ABOUT = "Plan files of ground stations: .plan of QGroundControl, .waypoints (QGC WPL 110) of Mission Planner."
COMMANDS = {
    "show": ("check a plan file of QGroundControl or Mission Planner and list its items", "survey.plan"),
    "save": ("save the mission that a running robot's vehicle stores", "uav1 flown.waypoints"),
}


def load(name: str) -> Command:
    """Return what declares the arguments of a command, and what runs it."""
    return {"show": (add_show_arguments, show_plan), "save": (add_save_arguments, save_plan)}[name]


def add_show_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy plan show`."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a .plan or .waypoints file")


def add_save_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy plan save`."""
    parser.add_argument("robot", help="a running robot")
    parser.add_argument("file", type=Path, metavar="FILE", help="file to write, *.plan or *.waypoints")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")
    add_fleet_arguments(parser, "the robot's fleet (default: whichever has the robot)")


def show_plan(args: Namespace) -> int:
    """List the items of a plan file. Raises BadInput for one that `upload_plan` would refuse."""
    try:
        plan = read_plan(args.file)
    except BadPlan as error:
        raise BadInput(str(error)) from None
    put_out(f"{args.file}: {summary(plan.items)}")
    put_out(
        "\n".join(map(printable, columns([_HEAD, *map(_row, range(1, len(plan.items) + 1), plan.items)], {0, 2, 3})))
    )
    for items, what in ((plan.fence, "fence"), (plan.rally, "rally points")):
        if items:
            put_out(f"{what}: {count(len(items), 'item')}")
    if plan.remark:
        note(f"{args.file}: {plan.remark}")
    return EXIT_DONE


_HEAD = ("item", "command", "latitude", "longitude", "altitude", "parameters")


def _row(seq: int, item: Item) -> tuple[str, ...]:
    parameters = [f"{value:g}" if math.isfinite(value) else "-" for value in item.parameters]
    while parameters and parameters[-1] in ("0", "-"):
        parameters.pop()
    place = ("", "", "")
    if has_place(item.command, item.frame) and (item.x or item.y or item.z):
        above = "home" if item.frame in ABOVE_HOME else "terrain" if item.above_terrain else "sea"
        place = (f"{item.x / 1e7:.7f}", f"{item.y / 1e7:.7f}", f"{item.z:g} m above {above}")
    return (str(seq), item.name, *place, " ".join(parameters))


def summary(items: Sequence[Item]) -> str:
    """Return the number of items and the length of the way between their places: `3 items, 58 m between them`."""
    places = [item.place for item in items if item.placed]
    way = sum(one.distance(other) for one, other in pairwise(places))
    length = f", {way:.0f} m from the first place to the last" if len(places) > 1 else ""
    return f"{count(len(items), 'item')}{length}"


def save_plan(args: Namespace) -> int:
    """Save the mission of a vehicle. Returns 0 if the file is written."""
    kind = args.file.suffix
    if kind not in SUFFIXES:
        raise BadInput(f"{args.file}: expected a file name {' or '.join(f'*{one}' for one in SUFFIXES)}")
    check_new(args.file, args.force)

    async def save(bus: Bus, where: Where) -> int:
        fleet = await fleet_of(bus, where, args.robot)
        stored = await ask_vehicle(bus, keys.stored_plan(fleet, args.robot), None, StoredPlan, args.robot, "items")
        if stored.problem:
            raise CommandError(f"{args.robot}: {stored.problem}")
        items = tuple(map(_item, stored.items))
        if len(items) < 2:
            raise CommandError(f"{args.robot}: the vehicle stores no mission")
        text = write_plan(items, "plan" if kind == ".plan" else "waypoints", stored.autopilot, stored.vehicle)
        write_whole(args.file, text)
        put_out(f"{args.file}: {summary(items[1:])}")
        return EXIT_DONE

    return on_the_bus(args, save)


def _item(stored: PlanItem) -> Item:
    one, two, three, four = (math.nan if value is None else value for value in stored.parameters)
    return Item(
        stored.command, stored.frame, (one, two, three, four), stored.x, stored.y, stored.z, stored.autocontinue
    )
