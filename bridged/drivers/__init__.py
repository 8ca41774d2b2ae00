"""Drivers: how the bridge talks to robots.

A driver is a module with the functions of `bridged.drivers.api.DriverKind`. Ours stand in the table below; others are
found by the entry points of `argosy.drivers` (docs/guides/drivers.md). Only those that a manifest names are imported.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib import import_module
from typing import cast

from bridged.drivers.api import DriverKind, Order
from bridged.drivers.argument_check import order_problems
from bridged.drivers.registry import load
from schemas.files.findings import Finding
from schemas.manifest.loader import Manifest
from schemas.mission.model import Robot

OURS = {
    "mavlink": "bridged.drivers.mavlink.registration",
    "zenoh": "bridged.drivers.zenoh.registration",
    "python": "bridged.drivers.python.registration",
}
GROUP = "argosy.drivers"


class NoDriver(ValueError):
    """There is no driver of a name, or it cannot be loaded; in words."""


@cache
def find_driver(name: str) -> DriverKind:
    """Import a driver. Raises NoDriver."""
    if name in OURS:
        return cast(DriverKind, import_module(OURS[name]))
    from importlib.metadata import entry_points  # takes longer than most missions need to be read

    found = entry_points(group=GROUP)
    for entry in found.select(name=name):
        origin = "" if entry.dist is None else f" of {entry.dist.name} {entry.dist.version}"
        try:
            kind = load(entry)
        except (Exception, SystemExit) as error:  # whatever a package does when it is imported
            raise NoDriver(f"driver `{name}`{origin} cannot be loaded: {type(error).__name__}: {error}") from None
        lacking = [
            one for one in ("check_manifest", "check_robot", "make_driver") if not callable(getattr(kind, one, 0))
        ]
        if lacking:
            raise NoDriver(f"driver `{name}`{origin} has no {', '.join(lacking)}")
        return cast(DriverKind, kind)
    known = ", ".join([*OURS, *sorted({entry.name for entry in found})])
    raise NoDriver(f"no driver `{name}`, there is {known}")


def check_manifest(manifest: Manifest) -> list[Finding]:
    """Say what the drivers do not know in a manifest, and which orders it has no action for, each at its line."""
    return [*order_problems(manifest), *_problems(manifest)]


def check_robot(manifest: Manifest, robot: Robot) -> list[tuple[str, str]]:
    """Say what the drivers miss in what the mission says of a robot: the field and the problem."""
    problems: list[tuple[str, str]] = []
    for name in manifest.drivers():
        try:
            problems += find_driver(name).check_robot(robot)
        except NoDriver:
            continue  # told with the manifest
    return problems


def orders_of(manifest: Manifest) -> frozenset[Order] | None:
    """Return the orders that a robot has, by its driver or its manifest; None if its driver does not say."""
    try:
        own: frozenset[Order] | None = getattr(find_driver(manifest.robot.driver), "ORDERS", None)
    except NoDriver:
        return None
    return None if own is None else own | frozenset(manifest.orders)


def _problems(manifest: Manifest) -> Iterator[Finding]:
    for name in manifest.drivers():
        try:
            kind = find_driver(name)
        except NoDriver as error:
            where = _where_named(manifest, name)
            yield manifest.finding(f"{'.'.join(where)}: {error}", *where)
            continue
        yield from kind.check_manifest(manifest.part(name))


def _where_named(manifest: Manifest, driver: str) -> tuple[str, ...]:
    if manifest.robot.driver == driver:
        return ("robot", "driver")
    for table, entries in (("percepts", manifest.percepts), ("actions", manifest.actions)):
        for name, entry in entries.items():
            if entry.driver == driver:
                return (table, name, "driver")
    return ()
