"""`argosy params`: the parameters of a running robot's vehicle, saved to a file, compared with one and set by one."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from pathlib import Path

from argosy.cli.arguments import Command
from argosy.cli.errors import BadInput, CommandError, complain, consent
from argosy.cli.operator_bus import Unanswered, Where, add_fleet_arguments, fleet_of, note, on_the_bus, put_out
from argosy.cli.vehicle_requests import ask_vehicle, check_new, write_whole
from argosy.params.param_files import (
    MOST_NAMED,
    Comparison,
    Difference,
    ParameterFile,
    compare,
    read_parameter_file,
    value_text,
    write_parameters,
)
from commd.bus.bus import Bus
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.findings import did_you_mean
from schemas.humanize import count, printable, some
from schemas.wire import keys
from schemas.wire.vehicle_records import ParameterRequest, VehicleParameters

ABOUT = "Parameters of the vehicle of a running robot; files of Mission Planner, MAVProxy and QGroundControl."
COMMANDS = {
    "save": ("save all parameters of a vehicle to a file", "uav1 uav1.param"),
    "diff": ("compare a vehicle's parameters with a file; exit code 1 if they differ", "uav1 uav1.param"),
    "load": (
        "set the parameters of a vehicle that differ from a file, each confirmed by the vehicle",
        "uav1 uav1.param --allow-safety FENCE_RADIUS",
    ),
}


def load(name: str) -> Command:
    """Return what declares the arguments of a command, and what runs it."""
    return {
        "save": (add_save_arguments, save_parameters),
        "diff": (add_diff_arguments, diff_parameters),
        "load": (add_load_arguments, load_parameters),
    }[name]


def _add_robot(parser: ArgumentParser, help_: str) -> None:
    parser.add_argument("robot", help="a running robot")
    parser.add_argument("file", type=Path, metavar="FILE", help=help_)
    add_fleet_arguments(parser, "the robot's fleet (default: whichever has the robot)")


def add_save_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy params save`."""
    _add_robot(parser, "file to write: a line NAME,VALUE for each parameter")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def add_diff_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy params diff`."""
    _add_robot(parser, "file of Mission Planner, MAVProxy or QGroundControl")


def add_load_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy params load`."""
    _add_robot(parser, "file of Mission Planner, MAVProxy or QGroundControl")
    parser.add_argument("--yes", action="store_true", help="set the parameters without asking")
    text = "set this parameter although the vehicle's safety depends on it; repeatable"
    parser.add_argument("--allow-safety", action="append", default=[], metavar="NAME", help=text)


def save_parameters(args: Namespace) -> int:
    """Save all parameters of a vehicle. Returns 0 if the file is written."""
    check_new(args.file, args.force)

    async def save(bus: Bus, where: Where) -> int:
        fleet = await fleet_of(bus, where, args.robot)
        values = await _read(bus, fleet, args.robot)
        head = f"parameters of {args.robot}, fleet {fleet}, {time.strftime('%Y-%m-%d %H:%M:%S %z')}"
        write_whole(args.file, write_parameters(values, [head]))
        put_out(f"{args.file}: {count(len(values), 'parameter')} of {args.robot}")
        return EXIT_DONE

    return on_the_bus(args, save)


def diff_parameters(args: Namespace) -> int:
    """Compare a vehicle's parameters with a file. Returns 0 if the vehicle has all that the file says."""
    file = _file(args)

    async def diff(bus: Bus, where: Where) -> int:
        comparison = await _compare(bus, await fleet_of(bus, where, args.robot), args.robot, file)
        return EXIT_FAILED if comparison.differences or comparison.unknown else EXIT_DONE

    return on_the_bus(args, diff)


def load_parameters(args: Namespace) -> int:
    """Set what differs from a file. Returns 0 if the vehicle then has all that the file says."""
    file = _file(args)
    for name in args.allow_safety:
        if name not in file.values:
            raise BadInput(f"--allow-safety {name}: {args.file} does not have it{did_you_mean(name, file.values)}")

    async def load(bus: Bus, where: Where) -> int:
        fleet = await fleet_of(bus, where, args.robot)
        comparison = await _compare(bus, fleet, args.robot, file)
        kept = [one for one in comparison.differences if one.safety and one.name not in args.allow_safety]
        chosen = [one for one in comparison.differences if one not in kept]
        if kept:
            allow = " ".join(f"--allow-safety {one.name}" for one in kept)
            note(f"{args.robot}: {len(kept)} not set, the vehicle's safety depends on them; to set them, add {allow}")
        if chosen and not args.yes:
            consent(f"set {count(len(chosen), 'parameter')} of {args.robot}", "nothing was set")
        unset = await _set_all(bus, fleet, args, chosen)
        return EXIT_FAILED if unset or kept or comparison.unknown else EXIT_DONE

    return on_the_bus(args, load)


def _file(args: Namespace) -> ParameterFile:
    file = read_parameter_file(args.file)
    if file.of_others:
        note(f"{args.file}: {count(file.of_others, 'parameter')} of other components than the autopilot left out")
    return file


async def _read(bus: Bus, fleet: str, robot: str) -> dict[str, float]:
    """Return all parameters of a vehicle. Raises CommandError."""
    found = await ask_vehicle(bus, keys.parameters(fleet, robot), None, VehicleParameters, robot, "parameters")
    if found.problem:
        raise CommandError(f"{robot}: {found.problem}")
    if found.left_out:
        note(f"{robot}: left out, as their values are no numbers: {some(found.left_out, MOST_NAMED)}")
    return found.values


async def _compare(bus: Bus, fleet: str, robot: str, file: ParameterFile) -> Comparison:
    comparison = compare(file.values, await _read(bus, fleet, robot))
    put_out("\n".join(map(printable, comparison.text(robot).split("\n"))))  # names come from the vehicle
    return comparison


async def _set_all(bus: Bus, fleet: str, args: Namespace, chosen: list[Difference]) -> list[str]:
    """Set parameters one after the other and print how each ended. Returns those that were not set."""
    left, done = [one.name for one in chosen], 0
    try:
        for one in chosen:
            request = ParameterRequest(name=one.name, value=one.wanted, allow_safety=one.name in args.allow_safety)
            key = keys.parameters(fleet, args.robot)
            try:
                reply = await ask_vehicle(bus, key, request, VehicleParameters, args.robot, "parameters")
            except Unanswered as lost:
                complain(f"{lost}; whether {one.name} was set is not known")
                break
            if not reply.problem:
                left.remove(one.name)
                done += 1
                put_out(f"{args.robot}: {one.name} = {value_text(one.wanted)}")
                continue
            complain(f"{args.robot}: {one.name} NOT set: {reply.problem}")
            if reply.cause in ("rights", "busy", "link"):  # it holds for all others too
                break
    finally:
        if chosen:
            rest = f"; {len(left)} not confirmed: {some(left, MOST_NAMED)}" if left else ""
            put_out(f"{args.robot}: {done} of {count(len(chosen), 'parameter')} set{rest}")
    return left
