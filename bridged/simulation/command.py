"""The command `bridged simulate VEHICLE`: each vehicle has a module with its own arguments."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

VEHICLES = {
    "copter": ("bridged.simulation.vehicle.command", "a copter on MAVLink"),
    "plane": ("bridged.simulation.vehicle.command", "a plane on MAVLink"),
    "rover": ("bridged.simulation.vehicle.command", "a rover on MAVLink"),
    "turtle": ("bridged.simulation.turtle.command", "a turtle on Zenoh keys, as turtlesim's"),
}
"""Vehicles that can be simulated: the module of each command, and its description."""


def add_arguments(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Declare the arguments of `bridged simulate`; only the vehicle that `argv` names is imported."""
    vehicles = parser.add_subparsers(dest="vehicle", metavar="VEHICLE", required=True, help=", ".join(VEHICLES))
    for name, (module, what) in VEHICLES.items():
        vehicle = vehicles.add_parser(name, help=what, description=f"Simulate {what}, until SIGTERM or SIGINT.")
        if name in argv[1:2]:
            import_module(module).add_arguments(vehicle)


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGTERM or SIGINT. Returns the exit code."""
    module, _ = VEHICLES[args.vehicle]
    code: int = import_module(module).run(args)
    return code


def number_in(what: str, low: float, high: float, kind: type[int | float] = float) -> Callable[[str], Any]:
    """Return a reader of an argument from `low` to `high`; `what` is its unit, for people."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"expected {what} between {low:g} and {high:g}, got {text!r}")
        if kind(value) != value:
            raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}")
        return kind(value)

    return read
